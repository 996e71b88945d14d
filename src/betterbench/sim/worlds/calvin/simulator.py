"""CALVIN's simulator, controlled over a socket. It runs from the user's checkout, in CALVIN's Python environment.

This module imports only the standard library and NumPy and, on request, packages from CALVIN's environment and the
``calvin_env`` checkout. The process does not judge success. It sends the result of ``get_info`` to the run, which
applies the rules.

Sources: calvin_env@797142c ``envs/play_table_env.py`` (``get_env``, ``step``, ``reset``) and
``scene/play_table_scene.py``; mees/calvin@fa03f01 ``evaluation/evaluate_policy.py`` for the order of calls and
``wrappers/calvin_env_wrapper.py`` for the gripper.
"""

from __future__ import annotations

import contextlib
import hashlib
import importlib
import sys
from collections.abc import Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from betterbench.jobs.frames import FrameContent
from betterbench.sim.worlds.simulator_loop import answer_requests

CAMERAS = {"front": ("static", 200), "wrist": ("gripper", 84)}
"""CALVIN's two cameras.

Keys are the camera names in our observations, values are CALVIN's name and the image side [pixel].
"""

BLOCKS = {"block_red": "middle", "block_blue": "small", "block_pink": "big"}
"""Sizes of the blocks in scene D, in the order in which the blocks appear in ``scene_obs``."""

_OTHER_SCENES = {
    "A": {"block_red": "middle", "block_blue": "big", "block_pink": "small"},
    "B": {"block_red": "small", "block_blue": "big", "block_pink": "middle"},
    "C": {"block_red": "big", "block_blue": "small", "block_pink": "middle"},
}
"""Sizes of the blocks in the training scenes (calvin_env@797142c, ``conf/scene``).

Before December 2021 (calvin_env@93aeae6), the names of the files for scenes A and D were swapped.
"""

OWN_CONFIG = "conf/ of the checkout: scene D"
"""Configuration version that is stored if the user provides no configuration of the published data."""

_SCENE_HEAD = 6  # numbers before the blocks' poses: two doors, a button, a switch and two lights
_VECTORS = ("current_pos", "current_orn", "current_lin_vel", "current_ang_vel")
_PACKAGES = ("pybullet", "numpy", "hydra-core")
_OVERRIDES = ["cameras=static_and_gripper", "scene=calvin_scene_D", "robot=panda_longer_finger"]


class CalvinSimulator:
    """One CALVIN environment, which can be used for one chain only.

    After a chain, PyBullet keeps some state that is cleared neither by ``restoreState`` nor by calvin_env's ``reset``
    and ``load``. The next chain in the same process would therefore differ by up to 0.5 rad.
    """

    def __init__(self, checkout: Path, config: Path | None, *, egl: bool) -> None:
        self._checkout, self._config, self._egl = checkout, config, egl
        self._env: Any = None
        self._cameras: list[Any] = []
        self._code = ""
        self._problem: Exception | None = None
        self._used = False
        self._split: list[int] | None = None
        self._depth = False

    def suite(self, name: str) -> dict[str, Any]:
        """Return the task, the versions and the objects of the chains.

        This creates the environment, and thereby checks the installation. The process cannot run a chain afterward.
        """
        self.prepare()
        if self._egl:
            self._require_images()
        task = {"name": name, "fingerprint": self._code}
        return {"tasks": [task], "versions": self.versions(), "objects": self._measure()}

    def versions(self) -> dict[str, str]:
        """Return the versions of all components that can change the results."""
        own = {package: version(package) for package in _PACKAGES}
        config = OWN_CONFIG if self._config is None else f"sha256 {_digest(self._config)}"
        renderer = "EGL" if self._egl else "TinyRenderer"
        return {"calvin_env": self._commit(), **own, "config": config, "renderer": renderer}

    def premises(self, request: Mapping[str, Any]) -> FrameContent:
        """Raise ValueError: CALVIN has no stored initial states, so there are no premises to check in advance.

        The premises of a chain are checked when the chain begins.
        """
        raise ValueError(f"CALVIN has no stored initial states, which were requested for {request.get('suite')}")

    def draw(self, request: Mapping[str, Any], qpos: np.ndarray) -> FrameContent:
        """Raise ValueError: chains are not diagnosed, so their recorded states are never rendered again."""
        raise ValueError(
            f"recorded states of CALVIN chains cannot be rendered: {request.get('suite')}, {len(qpos)} states"
        )

    def start(self, request: Mapping[str, Any]) -> FrameContent:
        """Begin a chain by setting the robot and the scene.

        If the request contains "next", begin the next instruction of the current chain from the current state instead.
        """
        self.prepare()
        env = self._env
        env.cameras = self._cameras if request["images"] else []
        self._split, self._depth = request.get("split"), bool(request.get("depth"))
        if request.get("next"):
            return self._row(env.get_obs(), env.get_info())
        if self._used:
            raise ValueError("this process has already run or measured a scene, but each chain needs a new process")
        self._used = True
        names = self._block_names()
        blocks = dict(zip(BLOCKS, np.split(np.array(request["scene"][_SCENE_HEAD:], float), len(BLOCKS)), strict=True))
        # calvin_env takes the blocks in the order of its own configuration.
        scene = np.concatenate([request["scene"][:_SCENE_HEAD], *(blocks[name] for name in names)])
        # calvin_env's reset changes neither the gripper action nor the state of the buttons. Both are set to the values
        # that they have at the first chain of CALVIN's own evaluation.
        env.robot.gripper_action = 1
        for button in env.scene.buttons:
            button.prev_is_pressed = False
        env.reset(robot_obs=np.array(request["robot"], float), scene_obs=scene)
        # Render once and discard the image, as in CALVIN's `rollout`: with EGL, the first image of a process differs
        # from later images.
        document, arrays = self._row(env.get_obs(), env.get_info())
        fixed = {
            "fingers": [int(i) for i in env.robot.gripper_joint_ids],
            "flange": int(env.robot.end_effector_link_id),
            "engine": self.versions(),
            "code": self._code,
        }
        return {**fixed, **document}, arrays

    def step(self, action: np.ndarray, *, look: bool) -> FrameContent:
        """Execute one control step with an action in CALVIN's own format.

        A positive gripper value is sent as 1, any other value as -1. calvin_env expects an absolute action as three
        parts: position, rotation and gripper. The action is split at the indices that the start request contained.
        """
        self._env.cameras = self._cameras if look else []
        move = np.array(action, float)
        move[-1] = 1.0 if move[-1] > 0.0 else -1.0
        seen, _, _, info = self._env.step(move if self._split is None else np.split(move, self._split))
        return self._row(seen, info)

    def make_environment(self) -> Any:  # noqa: ANN401 - of another environment
        """Create calvin_env's ``PlayTableSimEnv`` as its ``get_env`` does, but with only the two cameras in use."""
        if not (self._checkout / "calvin_env" / "envs" / "play_table_env.py").is_file():
            raise FileNotFoundError(
                f"{self._checkout} is not a checkout of calvin_env: it has no calvin_env/envs/play_table_env.py"
            )
        if not any((folder / ".git").exists() for folder in (self._checkout, *self._checkout.parents)):
            raise FileNotFoundError(
                f"{self._checkout} is not in a git repository, but calvin_env reads the commit of its checkout. "
                "Clone calvin_env with git"
            )
        sys.path.insert(0, str(self._checkout))
        hydra = importlib.import_module("hydra")
        omega = importlib.import_module("omegaconf").OmegaConf
        if self._config is None:
            with hydra.initialize_config_dir(config_dir=str(self._checkout / "conf"), version_base=None):
                config = hydra.compose(config_name="config_data_collection", overrides=_OVERRIDES)
        else:
            config = omega.load(self._config)
        omega.set_struct(config, False)
        wanted = {camera for camera, _ in CAMERAS.values()}
        for name in [n for n in config.cameras if n not in wanted]:
            del config.cameras[name]
        _require_scene_d(config.scene.objects.movable_objects)
        return hydra.utils.instantiate(config.env, show_gui=False, use_vr=False, use_scene_info=True, use_egl=self._egl)

    def prepare(self) -> None:
        """Create the environment on the first call. If that fails, later calls raise the same error again."""
        if self._problem is not None:
            raise self._problem
        if self._env is not None:
            return
        try:
            self._make()
        except Exception as problem:
            self._problem = problem
            raise

    def _make(self) -> None:
        self._code = self._fingerprint()
        env = self.make_environment()
        self._cameras = list(env.cameras)
        names = [str(block.name) for block in env.scene.movable_objects]
        if sorted(names) != sorted(BLOCKS):
            raise ValueError(f"the scene has the blocks {', '.join(names)}, but CALVIN's scene has {', '.join(BLOCKS)}")
        cameras = {camera.name: (camera.width, camera.height) for camera in self._cameras}
        for camera, side in CAMERAS.values():
            if cameras.get(camera) != (side, side):
                raise ValueError(
                    f"the camera {camera} has {cameras.get(camera)} pixels, but in CALVIN it has {side} x {side}"
                )
        self._env = env

    def _require_images(self) -> None:
        """Render once, and raise ValueError if an image has a single color.

        This happens if EGL starts but does not render.
        """
        for name, image in self._env.get_obs()["rgb_obs"].items():
            if np.ptp(image) == 0:
                raise ValueError(f"EGL starts, but the image {name} that it renders has only one color")

    def _block_names(self) -> list[str]:
        return [str(block.name) for block in self._env.scene.movable_objects]

    def _measure(self) -> list[dict[str, Any]]:
        """Return the objects, blocks first, with their extents along their own axes [m] and their masses [kg].

        Measuring moves the objects. Even after they are put back, the state of the solver is different, so the process
        must not run a chain afterward.
        """
        self._used = True
        p, cid = self._env.p, self._env.cid
        found = {}
        for thing in self._env.scene.get_objects():
            place, _ = p.getBasePositionAndOrientation(thing.uid, physicsClientId=cid)
            p.resetBasePositionAndOrientation(thing.uid, place, (0.0, 0.0, 0.0, 1.0), physicsClientId=cid)
            low, high = np.array(p.getAABB(thing.uid, -1, physicsClientId=cid))
            mass = float(p.getDynamicsInfo(thing.uid, -1, physicsClientId=cid)[0])
            found[str(thing.name)] = {"size": _floats(high - low), "mass": mass}
        names = (*BLOCKS, *sorted(found.keys() - BLOCKS.keys()))
        return [{"name": name, "fixed": name not in BLOCKS, **found[name]} for name in names]

    def _row(self, seen: Mapping[str, Any], info: Mapping[str, Any]) -> FrameContent:
        """Return the current state: ``get_info`` as JSON, and the robot, scene and camera images as arrays."""
        names = self._block_names()
        scene = np.array(seen["scene_obs"], float)
        blocks = dict(zip(names, np.split(scene[_SCENE_HEAD:], len(names)), strict=True))
        target = np.concatenate([self._env.robot.target_pos, self._env.robot.target_orn])
        arrays = {
            "robot": np.array(seen["robot_obs"], float),
            "scene": np.concatenate([scene[:_SCENE_HEAD], *(blocks[name] for name in BLOCKS)]),
            "target": np.array(target, float),
        }
        for name, (camera, _) in CAMERAS.items():
            image = seen["rgb_obs"].get(f"rgb_{camera}")
            if image is not None:
                arrays[f"image_{name}"] = np.asarray(image).astype(np.uint8)
            if image is not None and self._depth:
                arrays[f"depth_{name}"] = np.asarray(seen["depth_obs"][f"depth_{camera}"], np.float32)
        return {"info": _plain_info(info)}, arrays

    def _commit(self) -> str:
        """Return the commit of the checkout.

        It always exists, because calvin_env refuses to run outside a git repository.
        """
        git = importlib.import_module("git")
        return str(git.Repo(self._checkout, search_parent_directories=True).head.object.hexsha)

    def _fingerprint(self) -> str:
        """Return a digest of the files in the checkout that determine the physics: code, configuration and models."""
        patterns = ("calvin_env/**/*.py", "conf/**/*.yaml", "data/**/*.urdf")
        files = sorted(file for pattern in patterns for file in self._checkout.glob(pattern))
        parts = [f"{file.relative_to(self._checkout).as_posix()} {_digest(file)}" for file in files]
        return hashlib.sha256("\n".join(parts).encode()).hexdigest()


def _require_scene_d(blocks: Mapping[str, Mapping[str, Any]]) -> None:
    found = {str(name): Path(block["file"]).stem.rpartition("_")[2] for name, block in blocks.items()}
    if found != BLOCKS:
        scene = next((f"scene {name}" for name, known in _OTHER_SCENES.items() if known == found), "no scene of CALVIN")
        raise ValueError(
            f"the configuration has the blocks of {scene} ({_listed(found)}), but ABC to D uses scene D "
            f"({_listed(BLOCKS)}). Check out calvin_env at 797142c or 1431a46. If you specify a configuration, use "
            "validation/.hydra/merged_config.yaml"
        )


def _listed(blocks: Mapping[str, str]) -> str:
    return ", ".join(f"{name.removeprefix('block_')} {size}" for name, size in blocks.items())


def _plain_info(info: Mapping[str, Any]) -> dict[str, Any]:
    """Return the parts of the ``get_info`` result that the rules and the records need, as JSON."""
    robot, scene = info["robot_info"], info["scene_info"]
    blocks = {}
    for name, block in scene["movable_objects"].items():
        vectors = {key: _floats(block[key]) for key in _VECTORS}
        blocks[str(name)] = {"uid": int(block["uid"]), **vectors, "contacts": _contacts(block["contacts"])}
    fixed = {}
    for name, thing in scene["fixed_objects"].items():
        links = {str(link): int(number) for link, number in thing.get("links", {}).items()}
        fixed[str(name)] = {"uid": int(thing["uid"]), "links": links}
    return {
        "robot_info": {"uid": int(robot["uid"]), "contacts": _contacts(robot["contacts"])},
        "scene_info": {
            "movable_objects": blocks,
            "fixed_objects": fixed,
            "doors": {str(n): {"current_state": _first(d["current_state"])} for n, d in scene["doors"].items()},
            "lights": {str(n): {"logical_state": int(d["logical_state"])} for n, d in scene["lights"].items()},
        },
    }


def _contacts(points: Sequence[Sequence[Any]]) -> list[list[float]]:
    """Return the fields of PyBullet's contact points, in PyBullet's order, up to the normal force [N]."""
    return [[0, int(c[1]), int(c[2]), int(c[3]), int(c[4]), float(c[9])] for c in points or ()]


def _first(value: Any) -> float:  # noqa: ANN401 - a number, or in older versions a sequence that begins with it
    return float(np.ravel(value)[0])


def _floats(values: Sequence[float]) -> list[float]:
    return [float(v) for v in values]


def _digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def main() -> None:
    """Answer requests over a socket.

    The command-line arguments are the checkout, the configuration file (or ""), the renderer ("egl" or ""), and the
    file descriptor of the socket.
    """
    checkout, config, egl, descriptor = sys.argv[1:]
    simulator = CalvinSimulator(Path(checkout), Path(config) if config else None, egl=egl == "egl")
    with contextlib.suppress(Exception):  # the first request raises this error again and reports it
        simulator.prepare()
    answer_requests(simulator, int(descriptor))
