"""Report section that compares each policy with pretenders, i.e. reference policies that lack an ability on purpose."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from betterbench.diagnosis import RunDiagnosis
from betterbench.diagnosis.measures.power_matrix import EXPERT
from betterbench.diagnosis.measures.standing import Likeness, Margin, Standing, standing_of
from betterbench.report.legend import AXIS_NAMES
from betterbench.report.pages.calibration_page import rate_text
from betterbench.tasks import Axis

SCOPES = ("overall", *(f"axis:{axis.value}" for axis in Axis))
"""Columns of the score table: success over all variations, and on each axis."""


@dataclass(frozen=True, slots=True)
class ScoreRow:
    """Row of the score table.

    Attributes:
        name: Name of a policy under test or a reference policy.
        cells: Success rate in each column [%]; "–" if there is none.
        likeness: Text that states how often the outcomes of the reference policy agree with those of the policy under
            test; "" for the policy under test itself.
        mine: Whether this row is about the policy under test.
    """

    name: str
    cells: tuple[str, ...]
    likeness: str
    mine: bool


@dataclass(frozen=True, slots=True)
class ScoreTable:
    """Table of success rates: the policies under test, followed by the reference policies.

    Attributes:
        columns: Headings of the success rates.
        policies: Names of the policies under test. There is one column of agreement for each of them.
        rows: Success rates of each policy, and how often its outcomes agree with those of each policy under test.
    """

    columns: tuple[str, ...]
    policies: tuple[str, ...]
    rows: tuple[tuple[ScoreRow, tuple[str, ...]], ...]


@dataclass(frozen=True, slots=True)
class MarginRow:
    """Row of the margin table: success rate on a variation, shortcut ceiling and their difference, as strings.

    The shortcut ceiling is the success rate that a policy can reach without the tested ability.
    """

    variation: str
    rate: str
    ceiling: str
    margin: str
    remark: str


@dataclass(frozen=True, slots=True)
class PretenderView:
    """Comparison of one policy with the reference policies that lack an ability."""

    policy: str
    sentences: tuple[str, ...]
    notice: str
    columns: tuple[str, ...]
    rows: tuple[ScoreRow, ...]
    margins: tuple[MarginRow, ...]


def pretender_views(diagnoses: Sequence[RunDiagnosis]) -> list[PretenderView]:
    """Return the comparison of every policy with the reference policies that lack an ability.

    Without a power matrix, the comparison only contains the reason why it is missing.
    """
    return [_view(d.policy, standing_of(d)) for d in diagnoses]


def score_tables(views: Sequence[PretenderView]) -> list[ScoreTable]:
    """Return one score table for all policies that ran the same trials.

    The reference policies have the same scores for all of them.
    """
    tables: dict[tuple[object, ...], list[PretenderView]] = {}
    for view in views:
        lines = sorted((row.name, row.cells) for row in view.rows if not row.mine)
        if view.rows:
            tables.setdefault((view.columns, *lines), []).append(view)
    return [_score_table(together) for together in tables.values()]


def _score_table(views: Sequence[PretenderView]) -> ScoreTable:
    alike = [{row.name: row.likeness for row in view.rows if not row.mine} for view in views]
    mine = [(row, ("",) * len(views)) for view in views for row in view.rows if row.mine]
    lines = [(row, tuple(known[row.name] for known in alike)) for row in views[0].rows if not row.mine]
    return ScoreTable(views[0].columns, tuple(view.policy for view in views), (*mine, *lines))


def scope_columns(standings: Sequence[Standing]) -> tuple[str, ...]:
    """Return the columns of the score table for which at least one policy has trials, in the order of the suite."""
    return tuple(scope for scope in SCOPES if any(scope in s.scores for s in standings))


def scope_title(scope: str) -> str:
    """Return the heading of a column in the score table."""
    return "overall" if scope == "overall" else AXIS_NAMES.get(scope.removeprefix("axis:"), scope)


def score_rows(policy: str, standing: Standing, columns: Sequence[str]) -> list[ScoreRow]:
    """Return the row of the policy under test, followed by one row per reference policy, starting with the best."""
    known = {x.pretender: x for x in standing.likenesses}
    if standing.expert is not None:
        known[EXPERT] = standing.expert
    rows = [ScoreRow(policy, _cells(standing.scores, columns), "", mine=True)]
    for line in standing.lines:
        rows.append(ScoreRow(line.pretender, _cells(line.scores, columns), _words(known[line.pretender]), mine=False))
    return rows


def _view(policy: str, standing: Standing) -> PretenderView:
    columns = scope_columns([standing])
    rows = tuple(score_rows(policy, standing, columns)) if standing.lines else ()
    sentences = tuple(s for s in standing.sentences() if s != standing.notice)
    titles = tuple(scope_title(scope) for scope in columns)
    return PretenderView(policy, sentences, standing.notice, titles, rows, tuple(map(_margin, standing.margins)))


def _cells(scores: dict[str, float], columns: Sequence[str]) -> tuple[str, ...]:
    return tuple(f"{100 * scores[scope]:.0f}" if scope in scores else "–" for scope in columns)


def _words(x: Likeness) -> str:
    return f"{100 * x.agreement:.0f} ({100 * x.low:.0f} to {100 * x.high:.0f})"


def _margin(m: Margin) -> MarginRow:
    value = 100 * (m.margin.value or 0.0)
    remark = "control cell" if m.control else "" if m.margin.low > 0.0 else "not significant yet"
    return MarginRow(
        f"{m.task}/{m.variation}",
        rate_text(m.rate),
        f"{rate_text(m.ceiling.rate)}, {m.ceiling.pretender}",
        f"{value:+.0f} ({100 * m.margin.low:+.0f} to {100 * m.margin.high:+.0f})",
        remark,
    )
