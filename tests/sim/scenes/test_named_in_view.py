"""What an instruction names can be seen and told apart in the image of the front camera at the start."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from tests.daily import others_slow

from betterbench.interface.actions import EE_DELTA
from betterbench.sim.scenes import Renderer, Scene
from betterbench.sim.scenes.cameras import camera_matrices
from betterbench.sim.scenes.stage import quality_preset
from betterbench.tasks import Condition, get_task
from betterbench.tasks.authoring.registry import all_tasks
from betterbench.tasks.interventions import vary
from betterbench.tasks.judging.targets import asked_by

SIZE = 256
LEAST_PX = 150
STACKED_PX = 400
"""Pixels of a plate that is named and has another plate on it."""
APART_PX = 30
"""Rows of the image between the handles of two closed drawers, which are 10 to 15 rows high."""


def conditions_of(task_id: str) -> Iterator[Condition]:
    task = get_task(task_id)
    yield from task.training
    yield from (vary(task, variation)[0] for variation in task.variations)


def scene_of(condition: Condition, seed: int = 0) -> Scene:
    task, fast = get_task(condition.task), quality_preset("fast")
    scene = Scene(task, condition, seed=seed, action_space=EE_DELTA, quality=fast)
    scene.reset(check_premise=False)
    return scene


def shown_pixels(scene: Scene) -> dict[str, int]:
    """Returns the pixels that show of each object."""
    with Renderer(scene.model, width=SIZE, height=SIZE, quality=scene.quality) as renderer:
        view = renderer.render(scene.data, "front", masks=True)
    assert view.masks is not None
    placed = zip(scene.compiled.bodies, scene.placements, strict=True)
    return {p.spec.name: int(np.count_nonzero(view.masks == int(body))) for body, p in placed}


@pytest.mark.render
@pytest.mark.parametrize("task_id", others_slow((task.id for task in all_tasks()), 2))
def test_every_object_that_an_instruction_names_can_be_seen(task_id):
    for condition in conditions_of(task_id):
        shown = shown_pixels(scene_of(condition))
        for name in {n for a in asked_by(condition) for n in (*a.candidates, a.target)}:
            assert shown[name] >= LEAST_PX, (condition.name, name, shown[name])


@pytest.mark.render
@pytest.mark.parametrize("seed", [0, 1, 2])
@pytest.mark.parametrize("name", ["train3", "train6", "T2"])
def test_the_white_plate_shows_under_the_red_one(name, seed):
    condition = next(c for c in conditions_of("dinner_plates") if c.name.endswith(name))
    assert condition.preplaced
    assert shown_pixels(scene_of(condition, seed))["white_plate"] >= STACKED_PX


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_the_handle_of_the_upper_drawer_is_above_that_of_the_lower_one_in_the_image(seed):
    for condition in conditions_of("office_drawer"):
        scene = scene_of(condition, seed)
        if condition.opened:
            continue
        state = scene.state()
        knobs = [state.pose(n).apply(state.info.object(n).region("knob").position) for n in ("upper", "lower")]
        camera = camera_matrices(scene.model, scene.data, "front", width=SIZE, height=SIZE)
        (_, upper), (_, lower) = camera.project(np.array(knobs))[0]
        assert lower - upper >= APART_PX, (condition.name, upper, lower)
