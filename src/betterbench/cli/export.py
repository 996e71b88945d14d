"""``better export``: the outcomes of a run for others: one file to compare with, or an experiment tracker."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Annotated, Literal

import tyro

from betterbench.cli.console import OUT, print_json, say


def export_command(
    run: Annotated[Path, tyro.conf.Positional],
    *,
    to: Literal["submission", "tensorboard", "wandb"] = "submission",
    out: Path | None = None,
    name: str | None = None,
    project: str = "betterbench",
    check: Path | None = None,
    json: bool = False,
) -> None:
    """Write the outcomes of a run as one file that better compare reads, or hand its metrics to an experiment tracker.

    A submission holds the outcome of every planned trial, all versions, and the hash of every record.

    Example: better export runs/mine --out mine.json

    Args:
        run: Folder of the run.
        to: submission, tensorboard (extra tensorboard) or wandb (extra wandb; what it sends and where is up to its own
            settings, such as WANDB_MODE=offline).
        out: File of the submission, NAME.json if not given; or folder of the tracker, RUN/TRACKER.
        name: What the policy is called; the name that it declared if not given.
        project: Project of the tracker wandb.
        check: Submission to compare with the records of the run instead; nothing is written.
        json: Print one JSON document about what was written or checked.
    """
    from betterbench.cli.trackers import write_metrics
    from betterbench.comparison import read_submission, require_same, submission_of
    from betterbench.comparison.submission import submission_lines
    from betterbench.diagnosis import diagnose_run
    from betterbench.recording import RunFolder

    folder = RunFolder.open(run)
    if check is not None:
        submission = read_submission(check)
        require_same(folder, submission)
        _tell(
            {"identical": True, "sha256": submission.sha256},
            f"{check}: identical with what the run proves",
            as_json=json,
        )
        return
    if to != "submission":
        place = write_metrics(diagnose_run(folder), to, out or run / to, name=name, project=project)
        _tell({"written": str(place)}, f"written to {place}", as_json=json)
        return
    submission = submission_of(folder, name=name)
    file = out or Path(f"{re.sub(r'[^A-Za-z0-9.]+', '-', submission.name).strip('-.') or 'submission'}.json")
    _write(file, submission.file_bytes())
    for line in submission_lines(submission):
        say(line)
    _tell({"written": str(file), "sha256": submission.sha256}, f"written to {file}", as_json=json)


def _tell(document: dict[str, object], sentence: str, *, as_json: bool) -> None:
    if as_json:
        print_json(document)
    else:
        OUT.print(sentence, markup=False, soft_wrap=True)


def _write(file: Path, data: bytes) -> None:
    """Write a file, or raise InvalidInputError if its place cannot be written."""
    from betterbench.errors import InvalidInputError
    from betterbench.recording import write_durably

    try:
        write_durably(file, data)
    except OSError as error:
        raise InvalidInputError(
            "--out", f"{file} cannot be written ({error.strerror})", "Name another place"
        ) from error
