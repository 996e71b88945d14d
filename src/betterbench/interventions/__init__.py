"""Causal interventions: pure functions ``Condition -> Condition`` that declare what they change."""

from betterbench.interventions import language, layout, objects
from betterbench.interventions.apply import apply, operations, vary
from betterbench.interventions.operation import Changes

__all__ = ["Changes", "apply", "language", "layout", "objects", "operations", "vary"]
