"""Facts about the demonstrations in an external LeRobot data set (versions 2.0 to 3.0).

The facts are computed from instructions, actions and proprioception, because these data sets contain no simulator
state. Objects therefore have no names, and places are the points at which a gripper closes or opens. The columns with
the instruction, the gripper and the position are recognized by name. A data set is rejected if its names are ambiguous.
:class:`DataReading` lists the chosen columns.
"""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from betterbench.demonstrations.shortcuts.facts import EpisodeFacts, ShownStep
from betterbench.demonstrations.shortcuts.grips import SHORTEST_S, Jaws, closed_in, edges_of, held, jaws_of, still_ones
from betterbench.demonstrations.shortcuts.lerobot_choice import ArmPlace, Columns, Grip, choose_grippers, choose_places
from betterbench.demonstrations.shortcuts.lerobot_files import (
    CURE,
    FrameColumn,
    Frames,
    Tasks,
    is_pointer,
    numbers_in,
    read_columns,
    read_info,
    read_json,
    read_tasks,
    runs,
    task_columns,
    texts_in,
)
from betterbench.demonstrations.shortcuts.lerobot_order import EpisodePart, FileOrder, joined
from betterbench.demonstrations.shortcuts.numbers import NamedNumber, columns_of, find_column
from betterbench.demonstrations.shortcuts.places import direction, in_plane, place_names, principal_plane
from betterbench.demonstrations.shortcuts.reading import DataReading, GripperReading, PlaceReading, how_many
from betterbench.errors import InvalidInputError, RecordError, one_line
from betterbench.json_form import parse_json, read_bounded

MOST_NUMBER = 1e6
"""Maximum absolute value in a state or an action.

Values in meters, radians, degrees, millimeters and encoder ticks (4,096 to 65,536 per turn) are far smaller.
"""
NOT_FINITE = "a number that is not finite"
BEYOND = f"a number with an absolute value above {MOST_NUMBER:,.0f}"
MOST_EPISODES = 5000
"""Maximum number of episodes to read. More episodes would take time without making the tests more conclusive."""
USUAL_FPS = 10.0
_MOST_FPS = 1e4
_MOST_COUNT = 10**9
_MOST_LISTED = 8
_MAX_JSON_BYTES = 64 * 1024 * 1024
_SPACES = {
    "position": "",
    "joints": " in joint space (places are the two principal components of the joints)",
    "numbers": " (places are the two principal components of these numbers)",
    "steps": " added up from the start of each episode",
}

_Floats = npt.NDArray[np.float64]
_Ints = npt.NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Choices:
    """Columns and conventions of a data set that the user specified.

    Columns that the user did not specify are recognized by their names.

    Attributes:
        instruction: Column with the instruction, either in the frames or in the tasks file.
        grippers: Names of the gripper components, one per arm.
        places: Names of the position components. Each gripper has the same number of components.
        closed: The closed end of the gripper's range.
        seed: Seed for drawing the sample if there are more than :data:`MOST_EPISODES` episodes.
    """

    instruction: str | None = None
    grippers: tuple[str, ...] = ()
    places: tuple[str, ...] = ()
    closed: Literal["low", "high"] | None = None
    seed: int = 0


@dataclass(frozen=True, slots=True)
class LeRobotFacts:
    """Facts about the episodes of a LeRobot data set, with a description of the data that they were derived from."""

    facts: tuple[EpisodeFacts, ...]
    reading: DataReading


def is_lerobot_dataset(path: Path) -> bool:
    """Return whether a folder looks like a LeRobot data set, i.e. contains ``meta/info.json``."""
    return (path / "meta" / "info.json").is_file()


def facts_of_lerobot(path: Path) -> tuple[EpisodeFacts, ...]:
    """Return the facts about each episode of a LeRobot data set, in which all columns must be recognizable by name."""
    return read_lerobot(path).facts


def read_lerobot(path: Path, choices: Choices | None = None) -> LeRobotFacts:
    """Return the facts about each episode of a LeRobot data set.

    If the instruction changes within an episode, the episode is split into segments, and there are separate facts about
    each segment. With two arms, there is one group of facts per arm, and another group with the arm that closes its
    gripper first.

    Args:
        path: Folder of the data set.
        choices: Columns and conventions given by the user.

    Raises:
        InvalidInputError: If the folder is not a LeRobot data set, or the columns with the instruction, the gripper or
            the position are ambiguous.
        UnknownNameError: If a column named by the user does not exist.
        RecordError: If a file cannot be read.
    """
    given = choices if choices is not None else Choices()
    info = read_info(path)
    where = str(path / "meta" / "info.json")
    numbers = columns_of(info["features"], _modality(path))
    columns = Columns.of(numbers, where, steps=_says_steps(path))
    grips = choose_grippers(columns, given.grippers)
    places = choose_places(columns, grips, given.places)
    said = _Said.of(path, info, given.instruction)
    scanned = _scan(path, said)
    chosen = _sample(scanned.episodes, given.seed)
    widths = {
        n.column: len(numbers[n.column]) for n in (*(g.number for g in grips), *(n for p in places for n in p.numbers))
    }
    episodes, odd = _read(scanned, chosen, grips, places, widths)
    for reason, left in scanned.odd.items():
        odd.setdefault(reason, []).extend(left)
    _require_mostly_usable(path, odd, len(chosen) + sum(map(len, scanned.odd.values())))
    shortest = _shortest(info)
    values = [(grip, [e.grips[grip.arm] for e in episodes]) for grip in grips]
    arms, still = [], []
    for (grip, numbers_of), place, idle in zip(values, places, still_ones(values, shortest), strict=True):
        if idle is None:
            jaws = jaws_of(grip, numbers_of, given.closed, where)
            arms.append(_Arm.of((grip, place), jaws, episodes, shortest))
        else:
            still.append(f"the gripper {grip.number.shown}, {idle.told}")
    if not arms:
        shown = ", ".join(grip.number.shown for grip in grips)
        raise InvalidInputError(
            str(path), f"the gripper ({shown}) never moves", "Choose another component with --gripper"
        )
    name = f"LeRobot dataset {one_line(path.absolute().name, most=80)}"
    facts: list[EpisodeFacts] = []
    for arm in arms:
        facts += _facts(f"{name}, {arm.grip.arm} arm" if len(grips) > 1 else name, arm, episodes)
    if len(arms) > 1:
        facts += _facts_on_arms(name, arms, episodes)
    not_drawn = len(scanned.episodes) - len(chosen)
    read = _Read(info, said, scanned, tuple(episodes), tuple(arms), tuple(still), odd, not_drawn, given.seed)
    return LeRobotFacts(tuple(facts), _reading(read))


def _modality(path: Path) -> Mapping[str, Any]:
    file = path / "meta" / "modality.json"
    return read_json(file) if file.exists() else {}


def _says_steps(path: Path) -> bool:
    """Return whether ``meta/betterbench.json`` declares that each action is a displacement of the tool."""
    file = path / "meta" / "betterbench.json"
    if not file.is_file() or is_pointer(file):
        return False
    try:
        form = parse_json(read_bounded(file, max_bytes=_MAX_JSON_BYTES, cure=CURE))
        return str(form["layout"]["adapter"]["answer"]["space"]).startswith("ee_delta")
    except (InvalidInputError, ValueError, KeyError, TypeError):
        return False


@dataclass(frozen=True, slots=True)
class _Said:
    """Location of the instructions in a data set.

    Attributes:
        column: Column of the frames that holds the instruction or its index.
        tasks: Instructions by index; None if the column holds the instructions themselves.
        others: Further columns that may contain instructions.
    """

    column: str
    tasks: Tasks | None
    others: tuple[str, ...]

    @classmethod
    def of(cls, path: Path, info: Mapping[str, Any], named: str | None) -> _Said:
        """Find the instructions in the tasks file, or in the column named by the user."""
        features = info["features"]
        texts = [
            name
            for name, feature in features.items()
            if isinstance(feature, dict)
            and (str(feature.get("dtype")) in ("string", "large_string") or name.startswith("annotation."))
        ]
        if named is None or named == "task_index":
            tasks = read_tasks(path)
            return cls("task_index", tasks, (*tasks.others, *texts))
        if named in features:
            numbers = str(features[named].get("dtype") if isinstance(features[named], dict) else "").startswith("int")
            return cls(named, read_tasks(path) if numbers else None, ())
        in_tasks = task_columns(path)
        if named not in in_tasks:
            find_column("--instruction", named, (*texts, *in_tasks, "task_index"))
            return cls(named, None, ())
        return cls("task_index", read_tasks(path, named), ())

    @property
    def source(self) -> str:
        """Location of the instructions, as text."""
        if self.tasks is None:
            return f"column {self.column} of the frames"
        return f"{self.tasks.source}, by {self.column} of the frames"

    def codes(self, file: Path, column: FrameColumn, known: dict[str | None, int]) -> _Ints:
        """Return, for each row, the index of its instruction in ``known``. New instructions are added to ``known``.

        The index is -1 where the column is not a finite number. Raises RecordError if a task index has no text.
        """
        texts = texts_in(file, self.column, column)
        if texts is not None:
            codes, listed = texts
        else:
            if self.tasks is None:
                problem = f"{self.column} contains no strings"
                raise RecordError(f"{file}: {problem}. Choose a column that contains strings or task indices.")
            values = numbers_in(file, self.column, column, 1)
            finite = np.isfinite(values)
            counts = np.clip(values[finite], -_MOST_COUNT, 2.0 * _MOST_COUNT)
            unique, codes_of = np.unique(counts.astype(np.int64), return_inverse=True)
            unknown = [int(n) for n in unique if int(n) not in self.tasks.texts]
            if unknown:
                raise RecordError(
                    f"{file}: {self.column} has {unknown[0]}, but {self.tasks.source} has no such task. "
                    "Add the task to this file, or correct the index."
                )
            listed = [self.tasks.texts[int(n)] for n in unique]
            codes = np.full(len(values), len(listed) + 1, dtype=np.int64)
            codes[finite] = codes_of
        clean = [text if text is not None and text.strip() else None for text in (*listed, None)]
        numbers = np.array([*(known.setdefault(text, len(known)) for text in clean), -1], dtype=np.int64)
        return np.asarray(numbers[np.where(codes < 0, len(listed), codes)], dtype=np.int64)


@dataclass(frozen=True, slots=True)
class _Stretch:
    """Episode of a data set.

    Attributes:
        index: Episode index.
        parts: Rows of the episode in each file, in frame order.
        segments: Segments with one instruction, as (first row, row after the last row, instruction).
    """

    index: int
    parts: tuple[EpisodePart, ...]
    segments: tuple[tuple[int, int, str], ...]

    @property
    def length(self) -> int:
        """Number of frames."""
        return sum(map(len, self.parts))


@dataclass(slots=True)
class _Scanned:
    """Usable episodes of a data set, and counts of the unusable episodes.

    Attributes:
        episodes: Usable episodes.
        orders: Files in which the rows had to be sorted, each with the order of its rows.
        short: Number of episodes with fewer than two frames.
        silent: Number of episodes without an instruction.
        pointers: Number of files that are Git LFS pointers.
        odd: Indices of the episodes with unusable values, by reason.
    """

    episodes: list[_Stretch] = field(default_factory=list)
    orders: dict[Path, FileOrder] = field(default_factory=dict)
    short: int = 0
    silent: int = 0
    pointers: int = 0
    odd: dict[str, list[int]] = field(default_factory=dict)

    @property
    def there(self) -> int:
        """Number of episodes in the files, including unusable episodes."""
        return len(self.episodes) + self.short + self.silent + sum(map(len, self.odd.values()))


def _scan(path: Path, said: _Said) -> _Scanned:
    """Find the episodes in all files, with their instructions. Raises RecordError if an episode occurs twice."""
    frames = Frames.of(path)
    frames.require_some(path)
    found, known = _Scanned(pointers=len(frames.pointers)), dict[str | None, int]()
    parts: dict[int, list[tuple[EpisodePart, list[tuple[int, int]]]]] = {}
    for file in frames.files:
        order = FileOrder.of(file)
        if order.rows is not None:
            found.orders[file] = order
        codes = order.sort(said.codes(file, read_columns(file, {said.column: 1})[said.column], known))
        for start, stop in runs(order.episodes):
            lengths = [(b - a, int(codes[start + a])) for a, b in runs(codes[start:stop])]
            parts.setdefault(int(order.episodes[start]), []).append((EpisodePart.of(file, order, start, stop), lengths))
    texts = list(known)
    for number, some in parts.items():
        order_of_parts = joined(number, [part for part, _ in some])
        said_in = [run for i in order_of_parts for run in some[i][1]]
        stretch = _Stretch(number, tuple(some[i][0] for i in order_of_parts), _segments(said_in, texts))
        if not all(part.finite for part in stretch.parts) or any(code < 0 for _, code in said_in):
            found.odd.setdefault(f"{NOT_FINITE} (in {said.column} or the order of the frames)", []).append(number)
        elif stretch.length < 2:
            found.short += 1
        elif not stretch.segments:
            found.silent += 1
        else:
            found.episodes.append(stretch)
    _require_mostly_usable(path, found.odd, found.there)
    if not found.episodes and found.silent:
        problem = f"none of {how_many(found.silent, 'episode')} has an instruction"
        raise InvalidInputError(str(path), f"{problem} in {said.source}", "Choose another column with --instruction")
    if not found.episodes:
        raise InvalidInputError(str(path / "data"), "it contains no episode with at least two frames", CURE)
    return found


def _require_mostly_usable(path: Path, odd: Mapping[str, Sequence[int]], of: int) -> None:
    """Raise InvalidInputError if more than half of the episodes have unusable values."""
    count = sum(map(len, odd.values()))
    if 2 * count > of:
        reason = next(iter(odd))
        problem = f"{count:,} of {how_many(of, 'episode')} cannot be used: episode {odd[reason][0]} has {reason}"
        cure = "Choose other columns with --gripper, --place or --instruction, or correct these numbers"
        raise InvalidInputError(str(path), problem, cure)


def _segments(lengths: Sequence[tuple[int, int]], texts: Sequence[str | None]) -> tuple[tuple[int, int, str], ...]:
    """Return the segments that have an instruction and at least two frames.

    Args:
        lengths: Runs of rows with the same instruction, as (number of rows, index of the instruction in ``texts``).
        texts: Instructions; None for an empty instruction.

    Returns:
        First row, row after the last row, and instruction of each segment.
    """
    found, at = [], 0
    for code, group in itertools.groupby(lengths, key=lambda run: run[1]):
        size, text = sum(length for length, _ in group), texts[code] if code >= 0 else None
        if text is not None and size >= 2:
            found.append((at, at + size, text))
        at += size
    return tuple(found)


def _sample(episodes: Sequence[_Stretch], seed: int) -> list[_Stretch]:
    """Draw a random sample of at most :data:`MOST_EPISODES` episodes.

    The sample contains the instructions in the same proportions as the data set.
    """
    if len(episodes) <= MOST_EPISODES:
        return list(episodes)
    by_text: dict[str, list[_Stretch]] = {}
    for episode in sorted(episodes, key=lambda e: e.index):
        by_text.setdefault(episode.segments[0][2], []).append(episode)
    exact = {text: MOST_EPISODES * len(group) / len(episodes) for text, group in by_text.items()}
    shares = {text: int(share) for text, share in exact.items()}
    by_rest = sorted(by_text, key=lambda text: (shares[text] - exact[text], text))
    for text in by_rest[: MOST_EPISODES - sum(shares.values())]:
        shares[text] += 1
    draw = np.random.Generator(np.random.PCG64(seed))
    chosen = [
        group[int(rank)]
        for text, group in sorted(by_text.items())
        for rank in draw.permutation(len(group))[: shares[text]]
    ]
    return sorted(chosen, key=lambda e: (str(e.parts[0].file), e.parts[0].start))


@dataclass(frozen=True, slots=True)
class _Episode:
    """Gripper values (T,) and positions (T, d) of each arm in an episode."""

    stretch: _Stretch
    grips: Mapping[str, _Floats]
    ways: Mapping[str, _Floats]


def _read(
    scanned: _Scanned,
    chosen: Sequence[_Stretch],
    grips: Sequence[Grip],
    places: Sequence[ArmPlace],
    widths: Mapping[str, int],
) -> tuple[list[_Episode], dict[str, list[int]]]:
    """Return the values of the chosen episodes, and the indices of the episodes with unusable values, by reason."""
    odd: dict[str, list[int]] = {}
    by_file: dict[Path, list[tuple[_Stretch, int]]] = {}
    for stretch in chosen:
        for i, part in enumerate(stretch.parts):
            by_file.setdefault(part.file, []).append((stretch, i))
    used = {name: sorted({n.index for n in _all(grips, places) if n.column == name}) for name in widths}
    pieces: dict[int, dict[int, Mapping[str, _Floats]]] = {}
    found: dict[int, _Episode] = {}
    for file, some in by_file.items():
        columns = read_columns(file, widths)
        rows = {}
        for name, width in widths.items():
            values = numbers_in(file, name, columns[name], width).reshape(-1, width)[:, used[name]]
            rows[name] = values[scanned.orders[file].rows] if file in scanned.orders else values
        for stretch, i in some:
            part, there = stretch.parts[i], pieces.setdefault(stretch.index, {})
            there[i] = {name: values[part.start : part.stop] for name, values in rows.items()}
            if len(there) == len(stretch.parts):
                del pieces[stretch.index]
                cut = {name: np.concatenate([there[k][name] for k in range(len(there))]) for name in widths}
                reason = next(filter(None, itertools.starmap(_odd, cut.items())), "")
                if reason:
                    odd.setdefault(reason, []).append(stretch.index)
                else:
                    found[stretch.index] = _episode(stretch, grips, places, cut, used)
    return [found[stretch.index] for stretch in chosen if stretch.index in found], odd


def _odd(column: str, values: _Floats) -> str:
    """Return the reason why the values of a column are unusable. Return "" if they are usable."""
    if not np.isfinite(values).all():
        return f"{NOT_FINITE} (in {column})"
    return f"{BEYOND} (in {column})" if (np.abs(values) > MOST_NUMBER).any() else ""


def _episode(
    stretch: _Stretch,
    grips: Sequence[Grip],
    places: Sequence[ArmPlace],
    cut: Mapping[str, _Floats],
    used: Mapping[str, Sequence[int]],
) -> _Episode:
    """Collect the gripper values and positions of an episode.

    Args:
        stretch: Episode of the data set.
        grips: Column and index of each arm's gripper value.
        places: Columns and indices of each arm's position values.
        cut: Values that were read from each column, (T, n).
        used: For each column, the indices of the n values that were read.
    """

    def of(number: NamedNumber) -> _Floats:
        return cut[number.column][:, used[number.column].index(number.index)]

    ways = {}
    for place in places:
        way = np.column_stack([of(n) for n in place.numbers])
        ways[place.arm] = np.cumsum(way, axis=0) - way[0] if place.space == "steps" else way
    return _Episode(stretch, {g.arm: held(of(g.number)) for g in grips}, ways)


def _all(grips: Sequence[Grip], places: Sequence[ArmPlace]) -> Iterator[NamedNumber]:
    yield from (grip.number for grip in grips)
    yield from (number for place in places for number in place.numbers)


@dataclass(frozen=True, slots=True)
class _Arm:
    """Gripper events and positions of one arm in all episodes.

    Attributes:
        grip: Gripper component of the arm.
        place: Position components of the arm.
        jaws: Range of the gripper's values, and its closed end.
        closings: For each episode, the rows in which the gripper closes.
        openings: For each episode, the rows in which the gripper opens.
        share_closed: Fraction of all rows in which the gripper is closed.
        ways: For each episode, the values (T, d) of the position components.
        points: For each episode, the positions (T, 2) in a horizontal plane. If the values are not positions, these are
            their two principal components.
        span: Range of these points.
    """

    grip: Grip
    place: ArmPlace
    jaws: Jaws
    closings: tuple[tuple[int, ...], ...]
    openings: tuple[tuple[int, ...], ...]
    share_closed: float
    ways: tuple[_Floats, ...]
    points: tuple[_Floats, ...]
    span: float

    @classmethod
    def of(cls, chosen: tuple[Grip, ArmPlace], jaws: Jaws, episodes: Sequence[_Episode], shortest: int) -> _Arm:
        """Find the gripper events and positions of an arm.

        Args:
            chosen: Gripper and position components of the arm.
            jaws: Range of the gripper's values, and its closed end.
            episodes: Values of all episodes.
            shortest: Minimum number of consecutive rows for which a gripper must be closed or open.
        """
        grip, place = chosen
        grips, ways = [e.grips[grip.arm] for e in episodes], [e.ways[grip.arm] for e in episodes]
        every = np.concatenate([way[:: max(1, len(way) // 50)] for way in ways])
        exact = place.space in ("position", "steps")
        points = [way[:, :2] if exact else way for way in ways]
        if not exact:
            plane = principal_plane(every)
            points = [in_plane(way, plane) for way in ways]
        span = float(max(np.ptp(np.concatenate([p[:: max(1, len(p) // 50)] for p in points]), axis=0).max(), 1e-9))
        closed = [closed_in(values, jaws, shortest) for values in grips]
        edges = [edges_of(rows) for rows in closed]
        share = float(np.mean(np.concatenate(closed)))
        return cls(
            grip,
            place,
            jaws,
            tuple(tuple(a) for a, _ in edges),
            tuple(tuple(b) for _, b in edges),
            share,
            tuple(ways),
            tuple(points),
            span,
        )

    @property
    def never(self) -> int:
        """Number of episodes in which the gripper never closes."""
        return sum(not rows for rows in self.closings)


def _shortest(info: Mapping[str, Any]) -> int:
    """Return the minimum number of consecutive frames for which a gripper must be closed or open."""
    return max(1, round(SHORTEST_S * (_rate(info) or USUAL_FPS)))


def _rate(info: Mapping[str, Any]) -> float | None:
    """Return the frame rate that a data set declares. Return None if it is missing or invalid."""
    fps = info.get("fps")
    known = isinstance(fps, int | float) and not isinstance(fps, bool) and 0.0 < fps < _MOST_FPS
    return float(fps) if known and fps is not None else None


def _facts(group: str, arm: _Arm, episodes: Sequence[_Episode]) -> Iterator[EpisodeFacts]:
    """Yield the facts about one arm.

    Each episode is split into segments in which the instruction does not change. There is one set of facts per segment.
    """
    exact = arm.place.space in ("position", "steps")
    names = []
    for edges in (arm.closings, arm.openings):
        where = [way[row] for way, rows in zip(arm.ways, edges, strict=True) for row in rows]
        given = iter(place_names(where, exact=exact))
        names.append([[(row, next(given)) for row in rows] for rows in edges])
    for i, episode in enumerate(episodes):
        for begin, end, text in episode.stretch.segments:
            last = end == episode.stretch.length
            origins = [name for row, name in names[0][i] if begin <= row < end]
            targets = [name for row, name in names[1][i] if begin <= row < end or (last and row == end)]
            count = max(len(origins), len(targets))
            # If a segment has more closings than openings or vice versa, the first closing is still the origin of the
            # first step, and the last opening is still the target of the last step.
            origins += [""] * (count - len(origins))
            targets = [""] * (count - len(targets)) + targets
            steps = tuple(ShownStep("", "", a, b) for a, b in zip(origins, targets, strict=True))
            heading = direction(arm.points[i][begin:end], arm.span)
            yield EpisodeFacts(_name(episode, begin), group, text, steps, heading=heading)


def _name(episode: _Episode, begin: int) -> str:
    name = f"episode {episode.stretch.index}"
    return f"{name}, from frame {begin}" if len(episode.stretch.segments) > 1 else name


def _facts_on_arms(group: str, arms: Sequence[_Arm], episodes: Sequence[_Episode]) -> Iterator[EpisodeFacts]:
    """Yield the arm that closes its gripper first, for each segment of an episode with a constant instruction."""
    for i, episode in enumerate(episodes):
        for begin, end, text in episode.stretch.segments:
            closings = [(row, arm.grip.arm) for arm in arms for row in arm.closings[i] if begin <= row < end]
            steps = (ShownStep(f"{min(closings)[1]} arm", "", "", ""),) if closings else ()
            yield EpisodeFacts(_name(episode, begin), group, text, steps)


@dataclass(frozen=True, slots=True)
class _Read:
    """Data that were read and choices that were made, for the description of the data set.

    Attributes:
        still: Grippers that never move, each with the evidence.
        odd: Indices of the episodes that were left out because of unusable values, by reason.
        not_drawn: Number of episodes that are not in the random sample.
    """

    info: Mapping[str, Any]
    said: _Said
    scanned: _Scanned
    episodes: tuple[_Episode, ...]
    arms: tuple[_Arm, ...]
    still: tuple[str, ...]
    odd: Mapping[str, Sequence[int]]
    not_drawn: int
    seed: int

    @property
    def listed(self) -> int | None:
        """Number of episodes that the data set declares; None if this number is missing or invalid."""
        total = self.info.get("total_episodes")
        known = isinstance(total, int) and not isinstance(total, bool) and 0 < total <= _MOST_COUNT
        return total if known else None


def _reading(read: _Read) -> DataReading:
    segments, episodes = sum(len(e.stretch.segments) for e in read.episodes), len(read.episodes)
    observations = ""
    if segments > episodes:
        changing = sum(len(e.stretch.segments) > 1 for e in read.episodes)
        observations = f", compared as {segments:,} segments, because the instruction changes within {changing:,}"
    texts = Counter(text for e in read.episodes for _, _, text in e.stretch.segments)
    instruction = f"{read.said.source}, {len(texts):,} different"
    if read.said.others:
        shown = ", ".join(one_line(other, most=60) for other in read.said.others[:4])
        instruction += f" (also there: {shown}; --instruction COLUMN reads another one)"
    return DataReading(
        episodes,
        max(read.listed or 0, read.scanned.there),
        observations,
        instruction,
        tuple(map(_gripper, read.arms)),
        tuple(map(_place, read.arms)),
        about=tuple(_about(read.scanned)),
        left_out=tuple(_left_out(read)),
        warnings=tuple(_warnings(read)),
    )


def _about(scanned: _Scanned) -> Iterator[str]:
    """Yield sentences about the sorting and joining of frames."""
    for key, group in sorted(Counter(order.key for order in scanned.orders.values()).items()):
        by = (
            f"by episode_index and {key}"
            if key
            else "by episode_index only: no column contains the order of the frames"
        )
        yield f"Order of the frames: the rows of {how_many(group, 'file')} had to be sorted, {by}"
    split = sum(len(stretch.parts) > 1 for stretch in scanned.episodes)
    if split:
        yield f"Order of the frames: {how_many(split, 'episode')} with frames in several files had to be joined"


def _left_out(read: _Read) -> Iterator[str]:
    """Yield a description of each part of the data that was left out, and the reason."""
    scanned = read.scanned
    if (read.listed or 0) > scanned.there:
        yield f"{how_many((read.listed or 0) - scanned.there, 'episode')} whose frames are not in the folder"
    if scanned.pointers:
        what = "Git LFS pointer" if scanned.pointers == 1 else "Git LFS pointers"
        yield f"{scanned.pointers:,} {what} instead of files (run git lfs pull to fetch them)"
    if scanned.short:
        yield f"{how_many(scanned.short, 'episode')} of fewer than two frames"
    if scanned.silent:
        yield f"{how_many(scanned.silent, 'episode')} without an instruction"
    for reason, left in sorted(read.odd.items()):
        numbers = ", ".join(map(str, sorted(left)[:_MOST_LISTED])) + (", ..." if len(left) > _MOST_LISTED else "")
        shown = f"episode {numbers}" if len(left) == 1 else f"episodes {numbers}"
        yield f"{how_many(len(left), 'episode')} with {reason}: {shown}"
    if read.not_drawn:
        was = "was" if read.not_drawn == 1 else "were"
        drawn = f"{how_many(read.not_drawn, 'episode')} that {was} not drawn"
        yield f"{drawn} (each instruction in proportion, seed {read.seed})"
    yield from read.still


def _warnings(read: _Read) -> Iterator[str]:
    """Yield warnings about properties of the data that may lead to wrong findings."""
    total = read.info.get("total_episodes")
    if read.listed is None and total is not None:
        yield "total_episodes in meta/info.json is not a count"
    elif 0 < (read.listed or 0) < read.scanned.there:
        yield f"meta/info.json says {how_many(read.listed or 0, 'episode')}, but the files have {read.scanned.there:,}"
    if _rate(read.info) is None:
        fps = read.info.get("fps")
        found = "is missing" if fps is None else f"is {one_line(repr(fps), most=40)}, which is not a rate"
        yield f"fps in meta/info.json {found}; {USUAL_FPS:.0f} frames per second were assumed"
    for arm in read.arms:
        of_arm = f" of the {arm.grip.arm} arm" if len(read.arms) > 1 else ""
        if arm.never:
            yield f"the gripper{of_arm} never closes in {arm.never:,} of {how_many(len(read.episodes), 'episode')}"
        if arm.jaws.warning:
            yield arm.jaws.warning


def _gripper(arm: _Arm) -> GripperReading:
    jaws = arm.jaws
    source = f"{arm.grip.number.shown} (by {arm.grip.by})"
    return GripperReading(
        arm.grip.arm, source, round(jaws.low, 6), round(jaws.high, 6), jaws.closed, jaws.because,
        round(arm.share_closed, 6), arm.never,
    )  # fmt: skip


def _place(arm: _Arm) -> PlaceReading:
    numbers = arm.place.numbers
    if len(numbers) <= 3 or arm.place.space in ("position", "steps"):
        shown = ", ".join(n.shown for n in numbers)
    else:
        shown = f"{len(numbers)} numbers of {numbers[0].column}, {numbers[0].shown} to {numbers[-1].shown}"
    return PlaceReading(arm.grip.arm, f"{shown}{_SPACES[arm.place.space]} (by {arm.place.by})", arm.place.space)
