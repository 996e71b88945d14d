"""``better replay``: simulate a record again, or render its video."""

from __future__ import annotations

import os
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from betterbench.cli.console import OUT, print_json, progress_bar, say
from betterbench.errors import BetterError, InvalidInputError, RecordError, one_line
from betterbench.quoting import shell_word

if TYPE_CHECKING:
    from betterbench.records import RecordMetadata, RunFolder

MOST_FIELDS = 5
"""Maximum number of differing fields in the error about a replay."""


def replay_command(
    record: Annotated[Path, tyro.conf.Positional],
    *,
    check: bool = False,
    twin: bool = False,
    out: Path | None = None,
    camera: str = "front",
    size: int | None = None,
    overwrite: bool = False,
    json: bool = False,
) -> None:
    """Replay the actions of a record and compare every state, or write a video of the trial.

    Example: better replay runs/expert/records/fast_food/T1/0.parquet --check

    Args:
        record: Record file in the folder of its run.
        twin: Render the trial next to its training twin (the training trial with the same seed), with instructions,
            elapsed time, labels and the path of the gripper.
        check: Simulate the trial again and compare all recorded results, instead of writing a video.
        out: Video file to write; a file in the run folder if not given.
        camera: Camera of the video.
        size: Side length of the video in pixels, or of each half with --twin; default 512, or 384 with --twin.
        overwrite: Replace a file that `better replay` did not write.
        json: Print the result of --check as one JSON document.
    """
    from betterbench.evaluation import check_record

    _require_file(record)
    if check and twin:
        raise InvalidInputError(
            "--twin", "it cannot be combined with --check, which does not write a video", "Leave out --twin or --check"
        )
    if not check:
        path = (_twin_video if twin else _video)(record, out, camera=camera, size=size, overwrite=overwrite)
        say(f"wrote {path}", whole=True)
        return
    result = check_record(record)
    if json:
        print_json({"record": str(record), "identical": result.identical, **asdict(result)})
    elif result.identical:
        OUT.print(f"identical: {result.rows} states, every verdict and all {result.fields} fields", markup=False)
    if not result.identical:
        where = "none" if result.first_difference is None else f"from row {result.first_difference} on"
        more = len(result.differing) - MOST_FIELDS
        listed = "; ".join(result.differing[:MOST_FIELDS]) + (f"; and {more} more" if more > 0 else "")
        raise BetterError(
            f"{record}: the replay differs from the record. States that differ: {where}, by at most "
            f"{result.largest_difference:.3g}. The verdicts {'agree' if result.verdict_agrees else 'differ'}. Fields "
            f"that differ: {listed}. "
            f"{'; '.join(result.notes) or 'Versions are the same'}."
        )


def _require_file(record: Path) -> None:
    """Raise RecordError if a path is the folder of a run. The message names a record of the run."""
    if not (record / "run.json").is_file():
        return
    found = min(record.glob("records/*/*/*.parquet"), default=None)
    one = f"such as {shell_word(found)}" if found is not None else "but this run has none yet"
    raise RecordError(f"{record}: this is a folder of a run. Pass one of its records, {one}.")


def run_of(record: Path) -> tuple[RunFolder, RecordMetadata]:
    """Return the run to which a record file belongs, and the metadata of the record.

    Raises:
        RecordError: If the record file is not in the folder of its run.
    """
    from betterbench.records import RunFolder, read_record

    _require_file(record)
    meta = read_record(record).metadata
    place = Path(os.path.realpath(record))
    folder = place.parents[3] if len(place.parents) > 3 else place.parent
    run = RunFolder.open(folder) if (folder / "run.json").is_file() else None
    if run is None or Path(os.path.realpath(run.record_path(meta.task, meta.condition, meta.seed))) != place:
        trial = one_line(f"{meta.task}/{meta.condition}/{meta.seed}")
        raise RecordError(
            f"{record}: the record is not in its run folder, which contains the scene. Pass the path in that folder, "
            f"or move the record back to RUN/records/{trial}.parquet."
        )
    return run, meta


def _video(record: Path, out: Path | None, *, camera: str, size: int | None, overwrite: bool) -> Path:
    from betterbench.evaluation import write_video
    from betterbench.jobs.outputs import OutputFile

    run, meta = run_of(record)
    path = out or run.video_path(meta.task, meta.condition, meta.seed, camera=camera)
    with OutputFile(path, "replay", overwrite=overwrite), progress_bar("video", 0) as (bar, task):
        return write_video(
            run,
            meta.task,
            meta.condition,
            meta.seed,
            camera=camera,
            size=size or 512,
            out=path,
            on_progress=lambda done, planned: bar.update(task, completed=done, total=planned),
        )


def _twin_video(record: Path, out: Path | None, *, camera: str, size: int | None, overwrite: bool) -> Path:
    from betterbench.api.report import panel_of
    from betterbench.cli.output.diagnosis import diagnosed
    from betterbench.evaluation import FilmLook, write_twin_film
    from betterbench.jobs.outputs import OutputFile
    from betterbench.tasks import TrialId

    run, meta = run_of(record)
    trials = {t.key: t for t in diagnosed(run).trials}
    trial = trials.get(str(TrialId(meta.task, meta.condition, meta.seed)))
    if trial is None:
        raise RecordError(f"{record}: its trial is not in the plan of {run.path}. Choose a record of a planned trial.")
    panels = [panel_of(trial, "this trial")]
    beside = trials.get(trial.twin_key or "")
    if beside is not None and beside.record is not None:
        panels.append(panel_of(beside, "training twin"))
    else:
        why = "training trials have no twin" if trial.variation is None else "the training twin has no record"
        say(f"{trial.key} is shown alone: {why}")
    path = out or run.video_path(meta.task, meta.condition, meta.seed, camera="twin")
    look = FilmLook(camera=camera, size=size or 384, rate_hz=10, longest_s=None, quality="standard")
    with OutputFile(path, "replay", overwrite=overwrite), progress_bar("film", 0) as (bar, task):
        return write_twin_film(
            run,
            panels,
            path,
            look=look,
            on_progress=lambda done, planned: bar.update(task, completed=done, total=planned),
        )
