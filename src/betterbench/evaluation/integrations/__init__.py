"""Integrations of the tasks into other evaluation harnesses."""
