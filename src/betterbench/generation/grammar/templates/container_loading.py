"""Themes for the template "container loading": small objects that are put into the two drawers of a cabinet."""

from betterbench.generation.grammar.theme import Grammar, Group, Pool, Theme, one, register, several
from betterbench.tasks.authoring.templates import CONTAINER_LOADING

_CABINET = one("drawer_cabinet")
_DRAWERS = Group((Pool(("upper_drawer",)), Pool(("lower_drawer",))), follows="cabinet")

GRAMMAR = register(
    Grammar(
        template=CONTAINER_LOADING,
        requested="Putting the requested items away",
        general="Put the items into the drawers of the {cabinet}.",
        most_items=2,
        themes=tuple(
            Theme(name, context, instructions, {"cabinet": _CABINET, "drawers": _DRAWERS, "items": items})
            for name, context, items, instructions in (
                (
                    "Filing office supplies",
                    "office",
                    several(2, "stapler", "tape_roll", "computer_mouse"),
                    (
                        "Put the office supplies into the drawers of the {cabinet}.",
                        "Store the office supplies in the drawers of the {cabinet}.",
                    ),
                ),
                (
                    "Tidying a student's desk",
                    "dorm room",
                    several(2, "stapler", "tape_roll", "computer_mouse"),
                    (
                        "Put the desk clutter into the drawers of the {cabinet}.",
                        "Put the desk clutter away in the {cabinet}.",
                    ),
                ),
                (
                    "Putting toy blocks away",
                    "playroom",
                    Group((Pool(("round_block",), 2, by_color=True),)),
                    ("Put the toy blocks into the drawers of the {cabinet}.", "Put the toys away in the {cabinet}."),
                ),
                (
                    "Stocking an art room",
                    "art room",
                    several(2, "tape_roll", "round_block", "stapler"),
                    (
                        "Put the craft supplies into the {cabinet}.",
                        "Store the craft supplies in the drawers of the {cabinet}.",
                    ),
                ),
                (
                    "Storing cleaning supplies",
                    "laundry room",
                    several(2, "sponge", "soap_bar"),
                    (
                        "Store the cleaning supplies in the drawers of the {cabinet}.",
                        "Put the cleaning supplies into the {cabinet}.",
                    ),
                ),
                (
                    "Stocking a bathroom cabinet",
                    "bathroom",
                    Group((Pool(("soap_bar",), 2, by_color=True),)),
                    (
                        "Put the bars of soap into the drawers of the {cabinet}.",
                        "Store the soap in the drawers of the {cabinet}.",
                    ),
                ),
                (
                    "Stocking a craft cabinet",
                    "craft room",
                    several(2, "tape_roll", "round_block", "stapler"),
                    (
                        "Put the craft supplies into the drawers of the {cabinet}.",
                        "Stock the drawers of the {cabinet} with craft supplies.",
                    ),
                ),
            )
        ),
    )
)
"""Scenarios of container loading: a cabinet with two drawers, and two small items."""
