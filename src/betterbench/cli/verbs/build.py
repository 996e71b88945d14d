"""``better build``: build certified tasks from scenarios."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from betterbench.cli.build_options import USUAL_BUILD, BuildOptions, ChosenBuild
from betterbench.cli.console import OUT, print_json, print_table, progress_bar, say
from betterbench.errors import InvalidInputError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from betterbench.diagnosis.measures.power_matrix import PowerMatrix
    from betterbench.generation.building.importing import ImportedMeshes
    from betterbench.generation.building.result import BuildReport, Result
    from betterbench.generation.scenario import Scenario
    from betterbench.jobs import JobProgress

PAGE, CARDS, POWER_RUNS = "suite.html", "cards", "power"


def build_command(
    scenarios: Annotated[tuple[Path, ...], tyro.conf.Positional],
    *,
    out: Path,
    build: ChosenBuild = USUAL_BUILD,
    overwrite: bool = False,
    json: bool = False,
) -> None:
    """Build tasks from scenarios, certify them, and write them as a suite.

    Assets are chosen by a search of the catalogue. A task that fails certification is changed and tried again: without
    the failing variations, with other slots, or with other assets. The command also writes a page, which lists the
    scenarios that cannot be certified and the clause that failed. Running the command again resumes an interrupted
    build and produces the same files.

    Example: better build picnic/scenarios --out picnic/suite

    Args:
        scenarios: Scenario files written by `better generate`, or folders with such files.
        out: Output folder of the build. The suite is written to a folder inside it.
        build: Options for building and certifying tasks.
        overwrite: Replace files in the output folder that `better build` did not write.
        json: Print one JSON document instead of a table.
    """
    build_and_tell(read_scenarios(scenarios), out, build, overwrite=overwrite, json=json)


def read_scenarios(paths: Sequence[Path]) -> list[Scenario]:
    """Read scenarios from files and folders, ordered by path and then by the number in the file name.

    Raises:
        InvalidInputError: If a path does not exist, a folder contains no scenario, a file is not a scenario, the object
            groups of a scenario differ from those of its template, or two objects have the same name.
    """
    from betterbench.generation.scenario_form import scenario_from_json
    from betterbench.generation.sense import require_groups
    from betterbench.json_form import read_bounded

    cure = "Pass a folder written by `better generate`"
    found = []
    for path in paths:
        folder = path / "scenarios" if (path / "scenarios").is_dir() else path
        files = sorted(folder.glob("*.json"), key=_by_number) if folder.is_dir() else [path]
        if not files:
            raise InvalidInputError(str(path), "the folder contains no scenario", cure)
        for file in files:
            scenario = scenario_from_json(read_bounded(file, max_bytes=1 << 20, cure=cure), where=str(file))
            require_groups(scenario, where=str(file))
            found.append(scenario)
    return found


def _by_number(file: Path) -> tuple[int, str]:
    """Return a sort key that puts "1000_name.json" after "999_name.json", and files without a number last."""
    number = file.name.partition("_")[0]
    return (int(number) if number.isascii() and number.isdigit() and len(number) < 10 else 10**10), file.name


def build_and_tell(
    scenarios: Sequence[Scenario], out: Path, build: BuildOptions, *, overwrite: bool, json: bool
) -> None:
    """Build and certify tasks from scenarios, draw their picture cards, write a page, and print the outcome.

    If requested, also measure which faults each variation can expose.
    """
    from betterbench.cli.verbs.evaluate import prepare_robot
    from betterbench.generation.building.job import build_suite
    from betterbench.jobs.outputs import OutputFolder
    from betterbench.report.pages.build_page import write_build_page
    from betterbench.tasks import require_suite_name

    settings = build.settings
    require_suite_name(build.name, where="--name")
    prepare_robot()
    with OutputFolder(out, "build", overwrite=overwrite):
        with progress_bar("build", len(scenarios)) as (bar, task):

            def told(progress: JobProgress[Result]) -> None:
                last = progress.last
                bar.update(task, completed=progress.done, note="" if last is None else last.task_id)
                if last is not None and not last.certified:
                    say(f"{last.task_id}: rejected: {last.attempts[0].reason}")

            built = build_suite(
                scenarios,
                out,
                name=build.name,
                settings=settings,
                workers=build.processes,
                meshes=build.catalogue,
                on_import=lambda imported: _tell_imported(imported, out),
                on_progress=told,
            )
        cards, matrix = {}, None
        if built.suite is not None:
            cards = draw_cards(built, out)
            # Write a page before the measurement of the power, which takes long, so that the suite can be inspected.
            if build.power:
                say(f"page without power: {write_build_page(built, out / PAGE, settings=settings, cards=cards)}")
                matrix = power_of_suite(built, out, build.power, build.processes)
        page = write_build_page(built, out / PAGE, settings=settings, cards=cards, power=matrix)
    _tell(built, page, json=json)


def _tell_imported(imported: ImportedMeshes, out: Path) -> None:
    """Print the names of the imported meshes, and the reason for each matching mesh that could not be imported."""
    from betterbench.generation.building.importing import IMPORTED

    for row, problem in imported.refused:
        say(f"not imported: {row}: {problem}")
    if imported.names:
        say(f"imported: {', '.join(imported.names)}; load them with --asset-dir {out / IMPORTED}")


def draw_cards(built: BuildReport, out: Path, *, verb: str = "build") -> dict[str, str]:
    """Draw the missing picture cards of certified tasks.

    Return the path of each task's card, relative to ``out``.
    """
    from betterbench.evaluation.figures.show import image_file, show_card
    from betterbench.jobs import write_durably
    from betterbench.jobs.outputs import mark_of
    from betterbench.tasks.user_files import load_task_files

    load_task_files([] if built.suite is None else [built.suite])
    (out / CARDS).mkdir(exist_ok=True)
    certified = [result for result in built.results if result.certified]
    cards = {}
    with progress_bar("cards", len(certified)) as (bar, task):
        for number, result in enumerate(certified, start=1):
            path = out / CARDS / f"{result.task_id}-{result.key[:12]}.jpg"
            if not path.exists():
                write_durably(path, image_file(show_card(result.task_id), ".jpg", remark=mark_of(verb)))
            cards[result.task_id] = f"{CARDS}/{path.name}"
            bar.update(task, completed=number)
    return cards


def power_of_suite(built: BuildReport, out: Path, trials: int, workers: int) -> PowerMatrix:
    """Run policies with faulty decision rules on every variation of a suite.

    The results form the power matrix, which is written into the suite's folder.
    """
    from betterbench.calibration import measure_power, power_trials
    from betterbench.jobs import write_durably
    from betterbench.tasks.suite_folder import POWER

    tasks = [result.task_id for result in built.results if result.certified]
    planned = power_trials(tasks, rule_trials=trials, probes=False)
    with progress_bar("power", planned.total) as (bar, task):
        found = measure_power(
            planned,
            out / POWER_RUNS,
            workers=workers,
            on_progress=lambda progress: bar.update(task, completed=progress.done, note=progress.policy),
        )
    if built.suite is not None:
        write_durably(built.suite / POWER, found.to_text().encode())
    return found


def _tell(built: BuildReport, page: Path, *, json: bool) -> None:
    certified = [result for result in built.results if result.certified]
    if json:
        print_json(
            {
                "suite": None if built.suite is None else str(built.suite),
                "page": str(page),
                "certified": [r.task_id for r in certified],
                "refused": {r.task_id: r.attempts[0].reason for r in built.results if not r.certified},
            }
        )
        return
    rows = [
        (r.task_id, r.template, ", ".join(v["name"] for v in (r.task or {})["variations"]), r.attempts[-1].change)
        for r in certified
    ]
    if rows:
        print_table(("task", "template", "variations", "built"), rows, title="certified:")
    refused = [(r.task_id, r.attempts[0].reason) for r in built.results if not r.certified]
    if refused:
        print_table(("scenario", "reason"), refused, title="refused:")
    OUT.print(f"certified  {len(certified)} of {len(built.results)} scenarios", markup=False)
    if built.suite is not None:
        OUT.print(f"suite      {built.suite}", markup=False, soft_wrap=True)
    OUT.print(f"page       {page}", markup=False, soft_wrap=True)
