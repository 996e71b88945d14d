"""Constraint templates of the suite. They are in the same order as the tasks that follow them."""

from betterbench.tasks.authoring.template import ObjectGroup, Template

PATTERNED_ARRANGEMENT = Template(
    name="patterned_arrangement",
    title="Patterned Arrangement",
    description="Put the named objects to the named sides of the anchor, in any order.",
    challenge="Relative placement: a side moves and turns with its anchor.",
    goal=(
        "Each named object stands or lies at its named side, cutlery at a plate with its handle to the front, "
        "at rest and released; no other object was brought to a side."
    ),
    premise="The named objects are in their slots, and the named sides are free.",
    groups=(
        ObjectGroup(
            "anchor",
            "Object around which the others are placed; it has named sides.",
            ("laptop", "plate", "tray", "placemat"),
            (1, 1),
            role="fixture",
        ),
        ObjectGroup("items", "Objects that may be requested.", ("desk object", "cutlery", "cup"), (2, 4), role="item"),
        ObjectGroup(
            "distractors", "Objects that must stay in place.", ("tableware", "desk object"), (0, 6), role="distractor"
        ),
    ),
    relation="beside",
    exclusive=True,
    order="free",
)
"""Objects are placed around an anchor, each at its own side of the anchor and aligned with it."""

LOOSE_PACKING = Template(
    name="loose_packing",
    title="Loose Packing",
    description="Put the named objects into the container, in the order in which they are named.",
    challenge="Free-form containment while tracking which of several similar objects are already packed.",
    goal=(
        "The named objects are inside the container, at rest and released, packed in the named order "
        "where the instruction gives one; no other object is inside."
    ),
    premise="The named objects are in their slots; objects already inside are part of the setup.",
    groups=(
        ObjectGroup(
            "container",
            "Container, open at the top.",
            ("bag", "box", "basket", "bin"),
            (1, 1),
            role="container",
        ),
        ObjectGroup("items", "Requested objects; several may be alike.", ("food", "small object"), (1, 6), role="item"),
        ObjectGroup(
            "distractors", "Objects that must stay in place.", ("food", "small object"), (0, 6), role="distractor"
        ),
    ),
    relation="inside",
    exclusive=True,
    order="named",
)
"""The named objects, and no others, go into a container.

Any pose is allowed, but a drink must not lie on its side.
"""

CONSTRAINED_POSITIONING = Template(
    name="constrained_positioning",
    title="Constrained Positioning",
    description="Put the named object on the marked region of the fixture, aligned with it.",
    challenge="High-precision alignment with a static fixture of the environment.",
    goal="The named object stands centered on the marked region, upright, with its handle clear, at rest and released.",
    premise="The named object is in its slot and the marked region is free, unless no step is left.",
    groups=(
        ObjectGroup(
            "fixture", "Fixture with the marked region.", ("coffee machine", "scale", "charger"), (1, 1), role="fixture"
        ),
        ObjectGroup("items", "Objects that may be requested.", ("cup", "mug", "bowl"), (1, 4), role="item"),
        ObjectGroup("distractors", "Objects that must stay on the table.", ("kitchenware",), (0, 4), role="distractor"),
    ),
    relation="on_ring",
    exclusive=True,
    order="free",
)
"""One object goes to an exact region of a fixture, with a given orientation."""

CONTAINER_LOADING = Template(
    name="container_loading",
    title="Container Loading",
    description="Put the named objects into the named drawers and close them.",
    challenge="Articulated containers whose state determines the possible next steps.",
    goal=(
        "The named objects are in the named drawers, no other object is in a drawer, and the named drawers "
        "are closed, all at rest and released."
    ),
    premise="The named objects are in their slots, and each drawer is opened as the condition defines.",
    groups=(
        ObjectGroup("cabinet", "Cabinet that contains the drawers.", ("cabinet",), (1, 1), role="fixture"),
        ObjectGroup(
            "drawers",
            "Drawers to load; each slides on rails with friction and stops.",
            ("drawer",),
            (1, 2),
            role="drawer",
        ),
        ObjectGroup("items", "Objects that may be requested.", ("office supply", "small object"), (1, 4), role="item"),
        ObjectGroup(
            "distractors",
            "Objects that must stay in place.",
            ("office supply", "small object"),
            (0, 4),
            role="distractor",
        ),
    ),
    relation="inside",
    exclusive=True,
    order="free",
    also=("closed",),
    base_steps=300,
    steps_per_subgoal=600,
)
"""Objects go into drawers, which must be opened before and closed afterward."""

LOGICAL_ASSEMBLY = Template(
    name="logical_assembly",
    title="Logical Assembly",
    description="Stack the named layers on the base, from below, in the order in which they are named.",
    challenge="Strict order: a layer below cannot be added later.",
    goal=(
        "The named layers lie on each other in the named order, centered over the base and flat, at rest and "
        "released; no other object is in the stack."
    ),
    premise="The named layers are in their slots; layers already on the base are part of the setup.",
    groups=(
        ObjectGroup("base", "Base of the stack.", ("bun", "plate", "tray"), (1, 1), role="container"),
        ObjectGroup("layers", "Requested layers; several may be alike.", ("food layer", "block"), (2, 6), role="item"),
        ObjectGroup(
            "distractors", "Objects that must stay in place.", ("food layer", "small object"), (0, 4), role="distractor"
        ),
    ),
    relation="layer",
    exclusive=True,
    order="built",
)
"""Layers go on top of each other in a given order."""

PRECISION_INSERTION = Template(
    name="precision_insertion",
    title="Precision Insertion",
    description="Put the named objects into the named holes of the rack, in any order.",
    challenge="Contact-rich alignment within 3 mm on each side; collisions with the rack are counted.",
    goal=(
        "Each named object stands on the floor of its named hole, upright, at rest and released; nothing "
        "else was put into a hole."
    ),
    premise="The named objects are in their slots and their holes are free.",
    groups=(
        ObjectGroup("rack", "Object with the holes.", ("rack", "stand", "charger"), (1, 1), role="fixture"),
        ObjectGroup("items", "Objects that may be requested.", ("jar", "bottle", "plug"), (1, 6), role="item"),
        ObjectGroup("distractors", "Objects that must stay in place.", ("jar", "bottle"), (0, 4), role="distractor"),
    ),
    relation="in_hole",
    exclusive=True,
    order="free",
)
"""Objects go into holes into which they fit with a few millimeters of clearance."""

RECURSIVE_STACKING = Template(
    name="recursive_stacking",
    title="Recursive Stacking",
    description="Put the named plate on the named plate or stack.",
    challenge="Moving targets: a stacked plate can be the target of the next plate.",
    goal=(
        "Each named plate is at the center of the target plate, flat and touching it, at rest and released; nothing "
        "else was put on an instructed plate."
    ),
    premise="The named plates are in their slots or on another plate, as the condition defines.",
    groups=(
        ObjectGroup(
            "plates",
            "Plates to stack and to stack on, distinguished by color.",
            ("plate", "bowl", "tray"),
            (2, 4),
            role="item",
        ),
        ObjectGroup("distractors", "Objects that must stay in place.", ("bowl", "plate"), (0, 3), role="distractor"),
    ),
    relation="on_plate",
    exclusive=True,
    order="built",
)
"""Objects of one kind are stacked on each other. A stack can itself be the target."""

TEMPLATES = {
    t.name: t
    for t in (
        PATTERNED_ARRANGEMENT,
        LOOSE_PACKING,
        CONSTRAINED_POSITIONING,
        CONTAINER_LOADING,
        LOGICAL_ASSEMBLY,
        PRECISION_INSERTION,
        RECURSIVE_STACKING,
    )
}
"""The seven constraint templates, by name."""
