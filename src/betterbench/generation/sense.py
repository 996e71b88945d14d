"""Plausibility checks of a scenario for its template.

Each problem is a sentence that begins with the path of the field, and can be sent back to the model that wrote the
scenario. The scenario has to meet these requirements:

- the groups are the groups of the template, each has an allowed number of objects, and instance names are unique;
- each object belongs to an allowed type of its group, and the items of a group belong together;
- sizes and masses are usual for the kind of object, items fit the gripper and the container, and the arm can lift them;
- the instruction (:mod:`~betterbench.generation.instruction_sense`) is one imperative sentence about existing objects,
  and does not list the steps.
"""

from __future__ import annotations

from collections.abc import Iterator

from betterbench.errors import InvalidInputError, UnknownNameError
from betterbench.generation.instruction_sense import instruction_problems
from betterbench.generation.scenario import DescribedObject, Scenario
from betterbench.generation.vocabulary import belongs, domain_of, head_nouns
from betterbench.sim.asset_checks.limits import LEAST_M, MASS_FACTOR, MOST_DENSITY, MOST_M, PAYLOAD_KG
from betterbench.sim.asset_checks.opening import gripper_opening_m
from betterbench.sim.assets.importing.kinds import kind_of
from betterbench.tasks.authoring.template import ObjectGroup, Template
from betterbench.tasks.authoring.templates import TEMPLATES

LARGEST_ITEM_M = 0.25
"""Maximum size of an item [m]. The largest object that is moved in the suite is a serving plate of 20 cm."""
SIZE_SLACK = 2.0
"""Factor by which a size may deviate from the usual sizes of a kind of object.

For example, a pill bottle is smaller than other bottles but has no row in the table of kinds, and a lunchbox with an
open lid is longer than a closed one.
"""
HEAVIEST_FIXTURE_KG = 20.0
"""Maximum mass of an object that is not lifted [kg]. The importer of meshes has the same limit."""
_ROUND = frozenset(
    {("apple",), ("orange",), ("peach",), ("tomato",), ("onion",), ("potato",), ("ball",), ("grapefruit",), ("melon",)}
)
"""Kinds that are as thick as they are long, so that the gripper must open by their full size."""


def require_groups(scenario: Scenario, *, where: str = "scenario") -> None:
    """Raise InvalidInputError if the groups differ from the groups of the template, or two objects have the same name.

    Args:
        scenario: Scenario to check.
        where: File or location of the scenario, for error messages.
    """
    for path, problem, cure in (*_group_problems(scenario, TEMPLATES[scenario.template]), *_name_problems(scenario)):
        raise InvalidInputError(f"{where}: {path}", problem, cure)


def sense_problems(
    scenario: Scenario, *, where: str = "scenario", mixed: bool = False
) -> tuple[InvalidInputError, ...]:
    """Return the problems of a scenario, or an empty tuple if it is plausible.

    Args:
        scenario: Scenario to check.
        where: Location of the scenario, used as a prefix for the paths of fields.
        mixed: Whether items of different domains (such as food and office supplies) may be in one group, because the
            user named these objects.

    Raises:
        UnknownNameError: If the template of the scenario does not exist.
    """
    if scenario.template not in TEMPLATES:
        raise UnknownNameError("template", scenario.template, TEMPLATES)
    template = TEMPLATES[scenario.template]
    found = [*_group_problems(scenario, template), *_name_problems(scenario)]
    if not found:  # the other checks assume that each group is known
        found += _object_problems(scenario, template)
        found += () if mixed else _mixture_problems(scenario, template)
        found += _receiver_problems(scenario, template)
        found += instruction_problems(scenario, template)
    return tuple(InvalidInputError(f"{where}: {path}", problem, cure) for path, problem, cure in found)


Found = tuple[str, str, str]
"""A problem as a tuple of the path of the field, the problem and the remedy."""


def _group_problems(scenario: Scenario, template: Template) -> Iterator[Found]:
    known = {group.group_id: group for group in template.groups}
    for name in scenario.groups:
        if name not in known:
            message = str(UnknownNameError("group", name, known)).rstrip(".")
            yield "instantiation", message, "Use the group_id values of the template"
    for name, group in known.items():
        count, (low, high) = len(scenario.groups.get(name, ())), group.count_range
        if not low <= count <= high:
            wanted = str(low) if low == high else f"{low} to {high}"
            yield f"instantiation.{name}", f"has {count} objects", f"Give {wanted}, the count_range of the group"


def _name_problems(scenario: Scenario) -> Iterator[Found]:
    first: dict[str, str] = {}
    for path, described, _ in _objects(scenario, None):
        name = described.instance_name
        if name in first:
            yield (
                f"{path}.instance_name",
                f"{name!r} is also the name of {first[name]}",
                "Give each object a different name",
            )
        first.setdefault(name, path)


def _objects(
    scenario: Scenario, template: Template | None
) -> Iterator[tuple[str, DescribedObject, ObjectGroup | None]]:
    known = {group.group_id: group for group in template.groups} if template else {}
    for name, objects in scenario.groups.items():
        for number, described in enumerate(objects):
            yield f"instantiation.{name}[{number}]", described, known.get(name)


def _object_problems(scenario: Scenario, template: Template) -> Iterator[Found]:
    for path, described, group in _objects(scenario, template):
        if group is None:
            continue
        text = described.asset_query if head_nouns(described.asset_query) else described.description
        if not belongs(text, described.tags, group.allowed_types):
            allowed = ", ".join(group.allowed_types)
            problem = f"{described.asset_query!r} is not of an allowed type of the group {group.group_id!r}"
            yield f"{path}.asset_query", problem, f"Choose an object of one of these types: {allowed}"
        lifted = group.role in ("item", "distractor")
        yield from _size_problems(path, described, lifted=lifted)
        yield from _mass_problems(path, described, lifted=lifted)


def _size_problems(path: str, described: DescribedObject, *, lifted: bool) -> Iterator[Found]:
    low, high = described.size_m
    path = f"{path}.estimated_size"
    shown, middle = f"[{low:g}, {high:g}] m", 0.5 * (low + high)
    usual = kind_of(described.asset_query)
    most = LARGEST_ITEM_M if lifted else MOST_M
    if middle < LEAST_M:
        yield path, f"{shown} is too small to be seen and grasped", f"Give at least {LEAST_M:g} m, in meters"
    elif high > most:
        reason = "leave the items room on the table" if lifted else "stand on the table in view"
        yield path, f"{shown} is too large to {reason}", f"Give at most {most:g} m, in meters, or a smaller object"
    elif lifted and _is_round(described) and middle > gripper_opening_m():
        cure = f"The gripper opens {gripper_opening_m():g} m, so give at most that, or an object with a thinner part"
        yield path, f"{shown} does not fit between the fingers, because the object is round", cure
    elif usual is not None and not (high * SIZE_SLACK >= usual.low_m and low <= SIZE_SLACK * usual.high_m):
        cure = f"The largest dimension is usually {usual.low_m:g} to {usual.high_m:g} m; give it in meters"
        yield path, f"{shown} is not a usual size of {described.asset_query!r}", cure


def _mass_problems(path: str, described: DescribedObject, *, lifted: bool) -> Iterator[Found]:
    low, high = described.mass_kg
    path = f"{path}.estimated_mass"
    shown, usual = f"[{low:g}, {high:g}] kg", kind_of(described.asset_query)
    most = PAYLOAD_KG if lifted else HEAVIEST_FIXTURE_KG
    if high > most:
        cure = f"Give at most {most:g} kg" + (", the payload of the arm with its gripper" if lifted else "")
        yield path, f"{shown} is too heavy", cure
    elif low > MOST_DENSITY * described.size_m[1] ** 3:
        yield path, f"{shown} is heavier than solid brass of this size", "Give masses in kilograms and sizes in meters"
    elif usual is not None and low > MASS_FACTOR * usual.mass_at(max(described.size_m[1], usual.middle_m)):
        cure = f"It is usually about {usual.mass_kg:g} kg; give it in kilograms"
        yield path, f"{shown} is not a usual mass of {described.asset_query!r}", cure


def _is_round(described: DescribedObject) -> bool:
    return any(head in _ROUND for head in head_nouns(described.asset_query))


def _mixture_problems(scenario: Scenario, template: Template) -> Iterator[Found]:
    for group in template.groups:
        if group.role != "item":
            continue
        seen: dict[str, str] = {}
        for number, described in enumerate(scenario.groups.get(group.group_id, ())):
            domain = domain_of(described.asset_query)
            other = next((d for d in seen if d != domain), None) if domain else None
            if other is not None:
                problem = f"{described.asset_query!r} ({domain}) does not belong with {seen[other]!r} ({other})"
                yield f"instantiation.{group.group_id}[{number}]", problem, "Choose items that belong together"
            elif domain:
                seen[domain] = described.asset_query


def _receiver_problems(scenario: Scenario, template: Template) -> Iterator[Found]:
    """Check that containers are larger than the items that go into them."""
    if template.relation != "inside":
        return
    roles = {group.group_id: group.role for group in template.groups}
    items = [o for name, objects in scenario.groups.items() if roles[name] == "item" for o in objects]
    largest = max(items, key=lambda o: o.size_m[1])
    for path, described, group in _objects(scenario, template):
        receives = group is not None and group.role in ("container", "drawer")
        if receives and 0.5 * sum(described.size_m) <= 0.5 * sum(largest.size_m):
            problem = f"{list(described.size_m)} m is not larger than {largest.instance_name!r}, which goes into it"
            yield f"{path}.estimated_size", problem, "Give a larger container or smaller items"
