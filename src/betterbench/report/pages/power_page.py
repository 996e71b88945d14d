"""Page about a power matrix: success rates of pretenders, and variations that can be solved without observations.

A pretender is a reference policy that lacks an ability on purpose.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from betterbench.diagnosis.measures.power_matrix import (
    BLIND,
    FLOOR,
    STOPPING_AT_NEWS,
    BlindCell,
    Key,
    PowerCell,
    PowerMatrix,
    power_cure,
)
from betterbench.diagnosis.thresholds import FAILS_AT, REPLAY_LIMIT
from betterbench.errors import UnknownNameError
from betterbench.quoting import markdown_code, markdown_table, markdown_text
from betterbench.report.html import environment, write
from betterbench.report.pages.not_shown import not_shown
from betterbench.statistics import percent
from betterbench.statistics.power import DEFAULT_ALPHA
from betterbench.tasks import Axis, get_task
from betterbench.wording import listed, plural

RAW, CORRECTED = "°", "*"
"""Marks of cells that are significantly above chance only before the correction over all cells, or also after it."""


@dataclass(frozen=True, slots=True)
class Table:
    """Table on the page: heading, caption, columns and rows."""

    title: str
    caption: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


def write_power_page(matrix: PowerMatrix, out: Path) -> Path:
    """Write the page and its tables as Markdown into a folder. Return the path of the page."""
    write(out / "power.md", power_markdown(matrix))
    page = (
        environment()
        .get_template("power.html.jinja")
        .render(sentences=power_sentences(matrix), tables=power_tables(matrix), versions=matrix.versions)
    )
    return write(out / "power.html", page)


def power_markdown(matrix: PowerMatrix) -> str:
    """Return the sentences and tables about a power matrix as Markdown."""
    lines = [f"- {_markdown(sentence)}" for sentence in power_sentences(matrix)]
    for table in power_tables(matrix):
        lines += ["", f"### {_markdown(table.title)}", "", _markdown(table.caption), ""]
        head = tuple(map(_markdown, table.columns))
        lines += markdown_table(head, (tuple(map(_markdown, row)) for row in table.rows))
    return "\n".join(lines) + "\n"


def _markdown(text: str) -> str:
    """Convert a text to Markdown. Names between backticks are formatted as code."""
    parts = re.split("(`[^`]*`)", text)
    return "".join(markdown_code(part[1:-1]) if n % 2 else _escaped(part) for n, part in enumerate(parts))


def _escaped(part: str) -> str:
    """Escape a part of a text for Markdown, and keep its leading and trailing space."""
    inner = part.strip()
    return part.replace(inner, markdown_text(inner), 1) if inner else part


def power_sentences(matrix: PowerMatrix) -> tuple[str, ...]:
    """Return sentences that state what the power matrix shows about the suite."""
    keys = matrix.variations
    control = [_name(key) for key in keys if matrix.control(key)]
    told = len(keys) - len(control)
    replayed = [key for key in keys if _solved(matrix.cell(BLIND[2], key))]
    all_of_them = plural(len(keys), "variation")
    failed = f"At least one rule fails {told} of {all_of_them}, without counting {STOPPING_AT_NEWS}, which "
    failed += "stops at every new combination"
    if control:
        failed += f". There {'is' if len(control) == 1 else 'are'} {plural(len(control), 'control cell')}, where the "
        failed += f"rules should succeed: {listed(control)}"
    blindly = (
        f"A demonstration replayed without looking solves more than {100 * REPLAY_LIMIT:.0f} % of the trials on "
        f"{len(replayed)} of {all_of_them}"
    )
    if replayed:
        blindly += f": {listed([_name(key) for key in replayed])}"
    said = [f"{failed}.", f"{blindly}.", *blind_sentences(matrix.blind_cells())]
    stale = matrix.stale_tasks()
    if stale:
        said.append(f"It was measured on another version of {listed(list(stale))}; {power_cure(stale)}.")
    return tuple(said)


def blind_sentences(cells: Sequence[BlindCell]) -> tuple[str, ...]:
    """Return sentences about variations that policies without vision, instruction or aim can solve.

    These variations are listed before and after a correction for multiple tests. Another sentence lists the variations
    with a redundant instruction.
    """
    said = []
    for mark, chosen in (
        (f"After Holm's correction over {plural(len(cells), 'cell')}", flagged(cells)),
        ("Before the correction", above_chance(cells)),
    ):
        named = list(dict.fromkeys(f"{c.task}/{c.variation}" for c in chosen))
        found = plural(len(named), "variation") if named else "no variation"
        each = listed([f"{c.task}/{c.variation} by {c.pretender} ({c.rate.k}/{c.rate.n})" for c in chosen])
        said.append(
            f"{mark}, policies without vision, instruction or aim solve {found} that "
            f"{'require' if len(named) > 1 else 'requires'} an action more often than by chance"
            + (f": {each}." if named else ".")
        )
    alone = redundant(cells)
    if alone:
        said.append(
            f"Only one instruction makes sense in the scene of {listed(alone)}, so the instruction is redundant there."
        )
    return tuple(said)


def flagged(cells: Iterable[BlindCell]) -> list[BlindCell]:
    """Return the cells with a success rate above chance after a correction for multiple tests.

    They are in order of increasing p-value.
    """
    return sorted((c for c in cells if c.flagged), key=lambda c: (c.p_value, c.task, c.variation, c.pretender))


def above_chance(cells: Iterable[BlindCell]) -> list[BlindCell]:
    """Return the cells with a success rate above chance without any correction, in order of increasing p-value."""
    found = (c for c in cells if c.above and c.p_value < DEFAULT_ALPHA)
    return sorted(found, key=lambda c: (c.p_value, c.task, c.variation, c.pretender))


def redundant(cells: Iterable[BlindCell]) -> list[str]:
    """Return the variations in whose scene only one instruction makes sense, so that the instruction is redundant."""
    return list(dict.fromkeys(f"{c.task}/{c.variation}" for c in cells if c.speechless))


def power_tables(matrix: PowerMatrix) -> tuple[Table, ...]:
    """Return the tables about a power matrix: first the overall results, then the results by variation."""
    return _overall(matrix), blind_table(matrix), _rules(matrix), _ceilings(matrix), _limits(matrix)


def blind_table(matrix: PowerMatrix) -> Table:
    """Return a table with the success rates of policies that lack vision, instruction or aim, on every variation.

    Success rates above chance are marked.
    """
    names = [name for name in (*BLIND, *FLOOR) if name in matrix.cells]
    tested = {(c.pretender, (c.task, c.variation)): c for c in matrix.blind_cells()}
    rows = []
    for key in matrix.variations:
        marks = []
        for name in names:
            cell, test = matrix.cell(name, key), tested.get((name, key))
            mark = ""
            if test is not None and test.above and test.p_value < DEFAULT_ALPHA:
                mark = CORRECTED if test.flagged else RAW
            marks.append(_count(cell) + mark)
        rows.append((_name(key), f"{100 * matrix.chances.get(key, 1.0):.0f} %", *marks))
    caption = (
        f"Each cell gives the number of successes out of all trials. {RAW} marks cells that are above chance at 5 % "
        f"only before the correction. {CORRECTED} marks cells that are also above chance after Holm's correction over "
        f"all cells. For `{BLIND[0]}`, chance is the probability of guessing the instruction among those that make "
        f"sense in the scene. For pretenders that move without looking, it is {100 * REPLAY_LIMIT:.0f} %."
    )
    return Table(
        "Variations that can be solved blind",
        caption,
        ("variation", "guessing", *(f"`{n}`" for n in names)),
        tuple(rows),
    )


def _overall(matrix: PowerMatrix) -> Table:
    rows = []
    for name, row in matrix.cells.items():
        cells = list(row.items())
        rates = [_mean(c.k / c.n for _, c in cells if c.n)]
        for axis in Axis:
            rates.append(_mean(c.k / c.n for key, c in cells if c.n and _axis(key) is axis))
        first = _mean(c.right / c.n for _, c in cells if c.n)
        trials, shared = sum(c.n for _, c in cells), sum(c.shared for _, c in cells)
        rows.append((f"`{name}`", *rates, first, str(trials), str(shared)))
    caption = (
        "The table gives the mean success over the variations in percent. Each variation has the same weight. If a "
        "rule agrees with all decisions of the expert in a trial, the episode would be identical. The trial then gets "
        "the expert's outcome and is counted as shared. Every other trial was simulated. The column 'first right' "
        "gives the share of trials with a correct first grasp attempt, or with no attempt if that is correct."
    )
    columns = ("pretender", "all", *(axis.letter for axis in Axis), "first right", "trials", "shared")
    return Table("The pretenders over the suite", caption, columns, tuple(rows))


def _rules(matrix: PowerMatrix) -> Table:
    rows = [(_name(key), *(_count(matrix.cell(name, key)) for name in matrix.rules)) for key in matrix.variations]
    caption = (
        "Each cell gives the number of successes out of all trials, for faulty rules at full strength with the "
        "expert's motion."
    )
    names = (f"`{name.rpartition(':')[2]}`" for name in matrix.rules)
    return Table("The faulty rules by variation", caption, ("variation", *names), tuple(rows))


def _ceilings(matrix: PowerMatrix) -> Table:
    rows = []
    for key in matrix.variations:
        ceiling, backed = matrix.ceiling(key), sorted(label.value for label in matrix.backed(key))
        best = "–" if ceiling is None else f"{_rate(ceiling.rate.k, ceiling.rate.n)}, `{ceiling.pretender}`"
        remark = "control cell" if matrix.control(key) else ", ".join(f"`{label}`" for label in backed)
        rows.append((_name(key), best, remark))
    caption = (
        "The shortcut ceiling is the best success rate among the rules that a variation claims to expose, the blind "
        "probes and the replays. A success rate proves an ability only above the ceiling. If only one instruction "
        "makes sense in a scene, the probe without language reaches 100 %, and the variation does not test language."
    )
    return Table("Shortcut ceilings", caption, ("variation", "ceiling", "labels of failing rules"), tuple(rows))


def _limits(matrix: PowerMatrix) -> Table:
    rows = [(_name(key), not_shown(matrix, key)) for key in matrix.variations if _axis(key) is not None]
    caption = (
        f"A policy without an ability passes a variation if it solves more than {100 * FAILS_AT:.0f} % of the "
        f"trials, or more than {100 * REPLAY_LIMIT:.0f} % if it moves without looking. The variation is then no "
        "evidence of the ability."
    )
    return Table("Abilities that a pass does not show", caption, ("variation", "limits"), tuple(rows))


def _solved(cell: PowerCell | None) -> bool:
    return cell is not None and cell.k > REPLAY_LIMIT * cell.n


def _name(key: Key) -> str:
    return "/".join(key)


def _axis(key: Key) -> Axis | None:
    try:
        return get_task(key[0]).variation(key[1]).axis
    except UnknownNameError:
        return None


def _mean(values: Iterable[float]) -> str:
    found = list(values)
    return f"{100 * sum(found) / len(found):.0f}" if found else "–"


def _count(cell: PowerCell | None) -> str:
    return "–" if cell is None else f"{cell.k}/{cell.n}"


def _rate(k: int, n: int) -> str:
    return f"{percent(k, n)} % ({k}/{n})"
