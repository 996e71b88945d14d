"""Verbs of ``better`` that need this distribution."""
