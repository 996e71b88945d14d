"""Logical Assembly: layers go on top of each other in a given order."""

from __future__ import annotations

from betterbench.tasks.template import ObjectGroup, Template

LOGICAL_ASSEMBLY = Template(
    name="logical_assembly",
    title="Logical Assembly",
    description="Stack the named layers on the base, from below, in the order in which they are named.",
    challenge="Strict order: a layer below cannot be added later.",
    goal=(
        "The named layers lie on each other in the named order, centered over the base and flat, at rest "
        "and let go; nothing else lies there."
    ),
    premise="The named layers lie in their slots; what lies on the base already was put there on purpose.",
    groups=(
        ObjectGroup("base", "What the stack stands on.", ("bun", "plate", "tray"), (1, 1), role="container"),
        ObjectGroup(
            "layers", "What may be asked for; several may be alike.", ("food layer", "block"), (2, 6), role="item"
        ),
        ObjectGroup(
            "distractors", "What stays on the table.", ("food layer", "small object"), (0, 4), role="distractor"
        ),
    ),
    relation="layer",
    exclusive=True,
    order="built",
)
