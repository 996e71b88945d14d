"""Page about a generated suite: certified tasks with their task cards, and rejected scenarios with their attempts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from betterbench.diagnosis.measures.power_matrix import PowerMatrix
from betterbench.generation.building.result import BuildReport, Settings
from betterbench.report.html import environment, write


def write_build_page(
    built: BuildReport,
    path: Path,
    *,
    settings: Settings,
    cards: Mapping[str, str],
    power: PowerMatrix | None = None,
) -> Path:
    """Write the page about a generated suite, and return its path.

    Args:
        built: Outcome of the generation.
        path: File to write.
        settings: Settings of the generation.
        cards: Address of each task's card, relative to the page.
        power: Power matrix, which contains the success rates of reference policies on the variations; None if it was
            not measured.
    """
    certified = [result for result in built.results if result.certified]
    page = (
        environment()
        .get_template("build.html.jinja")
        .render(
            name="(no task)" if built.suite is None else built.suite.name,
            total=len(built.results),
            certified=certified,
            refused=[result for result in built.results if not result.certified],
            variations=sum(len((result.task or {})["variations"]) for result in certified),
            seeds=settings.seeds,
            cards=cards,
            powerless={result.task_id: powerless_of(result.task_id, power) for result in certified},
        )
    )
    return write(path, page)


def powerless_of(task: str, power: PowerMatrix | None) -> Sequence[str]:
    """Return the control variations of a task, which do not reveal any fault.

    These are the variations that even policies without the tested ability solve, according to the power matrix.
    """
    if power is None:
        return ()
    return [name for owner, name in power.variations if owner == task and power.control((owner, name))]
