"""States that were arranged by hand in real scenes, each with the verdict that a person would give.

The tables are data: ``truth_table.txt`` for relations, ``harm_table.txt`` for what no success may do.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import fields, replace
from pathlib import Path
from typing import NamedTuple

import pytest
from tests.looping import each
from tests.tasks.arranging import condition_of, one_step_before, states_of

from betterbench.geometry import Pose, from_yaw
from betterbench.interface.state import WorldState
from betterbench.tasks import GoalTracker, get_task
from betterbench.tasks.judging.harm import HarmWatch
from betterbench.tasks.judging.targets import Targets, asked_by
from betterbench.tasks.relations import RELATIONS, RestWatch, relation, released

HERE = Path(__file__).parent


def lines_of(name: str) -> list[list[str]]:
    text = (HERE / name).read_text()
    lines = [line for line in text.splitlines() if line.strip() and not line.startswith("#")]
    return [[cell.strip() for cell in line.split("|")] for line in lines]


class Line(NamedTuple):
    relation: str
    setting: str
    pair: str
    arrangement: str
    there: str
    done: str
    anyhow: str
    why: str


LINES = [Line(*cells) for cells in lines_of("truth_table.txt")]
HARMS = lines_of("harm_table.txt")


def verdict(place: str | None) -> str:
    return "no" if place is None else place or "yes"


@each("line", LINES)
def test_a_relation_says_what_a_person_would_say(line):
    thing, target = line.pair.split(" > ")
    _, state = states_of(line.setting, line.arrangement)
    kind = relation(line.relation)
    place = kind.where(state, thing, target)
    rest = RestWatch(rate_hz=20.0)
    rest.see(one_step_before(state, line.arrangement))
    rest.see(state)
    done = place is not None and rest.at_rest(thing) and released(state, thing)
    found = (verdict(place), "yes" if done else "no", verdict(kind.anyhow(state, thing, target)))
    assert found == (line.there, line.done, line.anyhow), f"{line.why}: {state.pose(thing)}"


def test_a_relation_reads_poses_contacts_and_what_is_held_and_nothing_else():
    # The goal tracker asks relations again only where one of these has changed.
    moved = Pose((0.3, 0.3, 0.6), from_yaw(1.0))
    for line in LINES:
        thing, target = line.pair.split(" > ")
        _, state = states_of(line.setting, line.arrangement)
        other = replace(
            state,
            step=state.step + 7,
            time_s=state.time_s + 1.0,
            linear_speeds=tuple(v + 1.0 for v in state.linear_speeds),
            angular_speeds=tuple(v + 1.0 for v in state.angular_speeds),
            ee_pose=moved,
            commanded_pose=moved,
            finger_width_m=0.5 * state.finger_width_m,
            gripper_command=-state.gripper_command,
            joint_positions=tuple(v + 0.1 for v in state.joint_positions),
            joint_velocities=tuple(v + 0.1 for v in state.joint_velocities),
            contacts=tuple(c._replace(force_n=c.force_n + 5.0) for c in state.contacts),
        )
        same = {f.name for f in fields(WorldState) if getattr(other, f.name) == getattr(state, f.name)}
        assert same <= {"info", "positions", "quaternions", "held", "gripper_command"}, same
        where = relation(line.relation).where
        assert where(other, thing, target) == where(state, thing, target), line


@each("cells", HARMS)
def test_a_success_does_no_harm(cells):
    setting, arrangement, goal, _ = cells
    start, state = states_of(setting, arrangement)
    condition = condition_of(setting)
    tracker = GoalTracker(condition, state.info, template=get_task(condition.task).template, control_rate_hz=20.0)
    tracker.update(start)
    for _ in range(6):  # a quarter second after it was put there, everything is at rest
        truth = tracker.update(state)
    assert truth.goal is (goal == "yes"), truth


@pytest.mark.parametrize(
    ("arrangement", "sort", "words"),
    [
        (
            "white_plate blue_plate z=-12; blue_plate white_plate.floor",
            "target_brought",
            "the white plate was brought to the blue plate without being requested",
        ),
        (
            "blue_plate white_plate.floor",
            "at_the_target",
            "the blue plate is at the white plate without being requested there",
        ),
    ],
)
def test_what_was_brought_is_named_as_what_was_brought(arrangement, sort, words):
    start, state = states_of("dinner_plates/train1", arrangement)
    condition = condition_of("dinner_plates/train1")
    asked = asked_by(condition)
    template = get_task(condition.task).template
    targets = Targets(asked, state.info, placing=template.relation)
    watch = HarmWatch(asked, targets, state.info, exclusive=template.exclusive)
    for seen in (start, state):
        watch.see(seen, targets.places(seen))
    found = {h.sort: h.words(state.info) for h in watch.found(state, targets.places(state))}
    assert found[sort] == words


def test_the_tables_are_large_and_cover_every_relation_with_both_verdicts():
    assert len(LINES) + len(HARMS) >= 150
    counts = Counter((line.relation, line.there != "no") for line in LINES)
    for name in RELATIONS:
        assert counts[name, True] >= 3, name
        assert counts[name, False] >= 3, name
    assert len({(line.setting, line.pair, line.arrangement) for line in LINES}) == len(LINES)
