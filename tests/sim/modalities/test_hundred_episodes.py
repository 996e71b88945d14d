"""A hundred episodes of all tasks: in every frame of both cameras masks, boxes and depth agree, also with rays."""

from __future__ import annotations

import logging

import numpy as np
import pytest
from tests.sim.modalities.agreement import (
    Rays,
    boxes_fit_the_masks,
    centers_lie_in_the_boxes,
    pixels_off_the_objects,
)

from betterbench.evaluation import evaluate, make_plan
from betterbench.records.modalities.file import ModalityFile
from betterbench.records.modalities.spec import ViewSpec
from betterbench.sim.modalities.folder import Wanted
from betterbench.sim.modalities.run import materialize_run
from betterbench.tasks import suite_tasks

pytestmark = [pytest.mark.physics, pytest.mark.render, pytest.mark.slow]

_LOG = logging.getLogger(__name__)
VIEWS = (ViewSpec("front"), ViewSpec("wrist"))
MODALITIES = ("depth", "instances", "semantics", "boxes")
RAYS = 10
"""Of each frame."""


@pytest.mark.parametrize("task", suite_tasks("better60"))
def test_every_frame_agrees_with_itself_and_with_rays(task, tmp_path):
    """Ten episodes of a task: variations, training conditions, one policy that is right and one that is not."""
    draw = np.random.default_rng(5)
    episodes = frames = seen = agreed = 0
    off = np.zeros(2, dtype=int)
    for number, policy in enumerate(("expert", "zoo:lexical")):
        plan = make_plan(policy, tasks=(task,), trials=1, seed=40, observation="state_only", quality="fast")
        run = evaluate(plan, tmp_path / str(number) / "run")
        trials = [entry.key for entry in run.entries()][number::2][:5]
        out = tmp_path / str(number) / "modalities"
        materialize_run(run, out, Wanted(VIEWS, MODALITIES), trials=trials)
        for trial in trials:
            episodes += 1
            rays = Rays(run, run.read_record(trial.task, trial.condition, trial.seed))
            for view in VIEWS:
                with ModalityFile(
                    out / trial.task / trial.condition / str(trial.seed) / f"{view.name}.parquet"
                ) as file:
                    for values in file.rows():
                        frames += 1
                        seen += boxes_fit_the_masks(file.header, values)
                        centers_lie_in_the_boxes(file.header, values)
                        off += np.array(pixels_off_the_objects(file.header, values))
                        agreed += rays.agreeing(file.header, values, draw, pixels=RAYS)
    said = f"{task}: {episodes} episodes, {frames} frames, {seen} boxes, rays {agreed}/{RAYS * frames}, off {off}"
    _LOG.info(said)
    assert episodes == 10
    assert seen > frames
    # The rest are pixels at an edge, whose ray passes the other side of it by a rounding error.
    assert agreed >= 0.99 * RAYS * frames, said
    # A triangle that is seen from its edge has no depth at the center of a pixel that it hardly covers.
    assert off[0] <= 1e-6 * off[1], said
