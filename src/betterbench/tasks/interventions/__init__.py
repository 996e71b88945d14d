"""Lookup of conditions by variation or by name, together with the changes that the variations declare."""

from betterbench.tasks.interventions.apply import apply, vary
from betterbench.tasks.interventions.resolve import ResolvedCondition, condition_names, resolve_condition

__all__ = ["ResolvedCondition", "apply", "condition_names", "resolve_condition", "vary"]
