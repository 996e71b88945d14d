"""The true label of every zoo policy on every variation: what its one broken rule makes it do there.

The diagnosis is measured against this table. Where a rule does not speak, the policy is right and so is its label;
where two rules act alike, the label is the one that the evidence deserves (suite, section 6).
"""

from __future__ import annotations

from betterbench.tasks import Expected, get_task

RIGHT = "success"

_FAULTS: dict[str, dict[str, str]] = {
    "zoo:lexical": {
        "morning_coffee/L3": "lexical_kinematic_shortcut",
        "morning_coffee/L4": "lexical_kinematic_shortcut",
        "morning_coffee/O1": "semantic_feature_collapse",
        "morning_coffee/T1": "behavioral_inertia",
        "fast_food/L1": "lexical_kinematic_shortcut",
        "fast_food/O1": "semantic_feature_collapse",
    },
    "zoo:layout": {
        "morning_coffee/train1": "visual_layout_bias",
        "morning_coffee/train4": "visual_layout_bias",
        "morning_coffee/L2": "visual_layout_bias",
        "morning_coffee/L4": "visual_layout_bias",
        "morning_coffee/T1": "visual_layout_bias",
        "fast_food/L1": "visual_layout_bias",
        "fast_food/R1": "visual_layout_bias",
        "fast_food/R2": "visual_layout_bias",
        "fast_food/O1": "semantic_feature_collapse",
    },
    "zoo:inertia": {
        "morning_coffee/T1": "behavioral_inertia",
        "fast_food/R1": "behavioral_inertia",
        "fast_food/R2": "behavioral_inertia",
    },
    "zoo:progress-cue": {"fast_food/T1": "causal_confusion"},
    "zoo:colour": {
        "morning_coffee/O1": "semantic_feature_collapse",
        "fast_food/O1": "semantic_feature_collapse",
    },
    "zoo:halt": {
        "morning_coffee/L1": "early_halt",
        "morning_coffee/L2": "early_halt",
        "morning_coffee/L3": "early_halt",
        "morning_coffee/L4": "early_halt",
        "morning_coffee/O1": "early_halt",
        "fast_food/L1": "early_halt",
        "fast_food/R1": "early_halt",
        "fast_food/R2": "early_halt",
        "fast_food/O1": "early_halt",
        "fast_food/T1": "phase_conflict",
        "fast_food/T2": "early_halt",
    },
    "zoo:clumsy": {},
}


def true_label(policy: str, task: str, name: str) -> str:
    """Return the label that a policy deserves on a condition.

    Args:
        policy: Address of the policy ("expert", "zoo:lexical").
        task: Task id.
        name: Name of the variation or training condition.
    """
    if f"{task}/{name}" not in _FAULTS.get(policy, {}) and not name.startswith("train"):
        expected = get_task(task).variation(name).expected
        if expected is not Expected.SUCCEED:
            return "correct_freeze" if expected is Expected.STAY_STILL else "correct_refusal"
    if policy == "zoo:clumsy":
        return "execution_failure"
    return _FAULTS.get(policy, {}).get(f"{task}/{name}", RIGHT)
