"""Patterns: one file per template. A pattern converts a cast to a task with training conditions and variations.

A cast is a scenario with chosen assets. A pattern chooses reachable and visible slots, creates training conditions with
confounds, derives the variations that the template allows on the four axes, and lists balanced conditions. New files in
this folder are found automatically.
"""

import importlib
import pkgutil

from betterbench.generation.patterns.pattern import PATTERNS, GeneratedTask, Unbuilt, pattern, pattern_of

for _module in pkgutil.iter_modules(__path__):
    importlib.import_module(f"{__name__}.{_module.name}")

__all__ = ["PATTERNS", "GeneratedTask", "Unbuilt", "pattern", "pattern_of"]
