"""Themes for the template "recursive stacking": plates of different colors."""

from betterbench.generation.grammar.theme import Grammar, Group, Pool, Theme, register
from betterbench.tasks.authoring.templates import RECURSIVE_STACKING

_PLATES = Group((Pool(("serving_plate",)), Pool(("dinner_plate",), 2, by_color=True)), colors_differ=True)

GRAMMAR = register(
    Grammar(
        template=RECURSIVE_STACKING,
        requested="Stacking the requested plates",
        general="Stack the plates.",
        themes=tuple(
            Theme(name, context, instructions, {"plates": _PLATES})
            for name, context, instructions in (
                (
                    "Stacking dinner plates",
                    "dining room",
                    ("Stack the dinner plates on the {plates}.", "Stack the plates in one pile."),
                ),
                (
                    "Clearing the table",
                    "restaurant",
                    ("Stack the plates on the table.", "Stack the plates on the {plates}."),
                ),
                (
                    "Putting clean dishes away",
                    "kitchen",
                    ("Stack the clean plates on the {plates}.", "Stack the clean plates in one pile."),
                ),
                (
                    "Preparing a buffet",
                    "buffet",
                    ("Stack the plates for the guests.", "Stack the plates on the buffet."),
                ),
            )
        ),
    )
)
"""Scenarios of recursive stacking: a serving plate and two dinner plates, all of different colors."""
