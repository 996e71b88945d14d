"""Page about a calibration: confusion matrix, wrong labels, and results of policies that lack vision or instruction."""

from __future__ import annotations

import io
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from betterbench.diagnosis import Calibration, Kind, Label
from betterbench.diagnosis.measures.confusion import FAMILIES
from betterbench.diagnosis.measures.power_matrix import PowerMatrix
from betterbench.quoting import markdown_code
from betterbench.report.html import data_uri, environment, write
from betterbench.report.pages.power_page import blind_sentences, blind_table
from betterbench.statistics import Rate, percent
from betterbench.wording import plural

if TYPE_CHECKING:
    from matplotlib.figure import Figure

KINDS = {kind: "right" if kind is Kind.NONE else kind.value for kind in Kind}


def write_calibration_page(
    calibration: Calibration,
    out: Path,
    *,
    family: str = "faulty",
    power: PowerMatrix | None = None,
    cure: str = "measure it again with better calibrate --power",
    strips: Mapping[tuple[str, str], bytes] | None = None,
) -> Path:
    """Write the page, the confusion matrix as SVG and PNG, and the tables as Markdown into a folder.

    With a power matrix, the page also shows which variations can be solved without vision or instruction.

    Args:
        calibration: The calibration.
        out: Folder to write to.
        family: Family of policies that were used for the calibration.
        power: Power matrix; None if it was not measured.
        cure: Command that measures the power matrix, which is shown if there is none.
        strips: Film strips (JPEG) of trials with a wrong label, by policy and trial.

    Returns:
        Path of the page.
    """
    figure = confusion_figure(calibration)
    svg = _drawn(figure, "svg")
    write(out / "confusion.svg", svg)
    write(out / "confusion.png", _drawn(figure, "png"))
    write(out / "calibration.md", calibration_markdown(calibration, family))
    pages = environment()
    pages.filters.update(rate=rate_text, name=label_name)
    page = pages.get_template("calibration.html.jinja").render(
        calibration=calibration,
        what=FAMILIES[family],
        summary=calibration_summary(calibration),
        policies=rates_by_policy(calibration, family),
        strips={key: data_uri(image, "image/jpeg") for key, image in (strips or {}).items()},
        matrix=data_uri(svg, "image/svg+xml"),
        scores=calibration.scores(),
        blind=blind_sentences(power.blind_cells()) if power is not None else (),
        table=blind_table(power) if power is not None else None,
        cure=cure,
        kinds=KINDS,
    )
    return write(out / "calibration.html", page)


def confusion_figure(calibration: Calibration) -> Figure:
    """Return the confusion matrix with one row for each true label.

    Cells show counts. The darker a cell, the larger its fraction of the row.
    """
    import matplotlib as mpl  # noqa: PLC0415 - takes 0.4 s, which a diagnosis in the terminal does not need
    from matplotlib.figure import Figure  # noqa: PLC0415

    labels = calibration.labels
    n = len(labels)
    totals = {t: sum(c for (truth, _), c in calibration.counts.items() if truth is t) for t in labels}
    shares = [[calibration.counts.get((t, g), 0) / max(1, totals[t]) for g in labels] for t in labels]
    with mpl.rc_context({"svg.fonttype": "none", "svg.hashsalt": "betterbench", "font.size": 9}):
        figure = Figure(figsize=(2.9 + 0.52 * n, 2.3 + 0.42 * n), layout="constrained")
        axes = figure.subplots()
        axes.imshow(shares, cmap="Blues", vmin=0.0, vmax=1.0, aspect="auto")
        for row, truth in enumerate(labels):
            for column, given in enumerate(labels):
                count = calibration.counts.get((truth, given), 0)
                if count:
                    wrong = row != column
                    dark = shares[row][column] > 0.55
                    color = ("#ffc9c3" if dark else "#b3261e") if wrong else "white" if dark else "#1b1b1b"
                    axes.text(
                        column,
                        row,
                        str(count),
                        ha="center",
                        va="center",
                        color=color,
                        weight="bold" if wrong else "normal",
                    )
        axes.set_xticks(range(n), [label_name(g) for g in labels], rotation=40, ha="right", rotation_mode="anchor")
        axes.set_yticks(range(n), [f"{label_name(t)}  (n = {totals[t]})" for t in labels])
        axes.set_xlabel("label given by the diagnosis")
        axes.set_ylabel("true label")
        for before, after, at in zip(labels, labels[1:], range(n), strict=False):
            if before.kind is not after.kind:  # draw a line between two kinds of failure
                axes.axhline(at + 0.5, color="#777777", linewidth=0.8)
                axes.axvline(at + 0.5, color="#777777", linewidth=0.8)
        axes.set_title(f"{calibration.overall.k} of {calibration.overall.n} trials get their true label", loc="left")
        axes.tick_params(length=0)
        for side in axes.spines.values():
            side.set_visible(False)
    return figure


def calibration_markdown(calibration: Calibration, family: str = "faulty") -> str:
    """Return the tables of a calibration as Markdown.

    The rows are faulty policies or, for the independent family, habits.
    """
    lines = [
        calibration_summary(calibration),
        "",
        "| true label | kind | recall (true labels found) | precision (given labels that are true) |",
        "|---|---|---|---|",
    ]
    lines += [
        f"| `{s.label.value}` | {KINDS[s.label.kind]} | {rate_text(s.recall)} | {rate_text(s.precision)} |"
        for s in calibration.scores()
    ]
    lines += ["", "| policy | correct labels |", "|---|---|"]
    lines += [
        f"| {markdown_code(name)} | {rate_text(rate)} |" for name, rate in rates_by_policy(calibration, family).items()
    ]
    return "\n".join(lines) + "\n"


def rates_by_policy(calibration: Calibration, family: str) -> dict[str, Rate]:
    """Count the correctly labeled trials for each faulty policy or, in the independent family, for each habit."""
    rates: dict[str, Rate] = {}
    for policy, rate in calibration.policies.items():
        name = policy if family == "faulty" else policy.rpartition("-")[0]
        before = rates.get(name, Rate(0, 0))
        rates[name] = Rate(before.k + rate.k, before.n + rate.n)
    return rates


def calibration_summary(calibration: Calibration) -> str:
    """Return a summary of a calibration in a few sentences."""
    kinds, overall = rate_text(calibration.failed_kinds), rate_text(calibration.overall)
    labels = (
        f"Of the failed trials, {rate_text(calibration.failed)} got their true label, and {kinds} got a label of the "
        f"right kind. Of all trials, {overall} got their true label."
    )
    crossed = (
        f"Reasoning and execution failures were confused in {rate_text(calibration.crossed_rate)} of the trials that "
        f"failed for either reason."
    )
    sentences = [labels, crossed]
    if calibration.without_grasp.n:
        found = rate_text(calibration.without_grasp)
        sentences.append(f"Of the failed trials without a grasp attempt, {found} got their true label.")
    if calibration.accused.n:
        found = f"{calibration.accused.k} of {plural(calibration.accused.n, 'trial')}"
        sentences.append(f"Trials of policies without a fault were labeled as reasoning failures in {found}.")
    if calibration.left_out:
        sentences.append(f"{plural(calibration.left_out, 'trial')} do not show the habit and are therefore left out.")
    return " ".join(sentences)


def rate_text(rate: Rate) -> str:
    """Format a rate with its count, e.g. "98.3 % (118/120)"."""
    return "–" if rate.n == 0 else f"{percent(rate.k, rate.n)} % ({rate.k}/{rate.n})"


def label_name(label: Label) -> str:
    """Return a label as words, i.e. with spaces instead of underscores."""
    return label.value.replace("_", " ")


def _drawn(figure: Figure, kind: str) -> bytes:
    import matplotlib as mpl  # noqa: PLC0415 - see confusion_figure

    buffer = io.BytesIO()
    with mpl.rc_context({"svg.fonttype": "none", "svg.hashsalt": "betterbench"}):
        figure.savefig(buffer, format=kind, dpi=150, metadata={"Date": None} if kind == "svg" else {"Software": None})
    return buffer.getvalue()
