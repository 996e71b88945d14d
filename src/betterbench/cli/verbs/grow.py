"""``better generate --until``: add certified tasks to a suite, subject to quotas, until it has the requested size."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from betterbench.cli.console import OUT, print_json, print_table, progress_bar, say
from betterbench.cli.yaml_file import read_yaml
from betterbench.errors import one_line
from betterbench.jobs.lock import LOCK_NAME

if TYPE_CHECKING:
    from betterbench.cli.build_options import BuildOptions
    from betterbench.generation.growth.job import GrowProgress, GrowSettings
    from betterbench.generation.growth.quotas import Quota
    from betterbench.generation.growth.result import Growth

PAGE = "growth.html"


def read_quotas(texts: Sequence[str], file: Path | None) -> tuple[Quota, ...]:
    """Return the quotas given by ``--quota`` and by the file ``--quotas``.

    Raises:
        InvalidInputError: If the file cannot be read, or a quota is malformed.
        UnknownNameError: If a property or value does not exist.
    """
    from betterbench.generation.growth.quotas import parse_quota, quotas_from_form

    read = () if file is None else quotas_from_form(_form(file), where=str(file))
    return (*read, *map(parse_quota, texts))


def _form(file: Path) -> Mapping[str, object]:
    """Read a quota file and return its fields. Amounts that are numbers are converted to strings."""
    found = read_yaml(file, cure="Write lines like `template: {loose_packing: 20%}`")
    return {
        kind: {str(value): str(amount) if type(amount) is int else amount for value, amount in part.items()}
        if isinstance(part, dict)
        else part
        for kind, part in found.items()
    }


def grow_and_tell(settings: GrowSettings, out: Path, build: BuildOptions, *, overwrite: bool, json: bool) -> None:
    """Grow a suite, draw picture cards of its tasks, write a page, and print the outcome.

    If requested, also measure which faults each variation can expose.
    """
    from betterbench.cli.verbs.build import CARDS, draw_cards, power_of_suite
    from betterbench.cli.verbs.evaluate import prepare_robot
    from betterbench.generation.building.result import BuildReport
    from betterbench.generation.growth.job import grow_suite, prepare_growth
    from betterbench.jobs.outputs import OutputFolder
    from betterbench.report.pages.growth_page import write_growth_page

    prepared = prepare_growth(settings)
    prepare_robot()

    def write_so_far(growth: Growth) -> None:
        drawn = {p.stem.rpartition("-")[0]: f"{CARDS}/{p.name}" for p in sorted((out / CARDS).glob("*.jpg"))}
        write_growth_page(growth, out / PAGE, seeds=settings.build.seeds, cards=drawn, finished=False)

    with OutputFolder(out, "generate", overwrite=overwrite, holds=lambda path: path.name == LOCK_NAME):
        with progress_bar("certified", settings.until) as (bar, shown):

            def told(progress: GrowProgress) -> None:
                bar.update(shown, completed=progress.accepted, note=_note(progress))
                last = progress.last
                if last is not None and not last.certified:
                    say(f"{last.task_id}: rejected: {one_line(last.attempts[0].reason, most=300)}")

            grown = grow_suite(
                prepared,
                out,
                workers=build.processes,
                overwrite=overwrite,
                on_progress=told,
                on_round=write_so_far,
            )
        cards, matrix = {}, None
        if grown.suite is not None:
            built = BuildReport(tuple(task.result for task in grown.accepted), grown.suite)
            cards = draw_cards(built, out, verb="generate")
            matrix = power_of_suite(built, out, build.power, build.processes) if build.power else None
        page = write_growth_page(grown, out / PAGE, seeds=settings.build.seeds, cards=cards, power=matrix)
    _tell(grown, out, page, json=json)


def _note(progress: GrowProgress) -> str:
    parts = [f"{progress.refused} refused"] if progress.refused else []
    parts += [f"{progress.left_out} left out"] if progress.left_out else []
    parts += [f"scenario {progress.proposed}" if progress.last is None else progress.last.task_id]
    return ", ".join(parts)


def _tell(grown: Growth, out: Path, page: Path, *, json: bool) -> None:
    if json:
        suite = None if grown.suite is None else str(grown.suite)
        print_json(grown.to_json() | {"suite": suite, "out": str(out), "page": str(page)})
        return
    if grown.quotas:
        rows = [
            (
                q.quota,
                f"{q.have:.3g}",
                q.unit,
                "open" if q.is_open else "fulfilled",
            )
            for q in grown.quotas
        ]
        print_table(("quota", "has", "of", "state"), rows, title="quotas:")
    counted: dict[str, list[int]] = {}
    for task in grown.accepted:
        numbers = counted.setdefault(task.result.template, [0, 0])
        numbers[0] += 1
        numbers[1] += sum(task.variations.values())
    if counted:
        table = [(template, str(tasks), str(variations)) for template, (tasks, variations) in sorted(counted.items())]
        print_table(("template", "tasks", "variations"), table, title="certified:")
    if grown.refused:
        refused = [(r.task_id, one_line(r.attempts[0].reason, most=300)) for r in grown.refused]
        print_table(("scenario", "reason"), refused, title="refused:")
    say(grown.reason)
    OUT.print(f"certified  {len(grown.accepted)} of {grown.until} tasks, {grown.variations} variations", markup=False)
    OUT.print(f"left out   {grown.near_duplicates} near-duplicates", markup=False)
    if grown.suite is not None:
        OUT.print(f"suite      {grown.suite}", markup=False, soft_wrap=True)
    OUT.print(f"page       {page}", markup=False, soft_wrap=True)
