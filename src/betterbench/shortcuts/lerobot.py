"""What a stranger's LeRobot dataset shows, versions 2.0 to 3.0: instruction, actions and proprioception, and no state.

Things have no names there. A place is where the gripper closes or opens: a cell of the plane in which the tool moves,
cut at the gaps between the places that are found. Files are laid out as huggingface/lerobot 0.4 writes them.
"""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from betterbench.errors import InvalidInputError, RecordError, one_line
from betterbench.json_form import parse_json, read_bounded, read_object
from betterbench.shortcuts.facts import EpisodeFacts, ShownStep

GAP_SHARE = 0.08
"""Gap between neighboring values, as a share of the range of the longer axis, at which an axis is cut into cells."""
NARROW_SHARE = 0.2
"""Range of an axis, as a share of that of the longer one, below which it is not cut."""
LEAST_SHARE = 0.05
"""Least share of all values in a cell."""
CELLS = 3
"""Cells of an axis without gaps, each with as many values."""
SET_OUT_SHARE = 0.1
"""Way of the tool, as a share of the range of all its positions, after which its direction is taken."""
DIRECTIONS = 8
SHORTEST_S = 0.3
"""Time for which a gripper is closed or open at least [s]: shorter commands, as teleoperators give, are no grasps."""
USUAL_FPS = 10.0
MOST_NUMBERS = 10_000
"""Most numbers of a column per frame."""
MOST_EPISODES = 5000
"""Most episodes that are read, evenly chosen; the test needs no more."""
_MAX_JSON_BYTES = 256 * 1024 * 1024
_CURE = "Give the folder of a LeRobot dataset, which has meta/info.json and data"

_Floats = npt.NDArray[np.float64]
_Ints = npt.NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class _Columns:
    """Which columns and numbers of them are looked at.

    Attributes:
        widths: How many numbers each column has that is read: 1, or as many as the features say.
        state: Name of the column with the proprioception.
        action: Name of the column with the actions.
        position: Numbers of it that are x and y of the tool; None where its names do not tell.
        grip: Number of the action that moves the gripper.
        gripless: Numbers of the state that are not the gripper.
    """

    widths: Mapping[str, int]
    state: str
    action: str
    position: tuple[int, int] | None
    grip: int
    gripless: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class _Episode:
    index: int
    task: int
    state: _Floats
    grip: _Floats


def is_lerobot_dataset(path: Path) -> bool:
    """Tell whether a folder looks like a LeRobot dataset."""
    return (path / "meta" / "info.json").is_file()


def facts_of_lerobot(path: Path) -> tuple[EpisodeFacts, ...]:
    """Return what each episode of a LeRobot dataset shows; of a very large one, of as many as the test needs.

    Raises:
        InvalidInputError: If the folder is no such dataset, or has no instruction, action or proprioception.
        RecordError: If a file of it cannot be read.
    """
    info = _info(path)
    columns = _columns(path, info)
    tasks = _tasks(path)
    episodes = list(_episodes(path, info, columns))
    if not episodes:
        raise InvalidInputError(str(path / "data"), "it holds no episode", _CURE)
    unknown = sorted({e.task for e in episodes} - tasks.keys())
    if unknown:
        raise RecordError(f"{path / 'meta'}: it names no task {unknown[0]}, which the data has. Write the file again.")
    plane = _Plane([e.state for e in episodes], columns)
    rest, shortest = _rest(episodes), _shortest(info)
    closed = [_closings(e.grip, rest, shortest) for e in episodes]
    where = [plane.of(e.state) for e in episodes]
    origins = _places([w[start] for w, found in zip(where, closed, strict=True) for start, _ in found])
    targets = _places([w[stop] for w, found in zip(where, closed, strict=True) for _, stop in found])
    group, facts, k = f"LeRobot dataset {path.absolute().name}", [], 0
    for e, points, found in zip(episodes, where, closed, strict=True):
        steps = tuple(ShownStep("", "", origins[k + i], targets[k + i]) for i in range(len(found)))
        k += len(found)
        heading = _direction(points, plane.span)
        facts.append(EpisodeFacts(f"episode {e.index}", group, tasks[e.task], steps, heading=heading))
    return tuple(facts)


def _info(path: Path) -> Mapping[str, Any]:
    file = path / "meta" / "info.json"
    info = read_object(file, max_bytes=_MAX_JSON_BYTES, cure=_CURE)
    if not isinstance(info.get("features"), dict):
        raise InvalidInputError(str(file), "it lists no features", _CURE)
    version = info.get("codebase_version", "v3.0")
    if not re.match(r"v[23]\.", str(version)):
        problem = f"codebase_version is {one_line(version, most=40)!r}, and 2.0 to 3.0 are read"
        raise InvalidInputError(str(file), problem, "Convert the dataset with lerobot's own scripts")
    return info


def _shortest(info: Mapping[str, Any]) -> int:
    """Return the least number of frames in which a gripper is closed or open."""
    fps = info.get("fps")
    rate = float(fps) if isinstance(fps, int | float) and 0.0 < fps < 1e4 else USUAL_FPS
    return max(1, round(SHORTEST_S * rate))


def _columns(path: Path, info: Mapping[str, Any]) -> _Columns:
    """Return which columns are looked at; InvalidInputError if there is no action or no proprioception."""
    features, file = info["features"], str(path / "meta" / "info.json")
    sizes = {name: _size(feature) for name, feature in features.items()}
    if not sizes.get("action") and not sizes.get("actions"):
        raise InvalidInputError(file, "the dataset has no column action", "Give one with actions")
    states = [name for name in ("observation.state", "state") if sizes.get(name)]
    states += sorted(name for name, size in sizes.items() if size and name.startswith("observation."))
    if not states:
        raise InvalidInputError(
            file, "the dataset has no proprioception (observation.state)", "Give one with proprioception"
        )
    action = "action" if sizes.get("action") else "actions"
    names, acts = (_names(features[name])[: sizes[name]] for name in (states[0], action))
    grips = [i for i, name in enumerate(acts) if "grip" in name]
    position = None
    axes = [next((i for i, name in enumerate(names) if _is_axis(name, axis)), None) for axis in "xy"]
    if axes[0] is not None and axes[1] is not None:
        position = (axes[0], axes[1])
    gripless = tuple(i for i in range(sizes[states[0]]) if i >= len(names) or "grip" not in names[i])
    if not gripless:
        raise InvalidInputError(file, f"all numbers of {states[0]} are of the gripper", "Correct their names")
    widths = {"episode_index": 1, "task_index": 1, states[0]: sizes[states[0]], action: sizes[action]}
    return _Columns(widths, states[0], action, position, grips[-1] if grips else sizes[action] - 1, gripless)


def _size(feature: object) -> int:
    """Return how many numbers a column has per frame; 0 for images, texts and single numbers."""
    shape = feature.get("shape") if isinstance(feature, dict) else None
    dtype = str(feature.get("dtype")) if isinstance(feature, dict) else ""
    one = isinstance(shape, list) and len(shape) == 1 and isinstance(shape[0], int)
    return int(shape[0]) if one and dtype.startswith("float") and 1 < shape[0] <= MOST_NUMBERS else 0  # type: ignore[index]


def _names(feature: Mapping[str, Any]) -> list[str]:
    names = feature.get("names")
    if isinstance(names, dict):
        names = next((value for value in names.values() if isinstance(value, list)), None)
    if not isinstance(names, list):
        return []
    flat = itertools.chain.from_iterable(name if isinstance(name, list) else [name] for name in names)
    return [str(name).lower() for name in flat]


def _is_axis(name: str, axis: str) -> bool:
    parts = re.split(r"[^a-z]+", name)
    rotation = any(word in name for word in ("rot", "quat", "axis", "euler", "vel"))
    return axis in parts and not rotation


def _tasks(path: Path) -> dict[int, str]:
    """Return the instructions by their number; of version 3 from Parquet, of version 2 from JSON lines."""
    lines, table = path / "meta" / "tasks.jsonl", path / "meta" / "tasks.parquet"
    try:
        if table.is_file():
            found = pq.read_table(table).to_pydict()
            texts = next((values for name, values in found.items() if name != "task_index"), None)
            if texts is None:
                raise ValueError("it has no column with them")  # noqa: TRY301 - told below
            return {int(i): str(text) for i, text in zip(found["task_index"], texts, strict=True)}
        data = read_bounded(lines, max_bytes=_MAX_JSON_BYTES, cure=_CURE)
        forms = [parse_json(line) for line in data.decode().splitlines() if line.strip()]
        return {int(form["task_index"]): str(form["task"]) for form in forms}
    except (pa.ArrowException, OSError, ValueError, KeyError, TypeError, ArithmeticError) as error:
        where = table if table.is_file() else lines
        raise RecordError(f"{where}: the instructions cannot be read ({one_line(error)}). {_CURE}.") from error


def _episodes(path: Path, info: Mapping[str, Any], columns: _Columns) -> Iterator[_Episode]:
    """Yield episodes in the order of their files, evenly chosen if there are very many.

    Raises RecordError if one stands there twice, or there are not as many as the dataset says.
    """
    total, there = info.get("total_episodes"), set[int]()
    every = max(1, math.ceil(total / MOST_EPISODES)) if isinstance(total, int) else 1
    for file in sorted((path / "data").rglob("*.parquet")):
        rows = _rows(file, columns)
        index = rows["episode_index"].astype(np.int64)
        for start, stop in _runs(index):
            number = int(index[start])
            if number in there:
                raise RecordError(f"{file}: episode {number} stands in the data twice. Fetch the files again.")
            there.add(number)
            if number % every == 0 and stop - start >= 2:
                grip = rows[columns.action][start:stop, columns.grip]
                yield _Episode(number, int(rows["task_index"][start]), rows[columns.state][start:stop], grip)
    if there and isinstance(total, int) and total != len(there):
        where, what = path / "meta" / "info.json", f"total_episodes is {total}, and the data hold {len(there)}"
        raise RecordError(f"{where}: {what}. Fetch the files that are missing, or correct the number.")


def _rows(file: Path, columns: _Columns) -> Mapping[str, _Floats]:
    """Return the columns of a file that are looked at; RecordError if one is missing, or not as the features say."""
    try:
        missing = [name for name in columns.widths if name not in pq.read_schema(file).names]
        if missing:
            raise RecordError(f"{file}: it has no column {missing[0]}. {_CURE}.")
        table = pq.read_table(file, columns=list(columns.widths))
        rows = {name: _numbers(table.column(name), width) for name, width in columns.widths.items()}
    except (pa.ArrowException, OSError, ValueError, KeyError) as error:
        raise RecordError(f"{file}: it cannot be read ({one_line(error)}). Fetch the file again.") from error
    for name, values in rows.items():
        bad = np.flatnonzero(~np.isfinite(values if values.ndim == 1 else values.sum(axis=1)))
        if bad.size:
            raise RecordError(f"{file}: {name} is no finite number in row {bad[0]}. Leave the episode out.")
    return rows


def _numbers(column: pa.ChunkedArray, width: int) -> _Floats:
    """Return a column as numbers, one row per frame; ValueError if it does not have ``width`` numbers per frame."""
    flat = column.combine_chunks()
    if width == 1:
        return np.asarray(flat.to_numpy(zero_copy_only=False), dtype=np.float64)
    listed = pa.types.is_list(flat.type) or pa.types.is_large_list(flat.type) or pa.types.is_fixed_size_list(flat.type)
    if listed and any(count != width for count in pc.unique(pc.list_value_length(flat)).to_pylist()):
        msg = f"a column does not have {width} numbers in each row"
        raise ValueError(msg)
    values = np.asarray((flat.flatten() if listed else flat).to_numpy(zero_copy_only=False), dtype=np.float64)
    if len(values) != width * len(flat):
        msg = f"a column has {len(values)} numbers in {len(flat)} rows, and not {width} in each"
        raise ValueError(msg)
    return values.reshape(len(flat), width)


def _runs(index: _Ints) -> Iterator[tuple[int, int]]:
    """Yield the rows [start, stop) of each episode."""
    edges = [0, *(np.flatnonzero(np.diff(index)) + 1).tolist(), len(index)]
    yield from ((a, b) for a, b in itertools.pairwise(edges) if b > a)


class _Plane:
    """The plane in which places are told apart: x and y of the tool, or the two ways in which states differ most."""

    def __init__(self, states: Sequence[_Floats], columns: _Columns) -> None:
        self._position = columns.position
        self._columns = list(columns.gripless)
        every = np.concatenate([state[:: max(1, len(state) // 50)] for state in states])
        used = every[:, self._columns]
        self._middle = used.mean(axis=0)
        _, _, self._ways = np.linalg.svd(used - self._middle, full_matrices=False)
        strongest = np.abs(self._ways).argmax(axis=1)[:, None]
        self._ways *= np.sign(np.take_along_axis(self._ways, strongest, axis=1))  # the sign of a way is arbitrary
        points = self.of(every)
        self.span = float(max(np.ptp(points, axis=0).max(), 1e-9))

    def of(self, states: _Floats) -> _Floats:
        """Return the points of some states, (T, 2)."""
        if self._position is not None:
            return states[:, list(self._position)]
        points = (states[:, self._columns] - self._middle) @ self._ways[:2].T
        return points if points.shape[1] == 2 else np.column_stack([points, np.zeros(len(points))])


def _rest(episodes: Sequence[_Episode]) -> tuple[float, bool]:
    """Return the command between an open and a closed gripper, and whether open is above it: as episodes begin."""
    every = np.concatenate([e.grip for e in episodes])
    low, high = np.quantile(every, [0.02, 0.98])
    between = float(low + high) / 2.0
    begins_above = float(np.mean([e.grip[0] > between for e in episodes]))
    return between, begins_above > 0.5


def _closings(grip: _Floats, rest: tuple[float, bool], shortest: int) -> list[tuple[int, int]]:
    """Return the rows in which the gripper closes and opens again; the last row where it stays closed.

    In between, what is shorter than ``shortest`` rows counts as what was before.
    """
    between, open_above = rest
    closed = (grip < between) if open_above else (grip > between)
    for begin, end in _runs(closed.astype(np.int64)):
        if begin and end < len(closed) and end - begin < shortest:
            closed[begin:end] = closed[begin - 1]
    edges = np.flatnonzero(closed[1:] != closed[:-1]) + 1
    starts = [int(e) for e in edges if closed[e]]
    return [(start, next((int(e) for e in edges if e > start), len(grip) - 1)) for start in starts]


def _places(points: Sequence[_Floats]) -> list[str]:
    """Return the name of the place of each point: the middle of the points of its cell."""
    if not points:
        return []
    found = np.array(points)
    low, high = np.quantile(found, [0.01, 0.99], axis=0)
    span = float((high - low).max())
    cells = np.column_stack([_cells(found[:, 0], span), _cells(found[:, 1], span)])
    names: dict[tuple[int, int], str] = {}
    for cell in {(int(a), int(b)) for a, b in cells}:
        x, y = found[(cells == cell).all(axis=1)].mean(axis=0)
        names[cell] = f"({x:.2f}, {y:.2f})"
    return [names[int(a), int(b)] for a, b in cells]


def _cells(values: _Floats, span: float) -> _Ints:
    """Return the cell of each value: cut at gaps, or where there are none into cells of as many values."""
    ordered = np.sort(values)
    low, high = np.quantile(ordered, [0.01, 0.99])
    if high - low <= NARROW_SHARE * span:
        return np.zeros(len(values), dtype=np.int64)
    wide = np.flatnonzero(np.diff(ordered) > GAP_SHARE * span) + 1
    least = max(2, math.ceil(LEAST_SHARE * len(ordered)))
    cuts, last = [], 0
    for i in wide.tolist():
        if i - last >= least and len(ordered) - i >= least:
            cuts.append((ordered[i - 1] + ordered[i]) / 2.0)
            last = i
    if not cuts:
        cuts = np.quantile(ordered, [i / CELLS for i in range(1, CELLS)]).tolist()
    return np.searchsorted(np.array(cuts), values, side="right").astype(np.int64)


def _direction(points: _Floats, span: float) -> str:
    """Return in which of eight directions of the plane an episode sets out, "" if it stays where it begins."""
    away = points - points[0]
    far = np.flatnonzero(np.hypot(away[:, 0], away[:, 1]) >= SET_OUT_SHARE * span)
    if not far.size:
        return ""
    x, y = away[far[0]]
    turn = round(math.atan2(y, x) / (math.tau / DIRECTIONS)) % DIRECTIONS
    return f"at {360 // DIRECTIONS * turn}°"
