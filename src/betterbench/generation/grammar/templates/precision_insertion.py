"""Themes for the template "precision insertion": jars and bottles that are put into the holes of a rack."""

from betterbench.generation.grammar.theme import Grammar, Group, Pool, Theme, one, register
from betterbench.tasks.authoring.templates import PRECISION_INSERTION

_RACK = one("spice_rack")


def _jar(spice: str, color: str) -> tuple[Pool, Pool]:
    """Return two pools for a spice: one with its glass jar, and one with its plain steel jar."""
    return Pool(("spice_jar",), colors=(color,)), Pool((f"plain_{spice}_jar",))


_SALT, _PEPPER, _PAPRIKA = _jar("salt", "white"), _jar("pepper", "black"), _jar("paprika", "red")
_PILLS = Pool(("pill_bottle",))


def _both(*jars: tuple[Pool, Pool], more: tuple[Pool, ...] = ()) -> list[Group]:
    """Return one group for each combination of glass and steel jars."""
    choices: list[tuple[Pool, ...]] = [()]
    for glass, steel in jars:
        choices = [(*before, jar) for before in choices for jar in (glass, steel)]
    return [Group((*pools, *more)) for pools in choices]


_SEASONING = _both(_SALT, _PEPPER, _PAPRIKA)
_PAIRS = [
    g for pair in ((_SALT, _PEPPER), (_PEPPER, _PAPRIKA), (_SALT, _PAPRIKA)) for g in _both(*pair, more=(_PILLS,))
]
_CONTEXTS = (
    ("Filling the seasoning rack", "kitchen"),
    ("Setting out the spices", "restaurant kitchen"),
    ("Tidying the spice shelf", "pantry"),
    ("Getting ready for a barbecue", "backyard grill"),
)
_PANTRIES = (
    ("Organizing a camper's pantry", "camper van"),
    ("Restocking a cabin kitchen", "cabin"),
    ("Sorting the kitchen shelf", "dorm kitchen"),
)

GRAMMAR = register(
    Grammar(
        template=PRECISION_INSERTION,
        requested="Inserting the requested items",
        general="Put the items into the holes of the {rack}.",
        most_items=3,
        themes=(
            *(
                Theme(
                    *_CONTEXTS[number % len(_CONTEXTS)],
                    ("Put the spices into the holes of the {rack}.", "Fill the holes of the {rack} with the spices."),
                    {"rack": _RACK, "items": items},
                )
                for number, items in enumerate(_SEASONING)
            ),
            *(
                Theme(
                    *_PANTRIES[number % len(_PANTRIES)],
                    (
                        "Put the jars and the pill bottle into the holes of the {rack}.",
                        "Store the jars and the pill bottle in the {rack}.",
                    ),
                    {"rack": _RACK, "items": items},
                )
                for number, items in enumerate(_PAIRS)
            ),
        ),
    )
)
"""Scenarios of precision insertion: a rack with three holes, and three jars or bottles that fit them."""
