"""Themes for the template "logical assembly": burgers, and towers of round blocks."""

from betterbench.generation.grammar.theme import Grammar, Group, Pool, Theme, one, register
from betterbench.tasks.authoring.templates import LOGICAL_ASSEMBLY

_BURGER = Group(tuple(Pool((layer,)) for layer in ("patty", "cheese_slice", "lettuce_leaf", "bun_top")))
_CYLINDERS = Group((Pool(("round_block",), 4, by_color=True),))

GRAMMAR = register(
    Grammar(
        template=LOGICAL_ASSEMBLY,
        requested="Stacking the requested layers",
        general="Stack the layers on the {base}.",
        themes=(
            Theme(
                "Assembling a cheeseburger",
                "kitchen",
                ("Build a cheeseburger on the {base}.", "Assemble a cheeseburger on the {base}."),
                {"base": one("bun_bottom"), "layers": _BURGER},
            ),
            Theme(
                "Stacking round blocks",
                "kindergarten",
                ("Stack the round blocks on the {base}.", "Build a tower of round blocks on the {base}."),
                {"base": one("place_plate"), "layers": _CYLINDERS},
            ),
            Theme(
                "Building a block tower",
                "playroom",
                ("Build a tower of round blocks on the {base}.", "Stack the round toy blocks on the {base}."),
                {"base": one("place_plate"), "layers": _CYLINDERS},
            ),
        ),
    )
)
"""Scenarios of logical assembly: a base and four layers."""
