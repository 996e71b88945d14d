"""Variety: what counts as different in two demonstrations, and that amplified ones are as varied as their sources."""

from __future__ import annotations

import itertools
import json
import math
from dataclasses import replace

import numpy as np
import pytest

from betterbench.cli.main import main
from betterbench.demonstrations.making.acceptance import acceptance_of, write_acceptance
from betterbench.demonstrations.making.amplifier import AmplifierSettings
from betterbench.demonstrations.making.attempt import amplify_attempt
from betterbench.demonstrations.making.production import amplify, collect, scene_of
from betterbench.demonstrations.making.sources import demonstrated_source, load_library
from betterbench.demonstrations.making.transit import (
    MOST_STEP_M,
    MOST_STEP_RAD,
    TransitChange,
    carry_transit,
    checkpoints,
    retimed,
)
from betterbench.demonstrations.making.variety import SPREADS, VarietyMeter, variety_of_run
from betterbench.geometry import Pose, angle_between, distance, from_yaw
from betterbench.sim.robots import PANDA
from betterbench.tasks import TrialId

pytestmark = pytest.mark.physics
TASK = "morning_coffee"


@pytest.fixture(scope="module")
def record(sources):
    return next(iter(sources.records()))


@pytest.fixture(scope="module")
def pick(record):
    return demonstrated_source(record).skills[0]


def spread_of(*records):
    meter = VarietyMeter()
    for record in records:
        meter.add(record)
    (task,) = meter.tasks()
    return task


def shifted(record, shift: Pose):
    """The same motion with everything in the scene moved, as another draw of a slot's jitter moves it."""
    turned = [[(shift @ Pose(tuple(p), tuple(q))) for p, q in zip(ps, qs, strict=True)] for ps, qs in both(record)]
    tools = zip(record.ee_position.tolist(), record.ee_quaternion.tolist(), strict=True)
    tool = [shift @ Pose(tuple(p), tuple(q)) for p, q in tools]
    return replace(
        record,
        object_positions=np.array([[p.position for p in row] for row in turned]),
        object_quaternions=np.array([[p.quaternion for p in row] for row in turned]),
        ee_position=np.array([p.position for p in tool]),
        ee_quaternion=np.array([p.quaternion for p in tool]),
    )


def both(record):
    return zip(record.object_positions.tolist(), record.object_quaternions.tolist(), strict=True)


def test_one_path_to_another_start_is_no_variety(record):
    task = spread_of(record, shifted(record, Pose((0.02, -0.015, 0.0))))
    assert [m.demonstrations for m in task.motions] == [2] * len(task.motions)
    assert {m.skill for m in task.motions} == {"pick", "place"}
    for name in SPREADS:
        assert getattr(task.spread, name) == pytest.approx(0.0, abs=2e-3), name


def test_each_number_measures_what_it_is_named_after(record):
    """A bump in the middle of the way, two seconds more of time and another grasp show in their own numbers alone."""
    pick = spread_of(record, record).motions[0]
    window = next(s for segment in record.metadata.segments for s in segment.skills if s.kind == "pick")
    rows = np.arange(len(record))
    bump = np.where(rows < window.change - 30, np.sin(np.pi * np.clip(rows / (window.change - 30), 0, 1)), 0.0)
    raised = record.ee_position + 0.05 * bump[:, None] * [0.0, 0.0, 1.0]
    higher = spread_of(record, replace(record, ee_position=raised)).motions[0]
    assert pick.skill == higher.skill == "pick"
    assert 1.0 < higher.spread.height_cm <= 5.0
    assert higher.spread.path_cm > 1.0
    assert higher.spread.side_cm < 0.5
    assert higher.spread.grasp_cm == higher.spread.grasp_deg == higher.spread.duration_s == 0.0
    slower = spread_of(record, replace(record, time=1.5 * record.time)).motions[0]
    assert slower.spread.duration_s == pytest.approx(0.5 * record.time[window.change - 1], abs=1e-3)
    assert slower.spread.path_cm == 0.0


def test_a_failure_and_a_single_demonstration_are_not_compared(record):
    meter = VarietyMeter()
    meter.add(record)
    meter.add(replace(record, outcome=replace(record.outcome, success=False)))
    assert meter.tasks() == ()


def test_a_way_between_its_own_ends_is_what_it_was(pick):
    whole = (*pick.lead_in, *pick.targets[:3])
    again = carry_transit(pick, 2, whole[0], whole[-1], TransitChange())
    assert len(again) == len(whole)
    assert max(distance(a.position, b.position) for a, b in zip(again, whole, strict=True)) < 1e-9


def test_a_way_begins_and_ends_where_it_is_asked_to_and_keeps_its_height(pick):
    whole = (*pick.lead_in, *pick.targets[:3])
    start = Pose((whole[0].position[0] - 0.02, whole[0].position[1] + 0.03, whole[0].position[2]), from_yaw(0.3))
    goal = Pose((whole[-1].position[0] + 0.03, whole[-1].position[1], whole[-1].position[2]), from_yaw(-0.2))
    for change in (TransitChange(), TransitChange(0.03, 0.04, 1.3), TransitChange(-0.03, -0.02, 0.8)):
        way = carry_transit(pick, 2, start, goal, change)
        for found, wanted in ((way[0], start), (way[-1], goal)):
            assert distance(found.position, wanted.position) < 1e-9
            assert angle_between(found.quaternion, wanted.quaternion) < 1e-6
        steps = list(itertools.pairwise(way))
        assert max(distance(a.position, b.position) for a, b in steps) <= 1.02 * MOST_STEP_M
        assert max(angle_between(a.quaternion, b.quaternion) for a, b in steps) <= 1.02 * MOST_STEP_RAD
        seen = checkpoints(way, PANDA.workspace.check_step_m)
        assert (seen[0], seen[-1]) == (way[0], way[-1])
        longest = max(distance(a.position, b.position) for a, b in itertools.pairwise(seen))
        assert longest <= max(PANDA.workspace.check_step_m, 1.02 * MOST_STEP_M)
    plain, raised = (carry_transit(pick, 2, start, goal, TransitChange(0.0, z)) for z in (0.0, 0.04))
    highest = [max(p.position[2] for p in way) for way in (plain, raised)]
    assert highest[0] == pytest.approx(max(p.position[2] for p in whole), abs=0.01)
    assert 0.01 < highest[1] - highest[0] <= 0.04


def test_a_way_that_is_no_longer_that_of_its_source_is_not_carried_over(pick):
    start, goal = pick.lead_in[0], pick.targets[2]
    far = Pose(tuple(s + 3.0 * (g - s) for s, g in zip(start.position, goal.position, strict=True)), goal.quaternion)
    assert carry_transit(pick, 2, start, far, TransitChange()) is None
    missed = replace(pick, lead_in=None)
    assert carry_transit(missed, 2, start, goal, TransitChange()) is None


@pytest.mark.parametrize("faster", [0.6, 1.0, 1.4])
def test_a_way_at_another_speed_passes_the_same_points(faster):
    way = [Pose((0.01 * i, 0.002 * math.sin(0.4 * i), 0.3)) for i in range(40)]
    found = retimed(way, faster)
    assert (found[0], found[-1]) == (way[0], way[-1])
    assert len(found) - 1 == math.ceil(39 / faster - 1e-9)
    for pose in found:
        assert min(distance(pose.position, p.position) for p in way) < 0.006


def test_attempts_at_one_start_differ_in_path_height_and_side(sources):
    """Where the planner alone found the ways, path, height and side differed by 1.1, 0.2 and 0.2 cm here."""
    library = load_library(sources, TASK)
    scene = scene_of(TrialId(TASK, "train1", 1_000_000_100), "fast", "panda")
    attempts = [amplify_attempt(scene, number, library, AmplifierSettings()) for number in range(4)]
    done = [a.record for a in attempts if a.note.accepted]
    assert len(done) >= 3
    assert len({source for a in attempts for source in a.note.sources}) > 1
    spread = spread_of(*done).spread
    assert spread.path_cm > 1.5
    assert spread.height_cm > 0.6
    assert spread.side_cm > 1.0


def test_the_report_says_where_nothing_can_be_compared(amplified):
    assert acceptance_of(amplified).variety == ()  # of each condition there is one
    page = write_acceptance(amplified, acceptance_of(amplified), {}, {}).read_text()
    assert "No condition has two demonstrations that could be compared." in page


@pytest.mark.slow
def test_amplified_demonstrations_are_as_varied_as_their_sources(tmp_path, capsys):
    """Before, height, side and duration were 0.2 to 0.7 of those of the sources, and paths half as far apart."""
    few = collect([TASK], tmp_path / "sources", demos=5)
    many = amplify(few.path, tmp_path / "amplified", demos=8)
    found = acceptance_of(many)
    (theirs,), (own,) = found.sources, found.variety
    assert found.sources == variety_of_run(few)
    # Grasps are those of the sources: of pairs drawn from 5 sources, a fifth has one source and the same grasp.
    drawn = {name: 4 / 5 if name == "grasp_deg" else 1.0 for name in SPREADS}
    for name, share in drawn.items():
        assert getattr(own.spread, name) >= 0.9 * share * getattr(theirs.spread, name), name
    page = write_acceptance(many, found, {}, {}).read_text()
    assert f"| {TASK} | sources | {theirs.spread.path_cm:.2f} |" in page
    assert f"| {TASK} | set | {own.spread.path_cm:.2f} |" in page
    form = json.loads((many.path / "acceptance" / "acceptance.json").read_text())
    assert form["variety"][0]["spread"]["path_cm"] == own.spread.path_cm
    assert form["sources"][0]["spread"]["path_cm"] == theirs.spread.path_cm
    assert main(["shortcuts", str(many.path)]) == 0
    assert "variety: mean difference between two demonstrations" in capsys.readouterr().out
    moved = few.path.rename(tmp_path / "elsewhere")
    assert acceptance_of(many).sources == () != variety_of_run(type(few).open(moved))
