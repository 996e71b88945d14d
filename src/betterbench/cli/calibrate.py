"""``better calibrate``: the diagnosis measured on policies whose fault is known."""

from __future__ import annotations

import json as json_module
import os
from importlib import resources
from pathlib import Path

from betterbench.calibration import CalibrationProgress, calibration_policies
from betterbench.calibration import calibrate as run_calibration
from betterbench.calibration.policies import STRENGTHS
from betterbench.cli.console import OUT, print_json, print_table, progress_bar, say
from betterbench.cli.evaluate import prepare_robot
from betterbench.diagnosis import Calibration
from betterbench.diagnosis.confusion import PACKAGED
from betterbench.errors import InvalidInputError
from betterbench.report.calibration_page import KINDS, label_name, rate_text, suspicious, write_calibration_page
from betterbench.tasks import suite_tasks

WRONG_SHOWN = 12
"""Wrong labels that the terminal lists; the page has them all."""


def calibrate(
    *,
    out: Path = Path("runs/calibration"),
    tasks: tuple[str, ...] = (),
    policies: tuple[str, ...] = (),
    strengths: tuple[float, ...] = STRENGTHS,
    trials: int = 1,
    probe_trials: int = 8,
    seed: int = 0,
    workers: int | None = None,
    write_package: bool = False,
    json: bool = False,
) -> None:
    """Run the zoo of broken policies and hold their diagnosis against the truth: a confusion matrix.

    Each policy has one broken rule, applied in a share of its trials, and notes its own first wrong decision. Blind
    probes run too: what they solve proves little. Ctrl-C keeps what is done; the same command goes on.

    Example: better calibrate --tasks fast_food --trials 2 --out runs/calibration

    Args:
        out: Folder of the calibration.
        tasks: Tasks to run; the whole suite if none is named.
        policies: Policies of the zoo to run; all if none is named.
        strengths: Shares of the trials in which a rule applies; the weaker, the shakier the hand.
        trials: Trials per variation of each policy at each strength.
        probe_trials: Trials per variation of each blind probe; 0 for none.
        seed: First seed.
        workers: Worker processes; one per processor if not given.
        write_package: Also write the calibration that ships with the package; for its maintainers.
        json: Print the calibration as one JSON document at the end.
    """
    whole = not policies and (not tasks or set(tasks) == set(suite_tasks("better60")))
    if write_package and not whole:
        raise InvalidInputError(
            "--write-package", "it replaces the calibration of the whole suite", "Leave out --tasks and --policies"
        )
    prepare_robot("panda")
    planned = calibration_policies(
        policies=policies, strengths=strengths, trials=trials, probe_trials=probe_trials, seed=seed
    )
    with progress_bar("calibrate", 0) as (bar, task):

        def told(progress: CalibrationProgress) -> None:
            bar.update(task, completed=progress.done, total=progress.planned, note=progress.policy)

        found = run_calibration(planned, out, tasks=tasks, workers=workers or os.cpu_count() or 1, on_progress=told)
    text = json_module.dumps(found.to_json(), indent=1) + "\n"
    beside = out / ".calibration.json.part"
    beside.write_text(text, encoding="utf-8")
    beside.replace(out / "calibration.json")
    page = write_calibration_page(found, out)
    if write_package:
        with resources.as_file(resources.files("betterbench.diagnosis").joinpath("data")) as folder:
            (folder / PACKAGED).write_text(text, encoding="utf-8")
            say(f"packaged calibration: {folder / PACKAGED}")
    if json:
        print_json(found.to_json())
        return
    print_calibration(found)
    OUT.print(f"page        {page}\nmatrix      {out / 'confusion.png'}", markup=False, soft_wrap=True)


def print_calibration(found: Calibration) -> None:
    """Print what is found of each label, the worst mistakes and the probes."""
    rows = [
        [
            label_name(s.label),
            KINDS[s.label.kind],
            rate_text(s.recall),
            rate_text(s.precision),
            _taken_for(found, s.label),
        ]
        for s in found.scores()
    ]
    print_table(["true label", "kind", "found", "right when given", "otherwise taken for"], rows, title="calibration")
    for j in found.wrong[:WRONG_SHOWN]:
        OUT.print(f"• {j.policy} {j.trial}: {j.truth.value} called {j.label.value}. {j.text}", markup=False)
    if len(found.wrong) > WRONG_SHOWN:
        OUT.print(f"  and {len(found.wrong) - WRONG_SHOWN} more on the page", markup=False)
    for c in suspicious(found.probes):
        guess = f"guessing would in {c.chance:.2f} of them"
        OUT.print(f"• {c.probe} solves {c.task}/{c.variation} in {c.k}/{c.n} trials; {guess}", markup=False)
    OUT.print(f"right       {rate_text(found.overall)}, of the failed ones {rate_text(found.failed)}", markup=False)
    OUT.print(f"reasoning called execution or the other way round: {rate_text(found.crossed_rate)}", markup=False)


def _taken_for(found: Calibration, label: object) -> str:
    others = {g: n for (t, g), n in found.counts.items() if t is label and g is not t}
    return ", ".join(f"{label_name(g)} {n}" for g, n in sorted(others.items(), key=lambda item: -item[1]))
