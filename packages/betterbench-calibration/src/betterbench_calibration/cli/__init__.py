"""Subcommands of ``better`` that are part of this package."""
