"""Detection of the quantity that a component of an external data set measures, based on the component's name.

The name of a component is taken from ``meta/modality.json``, ``meta/info.json``, or the name of its column, in this
order. The index of a component in its vector is not used, because the last component is not always the gripper. It may
belong to a waist or a thumb.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from betterbench.errors import InvalidInputError, UnknownNameError, one_line

MOST_NUMBERS = 10_000
"""Maximum number of components in a column."""
_MOST_DIGITS = 9

_GRIPPER = re.compile(r"grip|claw$|jaws?$")
_FINGERS = {"finger", "fingers", "thumb", "index", "middle", "ring", "pinky", "pinkie", "little", "hand", "palm"}
_NAMED_FINGERS = _FINGERS - {"finger", "fingers"}
_RATES = {
    "vel", "velocity", "velocities", "qvel", "speed", "acc", "acceleration", "effort", "force", "torque", "current",
    "temperature", "load", "stiffness", "damping",
}  # fmt: skip
_TURNS = {
    "rot", "rotation", "quat", "quaternion", "euler", "axis", "angle", "roll", "pitch", "yaw", "rx", "ry", "rz", "qx",
    "qy", "qz", "qw", "wx", "wy", "wz", "rpy", "orientation", "ori",
}  # fmt: skip
_JOINTS = {
    "joint", "joints", "shoulder", "elbow", "wrist", "forearm", "upperarm", "waist", "motor", "servo", "pan", "lift",
    "flex", "arm", "qpos",
}  # fmt: skip
_BODY = {
    "head", "neck", "torso", "trunk", "hip", "knee", "ankle", "leg", "base", "wheel", "toe", "foot", "chassis", "waist",
}  # fmt: skip
_OTHERS = {
    "goal", "target", "object", "obj", "cam", "camera", "env", "environment", "com", "delta", "leader", "pixel",
    "image", "reward", "waypoint",
}  # fmt: skip
_EFFECTORS = {"ee", "eef", "eff", "tcp", "effector", "endeffector", "tool", "cartesian", "tip", "hand"}
_POSITIONS = {"pos", "position", "positions", "pose", "xyz", "translation", "trans", "cartesian"}
_SIDES = {"left": "left", "l": "left", "right": "right", "r": "right"}
_NUMBERED = re.compile(r"(?:arm|robot|gripper|agent|follower)[_.\s]?(\d+)")


@dataclass(frozen=True, slots=True)
class NamedNumber:
    """Component of a column.

    Attributes:
        column: Name of the column.
        index: Index of the component in the column.
        name: Name of the component in ``meta/info.json``; "" if it has none.
        labels: All names of the component from different files, starting with the most specific.
        by: Source of each of these names.
    """

    column: str
    index: int
    name: str
    labels: tuple[str, ...]
    by: tuple[str, ...]

    @property
    def shown(self) -> str:
        """Text that denotes this component in the options ``--gripper`` and ``--place``."""
        return f"{self.column}:{self.name}" if self.name else f"{self.column}[{self.index}]"


@dataclass(frozen=True, slots=True)
class NumberRole:
    """Physical quantity that a component measures, and the arm that it belongs to.

    Attributes:
        kind: ``gripper``, ``finger``, ``hand``, ``x``, ``y``, ``z``, ``joint``, ``body`` or ``other``; "" if unknown.
        arm: ``left``, ``right`` or a number as text; "" if unknown.
        by: Source of the name that determined the kind.
        kinds: Kind according to each of the component's names.
    """

    kind: str
    arm: str
    by: str
    kinds: tuple[str, ...]


def tokens(name: str) -> list[str]:
    """Split a name into its words and numbers in lower case, e.g. "leftArm_joint2" into left, arm, joint, 2."""
    split = re.sub(r"(?<=[a-z0-9])(?=[A-Z])", " ", name)
    return re.findall(r"[a-z]+|\d+", split.lower())


def arm_in(name: str) -> str:
    """Return the arm that a name mentions: ``left``, ``right``, or a number as a string; "" if it mentions no arm."""
    found = {_SIDES[token] for token in tokens(name) if token in _SIDES}
    if len(found) == 1:
        return found.pop()
    numbered = _NUMBERED.search(name.lower())
    return "" if found or numbered is None or numbered.group().startswith("gripper") else numbered.group(1)


def size_of(feature: object) -> int:
    """Return the number of components in a column.

    Return 0 for images, texts, integers, and arrays with more than one axis, because they are not vectors of
    measurements.
    """
    if not isinstance(feature, dict) or not str(feature.get("dtype")).startswith("float"):
        return 0
    shape = feature.get("shape")
    if not isinstance(shape, list) or not all(isinstance(n, int) and not isinstance(n, bool) for n in shape):
        return 0
    wide = [n for n in shape if n != 1]
    return (wide or [1])[0] if len(wide) <= 1 and all(0 < n <= MOST_NUMBERS for n in shape) else 0


def names_of(feature: object) -> list[str]:
    """Return the names of a column's components in order. They may be stored in nested lists and maps."""
    found = list(_names(feature.get("names") if isinstance(feature, dict) else None, "", 0))
    return [one_line(name, most=80) for name in found[:MOST_NUMBERS]]


def _names(form: object, prefix: str, depth: int) -> Iterable[str]:
    if isinstance(form, dict) and depth < 4:
        if form and all(isinstance(value, int) and not isinstance(value, bool) for value in form.values()):
            yield from (prefix + str(name) for name, _ in sorted(form.items(), key=lambda item: item[1]))
            return
        several = sum(isinstance(value, list | dict) for value in form.values()) > 1
        for key, value in form.items():
            yield from _names(value, f"{prefix}{key}." if several else prefix, depth + 1)
    elif isinstance(form, list) and depth < 4:
        for value in form:
            yield from _names(value, prefix, depth + 1)
    elif not isinstance(form, list | dict) and (depth or form is not None):
        yield prefix + str(form) if form is not None else ""


def columns_of(features: Mapping[str, Any], modality: Mapping[str, Any]) -> dict[str, tuple[NamedNumber, ...]]:
    """Return the components of each column of floating-point numbers.

    Args:
        features: Content of ``features`` in ``meta/info.json``.
        modality: Content of ``meta/modality.json``; empty if the file does not exist.
    """
    spans = _spans(modality)
    found = {}
    for column, feature in features.items():
        size = size_of(feature)
        names = names_of(feature)
        if (len(names) == 1 and size > 1) or len(names) > size:
            names = []  # data sets made for openpi have one name for all components
        numbers = []
        for index in range(size):
            name = names[index] if index < len(names) else ""
            labels = [
                ("meta/modality.json", spans.get((column, index), "")),
                ("names in meta/info.json", name),
                ("name of the column", f"{column}.{index}" if size > 1 else column),
            ]
            kept = [(by, label) for by, label in labels if label]
            numbers.append(NamedNumber(column, index, name, tuple(x for _, x in kept), tuple(by for by, _ in kept)))
        if size:
            found[column] = tuple(numbers)
    return found


def _spans(modality: Mapping[str, Any]) -> dict[tuple[str, int], str]:
    """Return the names in ``meta/modality.json`` by column and index of the component."""
    found: dict[tuple[str, int], str] = {}
    for kind, usual in (("state", "observation.state"), ("action", "action")):
        entries = modality.get(kind)
        for key, span in entries.items() if isinstance(entries, dict) else ():
            start, end = (span.get("start"), span.get("end")) if isinstance(span, dict) else (None, None)
            if not isinstance(start, int) or not isinstance(end, int) or not 0 <= start < end <= MOST_NUMBERS:
                problem = f"{kind}.{one_line(key, most=80)} has no start and end"
                raise InvalidInputError("meta/modality.json", problem, "Correct this entry, or remove the file")
            column = span.get("original_key") or usual
            for index in range(start, end):
                name = one_line(key, most=80)
                found[str(column), index] = f"{name}.{index - start}" if end - start > 1 else name
    return found


def parts_of(numbers: Sequence[NamedNumber]) -> list[NumberRole]:
    """Determine the role of each component of a column from its names."""
    sets = [_parts(numbers, level) for level in range(3)]
    parts = []
    for i, number in enumerate(numbers):
        found = [sets[level][i] for level in range(len(number.labels))]
        said = [(kind, by) for kind, by in zip(found, number.by, strict=True) if kind]
        # A gripper at the end of a range such as "left_arm" is recognized by its own name.
        named = next((one for one in said if one[0] == "gripper" and said[0][0] == "joint"), None)
        kind, by = named or (said[0] if said else ("", ""))
        arm = next((arm for label in (*number.labels, number.column) if (arm := arm_in(label))), "")
        parts.append(NumberRole(kind, arm, by, tuple(found)))
    return parts


def _parts(numbers: Sequence[NamedNumber], level: int) -> list[str]:
    """Return the kind of each component, as implied by the names in one file.

    Args:
        numbers: Components of a column.
        level: Index of the source in the ``labels`` of each component.
    """
    labels = [number.labels[level] if level < len(number.labels) else "" for number in numbers]
    kinds = [_kind(label) for label in labels]
    # If positions have an index but no axis name, the first three components with the same name are x, y and z.
    start = 0
    for base, group in itertools.groupby(labels, key=lambda label: re.sub(r"[\W_]*\d+\]?$", "", label)):
        size = len(list(group))
        words = set(tokens(base))
        numbered = labels[start] != base
        if numbered and size in (2, 3, 6, 7, 9) and _is_position(words):
            kinds[start : start + size] = [*"xyz"[: min(size, 3)], *[""] * (size - 3)][:size]
        start += size
    return kinds


def _is_position(words: set[str]) -> bool:
    gripper = any(_GRIPPER.match(word) for word in words) and words & {"pose", "xyz", "translation"}
    effector = words & _EFFECTORS and words & _POSITIONS
    return bool(gripper or effector) and not words & (_TURNS | _RATES | _OTHERS | {"joint", "joints"} | _BODY)


def _kind(label: str) -> str:
    words = tokens(label)
    known = set(words)
    if known & (_RATES | _OTHERS) or known & {"dx", "dy", "dz"}:
        return "other"
    axes, turns = known & {"x", "y", "z"}, known & _TURNS
    if len(axes) == 1 and not turns and not known & (_JOINTS - {"arm", "wrist"} | _BODY):
        return axes.pop()
    if any(_GRIPPER.match(word) for word in words):
        return "other" if turns or axes or known & {"pose", "xyz"} else "gripper"
    if known & _NAMED_FINGERS and not known & _EFFECTORS - {"hand"}:
        return "hand"
    if known & _FINGERS:
        return "finger"
    if known & _BODY and not (known & _SIDES.keys() and "waist" in known):
        return "body"
    if known & _JOINTS or any(re.fullmatch(r"j|q", word) for word in words):
        return "joint"
    return "other" if turns else ""


def find_column(option: str, name: str, known: Iterable[str]) -> str:
    """Return the column name that the user passed to an option.

    If this column does not exist, raise an UnknownNameError that suggests similar names.
    """
    columns = list(known)
    if name not in columns:
        raise UnknownNameError(f"column in {option}", name, columns)
    return name


def named_numbers(option: str, text: str, columns: Mapping[str, Sequence[NamedNumber]]) -> tuple[NamedNumber, ...]:
    """Return the components that the user specified as ``COLUMN``, ``COLUMN[2]``, ``COLUMN[0,1,2]`` or ``COLUMN:NAME``.

    Raises:
        UnknownNameError: If the column or the name does not exist.
        InvalidInputError: If an index is out of range, or several components have the name.
    """
    if text in columns:
        return tuple(columns[text])
    indexed = re.fullmatch(r"(.+)\[([\d,\s]+)\]", text)
    if indexed:
        numbers = columns[find_column(option, indexed.group(1), columns)]
        chosen = re.findall(r"\d+", indexed.group(2))
        for i in chosen:
            if len(i) > _MOST_DIGITS or int(i) >= len(numbers):
                problem = f"{indexed.group(1)} has {len(numbers)} components, so {one_line(i, most=20)} does not exist"
                raise InvalidInputError(option, problem, f"Use an index from 0 to {len(numbers) - 1}")
        return tuple(numbers[int(i)] for i in chosen)
    column, colon, name = text.partition(":")
    numbers = columns[find_column(option, column, columns)]
    found = [n for n in numbers if name in (n.name, *n.labels)]
    if not colon or not found:
        raise UnknownNameError(f"component of {column}", name, {n.name or str(n.index) for n in numbers})
    if len(found) > 1:
        problem = f"{len(found)} components of {column} have the name {one_line(name, most=80)!r}"
        which = ", ".join(str(n.index) for n in found[:8])
        raise InvalidInputError(option, problem, f"Write {column}[N], where N is one of {which}")
    return (found[0],)
