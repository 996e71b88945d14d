"""Interventions: look-up of the condition of a variation or a name, with its declared changes."""

from betterbench.tasks.interventions.apply import apply, vary
from betterbench.tasks.interventions.resolve import ResolvedCondition, condition_names, resolve_condition

__all__ = ["ResolvedCondition", "apply", "condition_names", "resolve_condition", "vary"]
