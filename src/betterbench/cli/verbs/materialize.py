"""``better materialize``: render images, depth, masks and boxes of every recorded state."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from betterbench.cli.console import OUT, print_json, progress_bar
from betterbench.quoting import shell_line

if TYPE_CHECKING:
    from betterbench.records import RunFolder
    from betterbench.sim.modalities.checking import FolderCheck
    from betterbench.sim.modalities.folder import Wanted
    from betterbench.tasks import TrialId

MOST_LISTED = 3
"""Maximum number of files in the error about a failed check. With --json, all files are listed."""


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
    """Render color, depth, masks, boxes and optical flow of every recorded state into seekable files.

    Only the records and scenes of the run are read. Running the command again resumes the job where it stopped: intact
    files are kept, and missing or damaged files are rendered again. The files do not depend on the number of workers or
    on interruptions.

    Example: better materialize runs/expert --camera front --camera wrist:448 --modality rgb --modality depth

    Args:
        run: Run folder.
        camera: Camera to render: NAME, NAME:SIZE, NAME:WIDTHxHEIGHT, or a new camera as
            NAME=X,Y,Z/X,Y,Z/FOVY:WIDTHxHEIGHT (position and target in meters, degrees); may be given several times.
            Default: the views of the run's policy.
        modality: Modality to write: rgb, depth, instances, semantics, boxes or flow; may be given several times.
            Default: all.
        trial: Trial to render, TASK/CONDITION/SEED; may be given several times. Default: all recorded trials.
        quality: Render preset of the color images; default: the preset used for the policy.
        out: Folder to write; RUN/modalities if not given.
        workers: Number of worker processes that render and compress files.
        follow: Also process trials of a run in progress, until it ends.
        check: Only check that the files of each recorded trial, or of each --trial, exist and match their checksums.
            Nothing is written.
        json: Print one JSON document as a summary.
    """
    from betterbench.records import RunFolder
    from betterbench.records.modalities.spec import ViewSpec, modalities_named
    from betterbench.sim.modalities.folder import Wanted, read_settings, require_same_settings
    from betterbench.sim.modalities.run import default_views, materialize_run
    from betterbench.wording import plural

    folder = RunFolder.open(run)
    place = out or folder.inside("modalities")
    trials = [_trial(text) for text in trial]
    views = tuple(ViewSpec.parse(text) for text in camera) or default_views(folder)
    wanted = Wanted(views, modalities_named(modality), quality)
    if check:
        if camera or modality or quality:
            require_same_settings(place, read_settings(place), wanted)
        _check(run, place, folder, trials, json=json)
        return
    with progress_bar("trials", 0) as (bar, task):
        done = materialize_run(
            folder,
            place,
            wanted,
            trials=trials,
            workers=workers,
            follow=follow,
            on_progress=lambda number, known: bar.update(task, completed=number, total=known),
        )
    if json:
        print_json({"out": str(place), **asdict(done)})
        return
    rate = f"{done.rows / done.seconds:.0f} images/s" if done.rows and done.seconds else "nothing to render"
    OUT.print(
        f"{plural(done.trials, 'trial')}: {plural(done.files, 'file')} written, {plural(done.rows, 'image')}, "
        f"{done.bytes / 1e6:.1f} MB, {rate}; {done.kept} kept\nwritten to  {place}",
        markup=False,
        soft_wrap=True,
    )


def _trial(text: str) -> TrialId:
    """Parse a trial given as TASK/CONDITION/SEED. Raise InvalidInputError if the string has a different format."""
    from betterbench.errors import InvalidInputError
    from betterbench.tasks import TrialId

    task, _, rest = text.partition("/")
    condition, _, seed = rest.partition("/")
    if not (task and condition and seed.isascii() and seed.isdigit()):
        raise InvalidInputError(
            "--trial", f"{text!r} is not a trial", "Write TASK/CONDITION/SEED, such as fast_food/T1/0"
        )
    return TrialId(task, condition, int(seed))


def _check(typed: Path, place: Path, folder: RunFolder, trials: Sequence[TrialId], *, json: bool) -> None:
    """Check rendered modalities against the records of a run. Raise RecordError if files are missing or wrong."""
    from betterbench.errors import RecordError
    from betterbench.sim.modalities.checking import check_folder
    from betterbench.wording import plural

    with progress_bar("files", 0) as (bar, task):
        found = check_folder(
            folder,
            place,
            trials=trials,
            on_progress=lambda done, known: bar.update(task, completed=done, total=known),
        )
    if json:
        problems = [f"{problem.path}: {problem.text}" for problem in found.problems]
        print_json({"out": str(place), "files": found.files, "rows": found.rows, "problems": problems})
    if found.problems:
        raise RecordError(_told(found, place, _command(typed, place, found.wanted, trials), typed))
    if not json:
        text = f"{plural(found.files, 'file')} with {plural(found.rows, 'image')}"
        verb = "is" if found.files == 1 else "are"
        OUT.print(f"{text} {verb} intact; no file is missing", markup=False)


def _told(found: FolderCheck, place: Path, command: str, run: Path) -> str:
    """Return a message that lists the problems found in a folder, with the remedies."""
    from betterbench.wording import plural

    if found.is_of_another_run:
        return (
            f"{place}: the files do not belong to the records of {run}. For example, one file belongs to "
            f"{found.strangers[0]}. Pass the run from which the files were rendered, or another --out to render this "
            "run."
        )
    listed = [f"{problem.path.relative_to(place)} {problem.text}" for problem in found.problems]
    said = f"{plural(len(listed), 'file')} missing or wrong: {_some(listed)}"
    cures = []
    extra = [str(problem.path) for problem in found.problems if problem.kind == "extra"]
    if extra:
        cures.append(f"Move {_some(extra)} away.")
    if len(found.problems) > len(extra):
        cures.append(f"To render them again: {command}")
    return f"{place}: {said}. {' '.join(cures)}"


def _some(texts: Sequence[str]) -> str:
    more = len(texts) - MOST_LISTED
    return "; ".join(texts[:MOST_LISTED]) + (f"; and {more} more (--json lists all)" if more > 0 else "")


def _command(run: Path, place: Path, wanted: Wanted, trials: Sequence[TrialId]) -> str:
    """Return the command that renders the missing files of a folder with its original options."""
    from betterbench.records.modalities.spec import MODALITIES

    words = ["better", "materialize", str(run)]
    for view in wanted.views:
        words += ["--camera", view.text]
    for modality in wanted.modalities if set(wanted.modalities) != set(MODALITIES) else ():
        words += ["--modality", modality]
    for trial in trials:
        words += ["--trial", str(trial)]
    if wanted.quality is not None:
        words += ["--quality", wanted.quality]
    return shell_line([*words, "--out", str(place)])
