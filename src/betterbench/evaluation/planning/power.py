"""Statistical power of a plan: the smallest differences in success that its trials can detect."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Sequence

from betterbench.evaluation.planning.plan import Plan
from betterbench.statistics import StoppingRule, smallest_paired_difference

USUAL_OPPOSITE = 0.1
"""Assumed fraction of pairs that differ in the direction opposite to the drop.

:func:`what_trials_show` gives two numbers. For the first number, this fraction is assumed to be 0. In practice,
however, each of two policies usually succeeds in some trials in which the other fails. The second number therefore
assumes this fraction.
"""


def what_trials_show(plan: Plan) -> str:
    """Return sentences that state the smallest drop in success that the trials of a plan can detect.

    The sentences contain values for all trials together, within an axis, and within a variation.
    """
    varied = [t for t in plan.trials if t.variation is not None and not t.ambiguous]
    if plan.until_decided is not None:
        return _until_decided(plan.until_decided, [(t.task, t.variation) for t in varied])
    if not varied:
        return "No trial tests a variation: the trials only show how well the training conditions were learned."
    levels: tuple[tuple[str, Collection[int]], ...] = (
        ("overall", (len(varied),)),
        ("within an axis", Counter(t.axis for t in varied).values()),
        ("within a variation", Counter((t.task, t.variation) for t in varied).values()),
    )
    best, usual, hidden = [], [], []
    for name, counts in levels:
        fewest, most = min(counts), max(counts)
        pairs = (str(fewest) if fewest == most else f"{fewest} to {most}") + (" pair" if most == 1 else " pairs")
        found = _smallest(fewest, most, opposite=0.0)
        if not found:
            hidden.append(f"{name} ({pairs})")
            continue
        best.append(f"{found} points {name} ({pairs})")
        usual.append(_smallest(fewest, most, opposite=USUAL_OPPOSITE))
    sentences = []
    if best:
        shown = [points for points in usual if points]
        needed = f"the drop must be {_listed(shown)} points" if shown else "no drop can be shown"
        sentences.append(
            f"With 80 % power, they show a drop against the twins, or against another policy, of {_listed(best)}. "
            f"If {100 * USUAL_OPPOSITE:.0f} % of the pairs differ the other way, {needed}."
        )
    if hidden:
        sentences.append(f"They are too few to show any drop {_listed(hidden)}. Use more --trials.")
    return " ".join(sentences)


def smallest_drop_line(plan: Plan) -> str:
    """Return a sentence that states the smallest overall drop in success that the trials of a plan can detect."""
    pairs = sum(t.variation is not None and not t.ambiguous for t in plan.trials)
    if not pairs:
        return "No trial tests a variation: the trials only show how well the training conditions were learned."
    found = _smallest(pairs, pairs, opposite=0.0)
    told = f"They can show an overall drop of {found} points" if found else "They are too few to show any drop"
    return f"{told} (details: --explain-power)."


def _until_decided(rule: StoppingRule, varied: Sequence[tuple[str, str | None]]) -> str:
    most = max(Counter(varied).values(), default=0)
    return (
        f"Each of the {len(set(varied))} variations gets {rule.first} to {most} trials with their twins. A variation "
        f"gets no more trials once they show that its success drops against the twins, or that it does not drop by "
        f"{100 * rule.margin:.0f} points. Of each kind of verdict, at most {100 * rule.level:.0f} % are expected to be "
        "wrong."
    )


def _listed(parts: list[str]) -> str:
    return parts[0] if len(parts) == 1 else f"{', '.join(parts[:-1])} and {parts[-1]}"


def _smallest(fewest: int, most: int, *, opposite: float) -> str:
    """Return the smallest detectable differences for the largest and the smallest number of pairs, as text.

    The text gives percentage points. It is empty if no difference can be detected.
    """
    values = [smallest_paired_difference(n, opposite=opposite).value for n in (most, fewest)]
    return " to ".join(dict.fromkeys(f"{100 * v:.{1 if v < 0.1 else 0}f}" for v in values if v is not None))
