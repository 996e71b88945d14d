"""Stored scenes are opened in a limited process: forged ones cost it, and nobody else, their life."""

from __future__ import annotations

import contextlib
import os
import re
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from tests.daily import others_slow

from betterbench.errors import RecordError
from betterbench.interface.actions import EE_DELTA
from betterbench.interface.state import NO_JITTER
from betterbench.jobs import limited_process
from betterbench.records.modalities.spec import ViewSpec
from betterbench.sim.scenes import Scene, StoredView, limited, load_model
from betterbench.sim.scenes.limited import LimitedView, LimitedViews
from betterbench.sim.scenes.stage import quality_preset
from betterbench.sim.scenes.stored import MODEL_FILE
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
        with pytest.raises(RecordError, match="positions for this scene"):
            view.draw(qpos[:-1], "front", jitter=NO_JITTER)
        with pytest.raises(RecordError, match="nosuch"):
            view.draw(qpos, "nosuch", jitter=NO_JITTER)
        with pytest.raises(RecordError, match="stored scene"):
            view.open({**files, MODEL_FILE: files[MODEL_FILE][:1000]})
        view.open(files)
        np.testing.assert_array_equal(view.draw(qpos, "front", jitter=NO_JITTER), expected)


def test_a_view_in_another_look_draws_what_a_new_one_draws(scene):
    """In one process, also after the death of the process, and a scene must be opened again."""
    files, qpos = scene.files(), scene.data.qpos.copy()
    looks = {("standard", 96): [], ("fast", 64): []}
    for (quality, size), expected in looks.items():
        here = StoredView(load_model(files), quality_preset(quality), width=size, height=size)
        expected.append(here.draw(qpos, "front", jitter=NO_JITTER).rgb)
        here.close()
    with LimitedViews() as views:
        (first,) = views.take(1, quality="standard", size=96)
        process = first.process_id
        for quality, size in [*looks, *looks]:
            view = views.take(2, quality=quality, size=size)[0]
            assert (view, view.size) == (first, size)
            with pytest.raises(RecordError, match="no scene is open"):
                view.draw(qpos, "front", jitter=NO_JITTER)
            view.open(files)
            np.testing.assert_array_equal(view.draw(qpos, "front", jitter=NO_JITTER), looks[quality, size][0])
        assert view.process_id == process
        os.kill(process, signal.SIGKILL)
        view.set_look(quality="standard", size=96)
        assert view.process_id != process
        view.open(files)
        np.testing.assert_array_equal(view.draw(qpos, "front", jitter=NO_JITTER), looks["standard", 96][0])
        taken = views.take(2, quality="standard", size=96)
        taken[0].close()
        again = views.take(1, quality="standard", size=96)
        assert again == [taken[1]]
        assert not again[0].is_closed
    assert all(view.is_closed for view in taken)


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


CRASHING = """
import os, signal
from betterbench.sim.scenes import limited
opened = limited.load_model
def crash(files):
    {how}
limited.load_model = crash
limited.draw_for_parent("fast", 64)
"""


@pytest.mark.parametrize(
    ("how", "said"),
    others_slow(
        [
            ("os.kill(os.getpid(), signal.SIGSEGV)", "crashed (SIGSEGV)"),
            ("os.kill(os.getpid(), signal.SIGKILL)", "was killed, perhaps because memory ran out"),
            ("signal.setitimer(signal.ITIMER_PROF, 0.2)\n    while True: pass", "took more than 60 s of CPU time"),
            ("os._exit(3)", "ended (exit status 3)"),
        ],
        4,
    ),
)
def test_a_scene_that_ends_each_process_is_one_clear_line(how, said, monkeypatch):
    started = []
    ordinary = subprocess.Popen

    def crashing(command, **options):
        started.append(command)
        return ordinary([sys.executable, "-c", CRASHING.format(how=how)], **options)

    monkeypatch.setattr(limited_process.subprocess, "Popen", crashing)
    with LimitedView(quality="fast", size=64) as view:
        with pytest.raises(RecordError, match=re.escape(said) + ".*damaged or forged"):
            view.open({"model.mjb": b"x"})
        assert view.is_closed
    assert len(started) == 2


WORKING = """
import resource, signal, time
from betterbench.sim.scenes import limited
def work(files):
    began = time.process_time()
    while time.process_time() - began < 0.1:
        pass
limited.load_model = work
limited.REQUEST_CPU_S = 0.2
time.process_time = lambda start=time.process_time: start() - {lag}
limited.draw_for_parent("fast", 64)
"""


@pytest.mark.parametrize("lag", [pytest.param(0.0, marks=pytest.mark.slow), 2.5])
def test_each_answer_has_its_own_time_on_whatever_clock_the_kernel_counts(lag, monkeypatch):
    """The kernel counts ticks, which run ahead of what Python tells: nobody asks what was used before."""
    ordinary = subprocess.Popen

    def working(command, **options):
        return ordinary([sys.executable, "-c", WORKING.format(lag=lag)], **options)

    monkeypatch.setattr(limited_process.subprocess, "Popen", working)
    with LimitedView(quality="fast", size=64) as view:
        first = view.process_id
        for _ in range(3):  # 0.3 s of CPU time in all
            view.open({"model.mjb": b"x"})
        assert view.process_id == first


def images(scene: Scene, hits: tuple[str, ...]) -> tuple[list[np.ndarray], int]:
    """Draws one image and a sequence of 24; the process is ended at the moments in ``hits``. Also counts processes."""
    files, rows = scene.files(), np.repeat(scene.data.qpos[None], 24, axis=0)
    rows[:, scene.arm_addresses[0]] += np.linspace(0.0, 0.3, 24)
    with LimitedView(quality="fast", size=64) as view:
        lives = [view.process_id]

        def struck(moment):
            if view.process_id not in lives:
                lives.append(view.process_id)
            if moment in hits:
                os.kill(view.process_id, signal.SIGSEGV)
                time.sleep(0.05)

        struck("open")
        view.open(files)
        struck("prepare")
        view.prepare([ViewSpec("front", 128, 128)], ("rgb",))
        struck("draw")
        first = view.draw(rows[0], "front", jitter=NO_JITTER)
        struck("sights")
        drawn = []
        for i, (sight,) in enumerate(view.sights(rows, jitter=NO_JITTER)):
            drawn.append(sight["rgb"].copy())
            if i in (3, 14):
                struck("again")
        struck("")
        return [first, *drawn], len(lives)


@pytest.fixture(scope="module")
def undisturbed(scene):
    return images(scene, ())


@pytest.mark.parametrize(
    ("hits", "expected"),
    [
        *others_slow([*(((moment,), 2) for moment in ("open", "prepare", "draw", "sights")), (("again",), 3)], 5),
        pytest.param(("open", "prepare", "draw", "sights", "again"), 7, marks=pytest.mark.slow),
    ],
)
def test_a_process_that_ends_by_chance_changes_nothing(scene, undisturbed, hits, expected):
    """What it was asked is asked of a new one; images are those of an undisturbed process, and none is missing."""
    calm, one_process = undisturbed
    disturbed, processes = images(scene, hits)
    assert (one_process, processes) == (1, expected)
    assert len(calm) == len(disturbed) == 25
    for one, other in zip(calm, disturbed, strict=True):
        np.testing.assert_array_equal(one, other)


def test_a_process_that_was_stopped_is_not_started_again(scene):
    with LimitedView(quality="fast", size=64) as view:
        view.open(scene.files())
        view.stop()
        assert view.is_closed  # at once, even if the process takes a moment to end
        with pytest.raises(RecordError, match="was killed"):
            view.draw(scene.data.qpos, "front", jitter=NO_JITTER)
        assert view.is_closed


def test_a_process_that_hangs_is_one_clear_line(scene, monkeypatch):
    monkeypatch.setattr(limited, "REQUEST_S", 0.3)
    with LimitedView(quality="fast", size=64) as view:
        os.kill(view._process.pid, signal.SIGSTOP)
        began = time.monotonic()
        with pytest.raises(RecordError, match=r"did not answer within 0.3 s.*too busy, or"):
            view.open(scene.files())  # more than a pipe holds
        assert time.monotonic() - began < 5.0
        assert view._process.returncode is not None


def test_time_in_which_both_processes_were_stopped_does_not_count(scene, monkeypatch):
    """Ctrl-Z for an hour, in the midst of a wait: the clock has gone on and nothing has come, once it goes on."""
    late, waits, real = [0.0], [], limited_process.select.select
    clock = time.monotonic

    def select_after_an_hour(*given):
        waits.append(given)
        if len(waits) % 3:
            return real(*given)
        late[0] += 3600.0
        return [], [], []

    with LimitedView(quality="fast", size=64) as view:
        view.open(scene.files())
        expected = view.draw(scene.data.qpos, "front", jitter=NO_JITTER)
        monkeypatch.setattr(limited_process.select, "select", select_after_an_hour)
        monkeypatch.setattr(limited_process.time, "monotonic", lambda: clock() + late[0])
        for _ in range(3):
            np.testing.assert_array_equal(view.draw(scene.data.qpos, "front", jitter=NO_JITTER), expected)
    assert late[0] > 3600.0


def test_the_process_that_draws_loads_no_tasks_no_tables_and_nothing_that_only_builds_scenes():
    """It is started for every film of a report; assets and kinematics would double what its start costs."""
    code = "import sys, betterbench.sim.scenes.limited; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    modules = set(done.stdout.split())
    assert "mujoco" in modules
    assert not {"mink", "scipy", "betterbench.sim.assets", "betterbench.sim.scenes.builder"} & modules
    assert not {"pyarrow", "trimesh", "PIL", "betterbench.tasks", "betterbench.records.run"} & modules
