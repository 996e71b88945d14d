"""Shortcut audit and predicted failures, formatted as Markdown."""

from __future__ import annotations

from collections.abc import Iterator

from betterbench.demonstrations.shortcuts.asked import tested_text, untested_text
from betterbench.demonstrations.shortcuts.examine import ALPHA, STRONG, Finding, GroupAudit, ShortcutAudit
from betterbench.demonstrations.shortcuts.prediction import Prediction
from betterbench.demonstrations.shortcuts.reading import DataReading
from betterbench.demonstrations.shortcuts.smallest import POWER, share_text
from betterbench.quoting import markdown_table, markdown_text
from betterbench.wording import plural

ABOUT = (
    "A **shortcut** is a rule that a learner could use and that some variation breaks. A regularity is a rule that "
    "all variations keep, such as the meaning of a word. Strength is mutual information above chance, "
    "relative to the largest possible value. A rule counts if its test, corrected for all questions, gives "
    f"p ≤ {ALPHA:g} and one of the following holds: its strength is at least {STRONG:g}, one value always occurs with "
    "the same other value, or two words determine half of the uncertainty that each alone leaves. For whole "
    "instructions, strength is the share of wrong guesses that they avoid. They are compared among demonstrations that "
    "agree in the words already found. "
    "Words that name their own place are not shortcuts."
)


SMALLEST = (
    "The smallest rule is given as the share of the demonstrations that it decides, with random outcomes in the "
    "others. The same test would find a rule of this size in at least "
    f"{100.0 * POWER:.0f} % of all data sets with these counts. "
    "A weaker rule may exist without being found."
)


def audit_lines(audit: ShortcutAudit) -> list[str]:
    """Format a shortcut audit as Markdown lines, with one section per group of demonstrations."""
    lines = [] if audit.reading is None else [*_reading_lines(audit.reading), ""]
    lines += [ABOUT, ""]
    for group in audit.groups:
        lines += [f"### {markdown_text(group.group)}", "", *_group_lines(group), ""]
    return lines


def _reading_lines(reading: DataReading) -> list[str]:
    """Return the description of the data as Markdown lines. Names from external data sets are escaped."""
    return [markdown_text(reading.paragraph)]


def _group_lines(group: GroupAudit) -> Iterator[str]:
    found = [f for f in group.findings if f.verdict != "none"]
    tested = sum(not question.untested for question in group.asked)
    shown = (
        plural(len(group.shortcuts), "shortcut"),
        plural(group.episodes, "demonstration"),
        plural(tested, "question"),
    )
    yield "{} in {}; {} tested.".format(*shown)
    yield from ("", f"Tested: {markdown_text(tested_text(group.asked))}.")
    if untested := untested_text(group.asked):
        yield from ("", f"Not tested: {markdown_text(untested)}.")
    for note in group.notes:
        yield ""
        yield f"{markdown_text(note[:1].upper() + note[1:])}."
    if found:
        yield from _finding_lines(found)
    if group.smallest:
        yield from ("", SMALLEST, "")
        head = ("association", "compared", "smallest rule that would be found")
        rows = ((r.title, f"{r.n} {r.noun}", share_text(r.least_share)) for r in group.smallest)
        yield from markdown_table(head, (tuple(map(markdown_text, row)) for row in rows))


def _finding_lines(found: list[Finding]) -> Iterator[str]:
    yield ""
    head = ("association", "verdict", "bits", "strength", "p", "rule for a learner", "broken by")
    ordered = sorted(found, key=lambda f: (f.verdict != "shortcut", -f.strength, f.question, f.subject))
    yield from markdown_table(head, (tuple(map(markdown_text, _cells(f))) for f in ordered))


def _cells(f: Finding) -> tuple[str, ...]:
    p = "never differs" if f.p_adjusted is None else f"{f.p_adjusted:.4f}"
    broken = f.meaning or ", ".join(name for name, _ in f.separating) or "none"
    return f.title, f.verdict, f"{f.bits:.2f}", f"{f.strength:.2f}", p, "; ".join(f.rules), broken


def doubt(audit: ShortcutAudit, prediction: Prediction) -> str:
    """Return a warning that variations for which no shortcut was found may fail too. Return "" if it does not apply.

    The warning applies if there are too few demonstrations to find every strong rule.
    """
    safe = sum(forecast.risk == 0.0 for forecast in prediction.variations)
    unseen = {group.group: len(group.not_shown) for group in audit.groups if group.not_shown}
    if not safe or not unseen:
        return ""
    tested = sum(len(group.smallest) for group in audit.groups)
    return (
        f"{plural(safe, 'variation')} without a found rule may still be at risk: for {sum(unseen.values())} of "
        f"{plural(tested, 'question')} there are too few demonstrations to show every strong rule"
    )


def prediction_lines(prediction: Prediction, *, most: int | None = None) -> list[str]:
    """Format the predicted failures as a Markdown table, starting with the most likely.

    Args:
        prediction: Prediction for all variations.
        most: Maximum number of variations in the table; None for all.
    """
    rows = []
    for f in prediction.variations[:most]:
        because = "; ".join(f.because) or "it breaks none of the found rules"
        cells = (str(f.rank), f"{f.task}/{f.variation}", f"{f.risk:.2f}", f.label or "–", because)
        rows.append(tuple(map(markdown_text, cells)))
    return markdown_table(("rank", "variation", "risk", "label", "because"), rows)
