"""Page about a suite that is generated until its quotas are met.

It shows the quotas, the certified tasks with their cards, the rejected scenarios by reason, and near-duplicates.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from betterbench.certification.certificate import CLAUSES
from betterbench.diagnosis.measures.power_matrix import PowerMatrix
from betterbench.generation.building.result import Result
from betterbench.generation.growth.result import Growth
from betterbench.report.html import environment, write
from betterbench.report.pages.build_page import powerless_of


@dataclass(frozen=True, slots=True)
class Bar:
    """Bar that shows the frequency of one value of a property.

    Attributes:
        value: The value.
        amount: Number of occurrences as text.
        percent: Length of the bar, as a percentage of all tasks or variations.
        least: Position of the quota's minimum on the bar [%]; None if there is no quota.
        most: Position of the quota's maximum on the bar [%]; None if the quota has no maximum.
        is_open: Whether the quota is not met yet.
    """

    value: str
    amount: str
    percent: float
    least: float | None = None
    most: float | None = None
    is_open: bool = False


@dataclass(frozen=True, slots=True)
class RefusalGroup:
    """Rejected scenarios whose first attempt failed for the same reason.

    Attributes:
        title: The reason.
        results: The scenarios.
    """

    title: str
    results: tuple[Result, ...]


@dataclass(frozen=True, slots=True)
class Cure:
    """Change to a scenario that was tried after a failed attempt.

    Attributes:
        change: The change.
        tried: Number of scenarios for which the change was tried.
        helped: Number of scenarios that were certified with this change.
    """

    change: str
    tried: int
    helped: int


def write_growth_page(
    growth: Growth,
    path: Path,
    *,
    seeds: int,
    cards: Mapping[str, str],
    power: PowerMatrix | None = None,
    finished: bool = True,
) -> Path:
    """Write the page about a growing suite, and return its path.

    Args:
        growth: Outcome of the growth.
        path: File to write.
        seeds: Number of certified trials for each variation.
        cards: Address of each task's card, relative to the page.
        power: Power matrix, which contains the success rates of reference policies on the variations; None if it was
            not measured.
        finished: Whether the growth has ended.
    """
    page = (
        environment()
        .get_template("growth.html.jinja")
        .render(
            growth=growth,
            name="(unfinished)" if growth.suite is None else growth.suite.name,
            finished=finished,
            seeds=seeds,
            bars=bars_of(growth),
            groups=refusal_groups(growth.refused),
            cures=cures_of(growth),
            clauses=CLAUSES,
            left_out=[proposal for proposal in growth.proposals if not proposal.is_drawn],
            set_aside=[task for task in growth.tasks if task.set_aside],
            cards=cards,
            powerless={task.result.task_id: powerless_of(task.result.task_id, power) for task in growth.accepted},
        )
    )
    return write(path, page)


def bars_of(growth: Growth) -> dict[str, list[Bar]]:
    """Return the bars of each property, one for each value that occurs or has a quota."""
    tasks = growth.accepted
    counts: dict[str, Counter[str]] = {
        "template": Counter(task.result.template for task in tasks),
        "difficulty": Counter(task.difficulty for task in tasks),
        "axis": Counter(),
        "context": Counter(task.context for task in tasks),
    }
    for task in tasks:
        counts["axis"].update(task.variations)
    found: dict[str, list[Bar]] = {}
    for kind, counter in counts.items():
        whole = growth.variations if kind == "axis" else growth.until
        quotas = {quota.value: quota for quota in growth.quotas if quota.kind == kind}
        values = sorted({*counter, *quotas}, key=lambda value: (-counter[value], value))
        found[kind] = []
        for value in values:
            percent = 100.0 * counter[value] / whole if whole else 0.0
            quota = quotas.get(value)
            to_percent = 1.0 if kind == "axis" else 100.0 / growth.until
            amount = f"{counter[value]}" + (f" ({percent:.0f} %)" if kind == "axis" else "")
            if quota is None:
                found[kind].append(Bar(value.replace("_", " "), amount, percent))
                continue
            most = None if quota.most is None else quota.most * to_percent
            bar = Bar(value.replace("_", " "), amount, percent, quota.least * to_percent, most, quota.is_open)
            found[kind].append(bar)
    return found


def refusal_groups(refused: Sequence[Result]) -> list[RefusalGroup]:
    """Group the rejected scenarios by the reason why their first attempt failed. The largest group comes first."""
    groups: dict[str, list[Result]] = {}
    for result in refused:
        groups.setdefault(_finding(result), []).append(result)
    ordered = sorted(groups.items(), key=lambda item: (-len(item[1]), item[0]))
    return [RefusalGroup(title, tuple(results)) for title, results in ordered]


def _finding(result: Result) -> str:
    """Return the requirement of the certificate that the first attempt violated, or the stage at which it failed."""
    first = result.attempts[0]
    if first.failures:
        clause = first.failures[0].clause
        return f"clause ({clause}) failed: {CLAUSES[clause]}"
    if "variations over" in first.reason:
        return "too few variations could be derived"
    return "no asset or no layout was found"


def cures_of(growth: Growth) -> list[Cure]:
    """Return the changes that were tried after a failed attempt, in the order in which they were tried."""
    tried: Counter[str] = Counter()
    helped: Counter[str] = Counter()
    for result in (*(task.result for task in growth.tasks), *growth.refused):
        changes = [attempt.change for attempt in result.attempts[1:]]
        if result.certified and result.left_out:
            changes.append("leaving out the failing variations")
        tried.update(changes)
        helped.update(changes[-1:] if result.certified else [])
    return [Cure(change, number, helped[change]) for change, number in tried.items()]
