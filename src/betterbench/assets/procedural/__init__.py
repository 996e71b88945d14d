"""The embedded library: parametric generators that turn a category, a look and a colour into an asset.

Importing this package registers every family; a new family is one file with a decorated function and one line here.
"""

from betterbench.assets.procedural import (  # noqa: F401  (imported for what they register)
    blocks,
    burger,
    can,
    coffee_machine,
    drink_cup,
    fries,
    mug,
    table_extras,
    takeaway_box,
)
from betterbench.assets.procedural.registry import build, categories, colours, generator, looks

__all__ = ["build", "categories", "colours", "generator", "looks"]
