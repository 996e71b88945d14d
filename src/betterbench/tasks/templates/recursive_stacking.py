"""Recursive Stacking: things of one kind are stacked on each other, and a stack can be a target."""

from __future__ import annotations

from betterbench.tasks.template import ObjectGroup, Template

RECURSIVE_STACKING = Template(
    name="recursive_stacking",
    title="Recursive Stacking",
    description="Put the named plate on the named plate or stack.",
    challenge="Targets that are themselves moved: what is put on something may carry the next.",
    goal=(
        "Each named plate stands in the middle of the named one, flat and touching it, at rest and let "
        "go; nothing else was put on a plate that is asked for."
    ),
    premise="The named plates stand in their slots or on another plate as the condition says.",
    groups=(
        ObjectGroup(
            "plates",
            "What is stacked and stacked upon; told apart by color.",
            ("plate", "bowl", "tray"),
            (2, 4),
            role="item",
        ),
        ObjectGroup("distractors", "What stays on the table.", ("bowl", "plate"), (0, 3), role="distractor"),
    ),
    relation="on_plate",
    exclusive=True,
    order="built",
)
