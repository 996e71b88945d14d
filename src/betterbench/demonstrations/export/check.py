"""Comparison of an exported data set with its source records."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, get_args

import numpy as np

from betterbench.demonstrations.export.comparing import CURE, ReadPictures, intact, require_match
from betterbench.demonstrations.export.expected import ExpectedDataset
from betterbench.demonstrations.export.frames import frame_numbers, shown_images
from betterbench.demonstrations.export.job import README, SOURCE_FILE, origin_of, pairs_of, stored_source
from betterbench.demonstrations.export.layout import DatasetLayout, layout_of
from betterbench.demonstrations.export.lerobot_check import LeRobotCheck, lerobot_check
from betterbench.demonstrations.export.part import ImageForm
from betterbench.demonstrations.export.pictures import Pictures
from betterbench.demonstrations.export.robomimic import read_origin, require_same_content
from betterbench.demonstrations.export.robomimic_check import RobomimicCheck
from betterbench.errors import BetterError, InvalidInputError, RecordError
from betterbench.interface.actions import USUAL_ROBOT
from betterbench.jobs import OnCount
from betterbench.json_form import SEAL, file_digest, parse_json
from betterbench.ordinary_file import read_ordinary
from betterbench.records import Record, RunFolder
from betterbench.tasks import TrialId

MOST_MEAN_ERROR = 4.0
"""Maximum mean error of an image due to the video codec, on a scale from 0 to 255.

Typical values are given in ``docs/export.md``.
"""


@dataclass(frozen=True, slots=True)
class ExportCheck:
    """Result of checking an exported data set.

    All files and three images per episode and camera are compared with the records (see ``docs/export.md``).

    Attributes:
        episodes: Number of episodes.
        frames: Number of frames.
        pictures: Number of images that were rendered again and compared.
        worst_error: Largest mean error of an image, on a scale from 0 to 255. It is 0 for lossless images.
    """

    episodes: int
    frames: int
    pictures: int
    worst_error: float


def check_export(runs: Sequence[RunFolder], path: Path, *, on_progress: OnCount | None = None) -> ExportCheck:
    """Compare a data set with the records that it was exported from.

    Args:
        runs: Folders of the runs.
        path: Folder or file of the data set.
        on_progress: Called with the number of checked episodes and the total number.

    Raises:
        InvalidInputError: If a file of the data set is missing, cannot be read or differs from the records.
        RecordError: If no run contains the record of an episode, or the record is damaged.
    """
    source = _source(path)
    shape = source["layout"]
    layout = layout_of(
        shape["adapter"]["name"], shape["observation"]["name"], robot=str(shape.get("robot", USUAL_ROBOT))
    )
    form: ImageForm = "png" if path.is_file() else source["images"]
    expected, episodes = ExpectedDataset(path, layout, form), source["episodes"]
    found = [_trial(runs, about) for about in episodes]
    told = any(
        "pairs" in about for about in episodes
    )  # data sets exported by earlier versions do not list the pairs of twin demonstrations
    pairs = pairs_of(runs, found) if told else {}
    pictures, worst = 0, 0.0
    with _stored(path, expected, len(episodes)) as stored, Pictures(layout.cameras, source["quality"]) as drawn:
        for number, (about, (of, trial)) in enumerate(zip(episodes, found, strict=True)):
            run, where = runs[of], f"{path}: episode {number}"
            record = run.read_record(trial.task, trial.condition, trial.seed)
            numbers = frame_numbers(record, layout)
            with intact(where):
                part = expected.add(record, about["record"], numbers, pairs.get((of, trial), []) if told else None)
                require_match(about, _about(expected, number), f"{_source_name(path)}: episodes[{number}]")
                read = stored.episode(number, part)
            shown = _shown(drawn, run, record, layout)
            for error in _errors(read, shown, where, 0.0 if form == "png" else MOST_MEAN_ERROR):
                worst, pictures = max(worst, error), pictures + 1
            if on_progress is not None:
                on_progress(number + 1, len(episodes))
        stored.finish()
    _compare_source(path, source, expected)
    return ExportCheck(len(episodes), expected.dataset.frames, pictures, worst)


@contextmanager
def _stored(path: Path, expected: ExpectedDataset, episodes: int) -> Iterator[LeRobotCheck | RobomimicCheck]:
    """Open a robomimic file or a LeRobot folder for the comparison."""
    if path.is_dir():
        yield lerobot_check(path, expected, episodes)
        return
    with RobomimicCheck(path, expected) as check:
        yield check


def _shown(drawn: Pictures, run: RunFolder, record: Record, layout: DatasetLayout) -> dict[int, dict[str, np.ndarray]]:
    """Render three frames of an episode again. Return the images by frame index and column name."""
    rows = sorted({0, record.n_steps // 2, record.n_steps - 1}) if layout.images else []
    images = shown_images(record, layout, drawn.of(run, record, rows), rows) if rows else ()
    return dict(zip(rows, images, strict=True))


def _errors(
    read: ReadPictures,
    shown: Mapping[int, Mapping[str, np.ndarray]],
    where: str,
    most: float,
) -> Iterator[float]:
    """Yield the mean error of each image that was rendered again, on a scale from 0 to 255.

    Raises InvalidInputError if an image is missing or its mean error is larger than ``most``.
    """
    rows = list(shown)
    for column in shown[rows[0]] if rows else ():
        with intact(f"{where}: its {column}"):
            found = read(column, rows)
        for row in rows:
            error = _error(found.get(row), shown[row][column])
            if error > most:
                problem = f"its {column} differs at frame {row} by {error:.2f} of 255 levels on average"
                raise InvalidInputError(where, problem, CURE)
            yield error


def _source_name(path: Path) -> str:
    return str(path / SOURCE_FILE) if path.is_dir() else f"{path}: better"


def _about(expected: ExpectedDataset, number: int) -> dict[str, Any]:
    """Return the metadata that the data set should contain for an episode."""
    episode = expected.dataset.episodes[number]
    return {**episode.about, "record": episode.record}


def _compare_source(path: Path, source: Mapping[str, Any], expected: ExpectedDataset) -> None:
    """Check that the description of a data set's origin agrees with the records and the layout.

    The omitted trials, the package version, the evaluation command, the digest of the options and the file sizes are
    not checked, because they cannot be derived from the records. The digests of the files are checked separately.
    """
    wanted = origin_of(
        expected.dataset.episodes,
        expected.layout,
        expected.form,
        source["quality"],
        identity=source.get("identity"),
        left_out=source.get("left_out"),
    )
    stated = {
        name: source[name]
        for name in ("package_version", "evaluate", "version", "files", "sha256", SEAL)
        if name in source
    }
    require_match(dict(source), wanted | stated, _source_name(path))
    if path.is_dir():
        stored_source(path)  # reading the origin verifies its seal, which covers all other fields
    _compare_digests(path, source)


def _compare_digests(path: Path, source: Mapping[str, Any]) -> None:
    """Compare all files with the digests stored in the data set, if it has any.

    This includes images that are not rendered again. Changes to the dataset card are allowed.
    """
    if path.is_file():
        with intact(str(path)):
            require_same_content(path, cure=CURE, raises=RecordError)
        return
    with intact(f"{path / SOURCE_FILE}: sha256"):
        told = {str(name): digest for name, digest in source.get("sha256", {}).items() if name != README}
    for name, digest in told.items():
        with intact(str(path / name)):
            if file_digest(path / name) != digest:
                raise InvalidInputError(str(path / name), "the file has changed since it was written", CURE)


def _source(path: Path) -> dict[str, Any]:
    """Read the description of a data set's origin that ``better export`` stored in the data set."""
    try:
        source = read_origin(path) if path.is_file() else parse_json(read_ordinary(path / SOURCE_FILE))
        layout = source["layout"]
        named = [layout["adapter"]["name"], layout["observation"]["name"], source["quality"], source["images"]]
        named += [about[key] for about in source["episodes"] for key in ("task", "condition", "record")]
        counted = [int(about[key]) for about in source["episodes"] for key in ("seed", "rows")]
        if not all(isinstance(name, str) for name in named) or min(counted, default=-1) < 0:
            raise ValueError("the layout or the episodes are missing")  # noqa: TRY301 - reported below
        if source["images"] not in get_args(ImageForm):
            raise ValueError("there are neither videos nor PNG files")  # noqa: TRY301 - reported below
    except BetterError:
        raise
    except (OSError, ValueError, KeyError, TypeError, OverflowError) as error:
        said = str(error).splitlines()[0] if str(error) else type(error).__name__
        problem = f"this is not a data set of `better export` ({said})"
        raise InvalidInputError(str(path), problem, "Pass the folder or file that `better export` wrote") from error
    form: dict[str, Any] = source
    return form


def _trial(runs: Sequence[RunFolder], about: Mapping[str, Any]) -> tuple[int, TrialId]:
    """Return the index of the run that contains an episode's record, and the trial of this record."""
    trial = TrialId(about["task"], about["condition"], about["seed"])
    for number, run in enumerate(runs):
        entry = run.entry(trial)
        if entry is not None and entry.status == "done" and run.record_digest(entry) == about["record"]:
            return number, trial
    raise RecordError(
        f"{trial}: none of the given runs has the record of this episode (SHA-256 {about['record'][:12]}...). "
        "Pass all runs from which the data set was exported."
    )


def _error(there: np.ndarray | None, wanted: np.ndarray) -> float:
    """Return the mean error of an image on a scale from 0 to 255.

    Return infinity if the image is missing or has another size.
    """
    if there is None or there.shape != wanted.shape:
        return float("inf")
    return float(np.abs(there.astype(np.int16) - wanted.astype(np.int16)).mean())
