"""Precision Insertion: things go into holes that fit them with a few millimeters of clearance."""

from __future__ import annotations

from betterbench.tasks.template import ObjectGroup, Template

PRECISION_INSERTION = Template(
    name="precision_insertion",
    title="Precision Insertion",
    description="Put the named objects into the named holes of the rack, in any order.",
    challenge="Contact-rich alignment within 3 mm a side; collisions with the rack are counted.",
    goal=(
        "Each named object stands on the floor of its named hole, upright, at rest and let go; nothing "
        "else was put into a hole."
    ),
    premise="The named objects stand in their slots and their holes are free.",
    groups=(
        ObjectGroup("rack", "What has the holes.", ("rack", "stand", "charger"), (1, 1), role="fixture"),
        ObjectGroup("items", "What may be asked for.", ("jar", "bottle", "plug"), (1, 6), role="item"),
        ObjectGroup("distractors", "What stays on the table.", ("jar", "bottle"), (0, 4), role="distractor"),
    ),
    relation="in_hole",
    exclusive=True,
    order="free",
)
