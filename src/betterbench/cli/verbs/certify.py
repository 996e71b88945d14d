"""``better certify``: check that each trial is solvable, so that a failure can be attributed to the policy."""

from __future__ import annotations

import os
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING

from betterbench.cli.console import OUT, print_json, progress_bar, say
from betterbench.cli.robot_option import USUAL_OPTION, ChosenRobot
from betterbench.errors import InvalidInputError

if TYPE_CHECKING:
    from betterbench.certification.certificate import Certificate, TrialCertificate
    from betterbench.certification.coverage import Coverage
    from betterbench.certification.demonstrations import Demonstration
    from betterbench.jobs import JobProgress


def certify_command(
    *,
    out: Path = Path("runs/certificate"),
    suite: str = "better60",
    tasks: tuple[str, ...] = (),
    trials: int = 20,
    seed: int = 0,
    workers: int | None = None,
    demonstrations: int | None = None,
    looks: str = "seen",
    arm: ChosenRobot = USUAL_OPTION,
    write_package: bool = False,
    overwrite: bool = False,
    json: bool = False,
) -> None:
    """Certify that trials can be solved with trained motions, begin at rest, and match the premise of the instruction.

    With the same tasks, trials and seed, `better eval` plans the same trials. Ctrl-C keeps finished trials, and
    running the command again resumes the job. The exit status is 0 even if a trial fails a clause of the certificate.
    Failed trials are listed, and `better eval` rejects them.

    With --demonstrations, the command measures that number of expert demonstrations per task instead of certifying. The
    measured release positions are needed for the certificate and for the poses of pre-placed objects. Do this once for
    each new task file.

    Example: better certify --tasks fast_food --trials 3 --out runs/certificate

    Args:
        out: Folder of the certificate.
        suite: Suite that contains the tasks.
        tasks: Tasks to certify; default: all tasks in the suite.
        trials: Trials per variation; the training conditions get at least as many.
        seed: First seed.
        workers: Number of worker processes; default: one per CPU core.
        demonstrations: Measure this number of demonstrations per task, for example 120, instead of certifying.
        looks: Appearance of objects and rooms: seen (in demonstrations) or unseen.
        arm: Option that selects the robot.
        write_package: Also write the compact certificate, or the demonstrations, that are shipped with the suite; for
            maintainers. With --tasks, the other tasks are copied from the packaged files if their versions agree.
        overwrite: Write even to a folder that `better certify` did not make, and replace files of the same names there.
        json: Print the certificate as one JSON document at the end.
    """
    from betterbench.certification.coverage import packaged_coverage
    from betterbench.certification.journal import holds_journal
    from betterbench.certification.runner import certify, versions_in_use
    from betterbench.cli.output.certificate import print_certificate
    from betterbench.cli.verbs.evaluate import prepare_robot
    from betterbench.evaluation import make_plan
    from betterbench.jobs.outputs import OutputFolder
    from betterbench.report.pages.certificate_page import write_certificate_page
    from betterbench.tasks import TrialId, suite_tasks
    from betterbench.tasks.authoring.registry import SUITES

    of_suite = suite_tasks(suite)  # needed with --tasks too, so that a mistyped suite is reported
    if write_package and arm != USUAL_OPTION:
        problem = "the packaged files are for the robot for which the tasks were designed"
        raise InvalidInputError("--write-package", problem, "Leave out --robot")
    robot = arm.of(tasks or of_suite)
    of_package = arm.of(of_suite)
    if write_package and demonstrations is None and robot != of_package:
        problem = f"the certificate of {suite} is for robot {of_package!r}, but these tasks are for {robot!r}"
        raise InvalidInputError("--write-package", problem, "Pass the suite of these tasks with --suite")
    if write_package and suite not in SUITES:
        raise InvalidInputError(
            "--write-package", f"{suite} is not a packaged suite", f"Choose one of {', '.join(SUITES)}"
        )
    if write_package and demonstrations is None and looks != "seen":
        raise InvalidInputError("--write-package", "the packaged certificate is for --looks seen", "Leave out --looks")
    kept = None
    if write_package and demonstrations is None and tasks:
        rest = [name for name in of_suite if name not in tasks]
        kept = packaged_coverage(suite).only(versions_in_use(rest, robot=robot)) if rest else None
    prepare_robot(robot)
    folder = OutputFolder(out, "certify", overwrite=overwrite, is_ours=lambda: holds_journal(out))
    if demonstrations is not None:
        with folder:
            _measure(
                tasks or of_suite,
                out,
                demonstrations,
                workers or os.cpu_count() or 1,
                robot=robot,
                write_package=write_package,
            )
        return
    plan = make_plan("expert", tasks=tasks or of_suite, trials=trials, seed=seed, looks=looks, robot=robot)
    planned = [TrialId(t.task, t.condition, t.seed) for t in plan.trials]
    with folder, progress_bar("certify", len(planned)) as (bar, task):

        def told(progress: JobProgress[TrialCertificate]) -> None:
            last = progress.last
            name = "" if last is None else f"{last.task}/{last.condition} seed {last.seed}"
            bar.update(task, completed=progress.done, note=name)
            if last is not None and not last.passed:
                say(f"{name}: " + "; ".join(f"({letter}) {last.clauses[letter].text}" for letter in last.failed))

        count = workers or os.cpu_count() or 1
        certificate = certify(planned, out, workers=count, looks=plan.looks, robot=plan.robot, on_progress=told)
        page = write_certificate_page(certificate, out / "certificate.html")
        if write_package:
            _write_package(certificate, kept, suite, of_suite)
    if json:
        print_json(certificate.sealed_json())
        return
    print_certificate(certificate)
    OUT.print(f"certificate {out / 'certificate.json'}\npage        {page}", markup=False, soft_wrap=True)


def _measure(tasks: tuple[str, ...], out: Path, number: int, workers: int, *, robot: str, write_package: bool) -> None:
    """Measure expert demonstrations of each task, and write the measurements to files."""
    from betterbench.certification.measuring import destination, measure, write_demonstrations
    from betterbench.tasks import get_task

    packaged = [name for name in tasks if destination(get_task(name).id) is None]
    if packaged and not write_package:
        problem = f"demonstrations of {packaged[0]} are already shipped with the suite"
        raise InvalidInputError("--demonstrations", problem, "Use --tasks from a --task-file, or add --write-package")
    with progress_bar("measure", number * len(tasks)) as (bar, task):

        def told(progress: JobProgress[Demonstration]) -> None:
            last = progress.last
            name = "" if last is None else f"{last.task}/{last.condition} seed {last.seed}"
            bar.update(task, total=progress.planned, completed=progress.done, note=name)
            if last is not None and last.problem:
                say(f"{name}: {last.problem}; the demonstration is left out")

        found = measure(tasks, out, number=number, workers=workers, robot=robot, on_progress=told)
    for name, shown in found.items():
        OUT.print(
            f"{name}: {shown.solved} demonstrations, {len(shown.releases)} placements", markup=False, soft_wrap=True
        )
    for path in write_demonstrations(found):
        OUT.print(f"demonstrations {path}", markup=False, soft_wrap=True)


def _write_package(certificate: Certificate, kept: Coverage | None, suite: str, tasks: tuple[str, ...]) -> None:
    """Write the compact form of a certificate into the package. The packaged entries of the other tasks are kept."""
    from betterbench.certification.coverage import Coverage, packaged_name
    from betterbench.certification.runner import write_coverage

    found = Coverage.of(certificate)
    with resources.as_file(resources.files("betterbench.certification").joinpath("data")) as folder:
        path = write_coverage(found if kept is None else found.joined(kept, tasks), folder / packaged_name(suite))
        say(f"packaged certificate: {path}")
