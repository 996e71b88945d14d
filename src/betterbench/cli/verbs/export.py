"""``better export``: write the outcomes of a run, its metrics for an experiment tracker, or a training data set."""

from __future__ import annotations

import os
import time
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import tyro

from betterbench.cli.console import OUT, passing_bar, print_json, progress_bar, say
from betterbench.errors import InvalidInputError
from betterbench.quoting import default_name


def export_command(
    runs: Annotated[tuple[Path, ...], tyro.conf.Positional],
    *,
    to: Literal[
        "submission", "tensorboard", "wandb", "lerobot", "lerobot-v2.1", "robomimic", "lmms-eval"
    ] = "submission",
    out: Path | None = None,
    name: str | None = None,
    project: str = "betterbench",
    check: Path | None = None,
    preset: str | None = None,
    tasks: tuple[str, ...] = (),
    variations: bool = False,
    images: Literal["video", "png"] = "video",
    observation: str | None = None,
    quality: str | None = None,
    validation: float = 0.0,
    language: bool = False,
    vqa: Path | None = None,
    workers: int | None = None,
    overwrite: bool = False,
    json: bool = False,
) -> None:
    """Export a run's outcomes, or the demonstrations of runs as a data set for training policies.

    A submission, which `better compare` can read, contains the outcome of every planned trial, the versions of the
    software, and the hash of each record. A data set (lerobot, lerobot-v2.1, robomimic) contains the observations and
    actions of successful trials in training conditions, in the layout of a preset. A policy trained on the data set is
    evaluated with the same preset. Ctrl-C keeps finished episodes, and running the command again resumes the export.

    Example: better export runs/demos --to lerobot --preset lerobot --out sets/demos

    Args:
        runs: Run folder; several folders for a data set.
        to: submission; tensorboard or wandb (extras with the same names; settings of wandb such as WANDB_MODE=offline
            determine what it uploads); lerobot (version 3.0), lerobot-v2.1 (for openpi, and with modality.json for
            GR00T and Being-H) or robomimic (HDF5, extra robomimic); for a run of `better vlm`, lmms-eval (sample logs).
        out: Where to write: the submission file (default NAME.json), the tracker folder (default RUN/TRACKER), the data
            set folder (for robomimic, a file), or the folder of the sample logs (default RUN/lmms_eval).
        name: Policy name; default: the name that the policy declared.
        project: Project name for the tracker wandb.
        check: Submission or data set to check against the records of the runs; nothing is written.
        preset: Layout of the data set, as in a policy's address (?preset=NAME); default: lerobot, gr00t_new_embodiment
            for lerobot-v2.1, or native for robomimic.
        tasks: Tasks in the data set; default: all tasks of the runs.
        variations: Also export successful trials of test variations. A policy trained on this data must not be
            evaluated on these variations.
        images: Image format: video (H.264) or png (lossless, six times larger). Images for robomimic are always
            lossless.
        observation: Observation preset of the evaluation; default: the first preset that has the layout's cameras.
        quality: Render preset for the images; default: the run's preset.
        validation: Fraction of the seeds held out for validation; the episodes with these seeds come last.
        language: Also write the language columns, which LeRobot versions before 0.6 reject.
        vqa: Question set made by `better vqa` about the same run, to be written to the language columns.
        workers: Number of episodes rendered in parallel; default: one per CPU core.
        overwrite: Replace a file that `better export` did not write, or another data set of `better export`.
        json: Print one JSON document about what was written or checked.
    """
    if not runs:
        named = "Pass the folder of the run, which is the --out of `better eval` or `better collect`"
        compared = f"Pass the folders of the runs to compare with {check}"
        raise InvalidInputError("runs", "no run was given", named if check is None else compared)
    if check is not None and _is_dataset(check):
        _check_dataset(runs, check, as_json=json)
        return
    if to in _PRESETS:
        options = _DatasetOptions(_PRESETS[to] if preset is None else preset, tasks, variations, observation, workers)
        written = {
            "form": images,
            "quality": quality,
            "validation": validation,
            "language": language,
            "questions": vqa,
            "overwrite": overwrite,
        }
        _export_dataset(runs, to, out, options, written, as_json=json)
        return
    given = {
        "--preset": preset, "--tasks": tasks, "--variations": variations, "--images": images != "video",
        "--observation": observation, "--quality": quality, "--validation": validation, "--language": language,
        "--vqa": vqa,
    }  # fmt: skip
    _refuse(given, to)
    if to == "lmms-eval":
        further = {"--name": name, "--check": check, "--project": project != "betterbench"}
        _export_samples(runs, out, {k: v for k, v in further.items() if v}, overwrite=overwrite, as_json=json)
        return
    _export_outcomes(runs, to, out, name=name, project=project, check=check, overwrite=overwrite, as_json=json)


def _export_samples(
    runs: tuple[Path, ...], out: Path | None, refused: Mapping[str, object], *, overwrite: bool, as_json: bool
) -> None:
    """Write the sample logs of runs of `better vlm` in the format of lmms-eval."""
    from betterbench.vlm.samples import write_samples

    for option in refused:
        raise InvalidInputError(option, "this option is not used by the lmms-eval export", f"Leave out {option}")
    files = [write_samples(run, out or run / "lmms_eval", overwrite=overwrite) for run in runs]
    document = {"files": [str(file) for file, _ in files], "samples": [count for _, count in files]}
    _tell(document, "\n".join(f"{count} samples\nwritten to  {file}" for file, count in files), as_json=as_json)


def _refuse(given: Mapping[str, object], to: str) -> None:
    """Raise InvalidInputError if an option that applies only to data sets was given."""
    for option, value in given.items():
        if value:
            cure = f"Add --to {', --to '.join(_PRESETS)}, or leave out {option}"
            raise InvalidInputError(option, f"this option applies only to data sets, and {to} is not a data set", cure)


def _is_dataset(path: Path) -> bool:
    """Return whether a path is a data set rather than a submission."""
    from betterbench.demonstrations.export.robomimic import is_hdf5

    return path.is_dir() or path.suffix in (".hdf5", ".h5") or is_hdf5(path)


_PRESETS = {"lerobot": "lerobot", "lerobot-v2.1": "gr00t_new_embodiment", "robomimic": "native"}
"""Default layout preset of each data set format."""


@dataclass(frozen=True, slots=True)
class _DatasetOptions:
    """Options that select the frames of a data set, and the number of workers that render these frames."""

    preset: str
    tasks: tuple[str, ...]
    variations: bool
    observation: str | None
    workers: int | None


def _export_dataset(
    runs: tuple[Path, ...],
    to: Any,  # noqa: ANN401 - the name of a format
    out: Path | None,
    options: _DatasetOptions,
    written: dict[str, Any],
    *,
    as_json: bool,
) -> None:
    from betterbench.cli.progress import took
    from betterbench.demonstrations.export import ExportPlan, export_dataset, layout_of, select_demonstrations
    from betterbench.demonstrations.export.job import validation_seeds
    from betterbench.demonstrations.export.layout import robot_of_runs
    from betterbench.records import RunFolder

    if out is None:
        what = "file, such as demos.hdf5" if to == "robomimic" else "folder of the data set"
        raise InvalidInputError("--out", "this option is required", f"Pass the {what}")
    folders = [RunFolder.open(run) for run in runs]
    layout = layout_of(options.preset, options.observation, robot=robot_of_runs(folders))
    selection = select_demonstrations(folders, tasks=options.tasks, variations=options.variations)
    plan = ExportPlan(folders, selection, layout, to, out, **written)
    began = time.monotonic()
    with progress_bar("export", len(selection.demonstrations)) as (bar, task):
        done = export_dataset(
            plan,
            workers=options.workers or os.cpu_count() or 1,
            on_progress=lambda count, planned: bar.update(task, completed=count, total=planned),
        )
        bar.update(task, completed=len(selection.demonstrations))
    seconds = time.monotonic() - began
    left_out = [f"{count} {reason}" for reason, count in done.left_out.items()]
    seeds = {chosen.trial.seed for chosen in selection.demonstrations}
    if plan.validation and not validation_seeds(seeds, plan.validation):
        say(f"no seed is held out: a fraction of {plan.validation:g} of {len(seeds)} seeds is less than one seed")
    if left_out:
        say(f"left out: {', '.join(left_out)}")
    if options.variations:
        say("this export includes test variations: do not use them to evaluate a policy that is trained on it")
    document = asdict(done) | {"path": str(done.path), "seconds": round(seconds, 3)}
    sentence = (
        f"{done.episodes} episodes, {done.frames} frames\n{took(seconds, done.bytes)}\n"
        f"written to  {done.path}\nevaluate    {done.evaluate}"
    )
    _tell(document, sentence, as_json=as_json)


def _check_dataset(runs: tuple[Path, ...], path: Path, *, as_json: bool) -> None:
    from betterbench.demonstrations.export import check_export
    from betterbench.records import RunFolder

    with progress_bar("check", 0) as (bar, task):
        found = check_export(
            [RunFolder.open(run) for run in runs],
            path,
            on_progress=lambda count, planned: bar.update(task, completed=count, total=planned),
        )
    sentence = (
        f"{path}: agrees with the records: {found.episodes} episodes, {found.frames} frames, "
        f"{found.pictures} images rendered again (largest mean error {found.worst_error:.2f} of 255 levels)"
    )
    _tell(asdict(found), sentence, as_json=as_json)


def _export_outcomes(
    runs: tuple[Path, ...],
    to: Any,  # noqa: ANN401 - submission or the name of a tracker
    out: Path | None,
    *,
    name: str | None,
    project: str,
    check: Path | None,
    overwrite: bool,
    as_json: bool,
) -> None:
    """Write a submission, check a submission against the run, or write the metrics for a tracker."""
    from betterbench.cli.output.diagnosis import diagnosed
    from betterbench.cli.trackers import write_metrics
    from betterbench.comparison import read_submission, require_same, submission_of
    from betterbench.comparison.submission import is_submission, submission_lines
    from betterbench.jobs import write_durably
    from betterbench.jobs.lock import FileLock
    from betterbench.jobs.outputs import OutputFile, require_replaceable
    from betterbench.records import RunFolder

    if len(runs) > 1:
        raise InvalidInputError(
            "runs", f"{len(runs)} runs were given", "Pass one run, or add --to lerobot for a data set"
        )
    folder = RunFolder.open(runs[0])
    if check is not None:
        submission = read_submission(check)
        with passing_bar(f"diagnosing {folder.path.name}") as told:
            require_same(folder, submission, on_progress=told)
        _tell(
            {"identical": True, "sha256": submission.sha256},
            f"{check}: agrees with the records of the run",
            as_json=as_json,
        )
        return
    if to != "submission":
        place = out or folder.inside(to)
        with FileLock(place):  # the lock file is not in the folder, because trackers read every file there
            write_metrics(diagnosed(folder), to, place, name=name, project=project, overwrite=overwrite)
        _tell({"written": str(place)}, f"written to {place}", as_json=as_json)
        return
    if out is not None:  # check this first, because reading the records takes long
        require_replaceable(out, "export", overwrite=overwrite, is_ours=is_submission)
    with passing_bar(f"diagnosing {folder.path.name}") as told:
        submission = submission_of(folder, name=name, on_progress=told)
    file = out or Path(f"{default_name(submission.name, otherwise='submission')}.json")
    try:
        with OutputFile(file, "export", overwrite=overwrite, is_ours=is_submission):
            write_durably(file, submission.file_bytes())
    except OSError as error:
        raise InvalidInputError(
            "--out", f"{file} cannot be written ({error.strerror})", "Choose another file"
        ) from error
    for line in submission_lines(submission):
        say(line)
    _tell({"written": str(file), "sha256": submission.sha256}, f"written to {file}", as_json=as_json)


def _tell(document: dict[str, object], sentence: str, *, as_json: bool) -> None:
    if as_json:
        print_json(document)
    else:
        OUT.print(sentence, markup=False, soft_wrap=True)
