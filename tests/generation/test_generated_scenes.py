"""Scenes of generated tasks: twins, framing and rest at the start, and the certificate of every cast."""

from __future__ import annotations

import json
import subprocess
import sys

import pytest
from tests.generation.casting import CASTS, SUITE
from tests.generation.test_fixture_patterns import registered

from betterbench.interface.actions import EE_DELTA
from betterbench.sim.scenes import Scene
from betterbench.sim.scenes.framing import (
    BACKGROUND,
    GRIPPER_PX,
    MARGIN_M,
    SIDE_PX,
    VISIBLE,
    FramingView,
    least_margin_m,
)
from betterbench.sim.scenes.stage import QUALITIES
from betterbench.tasks import task_to_json
from betterbench.tasks.interventions import vary

SHOWN = ("mugs_and_a_bystander", "block_and_stapler", "steel_jars")
"""Casts with an object that stands aside, one per pattern."""


def scene(task, condition, seed=0):
    return Scene(task, condition, seed=seed, action_space=EE_DELTA, quality=QUALITIES["fast"])


@pytest.mark.parametrize("name", SHOWN)
def test_a_trial_and_its_twin_differ_in_what_the_variation_names_alone(name):
    task = registered(name)
    variation = task.variation("L1")
    condition, changes = vary(task, variation)
    a, b = (scene(task, c).reset(check_premise=False) for c in (condition, task.train(variation.base)))
    assert a.joint_positions == b.joint_positions
    for spec in condition.objects:
        if spec.name not in changes.objects:
            assert a.pose(spec.name) == b.pose(spec.name)
    assert condition != task.train(variation.base)


@pytest.mark.parametrize("name", SHOWN)
def test_a_start_is_in_view_and_touches_nothing(name):
    task = registered(name)
    start = scene(task, task.training[0], seed=1)
    state = start.reset(check_premise=False)
    names = [o.name for o in state.info.objects if not o.fixed and o.role != "drawer"]
    assert not [(a, b) for a in names for b in names if a != b and state.touching(a, b)]
    assert least_margin_m(start) >= MARGIN_M
    view = FramingView(start)
    shown = view.start()
    view.close()
    assert shown.gripper_px >= GRIPPER_PX
    assert shown.background <= BACKGROUND
    assert all(o.side_px >= SIDE_PX and o.visible >= VISIBLE for o in shown.asked)


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in CASTS if name not in SUITE])
def test_every_condition_of_a_generated_task_is_certified(name, tmp_path):
    """Like the generator, measure three times the demonstrations if a pose is outside the training distribution.

    The commands run in processes of their own, because a loaded task stays registered.
    """
    refused = refusals(name, 36, tmp_path / "first")
    if {clause for _, clause, _ in refused} == {"b"}:
        refused = refusals(name, 108, tmp_path / "second")
    assert refused == []


def refusals(name, demonstrations, folder):
    """Return the condition, the clause and the text of each failed clause."""
    folder.mkdir()
    file = folder / f"{name}.json"
    file.write_text(json.dumps(task_to_json(registered(name, f"made_{name}"))))
    common = ("--task-file", file, "--tasks", f"made_{name}", "--workers", 1, "--out")
    better("certify", *common, folder / "measured", "--demonstrations", demonstrations)
    found = json.loads(better("certify", *common, folder / "certificate", "--trials", 1, "--json"))
    return [
        (trial["condition"], clause, text["text"])
        for trial in found["trials"]
        for clause, text in trial["clauses"].items()
        if not text["passed"]
    ]


def better(*arguments):
    """Run the command and return what it prints."""
    words = [sys.executable, "-m", "betterbench.cli", *map(str, arguments)]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout
