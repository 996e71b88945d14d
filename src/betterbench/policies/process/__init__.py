"""Policies written by users, which run in a separate process."""
