"""JSON format of tasks, for programs that write tasks and for people who share them.

``--task-file my_task.json`` loads a task from JSON in the same way as from a Python file, but executes no code.
"""

from __future__ import annotations

import dataclasses
import inspect
import json
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Annotated, Any, Literal

from pydantic import Field, TypeAdapter

from betterbench.errors import BetterError, InvalidInputError, UnknownNameError, one_line
from betterbench.interface.actions import USUAL_ROBOT
from betterbench.json_form import NO_TRUTH, json_schema_of, parse_json, read_form, strict_form
from betterbench.tasks.authoring import registry
from betterbench.tasks.authoring.condition_matrix import ConditionMatrix, Horizon, MatrixCell, State
from betterbench.tasks.authoring.no_test import require_no_test
from betterbench.tasks.authoring.operations import Operation, operation_named
from betterbench.tasks.authoring.readable import require_readable
from betterbench.tasks.authoring.regimes import ListedRegime, named_regimes
from betterbench.tasks.authoring.task import Task
from betterbench.tasks.authoring.template import Template
from betterbench.tasks.authoring.template_form import template_from_json, template_to_json
from betterbench.tasks.authoring.templates import TEMPLATES
from betterbench.tasks.authoring.variation import Variation
from betterbench.tasks.axes import Axis, Expected, Support
from betterbench.tasks.condition import Condition, ObjectSpec, Role, Slot, TargetRegion
from betterbench.tasks.relations import RELATIONS
from betterbench.tasks.subgoal import Instruction, Reference, Subgoal
from betterbench.tasks.user_files import READERS, TaskFile

SCHEMA_VERSION = 1
"""Version of the JSON form."""

_CURE = "Compare it with the output of task_to_json for a task of the suite"

_DEFAULT = Slot("default", 0.0, 0.0)

_Text = Annotated[str, Field(min_length=1, pattern=r"\S")]
_Meters = Annotated[float, Field(ge=-2.0, le=2.0)]
_Width = Annotated[float, Field(ge=0.0, le=2.0)]
_Radians = Annotated[float, Field(ge=-6.3, le=6.3)]


@strict_form
@dataclass(frozen=True, slots=True)
class _Slot:
    name: _Text
    x: _Meters
    y: _Meters
    yaw: _Radians = 0.0
    jitter_m: _Width = _DEFAULT.jitter_m
    yaw_jitter: Annotated[float, Field(ge=0.0, le=6.3)] = _DEFAULT.yaw_jitter


@strict_form
@dataclass(frozen=True, slots=True)
class _Place:
    target: _Text
    region: str = ""


@strict_form
@dataclass(frozen=True, slots=True)
class _Object:
    name: _Text
    kind: _Text
    category: _Text
    color: _Text | None = None
    role: Role = "item"
    fixed: bool = False
    mount: _Place | None = None


@strict_form
@dataclass(frozen=True, slots=True)
class _Reference:
    kind: _Text | None = None
    slot: _Text | None = None


@strict_form
@dataclass(frozen=True, slots=True)
class _Subgoal:
    name: _Text
    relation: _Text
    reference: _Reference
    target: _Text
    word: _Text
    count: Annotated[int, Field(ge=1, le=100)] = 1
    region: str = ""


@strict_form
@dataclass(frozen=True, slots=True)
class _Instruction:
    text: _Text
    subgoals: Annotated[tuple[_Subgoal, ...], Field(min_length=1)]
    ordered: bool = False


@strict_form
@dataclass(frozen=True, slots=True)
class _Condition:
    objects: Annotated[tuple[_Text, ...], Field(min_length=1)]
    layout: dict[str, str]
    instruction: _Instruction
    preplaced: dict[str, _Place] = dataclasses.field(default_factory=dict)
    opened: dict[str, _Width] = dataclasses.field(default_factory=dict)
    expected: Expected = Expected.SUCCEED
    mid_task_look: bool = False
    premise_broken: bool = False
    cloth: _Text | None = None
    watch_steps: Annotated[int, Field(ge=0, le=10**5)] = 0


@strict_form
@dataclass(frozen=True, slots=True)
class _Variation:
    name: _Text
    do: tuple[dict[str, Any], ...]
    title: _Text
    hypothesis: _Text
    base: _Text = "train1"
    expected: Expected = Expected.SUCCEED
    support: Support = Support.SEEN
    mid_task_look: bool = False
    premise_broken: bool = False
    watch_steps: Annotated[int, Field(ge=0, le=10**5)] = 0


@strict_form
@dataclass(frozen=True, slots=True)
class _Regime:
    conditions: Annotated[tuple[_Condition, ...], Field(min_length=1)]
    crossed: tuple[_Text, ...] = ()
    slots: tuple[_Slot, ...] = ()


@strict_form
@dataclass(frozen=True, slots=True)
class _Cell:
    row: State
    column: State
    conditions: tuple[_Text, ...]
    paper: _Text


@strict_form
@dataclass(frozen=True, slots=True)
class _Matrix:
    horizon: Horizon
    rows: _Text
    columns: _Text
    cells: tuple[_Cell, ...]


@strict_form
@dataclass(frozen=True, slots=True)
class _Form:
    schema_version: Annotated[Literal[1], NO_TRUTH]
    id: Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]{0,63}$")]
    version: Annotated[int, Field(ge=1, lt=10**6)]
    title: _Text
    description: _Text
    template: str | dict[str, Any]
    slots: Annotated[tuple[_Slot, ...], Field(min_length=1)]
    objects: Annotated[tuple[_Object, ...], Field(min_length=1)]
    training: Annotated[tuple[_Condition, ...], Field(min_length=1)]
    variations: tuple[_Variation, ...]
    notes: str = ""
    regimes: dict[Literal["balanced", "diverse-confounded"], _Regime] = dataclasses.field(default_factory=dict)
    robot: _Text = USUAL_ROBOT
    matrices: tuple[_Matrix, ...] = ()


_FORM = TypeAdapter(_Form)
_INSTRUCTION = TypeAdapter(_Instruction)
_NUMBER = TypeAdapter(_Width)
_TEXT = TypeAdapter(str)


def task_schema() -> dict[str, Any]:
    """Return the JSON schema for the JSON form of a task."""
    return json_schema_of(_FORM, title="Task")


def task_to_json(task: Task, *, notes: str = "") -> dict[str, Any]:
    """Return a task as a JSON-serializable dict.

    Args:
        task: The task.
        notes: Notes that the task's card shows besides the description, for example about randomization.

    Raises:
        InvalidInputError: If two different objects or slots of the task have the same name, because the JSON form
            identifies them by name.
    """
    slots = {slot.name: slot for slot in task.slots}
    objects: dict[str, ObjectSpec] = {}
    arguments = [value for v in task.variations for o in v.interventions for value in o.arguments.values()]
    listed = [o for regime in task.regimes.values() for c in regime.conditions for o in c.objects]
    for value in [*(o for c in task.training for o in c.objects), *arguments, *listed]:
        known: dict[str, Any] = objects if isinstance(value, ObjectSpec) else slots
        if isinstance(value, ObjectSpec | Slot) and known.setdefault(value.name, value) != value:
            problem = f"two different objects or slots are named {value.name!r}"
            raise InvalidInputError(f"task {task.id}", problem, "Give each object and each slot a unique name")
    packaged = TEMPLATES.get(task.template.name) == task.template
    form = {
        "schema_version": SCHEMA_VERSION,
        "id": task.id,
        "version": task.version,
        "title": task.title,
        "description": task.description,
        "notes": notes,
        "template": task.template.name if packaged else template_to_json(task.template),
        "slots": [asdict(slot) for slot in slots.values()],
        "objects": [asdict(spec) for spec in objects.values()],
        "training": [_condition_form(condition) for condition in task.training],
        "variations": [_variation_form(variation) for variation in task.variations],
    }
    if task.regimes:
        form["regimes"] = {name: _regime_form(regime) for name, regime in task.regimes.items()}
    if task.robot != USUAL_ROBOT:
        form["robot"] = task.robot
    if task.matrices:
        form["matrices"] = [asdict(matrix) for matrix in task.matrices]
    plain: dict[str, Any] = json.loads(json.dumps(form))  # lists for tuples, strings for enumerations
    return plain


def _condition_form(condition: Condition) -> dict[str, Any]:
    form = condition.to_json()
    del form["task"], form["name"]
    return {**form, "objects": [o.name for o in condition.objects]}


def _regime_form(regime: ListedRegime) -> dict[str, Any]:
    conditions = [_condition_form(condition) for condition in regime.conditions]
    return {"conditions": conditions, "crossed": regime.crossed, "slots": [asdict(slot) for slot in regime.slots]}


def _variation_form(variation: Variation) -> dict[str, Any]:
    form = {f.name: getattr(variation, f.name) for f in dataclasses.fields(variation) if f.name != "interventions"}
    return {**form, "do": [_operation_form(operation) for operation in variation.interventions]}


def _operation_form(operation: Operation) -> dict[str, Any]:
    def plain(value: object) -> object:
        if isinstance(value, ObjectSpec | Slot):
            return value.name
        return asdict(value) if isinstance(value, Instruction) else value

    return {"operation": operation.name, **{name: plain(value) for name, value in operation.arguments.items()}}


def task_from_json(form: Mapping[str, Any] | str | bytes, *, where: str = "task") -> Task:
    """Read a task from JSON, and check that its conditions and variations follow its template.

    Args:
        form: A JSON object, or a string that contains it.
        where: Name of the file in error messages.

    Raises:
        InvalidInputError: If a field is missing, unknown, of the wrong type or out of range. It is also raised if a
            field names an object, slot, template, relation, operation or condition that does not exist, or if a
            condition does not follow the template. The message names the path of the field.
    """
    read = read_form(_FORM, form if isinstance(form, str | bytes) else dict(form), where=where, cure=_CURE)
    names = _Names(where, read)
    template = _template(read.template, where)
    training = tuple(
        _condition(condition, names, f"training[{i}]", name=f"train{i + 1}")
        for i, condition in enumerate(read.training)
    )
    variations = tuple(_variation(v, names, f"variations[{i}]") for i, v in enumerate(read.variations))
    names.require_distinct("variations", [v.name for v in variations])
    task = Task(
        id=read.id,
        version=read.version,
        title=read.title,
        description=read.description,
        template=template,
        slots=tuple(names.slots.values()),
        training=training,
        variations=variations,
        robot=read.robot,
        matrices=_matrices(read, names),
    )
    task = dataclasses.replace(task, regimes=_regimes(dict(read.regimes.items()), names))
    require_readable(task)
    _require_applicable(task, names)
    try:
        require_no_test(task)
    except InvalidInputError as error:
        raise names.wrong(error.where.partition(": ")[2], error.problem, error.cure) from error
    return task


class _Names:
    """Reader of a task in JSON form.

    It finds objects and slots by name, and its errors contain the path of the field.
    """

    def __init__(self, where: str, form: _Form) -> None:
        self.where, self.task = where, form.id
        self.require_distinct("slots", [slot.name for slot in form.slots])
        self.require_distinct("objects", [spec.name for spec in form.objects])
        self.slots = {slot.name: Slot(**asdict(slot)) for slot in form.slots}
        self.objects = {spec.name: ObjectSpec(**{**asdict(spec), "mount": _place(spec.mount)}) for spec in form.objects}

    def wrong(self, path: str, problem: str, cure: str = _CURE) -> InvalidInputError:
        return InvalidInputError(f"{self.where}: {path}", problem, cure)

    def require_distinct(self, path: str, names: Sequence[str]) -> None:
        twice = [name for name, times in Counter(names).items() if times > 1]
        if twice:
            raise self.wrong(path, f"{one_line(repr(twice[0]), most=80)} is given twice", "Use each name only once")

    def find(self, path: str, kind: str, name: str, known: Mapping[str, Any]) -> Any:  # noqa: ANN401
        if name not in known:
            raise self.unknown(path, UnknownNameError(kind, name, known))
        return known[name]

    def unknown(self, path: str, error: BetterError) -> InvalidInputError:
        return self.wrong(path, one_line(str(error), most=400).rstrip("."))

    def object(self, path: str, name: str) -> ObjectSpec:
        found: ObjectSpec = self.find(path, "object", name, self.objects)
        return found

    def slot(self, path: str, name: str) -> Slot:
        found: Slot = self.find(path, "slot", name, self.slots)
        return found


def _place(form: _Place | None) -> TargetRegion | None:
    return None if form is None else TargetRegion(form.target, form.region)


def _template(form: str | dict[str, Any], where: str) -> Template:
    if isinstance(form, str):
        if form not in TEMPLATES:
            problem = one_line(str(UnknownNameError("template", form, TEMPLATES)), most=400).rstrip(".")
            raise InvalidInputError(
                f"{where}: template", problem, "Use the name of a packaged template, or write a complete template"
            )
        return TEMPLATES[form]
    try:
        return template_from_json(form)
    except InvalidInputError as error:
        raise InvalidInputError(f"{where}: {error.where}", error.problem, error.cure) from error


def _instruction(form: _Instruction, names: _Names, path: str) -> Instruction:
    subgoals = []
    for i, goal in enumerate(form.subgoals):
        at = f"{path}.subgoals[{i}]"
        names.find(f"{at}.relation", "relation", goal.relation, RELATIONS)
        names.object(f"{at}.target", goal.target)
        if (goal.reference.kind is None) == (goal.reference.slot is None):
            raise names.wrong(f"{at}.reference", "must contain either a kind or a slot", "Set exactly one of the two")
        if goal.reference.slot is not None:
            names.slot(f"{at}.reference.slot", goal.reference.slot)
        reference = Reference(goal.reference.kind, goal.reference.slot)
        subgoals.append(Subgoal(**{**asdict(goal), "reference": reference}))
    return Instruction(form.text, tuple(subgoals), form.ordered)


def _condition(form: _Condition, names: _Names, path: str, *, name: str) -> Condition:
    names.require_distinct(f"{path}.objects", form.objects)
    objects = tuple(names.object(f"{path}.objects[{i}]", one) for i, one in enumerate(form.objects))
    present = {spec.name: spec for spec in objects}
    for one, slot in form.layout.items():
        names.find(f"{path}.layout", "object of this condition", one, present)
        names.slot(f"{path}.layout.{one}", slot)
    names.require_distinct(f"{path}.layout", list(form.layout.values()))
    for one, place in form.preplaced.items():
        names.find(f"{path}.preplaced", "object of this condition", one, present)
        names.find(f"{path}.preplaced.{one}.target", "object of this condition", place.target, present)
    for one in form.opened:
        names.find(f"{path}.opened", "object of this condition", one, present)
    for spec in objects:
        starts = (spec.name in form.layout) + (spec.name in form.preplaced) + (spec.mount is not None)
        if starts != 1:
            problem = f"{spec.name!r} starts in {starts} places"
            raise names.wrong(
                path,
                problem,
                "Specify exactly one start for this object: a slot in layout, a target in preplaced, or a mount",
            )
    return Condition(
        task=names.task,
        name=name,
        objects=objects,
        layout=form.layout,
        instruction=_instruction(form.instruction, names, f"{path}.instruction"),
        preplaced={one: TargetRegion(place.target, place.region) for one, place in form.preplaced.items()},
        opened=form.opened,
        expected=form.expected,
        mid_task_look=form.mid_task_look,
        premise_broken=form.premise_broken,
        cloth=form.cloth,
        watch_steps=form.watch_steps,
    )


def _regimes(form: Mapping[str, _Regime], names: _Names) -> dict[str, ListedRegime]:
    """Return the listed regimes. Their conditions may use extra slots in addition to the slots of the task."""
    found = {}
    own = dict(names.slots)
    for regime, listed in form.items():
        path = f"regimes.{regime}"
        slots = tuple(Slot(**asdict(slot)) for slot in listed.slots)
        names.require_distinct(f"{path}.slots", [*own, *(slot.name for slot in slots)])
        names.slots = {**own, **{slot.name: slot for slot in slots}}
        numbered = enumerate(listed.conditions)
        conditions = tuple(_condition(c, names, f"{path}.conditions[{i}]", name="") for i, c in numbered)
        found[regime] = ListedRegime(conditions, listed.crossed, slots)
    names.slots = own
    return named_regimes(found, names.task)


def _matrices(form: _Form, names: _Names) -> tuple[ConditionMatrix, ...]:
    """Return the diagnostic matrices, after checking that their conditions exist."""
    known = {f"train{i + 1}": None for i in range(len(form.training))} | {v.name: None for v in form.variations}
    found = []
    for i, matrix in enumerate(form.matrices):
        for j, cell in enumerate(matrix.cells):
            for condition in cell.conditions:
                names.find(f"matrices[{i}].cells[{j}].conditions", "condition", condition, known)
        cells = tuple(MatrixCell(**{f.name: getattr(c, f.name) for f in dataclasses.fields(c)}) for c in matrix.cells)
        try:
            found.append(ConditionMatrix(matrix.horizon, matrix.rows, matrix.columns, cells))
        except InvalidInputError as error:
            raise names.wrong(f"matrices[{i}]", error.problem, error.cure) from error
    return tuple(found)


def _variation(form: _Variation, names: _Names, path: str) -> Variation:
    try:
        Axis.of(form.name)
    except ValueError as error:
        raise names.wrong(f"{path}.name", one_line(str(error), most=200), "Rename the variation") from error
    done = tuple(_operation(operation, names, f"{path}.do[{i}]") for i, operation in enumerate(form.do))
    given = {f.name: getattr(form, f.name) for f in dataclasses.fields(form) if f.name != "do"}
    return Variation(interventions=done, **given)


def _operation(form: Mapping[str, Any], names: _Names, path: str) -> Operation:
    """Return the operation that a JSON field describes, with its objects and slots looked up by name."""
    try:
        make = operation_named(str(form.get("operation", "")))
    except UnknownNameError as error:
        raise names.unknown(f"{path}.operation", error) from error
    _, *parameters = inspect.signature(make).parameters.values()
    expected = {parameter.name: parameter for parameter in parameters}
    for name in form:
        if name not in ("operation", *expected):
            raise names.unknown(f"{path}.{one_line(name, most=80)}", UnknownNameError("argument", name, expected))
    arguments: dict[str, Any] = {}
    for name, parameter in expected.items():
        if name in form:
            arguments[name] = _argument(form[name], str(parameter.annotation), names, f"{path}.{name}")
        elif parameter.default is inspect.Parameter.empty:
            raise names.wrong(f"{path}.{name}", "is missing")
    made: Operation = make(**arguments)
    return made


def _argument(value: object, annotation: str, names: _Names, path: str) -> object:
    where, text = f"{names.where}: {path}", json.dumps(value)
    match annotation:
        case "ObjectSpec":
            return names.object(path, read_form(_TEXT, text, where=where, cure=_CURE))
        case "Slot":
            return names.slot(path, read_form(_TEXT, text, where=where, cure=_CURE))
        case "Instruction":
            return _instruction(read_form(_INSTRUCTION, text, where=where, cure=_CURE), names, path)
        case "float":
            return read_form(_NUMBER, text, where=where, cure=_CURE)
        case "str":
            return read_form(_TEXT, text, where=where, cure=_CURE)
    raise names.wrong(path, f"an argument of type {annotation} has no JSON form", "Write the task in Python")


def _require_applicable(task: Task, names: _Names) -> None:
    """Check that every training condition and every variation follows the template of the task."""
    bases = {condition.name: condition for condition in task.training}
    for i, condition in enumerate(task.training):
        _require_pattern(task, condition, names, f"training[{i}]")
    for regime, listed in task.regimes.items():
        for i, condition in enumerate(listed.conditions):
            _require_pattern(task, condition, names, f"regimes.{regime}.conditions[{i}]")
    for i, variation in enumerate(task.variations):
        path = f"variations[{i}]"
        condition = names.find(f"{path}.base", "training condition", variation.base, bases)
        for j, operation in enumerate(variation.interventions):
            try:
                condition, _ = operation.carry_out(condition)
            except BetterError as error:
                raise names.unknown(f"{path}.do[{j}]", error) from error
        condition = condition.with_(premise_broken=variation.premise_broken)
        _require_pattern(task, condition, names, path)


def _require_pattern(task: Task, condition: Condition, names: _Names, path: str) -> None:
    problems = task.template.problems(condition)
    if problems:
        cure = f"Follow the template {task.template.name}, or name a different template"
        raise names.wrong(path, one_line("; ".join(problems), most=400), cure)
    present = {spec.name for spec in condition.objects}
    missing = [goal.target for goal in condition.instruction.subgoals if goal.target not in present]
    if missing:
        raise names.wrong(f"{path}.instruction", f"its target {missing[0]!r} is not in the scene", "Add this object")


def register_task_form(file: TaskFile) -> None:
    """Register the task that a JSON task file contains.

    Raises:
        InvalidInputError: If the content is not a valid task, or if another file has registered a task of the same
            name.
    """
    made = task_from_json(file.source, where=file.path)
    notes = parse_json(file.source).get("notes", "")

    def build() -> Task:
        return made

    build.__name__ = build.__qualname__ = made.id
    build.__module__ = "a_task_file_in_json"
    build.__doc__ = "\n\n".join(part for part in (made.description, notes) if part)
    registry.task(build)


READERS[".json"] = register_task_form


def task_forms(tasks: Iterable[str]) -> dict[str, dict[str, Any]]:
    """Return registered tasks as JSON-serializable dicts by name, including their notes.

    Raises:
        UnknownNameError: If one of the tasks does not exist.
    """
    forms = {}
    for name in tasks:
        _, _, notes = registry.notes_of(name).partition("\n")
        forms[name] = task_to_json(registry.get_task(name), notes=notes.strip())
    return forms
