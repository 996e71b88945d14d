"""calvin_env's environment without its physics, behind the process that betterbench runs for CALVIN.

Everything of that process is the real one but for ``make_environment``. The environment has the interface of
``PlayTableSimEnv``, and a scene in which an action names a subtask, as in tests/tasks/worlds/fake_world.py: 100 times
its first component is the number of the subtask, a negative one does nothing. It runs where betterbench is not
installed.

As in PyBullet, something of the steps before is left after a reset, and only a new process is without it.

``FAKE_FAULT`` (fake_faults.py) names the yaw of the red block, ``FAKE_ORDER`` the order of the blocks, ``FAKE_SHIFT``
how far beside their places blocks come to stand, ``FAKE_EGL`` what becomes of EGL ("dies", "black"), ``FAKE_COMMIT``
the commit of the checkout, and ``FAKE_MISSING`` a module that the environment lacks.
"""

import contextlib
import importlib
import json
import math
import os
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
from fake_faults import fail, fault_due

import betterbench
from betterbench.sim.worlds.calvin.simulator import CalvinSimulator
from betterbench.sim.worlds.simulator_loop import answer_requests

ROBOT, TABLE = 0, 5
BODIES = {"block_red": 2, "block_blue": 3, "block_pink": 4}
LINKS = {"base_link": -1, "drawer_link": 0, "slide_link": 1, "plank_link": 2}
SURFACE = {"table": "base_link", "slider_left": "plank_link", "slider_right": "plank_link", "drawer": "drawer_link"}
SUBTASKS = json.loads((Path(betterbench.__path__[0]) / "tasks/worlds/calvin/data/subtasks.json").read_text())[
    "subtasks"
]


def point(own, body, link):
    """A contact point as PyBullet gives it: fourteen fields."""
    return (0, own, body, -1, link, (0,) * 3, (0,) * 3, (0, 0, 1), 0.0, 1.5, 0.0, (0,) * 3, 0.0, (0,) * 3)


class Block:
    def __init__(self, env, name):
        self.env, self.name, self.uid = env, name, BODIES[name]


class FakeEngine:
    """PyBullet, as far as sizes are asked for."""

    def __getattr__(self, name):
        answers = {
            "getBasePositionAndOrientation": ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0)),
            "resetBasePositionAndOrientation": None,
            "getAABB": ((-0.03, -0.02, -0.02), (0.03, 0.02, 0.02)),
            "getDynamicsInfo": (1.0,),
            "saveState": 0,
            "restoreState": None,
        }
        return lambda *_, **__: answers[name]


class FakeEnv:
    """The parts of PlayTableSimEnv that are used."""

    left = 0.0

    def __init__(self):
        order = (os.environ.get("FAKE_ORDER") or "block_red,block_blue,block_pink").split(",")
        blocks = [Block(self, name) for name in order]
        table = SimpleNamespace(name="table", uid=TABLE)
        self.button = SimpleNamespace(prev_is_pressed=True)
        self.scene = SimpleNamespace(
            movable_objects=blocks, buttons=[self.button], get_objects=lambda: [table, *blocks]
        )
        self.robot = SimpleNamespace(
            gripper_joint_ids=[9, 10], end_effector_link_id=7, target_pos=np.zeros(3), target_orn=np.zeros(3)
        )
        self.cameras = [
            SimpleNamespace(name="static", width=200, height=200),
            SimpleNamespace(name="gripper", width=84, height=84),
        ]
        self.cid, self.p = 0, FakeEngine()
        self.at, self.place, self.steps = {}, {name: [0.0, 0.0, 0.0] for name in BODIES}, 0
        self.yaw = dict.fromkeys(BODIES, 0.0)
        self.state, self.robot_obs = np.zeros(24), np.zeros(15)

    def reset(self, robot_obs, scene_obs):
        assert robot_obs.shape == (15,)
        assert self.robot.gripper_action == 1
        assert not self.button.prev_is_pressed
        self.robot.target_pos, self.button.prev_is_pressed = robot_obs[:3], True
        self.robot_obs, self.state = robot_obs.copy(), scene_obs.copy()
        self.robot_obs[7:14] += FakeEnv.left
        self.steps = 0
        for i, block in enumerate(self.scene.movable_objects):
            x, y, z, _, _, yaw = scene_obs[6 + 6 * i : 12 + 6 * i].tolist()
            x += float(os.environ.get("FAKE_SHIFT") or 0.0)
            self.at[block.name] = "table" if y < 0 else ("slider_left" if x < 0 else "slider_right")
            self.place[block.name], self.yaw[block.name] = [x, y, z], yaw
        return self.get_obs()

    def symbolic(self):
        held = int("grasped" in self.at.values())
        return {
            "lightbulb": int(self.state[4]),
            "led": int(self.state[5]),
            "slider": "left" if self.state[0] > 0.14 else "right",
            "drawer": "open" if self.state[1] > 0.11 else "closed",
            **{f"{name.removeprefix('block_')}_block": at for name, at in self.at.items()},
            "grasped": held,
        }

    def get_obs(self):
        rng = np.random.default_rng([self.steps, int(abs(self.yaw["block_red"]) * 1e6)])
        sides = {"static": 200, "gripper": 84}
        if os.environ.get("FAKE_EGL") == "black":
            rng = SimpleNamespace(integers=lambda _low, _high, shape, dtype: np.zeros(shape, dtype))
        rgb = {f"rgb_{c.name}": rng.integers(0, 256, (sides[c.name],) * 2 + (3,), dtype=np.uint8) for c in self.cameras}
        blocks = [[*self.place[b.name], 0.0, 0.0, self.yaw[b.name]] for b in self.scene.movable_objects]
        scene = np.concatenate([self.state[:6], *blocks])
        depth = {f"depth_{c.name}": np.full((sides[c.name],) * 2, 0.5 + 0.01 * self.steps) for c in self.cameras}
        return {"rgb_obs": rgb, "depth_obs": depth, "robot_obs": self.robot_obs.copy(), "scene_obs": scene}

    def get_info(self):
        held = [name for name, at in self.at.items() if at == "grasped"]
        return {
            "robot_info": {"uid": ROBOT, "contacts": [point(ROBOT, BODIES[name], -1) for name in held]},
            "scene_info": {
                "movable_objects": {b.name: self._info_of(b.name) for b in self.scene.movable_objects},
                "fixed_objects": {"table": {"uid": TABLE, "links": LINKS}},
                "doors": {
                    "base__slide": {"current_state": float(self.state[0])},
                    "base__drawer": {"current_state": float(self.state[1])},
                },
                "lights": {
                    "lightbulb": {"logical_state": int(self.state[4])},
                    "led": {"logical_state": int(self.state[5])},
                },
            },
        }

    def _info_of(self, name):
        at, own, half = self.at[name], BODIES[name], 0.5 * self.yaw[name]
        if at == "grasped":
            contacts = (point(own, ROBOT, 9), point(own, ROBOT, 10))
        elif at.startswith("stacked"):
            other = next(n for n, p in self.at.items() if n != name and p.startswith("stacked"))
            contacts = (point(own, BODIES[other], -1), *((point(own, TABLE, -1),) if at == "stacked_bottom" else ()))
        else:
            contacts = (point(own, TABLE, LINKS[SURFACE[at]]),)
        return {
            "uid": own,
            "current_pos": tuple(self.place[name]),
            "current_orn": (0.0, 0.0, math.sin(half), math.cos(half)),
            "current_lin_vel": (0.0, 0.0, 0.0),
            "current_ang_vel": (0.0, 0.0, 0.0),
            "contacts": contacts,
        }

    def step(self, action):
        if isinstance(action, list):  # absolute: position, rotation, gripper
            assert [len(part) for part in action] in ([3, 3, 1], [3, 4, 1])
            action = np.concatenate([action[0], np.zeros(3), action[2]])
        assert action.shape == (7,)
        assert action[6] in (-1, 1)
        self.steps += 1
        FakeEnv.left += 1e-4
        self.robot_obs[14] = self.robot.gripper_action = action[6]
        self.robot.target_pos = self.robot.target_pos + 0.02 * action[:3]
        number = round(float(action[0]) * 100)
        if number >= 0:
            self.do(SUBTASKS[number])
        if self.steps == 3:
            self.fail()
        return self.get_obs(), 0, False, self.get_info()

    def do(self, subtask):
        state = self.symbolic()
        fits = [
            change
            for change in subtask["changes"]
            if all(state[k] in (v if isinstance(v, list) else [v]) for k, v in change["when"].items())
        ]
        if len(fits) != 1:
            return
        state |= fits[0]["then"]
        self.state[:2] = 0.28 * (state["slider"] == "left"), 0.22 * (state["drawer"] == "open")
        self.state[4:6] = state["lightbulb"], state["led"]
        for name in BODIES:
            place = state[f"{name.removeprefix('block_')}_block"]
            if place != self.at[name]:
                self.at[name] = place
                self.place[name][2] = {"drawer": 0.36, "grasped": 0.6}.get(place, 0.46)
        rule = subtask["rule"]
        if rule["kind"] == "rotate":
            self.yaw[rule["block"]] += math.radians(1.2 * rule["degrees"])
        if rule["kind"] == "push":
            self.place[rule["block"]][0] += 1.2 * rule["along_x_m"]

    def fail(self):
        kind = fault_due(lambda yaw: abs(float(yaw) - self.yaw["block_red"]) <= 1e-9)
        if kind == "nan":
            self.robot_obs = self.robot_obs * np.nan
        fail(kind)


class FakeCalvin(CalvinSimulator):
    def make_environment(self):
        print("this is printed to standard output")  # noqa: T201 - what simulators do
        if self._egl and os.environ.get("FAKE_EGL") == "dies":
            os.abort()
        missing = os.environ.get("FAKE_MISSING")
        if missing:
            try:
                importlib.import_module(missing)
            except ImportError as error:
                raise RuntimeError("Error locating target 'calvin_env.envs'; see the chained exception") from error
        return FakeEnv()

    def versions(self):
        commit = os.environ.get("FAKE_COMMIT") or "0" * 40
        return {"calvin_env": commit, "config": "fake", "renderer": "EGL" if self._egl else "TinyRenderer"}


def main():
    checkout, config, egl, descriptor = sys.argv[1:]
    simulator = FakeCalvin(Path(checkout), Path(config) if config else None, egl=egl == "egl")
    with contextlib.suppress(Exception):
        simulator.prepare()
    answer_requests(simulator, int(descriptor))
