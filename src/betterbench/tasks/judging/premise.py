"""Check that the initial scene of an episode satisfies the premises of the instruction."""

from collections import Counter

from betterbench.geometry import horizontal_distance
from betterbench.interface.state import WorldState
from betterbench.tasks.axes import Expected
from betterbench.tasks.condition import Condition
from betterbench.tasks.relations import RELATIONS, relation, upright
from betterbench.tasks.relations.closed import GAP, opening_m

SLOT_TOLERANCE_M = 0.04
"""Distance from its slot beyond which an object counts as outside the slot [m].

It is the sum of the jitter (15 mm to each side) and a margin for settling.
"""


def broken_premises(condition: Condition, state: WorldState) -> tuple[str, ...]:
    """Return one sentence for each premise of the instruction that the scene violates at reset."""
    problems: list[str] = []
    info = state.info
    for name, slot in condition.layout.items():
        if horizontal_distance(state.pose(name).position, info.slot(slot).position) > SLOT_TOLERANCE_M:
            problems.append(f"{name} does not stand in its slot {slot!r}")
    shared = Counter(condition.preplaced.values())
    for o in info.objects:
        place = condition.preplaced.get(o.name)
        if place is not None and shared[place] > 1:
            continue  # objects that a demonstration left together in one container lean on each other
        if not o.fixed and not upright(state, o.name):
            problems.append(f"{o.name} does not stand upright")
    for name, place in condition.preplaced.items():
        if not any(
            kind.regions(info.object(place.target)) and kind.holds(state, name, place.target, place.region)
            for kind in RELATIONS.values()
        ):
            where = " ".join(part for part in (place.target, place.region) if part)
            problems.append(f"{name} is not at {where} although it was placed there")
    problems += _drawers_not_as_asked(condition, state)
    if condition.premise_broken:
        return tuple(problems)
    done = 0
    for goal in condition.instruction.subgoals:
        names = condition.resolve(goal.reference)
        if len(names) < goal.count:
            problems.append(f"the instruction names {goal.word!r}, but the scene has {len(names)} of {goal.count}")
            continue
        if goal.region not in relation(goal.relation).regions(info.object(goal.target)):
            region = f"the region {goal.region!r}" if goal.region else "a region"
            problems.append(f"the asset of the target {goal.target} lacks {region} for the relation {goal.relation}")
            continue
        there = sum(relation(goal.relation).holds(state, name, goal.target, goal.region) for name in names)
        done += there >= goal.count
    if condition.expected is Expected.STAY_STILL and done < len(condition.instruction.subgoals):
        problems.append("nothing should be left to do, but a subgoal is open")
    if condition.expected is Expected.SUCCEED and done == len(condition.instruction.subgoals):
        problems.append("the goal is already reached")
    return tuple(problems)


def _drawers_not_as_asked(condition: Condition, state: WorldState) -> list[str]:
    problems = []
    for spec in condition.objects:
        opening = condition.opened.get(spec.name, 0.0)
        if spec.mount is not None and abs(opening_m(state, spec) - opening) > GAP:
            problems.append(f"{spec.name} is not drawn out by {opening:.3f} m")
    return problems
