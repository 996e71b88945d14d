"""Chains in the real calvin_env, number for number against its own loop in a process of its own.

It needs ``better worlds install calvin``, and ``BETTER_CALVIN_ENV``, a clone of mees/calvin_env or mees/calvin.
"""

import json
import os
import subprocess
from pathlib import Path

import numpy as np
import pytest

from betterbench.evaluation.planning.world_plan import make_world_plan
from betterbench.interface.actions import CALVIN_RELATIVE
from betterbench.sim.worlds import WorldProcesses, world_named
from betterbench.sim.worlds.calvin import calvin_command, checkout_root
from betterbench.tasks.worlds.calvin import calvin_chains, start_of

STEPS = 60

OWN_LOOP = """
import json, sys
import hydra
import numpy as np

checkout, egl, chain, out = sys.argv[1:]
sys.path.insert(0, checkout)
chain = json.loads(chain)
with hydra.initialize_config_dir(config_dir=checkout + "/conf", version_base=None):
    wanted = ["cameras=static_and_gripper", "scene=calvin_scene_D", "robot=panda_longer_finger"]
    config = hydra.compose(config_name="config_data_collection", overrides=wanted)
env = hydra.utils.instantiate(config.env, show_gui=False, use_vr=False, use_scene_info=True, use_egl=egl == "egl")
env.reset(robot_obs=np.array(chain["robot"]), scene_obs=np.array(chain["scene"]))
seen = [env.get_obs()]
for action in np.array(chain["actions"]):
    action[-1] = 1 if action[-1] > 0 else -1
    seen.append(env.step(action)[0])
rows = [np.concatenate([o["robot_obs"], o["scene_obs"]]) for o in seen]
images = {name: [o["rgb_obs"][f"rgb_{name}"] for o in seen] for name in ("static", "gripper")}
np.savez(out, rows=rows, **images)
"""


def _actions(number):
    """Return actions (n, 7) that wander, push down, and go beyond 1."""
    rng, action, found = np.random.default_rng(number), np.zeros(7), []
    for step in range(STEPS):
        action = 0.9 * action + 0.6 * rng.normal(size=7)
        found.append(np.clip(action, -1.8, 1.8))
        found[-1][2] -= 0.4
        found[-1][6] = 1.0 if step % 40 < 20 else -1.0
    return np.array(found)


@pytest.mark.slow
@pytest.mark.parametrize("egl", [False, True])
def test_every_chain_is_bit_for_bit_what_a_fresh_calvin_env_does(tmp_path, egl):
    named, world = os.environ.get("BETTER_CALVIN_ENV"), world_named("calvin").installation
    if named is None or not world.is_installed:
        pytest.skip("`better worlds install calvin` and BETTER_CALVIN_ENV")
    plan = make_world_plan("python:none.py:None", suite="calvin", command=calvin_command(Path(named), None, egl=egl))
    processes = WorldProcesses(plan.world.command)
    for number in (7, 8, 7):
        start = start_of(calvin_chains()[number].start)
        chain = {"robot": start.robot.tolist(), "scene": start.scene.tolist(), "actions": _actions(number).tolist()}
        out = tmp_path / f"{number}.npz"
        asked = [str(checkout_root(Path(named)).resolve()), "egl" if egl else "", json.dumps(chain), str(out)]
        subprocess.run([world.command()[0], "-c", OWN_LOOP, *asked], check=True, capture_output=True)
        own = np.load(out)
        scene = plan.world.open_scene(
            processes, task="calvin", condition="base", seed=number, action_space=CALVIN_RELATIVE, images=True
        )
        scene.reset()
        for step in range(STEPS + 1):
            assert scene.simulator_state()["qpos"].tobytes() == own["rows"][step].tobytes(), step
            assert np.array_equal(scene.images()["front"], own["static"][step]), step
            assert np.array_equal(scene.images()["wrist"], own["gripper"][step]), step
            if step < STEPS:
                scene.step(_actions(number)[step])
        scene.close(well=True)
    processes.close()
