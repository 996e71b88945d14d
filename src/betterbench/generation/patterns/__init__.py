"""Patterns: one file per template, which turns a cast into a task with training conditions and variations.

A pattern chooses slots that are in reach and in view, writes the training conditions with their confounds, derives the
variations that the template allows on the four axes, and lists balanced conditions.
"""

from betterbench.generation.patterns.pattern import PATTERNS, GeneratedTask, Unbuilt, pattern, pattern_of

__all__ = ["PATTERNS", "GeneratedTask", "Unbuilt", "pattern", "pattern_of"]
