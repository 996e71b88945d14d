"""Tasks laid out for another robot: where its base stands, and what it grasps and solves there."""

from __future__ import annotations

import dataclasses
import json
import math

import pytest

from betterbench.certification import placing
from betterbench.certification.placing import Feasibility, GraspCount, measure_feasibility, place_task, ring_of
from betterbench.cli.main import main
from betterbench.errors import InvalidInputError
from betterbench.policies.experts import privileged
from betterbench.sim.robots import ArmIK, robot, robot_names
from betterbench.tasks import get_task, suite_of, suite_tasks, task_from_json, task_to_json

SO101 = robot("so101")


def gaps(task):
    """Distances between all slots of a task [m]."""
    return [math.dist((a.x, a.y), (b.x, b.y)) for a in task.slots for b in task.slots]


@pytest.mark.parametrize("name", suite_tasks("better60"))
def test_a_placed_task_is_the_task_from_another_base(name):
    task = get_task(name)
    placed = place_task(task, SO101)
    ending = "_placed" if suite_of(f"{name}_so101") else ""
    assert (placed.task.id, placed.task.robot, placed.task.version) == (f"{name}_so101{ending}", "so101", 1)
    assert gaps(placed.task) == pytest.approx(gaps(task), abs=1e-6)
    x, y = placed.base_m
    assert placed.task.slots[0].x == pytest.approx(task.slots[0].x - x)
    assert placed.task.slots[0].y == pytest.approx(task.slots[0].y - y)
    assert [v.name for v in placed.task.variations] == [v.name for v in task.variations]
    assert task_from_json(json.dumps(task_to_json(placed.task))) == placed.task
    near, far = ring_of(SO101)
    cx, cy, _ = SO101.steering.center
    apart = [s.name for s in placed.task.slots if not near <= math.hypot(s.x - cx, s.y - cy) <= far]
    assert set(apart) <= set(placed.outside)


def test_a_packaged_layout_has_the_distances_of_its_task_scaled_and_only_slots_within_reach():
    task, packaged = get_task("cheeseburger"), get_task("cheeseburger_so101")
    assert gaps(packaged) == pytest.approx([0.85 * gap for gap in gaps(task)], abs=2e-4)
    assert [c.instruction for c in packaged.training] == [c.instruction for c in task.training]
    assert [(v.name, v.title) for v in packaged.variations] == [(v.name, v.title) for v in task.variations]
    assert {c.task for c in packaged.training} == {"cheeseburger_so101"}
    near, far = ring_of(SO101)
    x, y, _ = SO101.steering.center
    assert all(near <= math.hypot(s.x - x, s.y - y) <= far for s in packaged.slots)
    tool = ArmIK(SO101).forward(SO101.home_joints).position
    assert all(math.dist((s.x, s.y), tool[:2]) > 0.06 for s in packaged.slots)


@pytest.mark.parametrize("name", robot_names())
def test_a_robot_reaches_the_ring_in_which_slots_are_placed(name):
    spec, ik = robot(name), ArmIK(robot(name))
    near, far = ring_of(spec)
    for radius in (near, 0.93 * far):  # the edge of the reach is not exactly a sphere
        x, y, _ = spec.steering.center
        home = ik.forward(ik.home)
        found = ik.reach(ik.home, dataclasses.replace(home, position=(x + radius, y, placing.OBJECT_HEIGHT_M)))
        assert found.position_error_m < 1e-3, radius


def test_an_arm_with_a_short_reach_says_which_slots_are_out_of_it():
    placed = place_task(get_task("breakfast_table"), SO101)
    assert len(placed.outside) >= 3
    assert place_task(get_task("cheeseburger"), SO101).outside == ()


def test_a_task_of_the_robot_is_refused():
    with pytest.raises(InvalidInputError, match="fruit_basket is already laid out for robot 'so101'"):
        place_task(get_task("fruit_basket"), SO101)


@pytest.mark.physics
def test_feasibility_names_what_the_arm_cannot_reach_and_what_it_can(monkeypatch):
    task = place_task(get_task("morning_coffee"), SO101).task
    one = dataclasses.replace(task, training=task.training[:1])
    told = []
    found = measure_feasibility(one, seeds=1, on_trial=lambda: told.append(1))
    assert (found.trials, len(told)) == (1, 1)
    assert found.grasps == (GraspCount("red_mug", 1, 1, ""),)
    monkeypatch.setattr(privileged, "MAX_DECISIONS", 1)  # each plans every grasp again
    far = dataclasses.replace(one, slots=tuple(dataclasses.replace(s, x=s.x + 0.4) for s in one.slots))
    found = measure_feasibility(far, seeds=1)
    assert (found.solved, found.grasps[0].planned) == (0, 0)
    assert "m is out of reach of the SO-101 follower arm" in found.grasps[0].reason
    assert "not solved after" in found.problem


@pytest.fixture
def measured(monkeypatch):
    """A measurement that takes no time."""
    grasps = (GraspCount("bun", 1, 2, "bun at (0.5, 0.1, 0.0) m is out of reach of it"), GraspCount("patty", 2, 2, ""))
    monkeypatch.setattr(placing, "measure_feasibility", lambda *_, **__: Feasibility(1, 2, grasps, "not solved"))


@pytest.mark.usefixtures("measured")
def test_the_verb_writes_task_files_and_tells_the_numbers(tmp_path, capsys):
    out = tmp_path / "placed"
    words = ["place", "--robot", "so101", "--tasks", "cheeseburger", "--out", str(out)]
    assert main(words) == 0
    said = capsys.readouterr().out
    assert "3 of 4" in said
    assert "1 of 2" in said
    assert "out of reach of it" in " ".join(said.split())
    file = out / "cheeseburger_so101_placed.json"
    assert task_from_json(file.read_text()).robot == "so101"
    assert main([*words, "--json"]) == 0
    form = json.loads(capsys.readouterr().out)
    assert form["robot"] == "so101"
    assert form["tasks"][0]["grasps"][0]["name"] == "bun"
    assert form["tasks"][0]["base_m"] == list(place_task(get_task("cheeseburger"), SO101).base_m)


@pytest.mark.parametrize(
    ("given", "text"),
    [
        ([], "--robot: no robot was given"),
        (["--robot", "so100"], "Did you mean 'so101'"),
        (["--robot", "panda"], "already laid out for robot 'panda'"),
        (["--robot", "so101", "--tasks", "cheesburger"], "Did you mean 'cheeseburger'"),
        (["--robot", "so101", "--trials", "0"], "--trials: 0 is out of range"),
    ],
)
def test_wrong_input_is_one_line_and_nothing_is_written(given, text, tmp_path, capsys):
    assert main(["place", *given, "--out", str(tmp_path / "placed")]) == 2
    assert text in " ".join(capsys.readouterr().err.split())
    assert not (tmp_path / "placed").exists()
