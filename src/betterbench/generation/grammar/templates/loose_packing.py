"""Contexts of loose packing: meals to go, and trash."""

from betterbench.generation.grammar.theme import Grammar, Group, Pool, Theme, one, register, several
from betterbench.tasks.authoring.templates import LOOSE_PACKING

_LUNCHBOX, _TAKEAWAY, _BIN = one("lunchbox"), one("takeaway_box"), one("waste_bin")


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
        ),
    )
)
"""Scenarios of loose packing: a container and three items of different kinds."""
