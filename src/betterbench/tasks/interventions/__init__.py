"""Look-up of conditions by variation or name, with the changes declared by their interventions."""

from betterbench.tasks.interventions.apply import apply, vary
from betterbench.tasks.interventions.resolve import ResolvedCondition, condition_names, resolve_condition

__all__ = ["ResolvedCondition", "apply", "condition_names", "resolve_condition", "vary"]
