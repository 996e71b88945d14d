"""Logical Assembly: layers go on top of each other in a given order."""

from __future__ import annotations

from betterbench.tasks.template import ObjectGroup, Template

LOGICAL_ASSEMBLY = Template(
    name="logical_assembly",
    title="Logical Assembly",
    description="Stack the named layers on the base, from below, in the order in which they are named.",
    challenge="Strict order: a layer below cannot be added later.",
    groups=(
        ObjectGroup("base", "What the stack stands on.", ("bun", "plate", "tray"), (1, 1)),
        ObjectGroup("layers", "What may be asked for; several may be alike.", ("food layer", "block"), (2, 6)),
        ObjectGroup("distractors", "What stays on the table.", ("food layer", "small object"), (0, 4)),
    ),
    relation="layer",
    exclusive=True,
)
