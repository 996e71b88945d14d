"""Interventions: from a variation, or a name, to the condition that it describes and what it declares to change."""

from betterbench.tasks.interventions.apply import apply, vary
from betterbench.tasks.interventions.resolve import ResolvedCondition, condition_names, resolve_condition

__all__ = ["ResolvedCondition", "apply", "condition_names", "resolve_condition", "vary"]
