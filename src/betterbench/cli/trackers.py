"""Export of a run's metrics to an experiment tracker, either TensorBoard or Weights & Biases."""

from __future__ import annotations

import json
import os
import shutil
import tempfile
import time
import warnings
from collections import Counter
from pathlib import Path
from typing import Literal

from betterbench.cli.console import say
from betterbench.diagnosis import RunDiagnosis
from betterbench.errors import InvalidInputError
from betterbench.installation import missing_extra
from betterbench.jobs import write_durably
from betterbench.jobs.durable import PART_SUFFIX, DurableFile, remove_parts_of
from betterbench.jobs.outputs import mark_of, require_replaceable
from betterbench.quoting import shell_line

EVENTS_NAME = "events.out.tfevents.0.betterbench"
"""Name of the event file of a run. TensorBoard reads every file with "tfevents" in its name."""

_WANDB_PREFIX = ".wandb-"
_LEAST_ROOM = 1 << 20
"""Free disk space that wandb needs besides the space for the table of trials [bytes]. A run's log takes about 20 kB."""


def tracked_numbers(diagnosis: RunDiagnosis) -> dict[str, float]:
    """Return the metrics of a run and their confidence bounds, by name ("success_rate/fast_food/T1").

    Labels ("labels/timeout") are counted over the trials of all variations, without ambiguous trials.
    """
    numbers: dict[str, float] = {}
    for metric in diagnosis.metrics:
        parts = {"": metric.value, "/low": metric.low, "/high": metric.high, "/n": float(metric.n)}
        name = f"{metric.name}/{metric.scope}".replace(":", "/")
        numbers |= {f"{name}{part}": value for part, value in parts.items() if value is not None}
    labels = Counter(t.label.value for t in diagnosis.counted_trials if t.variation is not None)
    return numbers | {f"labels/{label}": float(n) for label, n in sorted(labels.items())}


def write_metrics(
    diagnosis: RunDiagnosis,
    to: Literal["tensorboard", "wandb"],
    out: Path,
    *,
    name: str | None,
    project: str,
    overwrite: bool = False,
) -> Path:
    """Write the metrics of a run in the format of an experiment tracker, and return the folder that was written.

    Args:
        diagnosis: Diagnosis of the run.
        to: Experiment tracker.
        out: Folder for the files of the tracker; created if missing.
        name: Name of the run in the tracker. If it is None, the name of the policy is used.
        project: Project name in Weights & Biases.
        overwrite: Whether to replace a file with the same name that this function did not write.

    Raises:
        MissingDependencyError: If the package of the tracker is not installed.
        InvalidInputError: If the folder cannot be written.
        RunConflictError: If a file with the same name exists and ``overwrite`` is not set.
        StorageError: If the disk is full.
    """
    numbers = tracked_numbers(diagnosis)
    try:
        out.mkdir(parents=True, exist_ok=True)
        if to == "tensorboard":
            require_replaceable(out / EVENTS_NAME, "export", overwrite=overwrite)
            _to_tensorboard(numbers, out / EVENTS_NAME)
        else:
            _to_wandb(diagnosis, numbers, out, name or diagnosis.policy, project)
    except ImportError as error:
        raise missing_extra(f"--to {to}: the package is not installed", to) from error
    except OSError as error:
        raise InvalidInputError(
            "--out", f"{out} cannot be written ({error.strerror})", "Choose another folder"
        ) from error
    return out


def _to_tensorboard(numbers: dict[str, float], file: Path) -> None:
    """Write the event file.

    The file of an earlier export is replaced, because TensorBoard would show both files.

    The events are written without the writer thread of ``SummaryWriter``, because this thread dies if the disk is full,
    and the next call would then wait forever.
    """
    with warnings.catch_warnings():
        # Suppress a warning of protobuf at import.
        warnings.simplefilter("ignore", DeprecationWarning)
        from tensorboardX.event_file_writer import EventsWriter
        from tensorboardX.proto.event_pb2 import Event
        from tensorboardX.summary import scalar, text

    with tempfile.TemporaryDirectory(prefix="betterbench-") as apart:
        writer = EventsWriter(str(Path(apart) / "events"))
        summaries = [text("about", mark_of("export")), *(scalar(key, value) for key, value in numbers.items())]
        for summary in summaries:
            writer.write_event(Event(summary=summary, wall_time=time.time(), step=0))
        writer.close()
        write_durably(file, next(Path(apart).iterdir()).read_bytes())


def _to_wandb(diagnosis: RunDiagnosis, numbers: dict[str, float], out: Path, name: str, project: str) -> None:
    """Write a complete wandb run next to the runs of earlier exports. If the export fails, nothing is left behind.

    On a full disk, wandb exits normally although data are missing, so the free space is checked before and after. The
    run is written to a temporary folder and then moved, because ``wandb sync`` would upload a partial run.
    """
    import wandb

    config = {"policy": diagnosis.policy, "versions": diagnosis.versions, "thresholds": diagnosis.thresholds}
    columns = ["task", "condition", "seed", "success", "label", "progress", "steps"]
    rows = [
        [t.task, t.variation or t.condition, t.seed, t.success, t.label.value, t.progress, t.steps]
        for t in diagnosis.counted_trials
    ]
    room = _LEAST_ROOM + 4 * len(json.dumps([config, numbers, rows]))
    place = out / "wandb"
    if place.is_symlink():
        raise InvalidInputError("--out", f"{place} is a symbolic link", "Remove the link, or choose another folder")
    for left in out.glob(f"{_WANDB_PREFIX}*{PART_SUFFIX}"):
        shutil.rmtree(left, ignore_errors=True)
    remove_parts_of(place)
    _require_room(place, room)
    with tempfile.TemporaryDirectory(
        prefix=_WANDB_PREFIX, suffix=PART_SUFFIX, dir=out, ignore_cleanup_errors=True
    ) as apart:
        offline = wandb.setup().settings.mode == "offline"
        # Suppress wandb's hint, because it names the temporary folder.
        quiet = wandb.Settings(silent=True) if offline else None
        with wandb.init(
            project=project, name=name, dir=apart, config=config, job_type="evaluation", settings=quiet
        ) as run:
            run.summary.update(numbers)
            run.log({"trials": wandb.Table(columns=columns, data=rows)})
        wandb.teardown()  # wandb's process may write files until this call
        _require_room(place, room)
        place.mkdir(exist_ok=True)
        for made in (Path(apart) / "wandb").iterdir():
            if made.is_dir() and not made.is_symlink():  # skip wandb's link to the latest run
                made.replace(place / made.name)
                if offline:
                    say(f"send it with: {shell_line(['wandb', 'sync', place / made.name])}", whole=True)


def _require_room(place: Path, size: int) -> None:
    """Raise StorageError if a file of ``size`` bytes does not fit on the disk.

    A test file of this size is written and removed again.
    """
    with DurableFile(place) as tried:
        tried.file.write(bytes(size))
        tried.file.flush()
        os.fsync(tried.file.fileno())
