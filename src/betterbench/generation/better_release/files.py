"""Strict reader for a task folder of the BeTTER release.

A task is a folder with ``task.yaml``, ``base_variation.yaml``, ``object_universe.yaml``, ``asset_bindings.yaml`` (may
be missing) and ``variations/ID.yaml``. The constraint template of the task is in the folder ``task_templates`` of the
clone, and may be missing. The field names follow the release at commit 9d75971. The YAML reader is passed as an
argument, because only one package may import the YAML library.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from typing import Annotated, Any, Literal, TypeVar

from pydantic import AfterValidator, Field, TypeAdapter

from betterbench.errors import UNPRINTABLE, InvalidInputError, UnknownNameError, one_line
from betterbench.jobs.places import require_inside
from betterbench.json_form import read_form, strict_form

YamlReader = Callable[[Path], dict[str, Any]]
"""Function that reads a YAML file into plain values, and raises InvalidInputError if the file cannot be read."""

BASE = "BASE"
"""Default id of the base variation, which every other variation extends."""

MOST_VARIATIONS = 200
"""Maximum number of variations that a task may have."""

_CURE = "Correct the file, or restore it from the release"
_QUOTE = "Quote the words on, off, yes and no, which YAML reads as booleans"

MOST_OBJECTS = 100
"""Maximum number of objects that a task may have."""

FormT = TypeVar("FormT")


def _readable(text: str) -> str:
    if UNPRINTABLE.search(text):
        raise ValueError("contains an unprintable character")
    return text


def _inside(text: str) -> str:
    path = PurePosixPath(text)
    if path.is_absolute() or ".." in path.parts or "\\" in text:
        raise ValueError("is a path outside the release folder")
    return _readable(text)


def _unit(rotation: tuple[float, float, float, float]) -> tuple[float, float, float, float]:
    if abs(math.hypot(*rotation) - 1.0) > _UNIT_TOLERANCE:
        raise ValueError("is not a rotation: the quaternion (w, x, y, z) must have unit length")
    return rotation


_UNIT_TOLERANCE = 0.01

_Id = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]{0,99}$")]
_Text = Annotated[str, Field(max_length=2000), AfterValidator(_readable)]
_Path = Annotated[str, Field(max_length=500), AfterValidator(_inside)]
_Relation = Annotated[str, Field(pattern=r"^[a-z][a-z_]{0,39}$")]
_Number = Annotated[float, Field(ge=-100.0, le=100.0)]
_Rotation = Annotated[tuple[_Number, _Number, _Number, _Number], AfterValidator(_unit)]
_Count = Annotated[int, Field(ge=0, le=100)]


@strict_form
@dataclass(frozen=True, slots=True)
class ReleasePose:
    """Initial pose of an object.

    Attributes:
        position: Position in the world frame [m]: robot base at the origin, x away from the robot, y left, z up.
        rotation: Quaternion (w, x, y, z).
        scale: Scale of the asset along its axes.
        selected_asset_id: Source id of the asset, or None to choose an asset by seed.
    """

    position: tuple[_Number, _Number, _Number]
    rotation: _Rotation = (1.0, 0.0, 0.0, 0.0)
    scale: tuple[_Number, _Number, _Number] = (1.0, 1.0, 1.0)
    selected_asset_id: _Id | None = None


@strict_form
@dataclass(frozen=True, slots=True, order=True)
class ReleasePredicate:
    """A relation between an object and a target: ``in(apple_1, lunchbox)``."""

    subject_id: _Id
    relation: _Relation
    target_id: _Id

    def __str__(self) -> str:
        """Format the predicate as a call."""
        return f"{self.relation}({self.subject_id}, {self.target_id})"


@strict_form
@dataclass(frozen=True, slots=True)
class ChannelChange:
    """Changes to the success predicates or fail predicates that the release derives from the object groups.

    Predicates can be replaced, appended and removed.
    """

    replace: tuple[ReleasePredicate, ...] | None = None
    append: tuple[ReleasePredicate, ...] = ()
    remove: tuple[ReleasePredicate, ...] = ()


@strict_form
@dataclass(frozen=True, slots=True)
class PolicyChange:
    """Changes to the success predicates and to the fail predicates."""

    success: ChannelChange = field(default_factory=ChannelChange)
    fail: ChannelChange = field(default_factory=ChannelChange)


@strict_form
@dataclass(frozen=True, slots=True)
class VariationFile:
    """A variation (or the base variation) as written in its file.

    The lists ``set_*``, ``add_*`` and ``remove_*`` change the members of a group. Inherited values are not filled in;
    see :func:`betterbench.generation.better_release.resolve`.
    """

    variation_id: _Id
    extends: _Id | None = None
    enabled: bool = True
    instruction: _Text | None = None
    goal_relation: _Relation | None = None
    container_instance_id: _Id | None = None
    set_goal_objects: tuple[_Id, ...] | None = None
    add_goal_objects: tuple[_Id, ...] = ()
    remove_goal_objects: tuple[_Id, ...] = ()
    set_fail_objects: tuple[_Id, ...] | None = None
    add_fail_objects: tuple[_Id, ...] = ()
    remove_fail_objects: tuple[_Id, ...] = ()
    set_decor_objects: tuple[_Id, ...] | None = None
    add_decor_objects: tuple[_Id, ...] = ()
    remove_decor_objects: tuple[_Id, ...] = ()
    policy_overrides: PolicyChange = field(default_factory=PolicyChange)
    pose_overrides: dict[_Id, ReleasePose] = field(default_factory=dict)
    notes: _Text = ""


@strict_form
@dataclass(frozen=True, slots=True)
class _FailPolicy:
    distractor_relation_to_container_is_fail: bool = True
    fail_on_relations: tuple[_Relation, ...] = ("in", "on")


@strict_form
@dataclass(frozen=True, slots=True)
class _Defaults:
    container_instance_id: _Id | None = None
    primary_goal_relation: _Relation = "in"
    allowed_goal_relations: tuple[_Relation, ...] = ()
    fail_policy: _FailPolicy = field(default_factory=_FailPolicy)


@strict_form
@dataclass(frozen=True, slots=True)
class _Registry:
    train: tuple[_Id, ...] = ()
    eval: tuple[_Id, ...] = ()


@strict_form
@dataclass(frozen=True, slots=True)
class TaskFileForm:
    """Content of the file ``task.yaml``."""

    task_id: _Id
    template_type: _Id
    instruction: _Text
    variation_registry: _Registry
    description: _Text = ""
    defaults: _Defaults = field(default_factory=_Defaults)


@strict_form
@dataclass(frozen=True, slots=True)
class ReleaseInstance:
    """An object of a task as described in ``object_universe.yaml``."""

    instance_id: _Id
    role: _Id | None = None
    semantic_name: _Id | None = None
    description: _Text = ""
    retrieval_query: _Text = ""
    tags: tuple[_Text, ...] = ()


@strict_form
@dataclass(frozen=True, slots=True)
class _Universe:
    container: tuple[ReleaseInstance, ...]
    goal_objects: tuple[ReleaseInstance, ...]
    fail_objects: tuple[ReleaseInstance, ...] = ()
    decor_objects: tuple[ReleaseInstance, ...] = ()


@strict_form
@dataclass(frozen=True, slots=True)
class _Candidate:
    source_uid: _Id
    asset_key: _Id | None = None
    registry_usd: _Path | None = None
    registry_meta: _Path | None = None


@strict_form
@dataclass(frozen=True, slots=True)
class _Binding:
    candidates: tuple[_Candidate, ...]
    semantic_name: _Id | None = None


@strict_form
@dataclass(frozen=True, slots=True)
class _Bindings:
    bindings: dict[_Id, _Binding]
    task_id: _Id | None = None
    template_type: _Id | None = None
    generated_from: dict[str, _Path] = field(default_factory=dict)


@strict_form
@dataclass(frozen=True, slots=True)
class TemplateSlot:
    """A group of objects in a template, with the allowed number of objects."""

    slot_name: _Id
    group_hint: Literal["container", "target", "distractor", "decor"]
    min_count: _Count
    max_count: _Count
    description: _Text = ""
    tags: tuple[_Text, ...] = ()


@strict_form
@dataclass(frozen=True, slots=True)
class ReleaseTemplate:
    """Content of a file in the folder ``task_templates``.

    The published templates contain ``on`` without quotes. YAML 1.1 parses this as the boolean true. The audit reports
    relations that were parsed as booleans.
    """

    template_id: _Id
    template_type: _Id
    allowed_relations: tuple[_Relation | bool, ...]
    primary_goal_relation: _Relation | bool
    fail_relations: tuple[_Relation | bool, ...]
    slots: tuple[TemplateSlot, ...]
    description: _Text = ""

    @property
    def booleans(self) -> tuple[str, ...]:
        """Paths of the relations that YAML read as booleans ("fail_relations[1]")."""
        found = ["primary_goal_relation"] if isinstance(self.primary_goal_relation, bool) else []
        for name, relations in (("allowed_relations", self.allowed_relations), ("fail_relations", self.fail_relations)):
            found += [f"{name}[{i}]" for i, relation in enumerate(relations) if isinstance(relation, bool)]
        return tuple(found)


_TASK, _VARIATION, _UNIVERSE = TypeAdapter(TaskFileForm), TypeAdapter(VariationFile), TypeAdapter(_Universe)
_BINDINGS, _TEMPLATE = TypeAdapter(_Bindings), TypeAdapter(ReleaseTemplate)


@dataclass(frozen=True)
class ReleaseTask:
    """A task of the release as written in its files.

    Attributes:
        folder: Folder of the task.
        task: Content of ``task.yaml``.
        base: Base variation. All other variations extend it.
        variations: The other variations by id, sorted.
        instances: Objects by id, in the order of the file.
        groups: Ids of the container, goal, fail and decor objects in ``object_universe.yaml``.
        candidates: Source ids of the assets for each object, by object id. None if ``asset_bindings.yaml`` is missing.
        names: Additional names of objects by object id, from ``asset_bindings.yaml``.
        template: Constraint template, or None if the clone does not contain it.
    """

    folder: Path
    task: TaskFileForm
    base: VariationFile
    variations: Mapping[str, VariationFile]
    instances: Mapping[str, ReleaseInstance]
    groups: Mapping[str, tuple[str, ...]]
    candidates: Mapping[str, tuple[str, ...]] | None
    names: Mapping[str, str]
    template: ReleaseTemplate | None


def find_tasks(folder: Path) -> tuple[Path, ...]:
    """Return the task folders in a clone of the release, or the folder itself if it is a task folder.

    Raises:
        InvalidInputError: If the folder contains no task.
    """
    if (folder / "task.yaml").is_file():
        return (folder,)
    found = sorted(file.parent for file in folder.glob("assets/tasks/*/*/task.yaml"))
    if not found:
        problem = "has neither a task.yaml nor assets/tasks/TEMPLATE/TASK/task.yaml"
        cure = "Pass a clone of github.com/BeingBeyond/BeTTER, or the folder of a task in it"
        raise InvalidInputError(str(folder), problem if folder.is_dir() else "is not a folder", cure)
    return tuple(found)


def read_release_task(folder: Path, read_yaml: YamlReader) -> ReleaseTask:
    """Read a task of the release.

    Args:
        folder: Folder that contains ``task.yaml``.
        read_yaml: Function that reads a YAML file. It must limit the size and the depth, and reject aliases.

    Raises:
        InvalidInputError: If a file is missing, is a link out of the folder or is not YAML; if a field is missing,
            unknown or of the wrong type; if a variation does not extend the base variation; or if the variation
            registry in ``task.yaml`` and the variation files differ.
    """

    def read(adapter: TypeAdapter[FormT], *parts: str) -> FormT:
        file = folder.joinpath(*parts)
        require_inside(file, folder)
        form = read_yaml(file)
        try:
            return read_form(adapter, form, where=str(file), cure=_CURE)
        except InvalidInputError as error:
            if error.problem.endswith(("not True", "not False")):
                raise InvalidInputError(error.where, error.problem, _QUOTE) from error
            raise

    task = read(_TASK, "task.yaml")
    universe = read(_UNIVERSE, "object_universe.yaml")
    base = read(_VARIATION, "base_variation.yaml")
    if base.extends is not None:
        _refuse(folder / "base_variation.yaml", "extends", "the base variation extends another", "Remove the field")
    has_bindings = (folder / "asset_bindings.yaml").exists()
    bindings = read(_BINDINGS, "asset_bindings.yaml") if has_bindings else _Bindings({})
    files = _variation_files(folder, task)
    variations = {name: read(_VARIATION, "variations", f"{name}.yaml") for name in files}
    for name, variation in variations.items():
        _require_own_place(folder / "variations" / f"{name}.yaml", name, variation, base)
    groups = {
        "container": universe.container,
        "goal": universe.goal_objects,
        "fail": universe.fail_objects,
        "decor": universe.decor_objects,
    }
    instances: dict[str, ReleaseInstance] = {}
    for group, members in groups.items():
        for i, instance in enumerate(members):
            if instance.instance_id in instances:
                where = f"{group}{'' if group == 'container' else '_objects'}[{i}].instance_id"
                problem = f"{instance.instance_id!r} occurs twice"
                _refuse(folder / "object_universe.yaml", where, problem, "Use a different id for each object")
            instances[instance.instance_id] = instance
    if len(instances) > MOST_OBJECTS:
        problem = f"lists {len(instances)} objects"
        _refuse(folder / "object_universe.yaml", "objects", problem, f"Use at most {MOST_OBJECTS} objects")
    if not universe.container:
        _refuse(folder / "object_universe.yaml", "container", "is empty", "List the container of the task")
    return ReleaseTask(
        folder,
        task,
        base,
        variations,
        instances,
        {name: tuple(one.instance_id for one in members) for name, members in groups.items()},
        {name: tuple(c.source_uid for c in b.candidates) for name, b in bindings.bindings.items()}
        if has_bindings
        else None,
        {name: b.semantic_name for name, b in bindings.bindings.items() if b.semantic_name},
        _template(folder, task, read_yaml),
    )


def _refuse(file: Path, field_path: str, problem: str, cure: str) -> None:
    raise InvalidInputError(f"{file}: {field_path}", problem, cure)


def _variation_files(folder: Path, task: TaskFileForm) -> list[str]:
    """Return the sorted names of the variations.

    The registry in ``task.yaml`` and the folder of variation files must contain the same names.
    """
    listed = (*task.variation_registry.train, *task.variation_registry.eval)
    where = folder / "task.yaml"
    twice = sorted({name for name in listed if listed.count(name) > 1})
    if twice:
        _refuse(where, "variation_registry", f"{twice[0]!r} is listed twice", "List each variation once")
    if not task.variation_registry.train:
        _refuse(where, "variation_registry.train", "is empty", "List at least one training variation")
    if len(listed) > MOST_VARIATIONS:
        problem = f"lists {len(listed)} variations"
        _refuse(where, "variation_registry", problem, f"Use at most {MOST_VARIATIONS} variations")
    files = {file.stem for file in (folder / "variations").glob("*.yaml")}
    missing = [name for name in listed if name not in files]
    if missing:
        known = one_line(str(UnknownNameError("file of variations", missing[0], files)), most=300).rstrip(".")
        _refuse(where, "variation_registry", f"lists {missing[0]!r}: {known}", "Add the file, or remove the entry")
    unlisted = sorted(files - set(listed))
    if unlisted:
        shown = one_line(repr(unlisted[0]), most=120)
        problem = f"does not list {shown}, although a file with this name exists"
        _refuse(where, "variation_registry", problem, "List it under train or eval, or remove the file")
    return sorted(listed)


def _require_own_place(file: Path, name: str, variation: VariationFile, base: VariationFile) -> None:
    """Check that a variation has the same name as its file and extends the base variation."""
    if variation.variation_id != name:
        problem = f"{variation.variation_id!r} is not the name of the file"
        _refuse(file, "variation_id", problem, f"Write {name!r}, or rename the file")
    if variation.extends not in (None, base.variation_id):
        problem = (
            f"{variation.extends!r} is not the base variation, but the release supports only one level of inheritance"
        )
        _refuse(file, "extends", problem, f"Write {base.variation_id!r}, and list what the other variation changes")


def _template(folder: Path, task: TaskFileForm, read_yaml: YamlReader) -> ReleaseTemplate | None:
    """Read the constraint template of a task from ``task_templates`` in the clone. Return None if it is missing."""
    if len(folder.absolute().parents) < 3:
        return None
    home = folder.absolute().parents[2] / "task_templates"
    file = home / f"{task.template_type}.yaml"
    if not file.is_file():
        return None
    require_inside(file, home)
    return read_form(_TEMPLATE, read_yaml(file), where=str(file), cure=_CURE)
