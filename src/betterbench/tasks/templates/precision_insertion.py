"""Precision Insertion: things go into holes that fit them with a few millimetres of clearance."""

from __future__ import annotations

from betterbench.tasks.template import ObjectGroup, Template

PRECISION_INSERTION = Template(
    name="precision_insertion",
    title="Precision Insertion",
    description="Put the named objects into the named holes of the rack, in any order.",
    challenge="Contact-rich alignment within 3 mm a side; collisions with the rack are counted.",
    groups=(
        ObjectGroup("rack", "What has the holes.", ("rack", "stand", "charger"), (1, 1)),
        ObjectGroup("items", "What may be asked for.", ("jar", "bottle", "plug"), (1, 6)),
        ObjectGroup("distractors", "What stays on the table.", ("jar", "bottle"), (0, 4)),
    ),
    relation="in_hole",
    exclusive=True,
)
