"""Patterned Arrangement: things are laid around an anchor, each at its side and aligned with it."""

from __future__ import annotations

from betterbench.tasks.template import ObjectGroup, Template

PATTERNED_ARRANGEMENT = Template(
    name="patterned_arrangement",
    title="Patterned Arrangement",
    description="Put the named objects to the named sides of the anchor, in any order.",
    challenge="Relative placement: a side moves and turns with its anchor.",
    goal=(
        "Each named object stands or lies in the zone of its named side, long things along the anchor, "
        "at rest and let go; nothing else was brought to a side."
    ),
    premise="The named objects stand in their slots, and the named sides are free.",
    groups=(
        ObjectGroup(
            "anchor",
            "What the others are laid around; it offers named sides.",
            ("laptop", "plate", "tray", "placemat"),
            (1, 1),
            role="fixture",
        ),
        ObjectGroup("items", "What may be asked for.", ("desk object", "cutlery", "cup"), (2, 4), role="item"),
        ObjectGroup("distractors", "What stays where it is.", ("tableware", "desk object"), (0, 6), role="distractor"),
    ),
    relation="beside",
    exclusive=True,
    order="free",
)
