"""Vector environments: the same trials as one by one, whatever runs them, and nothing lost at an automatic reset."""

from __future__ import annotations

import subprocess
import sys

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode
from tests.daily import in_turn

import betterbench
from betterbench.episodes import Observer
from betterbench.interface import observation_spec
from betterbench.interface.actions import EE_DELTA
from betterbench.sim.scenes import Scene
from betterbench.sim.scenes.stage import quality_preset
from betterbench.tasks import get_task

pytestmark = pytest.mark.physics

betterbench.register_environments()  # another test may have imported betterbench before Gymnasium

ID = "betterbench:BeTTER/MorningCoffee-v0"
MOVE = np.array([[0.3, -0.2, 0.1, 0.0, 0.1, 0.2, 1.0]], dtype=np.float32)


def vector(mode: str = "sync", *, envs: int = 2, vector_kwargs: dict | None = None, **arguments: object):
    arguments = {"observation": "state_only", "quality": "fast", **arguments}
    return gymnasium.make_vec(ID, num_envs=envs, vectorization_mode=mode, vector_kwargs=vector_kwargs, **arguments)


def rows(envs, steps: int = 4) -> np.ndarray:
    """All that two environments show over some steps, seeds 5 and 6."""
    seen, _ = envs.reset(seed=5)
    found = [seen]
    for _ in range(steps):
        found.append(envs.step(np.repeat(MOVE, 2, axis=0))[0])
    return np.array([np.concatenate([s[k].reshape(2, -1) for k in sorted(s)], axis=1) for s in found])


@pytest.mark.render
def test_the_images_and_measurements_are_those_that_a_policy_sees():
    envs = vector(observation="default")
    seen, info = envs.reset(seed=[8, 3])
    for step in range(3):
        for i, seed in enumerate((8, 3)):
            task = get_task("morning_coffee")
            scene = Scene(task, task.training[0], seed=seed, action_space=EE_DELTA, quality=quality_preset("fast"))
            scene.reset()
            for _ in range(step):
                scene.step(MOVE[0].astype(np.float64))
            observer = Observer(observation_spec("default"))
            shown = observer.observe(scene, scene.state())
            observer.close()
            for camera in ("front", "wrist"):
                assert np.array_equal(seen[camera][i], shown.images[camera])
            for name in ("joint_positions", "joint_velocities", "ee_position", "ee_quaternion"):
                assert np.array_equal(seen[name][i], getattr(shown, name))
            assert seen["gripper_width"][i] == shown.gripper_width
            assert info["instruction"][i] == shown.instruction
        seen, *_, info = envs.step(np.repeat(MOVE, 2, axis=0))
    envs.close()


def test_every_environment_has_its_own_seed_and_sentence():
    envs = vector(variation="L1")
    _, info = envs.reset(seed=[11, 2])
    assert info["seed"].tolist() == [11, 2]
    assert envs.reset(seed=7)[1]["seed"].tolist() == [7, 8]
    told = envs.get_attr("instruction")
    assert told == tuple(info["instruction"])
    assert told[0].endswith(".")
    assert envs.get_attr("step_limit") == (540, 540)
    envs.close()


SPAWNED = f"""
import sys
import gymnasium
import numpy as np
def main():
    envs = gymnasium.make_vec(
        "{ID}", num_envs=2, vectorization_mode="async", vector_kwargs={{"context": "spawn"}},
        observation="state_only", quality="fast",
    )
    found = [envs.reset(seed=5)[0]]
    for _ in range(4):
        found.append(envs.step(np.array({MOVE.tolist()} * 2, dtype=np.float32))[0])
    np.save(sys.argv[1], [np.concatenate([s[k].reshape(2, -1) for k in sorted(s)], axis=1) for s in found])
    print(*envs.get_attr("instruction"), *envs.get_attr("step_limit"), envs.spec.id, sep="\\n")
    envs.close()
if __name__ == "__main__":
    main()
"""


@in_turn(0, 2)
def test_a_script_that_imports_gymnasium_alone_spawns_environments_that_are_those_of_this_process(tmp_path):
    (tmp_path / "loop.py").write_text(SPAWNED)
    command = [sys.executable, str(tmp_path / "loop.py"), str(tmp_path / "rows.npy")]
    done = subprocess.run(command, check=False, capture_output=True, text=True, timeout=300)
    here = vector()
    try:
        assert np.array_equal(rows(here), np.load(tmp_path / "rows.npy")), done.stderr
        told = [*here.get_attr("instruction"), "540", "540", "BeTTER/MorningCoffee-v0"]
        assert done.stdout.splitlines() == told, done.stderr
    finally:
        here.close()


@pytest.mark.slow
@pytest.mark.render
def test_forked_servers_give_images_too():
    here = vector(observation="default")
    there = vector("async", vector_kwargs={"context": "forkserver"}, observation="default")
    try:
        assert np.array_equal(rows(here), rows(there))
    finally:
        here.close()
        there.close()


@pytest.mark.parametrize("mode", [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP, AutoresetMode.DISABLED])
def test_success_is_told_once_whatever_resets_the_environment(mode):
    # Staying still is right here, so that an open gripper that never moves succeeds when the time is over.
    envs = vector(envs=1, variation="T1", vector_kwargs={"autoreset_mode": mode})
    envs.reset(seed=0)
    still = np.array([[0.0] * 6 + [-1.0]], dtype=np.float32)
    limit = envs.get_attr("step_limit")[0]
    for _ in range(limit):
        _, reward, terminated, truncated, info = envs.step(still)
        if terminated[0] or truncated[0]:
            break
    assert terminated[0]
    assert reward[0] == 1.0
    told = info["final_info"] if mode is AutoresetMode.SAME_STEP else info
    assert told["success"][0]
    assert told["step"][0] == limit
    if mode is not AutoresetMode.DISABLED:
        _, reward, terminated, _, info = envs.step(still)
        assert not terminated[0]
        assert info["step"][0] == (1 if mode is AutoresetMode.SAME_STEP else 0)
        assert info["seed"][0] != 0, "the next trial is another one"
    envs.close()


FORKED = f"""
import subprocess
import sys

import gymnasium
def main():
    one = gymnasium.make("{ID}", render_mode="rgb_array", quality="fast")
    one.reset(seed=0)
    one.render()
    gymnasium.make_vec("{ID}", num_envs=2, vectorization_mode="async", quality="fast").reset(seed=1)
if __name__ == "__main__":
    main()
"""


@in_turn(1, 2)
@pytest.mark.render
def test_a_forked_copy_of_a_renderer_is_refused_with_what_to_write_instead(tmp_path):
    (tmp_path / "loop.py").write_text(FORKED)
    command = [sys.executable, str(tmp_path / "loop.py")]
    done = subprocess.run(command, check=False, capture_output=True, text=True, timeout=300)
    assert done.returncode == 1
    said = done.stderr.strip().splitlines()[-1]
    assert said.startswith("betterbench.errors.InvalidInputError: worker process: was forked")
    assert "vector_kwargs={'context': 'spawn'}" in said
    assert "TypeError" not in done.stderr
