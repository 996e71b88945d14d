"""``better calibrate``: test the diagnosis and the power of a suite on policies with known faults."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import resources
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING

from betterbench.cli.console import OUT, print_json, progress_bar, say
from betterbench.errors import InvalidInputError, UnknownNameError
from betterbench.installation import calibration_module
from betterbench.quoting import shell_word

STRENGTHS = (1.0, 0.6, 0.3)

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from betterbench.calibration import CalibrationProgress
    from betterbench.diagnosis.measures.confusion import Calibration
    from betterbench.diagnosis.measures.power_matrix import PowerMatrix


def calibrate_command(
    *,
    out: Path | None = None,
    tasks: tuple[str, ...] = (),
    policies: tuple[str, ...] = (),
    strengths: tuple[float, ...] = STRENGTHS,
    trials: int | None = None,
    seed: int = 0,
    workers: int | None = None,
    family: str = "faulty",
    films: int = 100,
    power: bool = False,
    write_package: bool = False,
    overwrite: bool = False,
    json: bool = False,
) -> None:
    """Run policies with known faults and compare each trial's label with the true label in a confusion matrix.

    Each policy follows one faulty decision rule in a fraction of its trials and records its first wrong decision as
    ground truth. The independent family has a different controller and other faulty behaviors, written by people who
    had not read the diagnosis code. With --power, faulty rules at full strength, blind probes and replayed
    demonstrations are run on every variation. The resulting power matrix shows the faults that each variation exposes.
    Ctrl-C keeps finished trials, and running the command again resumes the job.

    Example: better calibrate --tasks fast_food --trials 2 --out runs/calibration

    Args:
        out: Folder of the calibration; runs/calibration, runs/FAMILY or runs/power if not given.
        tasks: Tasks to run; default: the full suite.
        policies: Faulty policies to run; default: all.
        strengths: Fractions of trials in which a policy follows its faulty rule; a smaller fraction is combined with
            more action noise.
        trials: Trials per variation for each faulty policy at each strength, default 1; trials for each policy of the
            independent family, default 4.
        seed: First seed.
        workers: Number of worker processes; default: one per CPU core.
        family: Set of policies: the faulty policies, or a part of the independent family. The part "development" was
            used to develop the diagnosis. The other parts (held_out, second and so on) were each used only once.
        films: Maximum number of film strips of incorrect labels on the page; 0 renders none.
        power: Measure the power matrix instead. Its policies, strengths, trials and seeds are fixed, so the options
            for these cannot be used.
        write_package: Also write the file that is shipped with the package; for maintainers. With --power and --tasks,
            the other tasks are copied from the packaged file if they have not changed.
        overwrite: Write even to a folder that `better calibrate` did not make, and replace files of the same names
            there.
        json: Print the result as one JSON document at the end.
    """
    from betterbench.cli.verbs.evaluate import prepare_robots_of
    from betterbench.diagnosis.measures.confusion import FAMILIES
    from betterbench.jobs.outputs import OutputFolder, is_run

    if family not in FAMILIES:
        raise UnknownNameError("family", family, FAMILIES)
    _check_options(
        tasks, policies, strengths, trials=trials, seed=seed, family=family, power=power, write_package=write_package
    )
    if family != "faulty":
        _family(family)
    prepare_robots_of(tasks)
    count = workers or os.cpu_count() or 1
    if power:
        out = out or Path("runs/power")
        with OutputFolder(out, "calibrate", overwrite=overwrite, holds=is_run):
            _power(out, tasks, count, write_package=write_package, as_json=json)
        return
    from betterbench.calibration import calibrate, calibration_policies
    from betterbench.cli.output.calibration import print_calibration

    out = out or Path("runs") / ("calibration" if family == "faulty" else family)
    with OutputFolder(out, "calibrate", overwrite=overwrite, holds=is_run), _progress("calibrate") as told:
        if family == "faulty":
            planned = calibration_policies(policies=policies, strengths=strengths, seed=seed, trials=trials or 1)
            found = calibrate(planned, out, tasks=tasks, workers=count, on_progress=told)
        else:
            found = _family(family).calibrate_independent(
                family, out, trials=trials or 4, seed=seed, workers=count, on_progress=told
            )
        page = _store(found, out, family, tasks=tasks, films=films, write_package=write_package)
    if json:
        print_json(found.to_json())
        return
    print_calibration(found)
    OUT.print(f"page        {page}\nmatrix      {out / 'confusion.png'}", markup=False, soft_wrap=True)


def _family(part: str) -> ModuleType:
    """Return the module that calibrates on the independent family of policies.

    The module belongs to the separate package betterbench-calibration.
    """
    return calibration_module("family", f"--family {part} needs betterbench-calibration, which is not installed")


def _check_options(
    tasks: tuple[str, ...],
    policies: tuple[str, ...],
    strengths: tuple[float, ...],
    *,
    trials: int | None,
    seed: int,
    family: str,
    power: bool,
    write_package: bool,
) -> None:
    """Raise InvalidInputError if options cannot be combined."""
    from betterbench.tasks import suite_tasks

    if write_package and (policies or (tasks and not power and set(tasks) != set(suite_tasks("better60")))):
        problem = "it replaces the packaged file, which is about all tasks and policies of the suite"
        raise InvalidInputError("--write-package", problem, "Leave out --tasks and --policies")
    if power and (policies or strengths != STRENGTHS or trials is not None or seed != 0 or family != "faulty"):
        raise InvalidInputError(
            "--power",
            "the power matrix has fixed policies, strengths, trials and seeds",
            "Leave out these options, or leave out --power",
        )
    if family != "faulty" and (tasks or policies or strengths != STRENGTHS):
        raise InvalidInputError(
            "--family",
            "the independent family has fixed tasks and faulty behaviors at full strength",
            "Leave out --tasks, --policies and --strengths, or --family",
        )


def _power(out: Path, tasks: tuple[str, ...], workers: int, *, write_package: bool, as_json: bool) -> None:
    """Measure the power matrix, write it and its HTML page, and print a summary."""
    from betterbench.calibration import measure_power, power_trials
    from betterbench.cli.output.calibration import print_power
    from betterbench.tasks.user_files import suite_folder_of

    with _progress("power matrix") as told:
        found = measure_power(power_trials(tasks), out, workers=workers, on_progress=told)
    page = _store_power(found, out, write_package=write_package, tasks=tasks)
    if as_json:
        print_json(found.to_json())
        return
    print_power(found)
    OUT.print(f"page        {page}\nmatrix      {out / 'power.json'}", markup=False, soft_wrap=True)
    folder = suite_folder_of(tasks)
    if folder is not None:
        copied = f"cp {shell_word(str(out / 'power.json'))} {shell_word(str(folder))}"
        OUT.print(f"next        {copied}; reports about this suite will use it", markup=False, soft_wrap=True)


@contextmanager
def _progress(title: str) -> Iterator[Callable[[CalibrationProgress], None]]:
    """Show a progress bar, and yield the callback that advances it."""
    with progress_bar(title, 0) as (bar, task):
        yield lambda p: bar.update(task, completed=p.done, total=p.planned, note=p.policy)


def _store_power(found: PowerMatrix, out: Path, *, write_package: bool, tasks: Sequence[str]) -> Path:
    """Write a power matrix and its page, and return the path of the page.

    If requested, also write the packaged file. If only some tasks of the suite were measured, the packaged file keeps
    its values for the other tasks.
    """
    from betterbench.diagnosis.measures.power_matrix import packaged_matrix_name, packaged_power_matrix
    from betterbench.jobs import write_durably
    from betterbench.report.pages.power_page import write_power_page
    from betterbench.tasks import built_in_suite, suite_tasks

    write_durably(out / "power.json", found.to_text().encode())
    if write_package:
        suite = built_in_suite(tasks)
        earlier = packaged_power_matrix(suite) if tasks and set(tasks) != set(suite_tasks(suite)) else None
        whole = found if earlier is None else found.with_kept(earlier)
        with resources.as_file(resources.files("betterbench.diagnosis").joinpath("data")) as folder:
            write_durably(folder / packaged_matrix_name(suite), whole.to_text().encode())
            say(f"packaged power matrix: {folder / packaged_matrix_name(suite)}")
    return write_power_page(found, out)


def _store(
    found: Calibration, out: Path, family: str, *, tasks: Sequence[str], films: int, write_package: bool
) -> Path:
    """Write a calibration and its page, and return the path of the page.

    If requested, also write the packaged file.
    """
    from betterbench.cli.output.calibration import film_strips
    from betterbench.diagnosis.measures.confusion import packaged_file
    from betterbench.diagnosis.measures.power_matrix import measured_on, power_cure
    from betterbench.jobs import write_durably
    from betterbench.report.pages.calibration_page import write_calibration_page

    text = found.file_bytes()
    write_durably(out / "calibration.json", text)
    if write_package:
        with resources.as_file(resources.files("betterbench.diagnosis").joinpath("data")) as folder:
            write_durably(folder / packaged_file(family), text)
            say(f"packaged calibration: {folder / packaged_file(family)}")
    strips = film_strips(found.wrong[:films], out)
    return write_calibration_page(
        found, out, family=family, power=measured_on(tasks), cure=power_cure(tasks), strips=strips
    )
