"""Figures and films of scenes and records."""
