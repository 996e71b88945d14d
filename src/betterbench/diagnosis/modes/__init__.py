"""The failure modes, one file each: from the course of an episode to the first evidence of the mode, or None."""

from betterbench.diagnosis.modes import (
    behavioral_inertia,
    causal_confusion,
    early_halt,
    execution_failure,
    lexical_kinematic_shortcut,
    order_violation,
    phase_conflict,
    policy_error,
    semantic_feature_collapse,
    timeout,
    visual_layout_bias,
    wrong_object,
)

__all__ = [
    "behavioral_inertia",
    "causal_confusion",
    "early_halt",
    "execution_failure",
    "lexical_kinematic_shortcut",
    "order_violation",
    "phase_conflict",
    "policy_error",
    "semantic_feature_collapse",
    "timeout",
    "visual_layout_bias",
    "wrong_object",
]
