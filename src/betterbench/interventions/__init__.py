"""Causal interventions: pure functions ``Condition -> Condition`` that declare what they change."""

from betterbench.interventions.apply import Changes, apply, operations, vary
from betterbench.interventions import language, layout, objects

__all__ = ["Changes", "apply", "language", "layout", "objects", "operations", "vary"]
