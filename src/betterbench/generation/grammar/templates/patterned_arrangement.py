"""Themes for the template "patterned arrangement": desks with a laptop, and place settings around a plate."""

from betterbench.generation.grammar.theme import Grammar, Group, Pool, Theme, one, register, several
from betterbench.tasks.authoring.templates import PATTERNED_ARRANGEMENT

_LAPTOP, _PLATE = one("laptop"), one("place_plate")
_DESK = ("computer_mouse", "mug", "speaker", "stapler", "tape_roll", "tumbler", "can", "drink_cup", "cup")


def _laid(*vessels: str) -> Group:
    """Return a group with a silver fork, one of the given drinking vessels, and a silver spoon."""
    return Group((Pool(("fork",), colors=("silver",)), Pool(vessels), Pool(("spoon",), colors=("silver",))))


GRAMMAR = register(
    Grammar(
        template=PATTERNED_ARRANGEMENT,
        requested="Arranging the requested items",
        general="Arrange the items around the {anchor}.",
        most_items=3,
        themes=(
            Theme(
                "Preparing a desk for a meeting",
                "office desk",
                ("Arrange the desk around the {anchor} for a meeting.", "Set up the desk around the {anchor}."),
                {"anchor": _LAPTOP, "items": several(3, "computer_mouse", "mug", "speaker")},
            ),
            Theme(
                "Setting up a home office",
                "home office",
                ("Set up the home office around the {anchor}.", "Arrange the workspace around the {anchor}."),
                {"anchor": _LAPTOP, "items": several(3, "computer_mouse", "stapler", "tape_roll", "mug", "tumbler")},
            ),
            Theme(
                "Settling in for a study session",
                "library desk",
                (
                    "Arrange the desk around the {anchor} for a study session.",
                    "Set up the study desk around the {anchor}.",
                ),
                {"anchor": _LAPTOP, "items": several(3, "computer_mouse", "stapler", "can", "drink_cup", "tape_roll")},
            ),
            Theme(
                "Setting up a movie night",
                "living room table",
                ("Set up the table around the {anchor} for movie night.", "Arrange the table around the {anchor}."),
                {"anchor": _LAPTOP, "items": several(3, "speaker", "can", "drink_cup", "tumbler")},
            ),
            Theme(
                "Setting the breakfast table",
                "breakfast table",
                ("Set the table for breakfast around the {anchor}.", "Set a place for breakfast with the {anchor}."),
                {"anchor": _PLATE, "items": _laid("cup", "mug")},
            ),
            Theme(
                "Setting a place for lunch",
                "dining room",
                ("Set a place for lunch around the {anchor}.", "Set the table for lunch around the {anchor}."),
                {"anchor": _PLATE, "items": _laid("tumbler", "can")},
            ),
            Theme(
                "Setting a place at a diner",
                "diner",
                ("Set the table around the {anchor} for the guest.", "Set a place at the table with the {anchor}."),
                {"anchor": _PLATE, "items": _laid("drink_cup", "mug", "tumbler")},
            ),
            Theme(
                "Working at a shared desk",
                "coworking space",
                ("Set up the workspace around the {anchor}.", "Arrange the desk around the {anchor} for work."),
                {"anchor": _LAPTOP, "items": several(3, *_DESK)},
            ),
            Theme(
                "Setting out drinks",
                "patio table",
                ("Set the table around the {anchor} for the guests.", "Arrange the table around the {anchor}."),
                {
                    "anchor": _PLATE,
                    "items": Group((Pool(("cup", "mug", "tumbler", "drink_cup", "can"), 3),), colors_differ=True),
                },
            ),
        ),
    )
)
"""Scenarios of patterned arrangement: an anchor with sides, and three items of different kinds."""
