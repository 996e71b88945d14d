"""Causal interventions: pure functions ``Condition -> Condition`` that declare what they change."""

from betterbench.interventions import language, layout, objects
from betterbench.interventions.apply import apply, operations, vary
from betterbench.interventions.operation import Changes
from betterbench.interventions.resolve import ResolvedCondition, condition_names, resolve_condition

__all__ = [
    "Changes",
    "ResolvedCondition",
    "apply",
    "condition_names",
    "language",
    "layout",
    "objects",
    "operations",
    "resolve_condition",
    "vary",
]
