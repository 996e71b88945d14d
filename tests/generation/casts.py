"""Casts of objects of the library, by template and name."""

from __future__ import annotations

from betterbench.generation.cast import Cast
from betterbench.generation.scenario import DescribedObject, Scenario
from betterbench.tasks import authoring as a
from betterbench.tasks.condition import ObjectSpec


def cast(template: str, name: str, seed: int = 0, **groups) -> Cast:
    """Return a cast of these groups; ``look_alikes`` by the name of an item is one of them."""
    look_alikes = groups.pop("look_alikes", {})
    chosen = {key: tuple(found) if isinstance(found, list) else (found,) for key, found in groups.items()}
    described = {key: tuple(map(_described, objects)) for key, objects in chosen.items()}
    scenario = Scenario(template, name, f"{name}.", "kitchen", described)
    return Cast(scenario, chosen, {key: tuple(found) for key, found in look_alikes.items()}, seed)


def _described(spec: ObjectSpec) -> DescribedObject:
    return DescribedObject(f"a {spec.kind}", spec.kind, spec.name, (0.01, 1.0), (0.01, 0.4))


APPLE, ORANGE, LEMON = a.item("apple", color="red"), a.item("orange"), a.item("lemon")
GREEN_APPLE = a.item("green_apple", category="apple", color="green")
BURGER, FRIES, DRINK = a.item("burger"), a.item("fries", category="fries_box"), a.item("drink", category="drink_cup")
JAM, SALT, EGG = a.item("jam_jar"), a.item("salt_shaker"), a.item("egg_cup")
SPONGE, SOAP, TAPE = a.item("sponge"), a.item("soap_bar"), a.item("tape_roll")
RED_BLOCK, BLUE_BLOCK, GREEN_BLOCK, YELLOW_BLOCK = (
    a.item(f"{color}_block", category="block", color=color) for color in ("red", "blue", "green", "yellow")
)
RED_ROUND, BLUE_ROUND, GREEN_ROUND = (
    a.item(f"{color}_round_block", category="round_block", color=color) for color in ("red", "blue", "green")
)
PILLS, SAUCE, CAN = a.item("pill_bottle"), a.item("sauce_cup"), a.item("can", color="red")
MUG = a.item("mug", color="blue")
LUNCHBOX, TAKEAWAY, BIN = a.container("lunchbox"), a.container("takeaway_box"), a.container("waste_bin")

LOOSE_PACKING = (
    cast("loose_packing", "Packing a fruit lunch", container=LUNCHBOX, items=[APPLE, ORANGE, LEMON],
         look_alikes={"apple": [RED_BLOCK]}),
    cast("loose_packing", "Packing fast food", 1, container=TAKEAWAY, items=[BURGER, FRIES, DRINK],
         look_alikes={"burger": [a.item("round_block")]}),
    cast("loose_packing", "Clearing the table", 2, container=TAKEAWAY, items=[JAM, SALT, EGG, GREEN_APPLE],
         look_alikes={"jam_jar": [a.item("red_can", "red can", "can", "red")]}),
    cast("loose_packing", "Clearing the sink", 3, container=BIN, items=[SPONGE, TAPE, SAUCE],
         distractors=[MUG], look_alikes={"sponge": [a.item("cheese_slice")]}),
    cast("loose_packing", "Collecting trash", 5, container=BIN,
         items=[a.item("napkin", "crumpled napkin", "crumpled_napkin"), a.item("crushed_can"), SAUCE],
         look_alikes={"napkin": [a.item("egg_cup")]}),
    cast("loose_packing", "Packing snacks", 4, container=LUNCHBOX, items=[GREEN_APPLE, SAUCE, LEMON],
         look_alikes={"green_apple": [GREEN_BLOCK]}),
)  # fmt: skip

MOUSE, SPEAKER = a.item("mouse", category="computer_mouse"), a.item("speaker")
FORK, SPOON, CUP = a.item("fork"), a.item("spoon"), a.item("cup", color="blue")
STAPLER = a.item("stapler", color="red")
BOWL = a.item("bowl", category="cereal_bowl")
LAPTOP, PLATE = a.fixture("laptop"), a.fixture("plate", category="place_plate")

PATTERNED_ARRANGEMENT = (
    cast("patterned_arrangement", "Preparing a desk meeting", anchor=LAPTOP, items=[MOUSE, MUG, SPEAKER],
         look_alikes={"mouse": [a.item("soap_bar", color="gray")]}),
    cast("patterned_arrangement", "Laying the breakfast table", anchor=PLATE, items=[FORK, CUP, SPOON],
         distractors=[EGG, BOWL, SALT, JAM],
         look_alikes={"cup": [a.item("tumbler", color="blue")]}),
    cast("patterned_arrangement", "Serving condiments", 2, anchor=PLATE, items=[SALT, JAM, EGG],
         look_alikes={"jam_jar": [a.item("red_can", "red can", "can", "red")]}),
    cast("patterned_arrangement", "Tidying an office", 3, anchor=LAPTOP, items=[TAPE, MUG, STAPLER],
         look_alikes={"stapler": [a.item("red_stapler_block", "red block", "stapler_block", "red")]}),
    cast("patterned_arrangement", "Setting the table", 4, anchor=PLATE, items=[FORK, SPOON, SALT]),
)  # fmt: skip

PATTY, CHEESE = a.item("patty"), a.item("cheese", category="cheese_slice")
LETTUCE, TOP = a.item("lettuce", category="lettuce_leaf"), a.item("top_bun", category="bun_top")
BUN = a.container("bottom_bun", category="bun_bottom")
TRAY = a.container("plate", category="place_plate")

LOGICAL_ASSEMBLY = (
    cast("logical_assembly", "Assembling a cheeseburger", base=BUN, layers=[PATTY, CHEESE, LETTUCE, TOP],
         look_alikes={"cheese": [a.item("sponge")]}),
    cast("logical_assembly", "Building a tower", 1, base=TRAY, layers=[RED_ROUND, BLUE_ROUND, GREEN_ROUND],
         look_alikes={"red_round_block": [APPLE]}),
    cast("logical_assembly", "Preparing a salad burger", 2, base=BUN, layers=[CHEESE, PATTY, LETTUCE],
         look_alikes={"cheese": [a.item("sponge")]}),
    cast("logical_assembly", "Building a block tower", 3, base=TRAY,
         layers=[BLUE_BLOCK, YELLOW_BLOCK, RED_BLOCK, GREEN_BLOCK]),
)  # fmt: skip


def plate(color: str, category: str = "dinner_plate") -> ObjectSpec:
    return a.item(f"{color}_plate", category=category, color=color)


def bowl(color: str) -> ObjectSpec:
    return a.item(f"{color}_bowl", category="shallow_bowl", color=color)


RECURSIVE_STACKING = (
    cast("recursive_stacking", "Stacking dinner plates",
         plates=[plate("white", "serving_plate"), plate("red"), plate("blue")],
         look_alikes={"red_plate": [bowl("red")]}),
    cast("recursive_stacking", "Clearing the table", 1,
         plates=[plate("green"), plate("yellow", "serving_plate"), plate("blue")],
         look_alikes={"blue_plate": [bowl("blue")]}),
    cast("recursive_stacking", "Doing the dishes", 2, plates=[plate("white"), plate("green"), plate("red")],
         look_alikes={"red_plate": [bowl("red")]}),
    cast("recursive_stacking", "Sorting plates", 3,
         plates=[plate("green"), plate("yellow"), plate("red", "serving_plate")]),
)  # fmt: skip

CASTS = (*LOOSE_PACKING, *PATTERNED_ARRANGEMENT, *LOGICAL_ASSEMBLY, *RECURSIVE_STACKING)
SUITE_CASTS = {
    "fruit_lunch": LOOSE_PACKING[0],
    "desk_meeting": PATTERNED_ARRANGEMENT[0],
    "breakfast_table": PATTERNED_ARRANGEMENT[1],
    "cheeseburger": LOGICAL_ASSEMBLY[0],
    "dinner_plates": RECURSIVE_STACKING[0],
}
"""Casts with the objects of the suite's tasks."""
