"""The real openpi-client from the package index drives `better serve expert`, in an environment of its own."""

from __future__ import annotations

import base64
import contextlib
import dataclasses
import fcntl
import hashlib
import importlib.util
import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import platformdirs
import pytest

from betterbench.episodes import Observer
from betterbench.evaluation import open_server
from betterbench.evaluation.serving.shadow import ShadowSimulation
from betterbench.interface import EpisodeStart, episode_number, observation_spec
from betterbench.interface.actions import EE_DELTA
from betterbench.policies.conventions.presets import NATIVE, OPENPI_LIBERO
from betterbench.sim.scenes import Scene
from betterbench.sim.scenes.stage import quality_preset
from betterbench.tasks import GoalTracker, TrialId
from betterbench.tasks.interventions import resolve_condition

ROOT = Path(__file__).resolve().parents[2]
LOCK = ROOT / "requirements" / "openpi-client.lock"
SCRIPT = Path(__file__).with_name("openpi_drive.py")
TRIAL = TrialId("morning_coffee", "train1", 0)
PATIENCE_S = 120


@pytest.fixture(scope="session")
def openpi_python():
    """The Python of an environment that holds openpi-client and the NumPy it wants; made once for each lock."""
    spec = importlib.util.spec_from_file_location("setup_environment", ROOT / "tools" / "setup_environment.py")
    tool = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(tool)
    digest = hashlib.sha256(f"{sys.version}{LOCK.read_text(encoding='utf-8')}".encode()).hexdigest()[:16]
    home = Path(platformdirs.user_cache_dir("betterbench")) / "environments" / f"openpi-client-{digest}"
    home.parent.mkdir(parents=True, exist_ok=True)
    with home.with_suffix(".lock").open("w") as handle:
        fcntl.flock(handle, fcntl.LOCK_EX)  # test processes run side by side
        if not (home / "complete").exists():
            fill(tool, home)
    return home / "bin" / "python"


def fill(tool, home):
    """Makes the environment, or skips the test where that is not possible."""
    env, python = tool.uv_environment(os.environ), home / "bin" / "python"
    install = ["pip", "install", "--require-hashes", "--no-deps", "--only-binary", ":all:"]
    try:
        uv = tool.find_uv(env)
        for step in (["venv", "--clear", "--python", sys.executable, home], [*install, "--python", python, "-r", LOCK]):
            subprocess.run([uv, *step], env=env, check=True, capture_output=True, text=True, timeout=PATIENCE_S)
    except (tool.SetupError, OSError, subprocess.SubprocessError) as error:
        last = (getattr(error, "stderr", "") or str(error)).strip().splitlines()[-1:]
        pytest.skip(f"no environment for openpi-client could be made here: {' '.join(last)}")
    (home / "complete").touch()


class Drive:
    """A process of the real client; observations go in and answers come out as lines."""

    def __init__(self, python, server, broker=0):
        self.process = subprocess.Popen(
            [python, SCRIPT, str(server.port), str(broker)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            env={"PATH": os.defpath},
        )
        self.told = self.read()

    def read(self):
        line = self.process.stdout.readline()
        assert line, self.process.stderr.read()
        return json.loads(line)

    def infer(self, observation):
        form = {key: coded(value) for key, value in observation.items()}
        self.process.stdin.write(json.dumps(form) + "\n")
        self.process.stdin.flush()
        return self.read()

    def close(self):
        with contextlib.suppress(BrokenPipeError):
            self.process.stdin.close()
        try:
            assert self.process.wait(20) == 0, self.process.stderr.read()
        finally:
            self.process.kill()
            self.process.stdout.close()
            self.process.stderr.close()


def coded(value):
    if isinstance(value, np.ndarray):
        array = np.ascontiguousarray(value)
        return {"array": base64.b64encode(array.tobytes()).decode(), "dtype": array.dtype.str, "shape": array.shape}
    return value


@pytest.fixture
def drive(openpi_python):
    with contextlib.ExitStack() as stack:

        def start(server, broker=0):
            made = Drive(openpi_python, server, broker)
            stack.callback(made.close)
            return made

        yield start


def test_the_real_client_plays_an_episode_to_its_end(drive):
    found = resolve_condition(TRIAL.task, TRIAL.condition)
    task, condition = found.task, found.condition
    scene = Scene(task, condition, seed=TRIAL.seed, action_space=EE_DELTA, quality=quality_preset("fast"))
    observer = Observer(observation_spec("state_only"))
    start = EpisodeStart(condition.instruction.text, episode_number(TRIAL.seed), "ee_delta")
    tracker = GoalTracker(condition, scene.info, template=task.template, control_rate_hz=scene.control_rate_hz)
    with open_server("expert", port=0, chunk=16) as server:
        client = drive(server)
        assert client.told["numpy"].startswith("1.")
        assert client.told["metadata"]["betterbench"]["action_space"] == EE_DELTA.to_json()
        state = scene.reset()
        truth = tracker.update(state)
        while not truth.success and state.step < task.step_limit(condition):
            answer = client.infer(NATIVE.request(observer.observe(scene, state), start, TRIAL))
            assert (answer["dtype"], answer["shape"]) == ("float64", [16, 7])
            for action in answer["actions"]:
                scene.step(np.array(action))
                state = scene.state()
                truth = tracker.update(state)
                if truth.success:
                    break
        client.close()
    assert truth.success


def test_the_real_client_asks_in_liberos_layout_with_its_own_broker(drive):
    found = resolve_condition(TRIAL.task, TRIAL.condition)
    task, condition = found.task, found.condition
    scene = Scene(task, condition, seed=TRIAL.seed, action_space=EE_DELTA, quality=quality_preset("fast"))
    observer = Observer(observation_spec("state_only"))
    libero, image = dataclasses.replace(OPENPI_LIBERO, views=()), np.zeros((256, 320, 3), np.uint8)
    played = []
    with open_server("expert", port=0, chunk=8, trial=TRIAL) as server:
        client = drive(server, broker=5)
        for _ in range(20):
            seen = observer.observe(scene, scene.state())
            images = {"observation/image": image, "observation/wrist_image": image}
            answer = client.infer({**libero.request(seen), **images})
            played.append(answer["actions"])
            scene.step(np.array(answer["actions"]))
        client.close()
    np.testing.assert_array_equal(np.array(played), ShadowSimulation("expert", TRIAL).actions(0, 20))


def test_the_real_client_shows_our_errors_to_its_user(drive):
    with open_server("expert", port=0) as server:
        client = drive(server)
        answer = client.infer({"prompt": "put the red mug on the ring of the coffee maker"})
        client.close()
    assert answer["error"].startswith("Error in inference server:")
    assert "its handle not facing the machine.' (morning_coffee/train1)" in answer["error"]
