"""Constrained Positioning: one thing goes to an exact place on a fixture, in a given orientation."""

from __future__ import annotations

from betterbench.tasks.template import ObjectGroup, Template

CONSTRAINED_POSITIONING = Template(
    name="constrained_positioning",
    title="Constrained Positioning",
    description="Put the named object on the marked place of the fixture, aligned with it.",
    challenge="High-precision alignment with a static fixture of the environment.",
    goal="The named object stands centered on the marked place, upright, with its handle clear, at rest and let go.",
    premise="The named object stands in its slot and the marked place is free, unless there is nothing left to do.",
    groups=(
        ObjectGroup(
            "fixture", "What carries the marked place.", ("coffee machine", "scale", "charger"), (1, 1), role="fixture"
        ),
        ObjectGroup("items", "What may be asked for.", ("cup", "mug", "bowl"), (1, 4), role="item"),
        ObjectGroup("distractors", "What stays on the table.", ("kitchenware",), (0, 4), role="distractor"),
    ),
    relation="on_ring",
    exclusive=True,
    order="free",
)
