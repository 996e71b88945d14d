"""Stored scenes are opened in a limited process: forged ones cost it, and nobody else, their life."""

from __future__ import annotations

import contextlib
import os
import signal
import time

import numpy as np
import pytest

from betterbench.errors import RecordError
from betterbench.interface.actions import EE_DELTA
from betterbench.scenes import Scene, StoredView, limited, load_model
from betterbench.scenes.limited import LimitedView
from betterbench.scenes.stage import quality_preset
from betterbench.scenes.stored import MODEL_FILE
from betterbench.state import NO_JITTER
from betterbench.tasks import get_task

pytestmark = [pytest.mark.physics, pytest.mark.render]


@pytest.fixture(scope="module")
def scene():
    task = get_task("morning_coffee")
    return Scene(task, task.training[0], seed=0, action_space=EE_DELTA)


def test_it_draws_what_is_drawn_here_and_survives_every_forgery(scene):
    files, qpos = scene.files(), scene.data.qpos.copy()
    here = StoredView(load_model(files), quality_preset("fast"), width=64, height=64)
    expected = here.draw(qpos, "front", jitter=NO_JITTER).rgb
    here.close()
    with LimitedView(quality="fast", size=64) as view:
        view.open(files)
        np.testing.assert_array_equal(view.draw(qpos, "front", jitter=NO_JITTER), expected)
        with pytest.raises(RecordError, match="positions do not fit"):
            view.draw(qpos[:-1], "front", jitter=NO_JITTER)
        with pytest.raises(RecordError, match="nosuch"):
            view.draw(qpos, "nosuch", jitter=NO_JITTER)
        with pytest.raises(RecordError, match="stored scene"):
            view.open({**files, MODEL_FILE: files[MODEL_FILE][:1000]})
        view.open(files)
        np.testing.assert_array_equal(view.draw(qpos, "front", jitter=NO_JITTER), expected)


def test_a_forged_model_takes_nobody_along(scene, monkeypatch):
    draw, files = np.random.default_rng(7), scene.files()
    forged = bytearray(files[MODEL_FILE])
    for at in draw.integers(200, 20_000, 5_000):
        forged[at] = draw.integers(256)
    monkeypatch.setattr(limited, "REQUEST_S", 40.0)
    with LimitedView(quality="fast", size=64) as view, contextlib.suppress(RecordError):
        view.open({**files, MODEL_FILE: bytes(forged)})
        view.draw(scene.data.qpos, "front", jitter=NO_JITTER)
    assert view._process.returncode is not None


def test_a_process_that_crashes_or_hangs_is_one_clear_line(scene, monkeypatch):
    with LimitedView(quality="fast", size=64) as view:
        os.kill(view._process.pid, signal.SIGSEGV)
        with pytest.raises(RecordError, match=r"crashed.*damaged or forged"):
            view.open(scene.files())
    monkeypatch.setattr(limited, "REQUEST_S", 0.3)
    with LimitedView(quality="fast", size=64) as view:
        os.kill(view._process.pid, signal.SIGSTOP)
        began = time.monotonic()
        with pytest.raises(RecordError, match=r"nothing came of it.*too busy, or"):
            view.open(scene.files())  # more than a pipe holds
        assert time.monotonic() - began < 5.0
        assert view._process.returncode is not None
