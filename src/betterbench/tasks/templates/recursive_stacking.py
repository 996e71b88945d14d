"""Recursive Stacking: things of one kind are stacked on each other, and a stack can be a target."""

from __future__ import annotations

from betterbench.tasks.template import ObjectGroup, Template

RECURSIVE_STACKING = Template(
    name="recursive_stacking",
    title="Recursive Stacking",
    description="Put the named plate on the named plate or stack.",
    challenge="Targets that are themselves moved: what is put on something may carry the next.",
    groups=(
        ObjectGroup(
            "plates", "What is stacked and stacked upon; told apart by colour.", ("plate", "bowl", "tray"), (2, 4)
        ),
        ObjectGroup("distractors", "What stays on the table.", ("bowl", "plate"), (0, 3)),
    ),
    relation="on_plate",
    exclusive=True,
)
