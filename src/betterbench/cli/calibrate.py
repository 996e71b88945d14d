"""``better calibrate``: the diagnosis measured on policies whose fault is known."""

from __future__ import annotations

import json
import os
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING

from betterbench.cli.console import OUT, print_json, progress_bar, say
from betterbench.errors import InvalidInputError

if TYPE_CHECKING:
    from betterbench.calibration import CalibrationProgress
    from betterbench.diagnosis.confusion import Calibration


def calibrate_command(
    *,
    out: Path = Path("runs/calibration"),
    tasks: tuple[str, ...] = (),
    policies: tuple[str, ...] = (),
    strengths: tuple[float, ...] = (1.0, 0.6, 0.3),
    trials: int = 1,
    probe_trials: int = 8,
    seed: int = 0,
    workers: int | None = None,
    write_package: bool = False,
    json: bool = False,
) -> None:
    """Run the faulty policies and compare the label of each trial with the true one: a confusion matrix.

    Each policy follows one faulty rule in a share of its trials and records its own first wrong decision. Blind probes
    run too: a variation that they solve proves little. Ctrl-C keeps what is done; the same command resumes.

    Example: better calibrate --tasks fast_food --trials 2 --out runs/calibration

    Args:
        out: Folder of the calibration.
        tasks: Tasks to run; the whole suite if none is named.
        policies: Faulty policies to run; all if none is named.
        strengths: Shares of the trials in which a faulty rule is followed; smaller shares also get more action noise.
        trials: Trials per variation of each policy at each strength.
        probe_trials: Trials per variation of each blind probe; 0 for none.
        seed: First seed.
        workers: Worker processes; one per processor if not given.
        write_package: Also write the calibration that ships with the package; for its maintainers.
        json: Print the calibration as one JSON document at the end.
    """
    from betterbench.calibration import calibrate, calibration_policies
    from betterbench.cli.evaluate import prepare_robot
    from betterbench.cli.output.calibration import print_calibration
    from betterbench.tasks import suite_tasks

    if write_package and (policies or (tasks and set(tasks) != set(suite_tasks("better60")))):
        problem = "it replaces the calibration of the whole suite"
        raise InvalidInputError("--write-package", problem, "Leave out --tasks and --policies")
    prepare_robot("panda")
    planned = calibration_policies(
        policies=policies, strengths=strengths, seed=seed, trials=trials, probe_trials=probe_trials
    )
    with progress_bar("calibrate", 0) as (bar, task):

        def told(progress: CalibrationProgress) -> None:
            bar.update(task, completed=progress.done, total=progress.planned, note=progress.policy)

        found = calibrate(planned, out, tasks=tasks, workers=workers or os.cpu_count() or 1, on_progress=told)
    page = _store(found, out, write_package=write_package)
    if json:
        print_json(found.to_json())
        return
    print_calibration(found)
    OUT.print(f"page        {page}\nmatrix      {out / 'confusion.png'}", markup=False, soft_wrap=True)


def _store(found: Calibration, out: Path, *, write_package: bool) -> Path:
    """Write a calibration, also into the package if wanted, and its page, whose path is returned."""
    from betterbench.diagnosis.confusion import PACKAGED
    from betterbench.recording import write_durably
    from betterbench.report.calibration_page import write_calibration_page

    text = (json.dumps(found.to_json(), indent=1) + "\n").encode()
    write_durably(out / "calibration.json", text)
    if write_package:
        with resources.as_file(resources.files("betterbench.diagnosis").joinpath("data")) as folder:
            write_durably(folder / PACKAGED, text)
            say(f"packaged calibration: {folder / PACKAGED}")
    return write_calibration_page(found, out)
