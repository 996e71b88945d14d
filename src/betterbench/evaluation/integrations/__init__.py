"""Integrations that make the tasks available in other evaluation harnesses."""
