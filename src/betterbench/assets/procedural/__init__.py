"""The embedded library: parametric generators that turn a category, a look and a color into an asset.

Importing this package registers every family; a new family is one file with a decorated function and one line here.
"""

from betterbench.assets.procedural import (  # noqa: F401  (imported for what they register)
    blocks,
    breakfast,
    burger,
    burger_layers,
    can,
    coffee_machine,
    computer_mouse,
    crumpled_napkin,
    crushed_can,
    cup,
    cutlery,
    drawers,
    drink_cup,
    fries,
    fruit,
    keyboard,
    laptop,
    lunchbox,
    mug,
    place_plate,
    plates,
    speaker,
    spice_jars,
    spice_rack,
    stapler,
    table_extras,
    takeaway_box,
    tape_roll,
    waste_bin,
)
from betterbench.assets.procedural.registry import build, categories, colors, generator, looks

__all__ = ["build", "categories", "colors", "generator", "looks"]
