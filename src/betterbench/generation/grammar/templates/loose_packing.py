"""Themes for the template "loose packing": packed meals, and trash."""

from betterbench.generation.grammar.theme import Grammar, Group, Pool, Theme, one, register, several
from betterbench.tasks.authoring.templates import LOOSE_PACKING

_LUNCHBOX, _TAKEAWAY, _BIN = one("lunchbox"), one("takeaway_box"), one("waste_bin")
_SNACKS = ("apple", "orange", "lemon", "burger", "egg_cup", "jam_jar", "salt_shaker", "fries_box")
"""Food that fits under the lid of a lunchbox."""
_MEAL = (*_SNACKS, "drink_cup", "can")
_LEFTOVERS = (
    "apple",
    "orange",
    "lemon",
    "egg_cup",
    "jam_jar",
    "cheese_slice",
    "lettuce_leaf",
    "bun_top",
    "patty",
)
_LITTER = Group(
    (
        Pool(("crumpled_napkin", "crushed_can")),
        Pool(("lettuce_leaf", "patty", "bun_top", "cheese_slice", "lemon"), 2),
    )
)


GRAMMAR = register(
    Grammar(
        template=LOOSE_PACKING,
        requested="Packing the requested items",
        general="Put the items into the {container}.",
        themes=(
            Theme(
                "Packing a fruit lunch",
                "kitchen",
                ("Pack the fruit into the {container}.", "Put the fruit into the {container}."),
                {"container": _LUNCHBOX, "items": several(3, "apple", "orange", "lemon")},
            ),
            Theme(
                "Packing a school lunch",
                "kitchen on a school morning",
                ("Pack a school lunch into the {container}.", "Fill the {container} with lunch for school."),
                {"container": _LUNCHBOX, "items": several(3, "apple", "orange", "burger", "egg_cup")},
            ),
            Theme(
                "Packing a picnic",
                "picnic",
                ("Pack the picnic into the {container}.", "Pack the {container} for the picnic."),
                {
                    "container": _LUNCHBOX,
                    "items": several(3, "apple", "orange", "lemon", "jam_jar", "salt_shaker"),
                },
            ),
            Theme(
                "Packing a takeaway order",
                "fast food counter",
                ("Pack the order into the {container}.", "Put the takeaway order into the {container}."),
                {
                    "container": _TAKEAWAY,
                    "items": several(3, "burger", "fries_box", "drink_cup", "can"),
                },
            ),
            Theme(
                "Packing breakfast to go",
                "hotel breakfast buffet",
                ("Pack breakfast into the {container}.", "Fill the {container} with breakfast to go."),
                {"container": _TAKEAWAY, "items": several(3, "egg_cup", "jam_jar", "orange", "apple", "drink_cup")},
            ),
            Theme(
                "Packing for a cookout",
                "backyard cookout",
                ("Pack the cookout supplies into the {container}.", "Pack the {container} for the cookout."),
                {
                    "container": one("takeaway_box", "lunchbox"),
                    "items": several(3, "salt_shaker", "jam_jar", "lemon"),
                },
            ),
            Theme(
                "Cleaning up after a burger night",
                "kitchen table after dinner",
                ("Throw the trash into the {container}.", "Put the trash into the {container}."),
                {
                    "container": _BIN,
                    "items": Group((Pool(("crumpled_napkin",)), Pool(("patty", "lettuce_leaf"), 2))),
                },
            ),
            Theme(
                "Cleaning up after a cookout",
                "backyard table",
                ("Throw the trash into the {container}.", "Toss the trash into the {container}."),
                {"container": _BIN, "items": several(3, "crushed_can", "crumpled_napkin", "patty")},
            ),
            Theme(
                "Clearing out the bathroom",
                "bathroom",
                ("Throw the trash into the {container}.", "Put the bathroom trash into the {container}."),
                {
                    "container": _BIN,
                    "items": Group((Pool(("crumpled_napkin",)), Pool(("pill_bottle", "soap_bar", "sponge"), 2))),
                },
            ),
            Theme(
                "Packing lunch for work",
                "office kitchen",
                ("Pack lunch into the {container}.", "Fill the {container} with lunch for work."),
                {"container": _TAKEAWAY, "items": several(3, *_MEAL)},
            ),
            Theme(
                "Packing dinner to go",
                "restaurant counter",
                ("Pack dinner into the {container}.", "Fill the {container} with dinner to go."),
                {"container": _TAKEAWAY, "items": several(4, *_MEAL)},
            ),
            Theme(
                "Packing for a day trip",
                "family kitchen",
                ("Pack the snacks for the trip into the {container}.", "Pack the {container} for the trip."),
                {"container": _LUNCHBOX, "items": several(3, *_SNACKS)},
            ),
            Theme(
                "Clearing out the fridge",
                "kitchen by the fridge",
                ("Throw the leftovers into the {container}.", "Clear the leftovers into the {container}."),
                {"container": _BIN, "items": several(3, *_LEFTOVERS)},
            ),
            Theme(
                "Cleaning up after a family dinner",
                "dining room table",
                ("Throw the leftovers into the {container}.", "Toss the leftovers into the {container}."),
                {"container": _BIN, "items": several(4, *_LEFTOVERS)},
            ),
            Theme(
                "Cleaning up after a game night",
                "living room",
                ("Throw the trash into the {container}.", "Clear the litter into the {container}."),
                {"container": _BIN, "items": _LITTER},
            ),
        ),
    )
)
"""Scenarios of loose packing: a container and three or four items of different kinds."""
