"""Release points and final poses that were measured in expert demonstrations, and the file that contains them.

``better certify --demonstrations`` writes the file. If an object starts at a target, its pose is drawn from the final
poses. Clause (b) of the certificate compares releases with the release points. The file of the suite is part of the
package. The file for a user's tasks is stored next to the task file.
"""

from __future__ import annotations

import functools
import json
import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from importlib import resources
from pathlib import Path
from typing import Any, Literal, NamedTuple

from pydantic import TypeAdapter

from betterbench.errors import InvalidInputError
from betterbench.geometry import Pose, normalize
from betterbench.json_form import SEAL, open_seal, read_form, seal_of, strict_form
from betterbench.tasks.authoring.task import Task
from betterbench.tasks.randomness import SUITE_VERSION, stream
from betterbench.tasks.user_files import companion_of, options_for

HEIGHT_MM = 5.0
"""Largest accepted vertical distance between a release and the nearest release height in training [mm]."""
REACH_MM = 15.0
"""Largest accepted horizontal distance between a release in a container and the nearest release in training [mm].

This is the jitter of a slot.
"""

PACKAGED = "demonstrations.json"
FORM: Literal["betterbench demonstrations"] = "betterbench demonstrations"


class FlatPose(NamedTuple):
    """Planar pose of an object at its target, in the frame of the target.

    The position is relative to the center of the target region.

    Attributes:
        x_mm: x coordinate of the object [mm].
        y_mm: y coordinate of the object [mm].
        yaw_deg: Heading [deg].
    """

    x_mm: float
    y_mm: float
    yaw_deg: float


@strict_form
@dataclass(frozen=True, slots=True)
class Releases:
    """Points where demonstrations released objects at one target region.

    Attributes:
        slot: Slot of the target, or of the object that carries the target.
        relation: Relation that the release establishes.
        region: Region of the target, or "" if the target has only one region.
        level: Number of objects between the released object and the table at the slot.
        heights_mm: Heights of the lower end of the object above the table when it was released [mm], sorted.
        points_mm: Positions (x, y) of the object's base in the frame of the target, relative to the center of the
            region [mm].
    """

    slot: str
    relation: str
    region: str
    level: int
    heights_mm: tuple[float, ...]
    points_mm: tuple[tuple[int, int], ...]

    @property
    def place(self) -> tuple[str, str, str, int]:
        """Place of these releases, given by slot, relation, region and level."""
        return self.slot, self.relation, self.region, self.level

    def off_mm(self, height_mm: float) -> float:
        """Return how far a height is above the nearest release height in training [mm].

        The difference is negative if the given height is below the release height.
        """
        return min((height_mm - h for h in self.heights_mm), key=abs)

    def aside_mm(self, x_mm: float, y_mm: float) -> float:
        """Return the distance from a point to the nearest release point [mm].

        Both are in the frame of ``points_mm``.
        """
        return min(math.dist((x_mm, y_mm), point) for point in self.points_mm)


@strict_form
@dataclass(frozen=True, slots=True)
class FinalPoses:
    """Final poses of an object at a target in the demonstrations.

    Attributes:
        kind: Kind of the object.
        asset: Identity of the object's asset. It matters because objects with different shapes rest in different poses.
        target_kind: Kind of the target.
        target_asset: Identity of the target's asset.
        relation: Relation between the object and the target.
        region: Region of the target, or "" if the target has only one region.
        poses: Poses of the object at rest.
    """

    kind: str
    asset: str
    target_kind: str
    target_asset: str
    relation: str
    region: str
    poses: tuple[FlatPose, ...]


class LeaningPose(NamedTuple):
    """Final pose of an object that may lean on other objects, in the frame of the target.

    Attributes:
        position_mm: Position relative to the center of the target region [mm].
        quaternion: Rotation as a quaternion (w, x, y, z).
    """

    position_mm: tuple[float, float, float]
    quaternion: tuple[float, float, float, float]

    @classmethod
    def of(cls, pose: Pose) -> LeaningPose:
        """Convert a pose relative to the center of the target region to its stored form.

        The stored form is rounded to 0.01 mm and about 0.01 degrees.
        """
        x, y, z = (round(1000.0 * value, 2) for value in pose.position)
        qw, qx, qy, qz = (round(value, 4) for value in pose.quaternion)
        return cls((x, y, z), (qw, qx, qy, qz))

    @property
    def pose(self) -> Pose:
        """Pose ``T_middle_object`` of the object relative to the center of the target region [m]."""
        x, y, z = (0.001 * value for value in self.position_mm)
        return Pose((x, y, z), normalize(self.quaternion))


class FinalPose(NamedTuple):
    """Final pose of one of several objects at a target, with the kind of the object and the identity of its asset."""

    kind: str
    asset: str
    at: LeaningPose


@strict_form
@dataclass(frozen=True, slots=True)
class JointPoses:
    """Final poses of several objects that one demonstration left in the same place, such as a container.

    Objects in a container lean on each other and on the walls, so their poses are stored together.

    Attributes:
        target_kind: Kind of the target.
        target_asset: Identity of the target's asset.
        relation: Relation of each object to the target.
        region: Region of the target, or "" if the target has only one region.
        objects: The objects with their poses, sorted.
    """

    target_kind: str
    target_asset: str
    relation: str
    region: str
    objects: tuple[FinalPose, ...]

    def posed(self, objects: Sequence[tuple[str, str]]) -> tuple[Pose, ...] | None:
        """Return the poses ``T_middle_object`` of objects specified by kind and asset, in the given order.

        Return None if the demonstration did not leave exactly these objects there.
        """
        left, found = list(self.objects), []
        for wanted in objects:
            chosen = next((o for o in left if (o.kind, o.asset) == wanted), None)
            if chosen is None:
                return None
            left.remove(chosen)
            found.append(chosen.at.pose)
        return None if left else tuple(found)


@strict_form
@dataclass(frozen=True, slots=True)
class Demonstrated:
    """Release points and final poses in the demonstrations of one task, with the versions used to measure them.

    Attributes:
        suite: Version of the suite.
        engine: Version of the physics engine.
        version: Version of the task.
        solved: Number of demonstrations that were measured.
        releases: Release points, by target region.
        final_poses: Final poses, by object and target.
        together: Final poses of demonstrations that left several objects in one place, with one entry for each
            demonstration.
    """

    suite: str
    engine: str
    version: int
    solved: int
    releases: tuple[Releases, ...]
    final_poses: tuple[FinalPoses, ...]
    together: tuple[JointPoses, ...] = ()

    def releases_at(self, place: tuple[str | None, str | None, str, int]) -> Releases | None:
        """Return the releases at a place (slot, relation, region and level), or None if there are none."""
        return next((r for r in self.releases if r.place == place), None)

    def final_poses_at(
        self, target_kind: str, relation: str, region: str, *, kind: str, assets: tuple[str, str]
    ) -> tuple[FlatPose, ...]:
        """Return the final poses at a target from demonstrations with the most similar object, ideally the same one.

        Poses of the same object asset at the same target asset come first. If there are none, poses of the same object
        asset at other target assets are returned. Next come poses of the same kind of object, and then poses of any
        object at this target.
        """
        there = self._poses_at(target_kind, relation, region)
        of_kind = [p for p in there if p.kind == kind]
        same = [p for p in of_kind if p.asset == assets[0]]
        alike = [p for p in same if p.target_asset == assets[1]]
        return tuple(pose for found in alike or same or of_kind or there for pose in found.poses)

    def joint_poses_at(self, target_asset: str, relation: str, region: str) -> tuple[JointPoses, ...]:
        """Return the final poses from demonstrations that left several objects at a target with the given asset."""
        place = (target_asset, relation, region)
        return tuple(j for j in self.together if (j.target_asset, j.relation, j.region) == place)

    def shows(self, target_kind: str, relation: str, region: str, *, assets: tuple[str, str]) -> bool:
        """Return whether any demonstration brought the given object asset to the given target asset."""
        there = self._poses_at(target_kind, relation, region)
        return any((p.asset, p.target_asset) == assets for p in there)

    def _poses_at(self, *place: str) -> list[FinalPoses]:
        return [p for p in self.final_poses if (p.target_kind, p.relation, p.region) == place]


@strict_form
@dataclass(frozen=True, slots=True)
class DemonstrationsFile:
    """File with the measured demonstrations of several tasks, by task."""

    tasks: Mapping[str, Demonstrated]
    form: Literal["betterbench demonstrations"] = FORM

    def to_text(self) -> str:
        """Return the file as a JSON string, with one line for each place and for each pair of object and target."""
        tasks = [f" {json.dumps(name)}: {_task_text(self.tasks[name])}" for name in sorted(self.tasks)]
        seal = seal_of(json.loads(json.dumps({"form": self.form, "version": 2, **_tasks_form(self.tasks)})))
        head = f'{{"form": {json.dumps(self.form)}, "version": 2, "{SEAL}": "{seal}",\n "tasks": {{\n'
        return head + ",\n".join(tasks) + "\n}}\n"


_FILE = TypeAdapter(DemonstrationsFile)
_NONE = DemonstrationsFile({})
_PACKAGED_NAME = "packaged demonstrations"


def _tasks_form(tasks: Mapping[str, Demonstrated]) -> dict[str, Any]:
    return {"tasks": {name: asdict(task) for name, task in tasks.items()}}


def _task_text(task: Demonstrated) -> str:
    form: dict[str, Any] = asdict(task)
    lists = [
        f'  "{name}": [\n' + ",\n".join("   " + json.dumps(entry) for entry in form.pop(name)) + "\n  ]"
        for name in ("releases", "final_poses", "together")
    ]
    return json.dumps(form)[:-1] + ",\n" + ",\n".join(lists) + "\n }"


_measured: dict[str, Demonstrated] = {}


@contextmanager
def measured_so_far(task: str, found: Demonstrated | None) -> Iterator[None]:
    """Context manager that makes a task use the given measurements.

    This is needed while demonstrations are measured, because earlier demonstrations determine the start of later ones.
    """
    before = _measured.get(task)
    if found is not None:
        _measured[task] = found
    try:
        yield
    finally:
        _measured.pop(task, None)
        if before is not None:
            _measured[task] = before


def demonstrated(task: Task, *, engine: str) -> Demonstrated:
    """Return the measurements from the demonstrations of a task.

    Args:
        task: The task.
        engine: Version of the physics engine in use. Its minor version must be the same as when the demonstrations were
            measured.

    Raises:
        InvalidInputError: If the task was never measured, or was measured with different versions. The message names
            the command that measures it.
    """
    if task.id in _measured:
        return _measured[task.id]
    own = companion_of(task.id)
    if own is None:
        where, file = _PACKAGED_NAME, _packaged()
    else:
        where = str(own.path)
        file = _NONE if own.text is None else read_demonstrations(own.text, where)
    found, cure = file.tasks.get(task.id), cure_for(task.id)
    if found is None:
        raise InvalidInputError(where, f"demonstrations of {task.id} have not been measured", cure)
    for what, there, here in (
        ("suite version", found.suite, SUITE_VERSION),
        ("MuJoCo", minor_version(found.engine), minor_version(engine)),
        (f"version of {task.id}", found.version, task.version),
    ):
        if there != here:
            raise InvalidInputError(
                where, f"{task.id} was measured with {what} {there}, but this installation has {here}", cure
            )
    return found


def demonstrated_if_measured(task: Task, *, engine: str) -> Demonstrated | None:
    """Return the measurements from the demonstrations of a task, or None if there are none for the versions in use."""
    try:
        return demonstrated(task, engine=engine)
    except InvalidInputError:
        return None


def final_pose(task: Task, seed: int, *, kind: str, region: str, poses: Sequence[FlatPose]) -> FlatPose:
    """Draw the final pose of an object that starts at a target, from the random stream of the trial."""
    return poses[int(stream(task.id, seed, f"preplaced:{kind}:{region}").integers(len(poses)))]


def joint_index(task: Task, seed: int, *, kinds: Sequence[str], region: str, count: int) -> int:
    """Return the index of the demonstration that determines the poses of objects starting together at a target.

    The index is below ``count`` and is drawn from the random stream of the trial.
    """
    return int(stream(task.id, seed, f"preplaced:{' '.join(sorted(kinds))}:{region}").integers(count))


def cure_for(task: str) -> str:
    """Return a sentence without a period that names the command for measuring the demonstrations of a task."""
    own = companion_of(task)
    package = " --write-package" if own is None else ""
    return f"Run better certify{options_for([task])} --tasks {task} --demonstrations 120{package}"


@functools.lru_cache(maxsize=8)
def read_demonstrations(text: str, where: str) -> DemonstrationsFile:
    """Read a file of measured demonstrations.

    Raises:
        InvalidInputError: If the file is invalid.
    """
    cure = "Measure the demonstrations again with `better certify --demonstrations`"
    form = open_seal(text, where=where, cure=cure, since=("version", 2))
    form.pop("version", None)
    return read_form(_FILE, form, where=where, cure=cure)


@functools.lru_cache(maxsize=1)
def _packaged() -> DemonstrationsFile:
    """Return the measurements that come with the package, or empty measurements if the package has no such file."""
    file = resources.files("betterbench.tasks").joinpath("data", PACKAGED)
    return read_demonstrations(file.read_text(encoding="utf-8"), _PACKAGED_NAME) if file.is_file() else _NONE


def updated_text(path: Path, found: Mapping[str, Demonstrated]) -> str:
    """Return the new text for the file of demonstrated measurements.

    It contains the measurements in ``found``, and the previous measurements of all other tasks in the file.
    """
    before = read_demonstrations(path.read_text(encoding="utf-8"), str(path)).tasks if path.is_file() else {}
    _packaged.cache_clear()
    return DemonstrationsFile({**before, **found}).to_text()


def minor_version(version: str) -> str:
    """Return the major and minor part of a MuJoCo version.

    The minor part matters because contact forces, and therefore scores, can change between minor versions of MuJoCo.
    """
    return ".".join(version.split(".")[:2])
