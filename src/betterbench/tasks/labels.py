"""Outcome labels (suite, section 5). They stand below tasks and diagnosis, so that both name them as values."""

from __future__ import annotations

from enum import StrEnum


class Kind(StrEnum):
    """What sort of failure a label is."""

    NONE = "none"
    REASONING = "reasoning"
    EXECUTION = "execution"
    SYSTEM = "system"


class Label(StrEnum):
    """The one outcome of a trial (suite, section 5)."""

    SUCCESS = "success"
    CORRECT_FREEZE = "correct_freeze"
    CORRECT_REFUSAL = "correct_refusal"
    LEXICAL_KINEMATIC_SHORTCUT = "lexical_kinematic_shortcut"
    VISUAL_LAYOUT_BIAS = "visual_layout_bias"
    BEHAVIORAL_INERTIA = "behavioral_inertia"
    CAUSAL_CONFUSION = "causal_confusion"
    SEMANTIC_FEATURE_COLLAPSE = "semantic_feature_collapse"
    ORDER_VIOLATION = "order_violation"
    PHASE_CONFLICT = "phase_conflict"
    EARLY_HALT = "early_halt"
    WRONG_OBJECT = "wrong_object"
    EXECUTION_FAILURE = "execution_failure"
    TIMEOUT = "timeout"
    POLICY_ERROR = "policy_error"

    @property
    def kind(self) -> Kind:
        """What sort of failure the label is."""
        if self in (Label.SUCCESS, Label.CORRECT_FREEZE, Label.CORRECT_REFUSAL):
            return Kind.NONE
        if self in (Label.EXECUTION_FAILURE, Label.TIMEOUT):
            return Kind.EXECUTION
        return Kind.SYSTEM if self is Label.POLICY_ERROR else Kind.REASONING
