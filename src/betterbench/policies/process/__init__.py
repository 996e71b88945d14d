"""Policies of users, loaded from a Python file, in a process of their own."""
