"""Themes for the template "constrained positioning": mugs that are put on the ring of a coffee machine."""

from betterbench.generation.grammar.theme import Grammar, Group, Pool, Theme, one, register
from betterbench.tasks.authoring.templates import CONSTRAINED_POSITIONING

_MACHINE = one("coffee_machine")
_MUGS = Group((Pool(("mug",), 2, by_color=True),))

GRAMMAR = register(
    Grammar(
        template=CONSTRAINED_POSITIONING,
        requested="Positioning a requested item",
        general="Put one of them on the ring of the {fixture}.",
        most_items=3,
        themes=tuple(
            Theme(name, context, instructions, {"fixture": _MACHINE, "items": items})
            for name, context, items, instructions in (
                (
                    "Making coffee in the morning",
                    "kitchen",
                    _MUGS,
                    ("Put a mug on the ring of the {fixture}.", "Place a mug under the spout of the {fixture}."),
                ),
                (
                    "Taking a coffee break",
                    "office break room",
                    _MUGS,
                    ("Place a mug on the mark of the {fixture}.", "Set a mug on the ring of the {fixture}."),
                ),
                (
                    "Serving coffee at a cafe",
                    "cafe counter",
                    _MUGS,
                    ("Set a mug on the tray of the {fixture}.", "Put a mug on the marked ring of the {fixture}."),
                ),
                (
                    "Serving coffee to a guest",
                    "hotel lounge",
                    _MUGS,
                    ("Put a mug on the ring of the {fixture}.", "Set a mug under the spout of the {fixture}."),
                ),
            )
        ),
    )
)
"""Scenarios of constrained positioning: a coffee machine, and two mugs of different colors."""
