"""Casts of three patterns: those of the suite's tasks, and others from the procedural library."""

from __future__ import annotations

from betterbench.generation.cast import Cast
from betterbench.generation.scenario import Scenario
from betterbench.tasks import authoring as a


def cast(template, name, instruction, groups, look_alikes):
    """Return a cast of chosen objects without descriptions."""
    scenario = Scenario(template, name, instruction, "kitchen", {})
    return Cast(scenario, {key: tuple(specs) for key, specs in groups.items()}, look_alikes)


def mugs(*colors, machine="coffee_machine", machine_color=None, alike=None, distractors=()):
    """Return a cast of mugs of these colors; ``alike`` gives the category of the look-alikes."""
    items = [a.item(f"{color}_mug", f"{color} mug", "mug", color) for color in colors]
    found = {}
    for item in items:
        if alike:
            found[item.name] = (a.distractor(f"{item.color}_{alike}", category=alike, color=item.color),)
    fixture = a.ObjectSpec(machine, machine.replace("_", " "), machine, machine_color, "fixture")
    groups = {"fixture": [fixture], "items": items, "distractors": list(distractors)}
    return cast("constrained_positioning", "Morning coffee", "Get the coffee ready.", groups, found)


def desk(first, second, *, cabinet_color=None, alike=None, distractors=()):
    """Return a cast of two objects, given as (kind, category, color), and a cabinet."""
    items = [a.item(kind.replace(" ", "_"), kind, category, color) for kind, category, color in (first, second)]
    cabinet = a.ObjectSpec("cabinet", "cabinet", "drawer_cabinet", cabinet_color, "fixture")
    drawers = [a.drawer(mount, f"{mount}_drawer", cabinet) for mount in ("upper", "lower")]
    groups = {"cabinet": [cabinet], "drawers": drawers, "items": items, "distractors": list(distractors)}
    found = {name: (spec,) for name, spec in (alike or {}).items()}
    return cast("container_loading", "Filing office supplies", "Put the supplies away.", groups, found)


def jars(*items, rack_color=None, alike=None, distractors=()):
    """Return a cast of three jars, given as (name, kind, category, color), and a rack."""
    specs = [a.item(*item) for item in items]
    groups = {
        "rack": [a.ObjectSpec("rack", "rack", "spice_rack", rack_color, "fixture")],
        "items": specs,
        "distractors": list(distractors),
    }
    found = {name: (spec,) for name, spec in (alike or {}).items()}
    return cast("precision_insertion", "Filling the rack", "Fill the seasoning rack.", groups, found)


SPICES = {"salt": "white", "pepper": "black", "paprika": "red"}


def spice(name):
    """Return the description of a spice jar."""
    return name, f"{name} jar", "spice_jar", SPICES[name]


STAPLER_BLOCK = a.distractor("stapler_block", "stapler-shaped block", "stapler_block", "red")
PILLS = a.distractor("pill_bottle")

SUITE = {
    "morning_coffee": mugs("red", "blue", alike="can"),
    "office_drawer": desk(
        ("stapler", "stapler", "red"), ("tape", "tape_roll", "blue"), alike={"stapler": STAPLER_BLOCK}
    ),
    "seasoning_rack": jars(*map(spice, SPICES), alike={"salt": PILLS}),
}
"""Casts of the tasks of the suite."""

CASTS = {
    **SUITE,
    "green_yellow_mugs": mugs("green", "yellow", machine_color="silver", alike="drink_cup"),
    "three_mugs": mugs("white", "black", "red", machine_color="cream"),
    "mugs_and_a_bystander": mugs("gray", "red", machine_color="blue", distractors=[a.distractor("sponge")]),
    "soap_and_sponge": desk(("soap bar", "soap_bar", "green"), ("sponge", "sponge", "yellow"), cabinet_color="brown"),
    "mouse_and_sauce": desk(
        ("computer mouse", "computer_mouse", "black"),
        ("sauce cup", "sauce_cup", "white"),
        cabinet_color="gray",
        alike={"computer_mouse": a.distractor("soap", "soap bar", "soap_bar", "gray")},
    ),
    "block_and_stapler": desk(
        ("stapler", "stapler", "blue"), ("toy block", "block", "red"), distractors=[a.distractor("apple")]
    ),
    "pills_and_spices": jars(
        ("pill_bottle", "pill bottle", "pill_bottle", "white"), spice("pepper"), spice("paprika"), rack_color="gray"
    ),
    "steel_jars": jars(
        *((name, f"{name} jar", f"plain_{name}_jar", "gray") for name in SPICES), distractors=[a.distractor("lemon")]
    ),
    "spices_in_another_order": jars(spice("paprika"), spice("salt"), spice("pepper")),
}
"""Casts by a short name, at least three per pattern besides those of the suite."""
