"""``better materialize``: images, depth, masks and boxes of every recorded state."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from betterbench.cli.console import OUT, print_json, progress_bar

if TYPE_CHECKING:
    from betterbench.tasks import TrialId


def materialize_command(
    run: Annotated[Path, tyro.conf.Positional],
    *,
    camera: tyro.conf.UseAppendAction[tuple[str, ...]] = (),
    modality: tyro.conf.UseAppendAction[tuple[str, ...]] = (),
    trial: tyro.conf.UseAppendAction[tuple[str, ...]] = (),
    quality: str | None = None,
    out: Path | None = None,
    workers: int = 1,
    follow: bool = False,
    check: bool = False,
    json: bool = False,
) -> None:
    """Write colors, depth, masks, boxes and optical flow of every recorded state as seekable files.

    Nothing but the records and scenes of the run is read. Complete files are kept, so the same command resumes.
    Interruptions and the number of workers do not change a byte.

    Example: better materialize runs/expert --camera front --camera wrist:448 --modality rgb --modality depth

    Args:
        run: Folder of a run.
        camera: View to draw: NAME, NAME:SIZE, NAME:WIDTHxHEIGHT, or a camera of your own as
            NAME=X,Y,Z/X,Y,Z/FOVY:WIDTHxHEIGHT (position and target in meters, degrees); may be given several times. The
            views of the run's policy if none is given.
        modality: What to write of rgb, depth, instances, semantics, boxes and flow; may be given several times. All if
            none is given.
        trial: Trial to draw, TASK/CONDITION/SEED; may be given several times. All that are recorded if none is given.
        quality: Render preset of the colors; the one that the policy saw if not given.
        out: Folder to write; RUN/modalities if not given.
        workers: Processes that draw; files are compressed beside each.
        follow: Wait for trials that the run is still recording, until it ends.
        check: Read all files that are there and compare their checksums instead; nothing is written.
        json: Print one JSON document about what was done.
    """
    from betterbench.materialization.folder import Wanted
    from betterbench.materialization.run import default_views, materialize_run
    from betterbench.recording import RunFolder
    from betterbench.recording.modalities.spec import ViewSpec, modalities_named
    from betterbench.statistics.wording import plural

    folder = RunFolder.open(run)
    place = out or folder.path / "modalities"
    if check:
        _check(place, json=json)
        return
    trials = [_trial(text) for text in trial]
    views = tuple(ViewSpec.parse(text) for text in camera) or default_views(folder)
    with progress_bar("trials", 0) as (bar, task):
        done = materialize_run(
            folder,
            place,
            Wanted(views, modalities_named(modality), quality),
            trials=trials,
            workers=workers,
            follow=follow,
            on_progress=lambda number, known: bar.update(task, completed=number, total=known),
        )
    if json:
        print_json({"out": str(place), **asdict(done)})
        return
    rate = f"{done.rows / done.seconds:.0f} images/s" if done.rows and done.seconds else "nothing to draw"
    OUT.print(
        f"{plural(done.trials, 'trial')}: {plural(done.files, 'file')} written, {plural(done.rows, 'image')}, "
        f"{done.bytes / 1e6:.1f} MB, {rate}; {done.kept} kept\nwritten to  {place}",
        markup=False,
        soft_wrap=True,
    )


def _trial(text: str) -> TrialId:
    """Return the trial that TASK/CONDITION/SEED names, or raise InvalidInputError."""
    from betterbench.errors import InvalidInputError
    from betterbench.tasks import TrialId

    task, _, rest = text.partition("/")
    condition, _, seed = rest.partition("/")
    if not (task and condition and seed.isascii() and seed.isdigit()):
        raise InvalidInputError("--trial", f"{text!r} names no trial", "Give TASK/CONDITION/SEED, as fast_food/T1/0")
    return TrialId(task, condition, int(seed))


def _check(place: Path, *, json: bool) -> None:
    from betterbench.errors import RecordError
    from betterbench.materialization.folder import read_settings
    from betterbench.recording.modalities.file import ModalityFile

    read_settings(place)
    files, rows = sorted(place.glob("*/*/*/*.parquet")), 0
    problems: list[str] = []
    with progress_bar("files", len(files)) as (bar, task):
        for path in files:
            try:
                with ModalityFile(path) as file:
                    rows += file.check()
            except RecordError as problem:
                problems.append(str(problem))
            bar.advance(task)
    if json:
        print_json({"out": str(place), "files": len(files), "rows": rows, "problems": problems})
    if problems:
        more = f" {len(problems) - 1} more files are damaged too." if len(problems) > 1 else ""
        raise RecordError(f"{problems[0]}{more}")
    if not json:
        OUT.print(f"{len(files)} files with {rows} images are intact", markup=False)
