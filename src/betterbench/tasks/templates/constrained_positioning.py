"""Constrained Positioning: one thing goes to an exact place on a fixture, in a given orientation."""

from __future__ import annotations

from betterbench.tasks.template import ObjectGroup, Template

CONSTRAINED_POSITIONING = Template(
    name="constrained_positioning",
    title="Constrained Positioning",
    description="Put the named object on the marked place of the fixture, aligned with it.",
    challenge="High-precision alignment with a static fixture of the environment.",
    groups=(
        ObjectGroup("fixture", "What carries the marked place.", ("coffee machine", "scale", "charger"), (1, 1)),
        ObjectGroup("items", "What may be asked for.", ("cup", "mug", "bowl"), (1, 4)),
        ObjectGroup("distractors", "What stays on the table.", ("kitchenware",), (0, 4)),
    ),
    relation="on_ring",
    exclusive=True,
)
