"""Loose Packing: named things go into a container, in any pose, and nothing else does."""

from __future__ import annotations

from betterbench.tasks.template import ObjectGroup, Template

LOOSE_PACKING = Template(
    name="loose_packing",
    title="Loose Packing",
    description="Put the named objects into the container, in the order in which they are named.",
    challenge="Free-form containment while tracking which of several alike objects are already packed.",
    goal=(
        "The named objects are inside the container, at rest and let go, packed in the named order "
        "where the instruction gives one; nothing else is inside."
    ),
    premise="The named objects stand in their slots; what is inside already was put there on purpose.",
    groups=(
        ObjectGroup(
            "container",
            "What is packed into; open at the top.",
            ("bag", "box", "basket", "bin"),
            (1, 1),
            role="container",
        ),
        ObjectGroup(
            "items", "What may be asked for; several may be alike.", ("food", "small object"), (1, 6), role="item"
        ),
        ObjectGroup("distractors", "What stays on the table.", ("food", "small object"), (0, 6), role="distractor"),
    ),
    relation="inside",
    exclusive=True,
    order="named",
)
