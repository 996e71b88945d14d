"""Sentences that state the result of a comparison, and the smallest difference that its trials could have detected."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from betterbench.comparison.contrast import Contrast, Group, SequentialContrast
from betterbench.statistics import percent
from betterbench.statistics.wording import counted, p_text, points
from betterbench.tasks.labels import Kind
from betterbench.tasks.worlds.facts import facts_of_task
from betterbench.wording import plural

__all__ = ["p_text", "points", "scope_text", "sequential_sentences", "verdict_sentences"]

MANY = 3
"""Maximum number of policies for which each pair gets a sentence. For more policies, letters mark the differences."""

SHOWN_PARTS = 6
"""Maximum number of groups that are named in one sentence."""


def verdict_sentences(groups: Sequence[Group], *, paired: bool, alpha: float) -> tuple[str, ...]:
    """Return sentences that state the result of a comparison, most important first."""
    main = next((g for g in groups if g.measure == "success" and g.scope in ("overall", "training")), None)
    if main is None:
        return ("Nothing can be concluded: there are no trials to compare.",)
    pairs = [_sentence(c, paired=paired, alpha=alpha) for c in main.contrasts]
    if len(main.names) > MANY:
        return (_ranking(main),)
    ranking = [_ranking(main)] if len(main.names) > 2 else []
    return (*ranking, *pairs, *_parts(groups, main))


def sequential_sentences(contrasts: Sequence[SequentialContrast], alpha: float) -> tuple[str, ...]:
    """Return one sentence about the sequential evidence for each pair of policies."""
    return tuple(_sequential(c, alpha, len(contrasts)) for c in contrasts)


def scope_text(scope: str) -> str:
    """Describe the trials that a comparison covers. Task names of other worlds are used as they are."""
    if not facts_of_task(scope).measured:
        return scope
    return {"overall": "all variations", "training": "training conditions"}.get(
        scope, scope.removeprefix("axis:").replace("_", " ")
    )


def _sentence(c: Contrast, *, paired: bool, alpha: float) -> str:
    where = "the training trials" if c.scope == "training" else "the trials of variations"
    n = min(c.first_rate.n, c.second_rate.n)
    trials = plural(n, "pair") if paired else f"{plural(n, 'trial')} a side"
    corrected = f", Holm over {c.family}" if c.family > 1 else ""
    value = c.difference.value or 0.0
    numbers = (
        f"{100 * (1 - alpha):g} % interval {points(c.difference.low)} to {points(c.difference.high)}, "
        f"{c.test} {p_text(c.p_adjusted)}{corrected}, {trials}"
    )
    if c.different:
        swap = c.higher == c.second
        better, worse = (c.second, c.first) if swap else (c.first, c.second)
        high, low = (c.second_rate, c.first_rate) if swap else (c.first_rate, c.second_rate)
        return (
            f"{better} is better than {worse}: it succeeds in {counted(high)} of {where}, {worse} in {counted(low)}. "
            f"The difference {c.first} minus {c.second} is {points(value)} points ({numbers})."
        )
    return (
        f"Nothing can be concluded about which of {c.first} and {c.second} is better on {where}: "
        f"{counted(c.first_rate)} against {counted(c.second_rate)}, a difference of {points(value)} points "
        f"({numbers}). {_limit(c, n, trials)}"
    )


def _limit(c: Contrast, n: int, trials: str) -> str:
    """Describe the smallest detectable difference in a comparison without a significant result."""
    fewer = 0 if c.table is None else min(c.table.only_first, c.table.only_second)
    if fewer:
        trials += f", of which {fewer}/{n} ({percent(fewer, n)} %) point in the other direction,"
    if c.smallest is None or c.smallest.value is None:
        return f"With {trials}, no difference can be detected at 80 % power. Run more trials."
    return f"With {trials}, a true difference must be {points(c.smallest.value)} points to be detected at 80 % power."


def _ranking(group: Group) -> str:
    """Return sentences that rank the policies.

    They include the letters that mark significant differences, and the smallest difference that could be detected.
    """
    order = sorted(zip(group.rates, group.names, group.letters, strict=True), key=lambda row: -(row[0].value or 0.0))
    listed = ", ".join(f"{name} {counted(rate)} {letters}" for rate, name, letters in order)
    where = "Training conditions" if group.scope == "training" else "Variations"
    undecided = [c for c in group.contrasts if not c.different]
    text = f"{where}: {listed}."
    if not undecided:
        return f"{text} All of them differ significantly."
    if len(undecided) == len(group.contrasts):
        text += " Nothing can be concluded about any two of them."
    else:
        text += " Policies that share a letter do not differ significantly."
    needed = [c.smallest.value for c in undecided if c.smallest is not None and c.smallest.value is not None]
    if len(needed) < len(undecided):
        return f"{text} For some pairs, no difference can be detected at 80 % power. Run more trials."
    return f"{text} To be detected at 80 % power, a true difference must be up to {points(max(needed))} points."


def _parts(groups: Sequence[Group], main: Group) -> Iterator[str]:
    """For each pair of policies, yield a sentence about the groups of trials in which the two differ significantly.

    The groups are sorted by significance.
    """
    for k, pair in enumerate(main.contrasts):
        apart = [g.contrasts[k] for g in groups if g is not main and g.contrasts[k].different]
        if apart:
            apart.sort(key=lambda c: c.p_adjusted)
            listed = "; ".join(_part(c) for c in apart[:SHOWN_PARTS])
            more = f"; and {len(apart) - SHOWN_PARTS} more, see below" if len(apart) > SHOWN_PARTS else ""
            but = "" if pair.different else ", although not in success overall"
            yield f"{pair.first} and {pair.second} differ in some groups{but}: {listed}{more}."


def _part(c: Contrast) -> str:
    higher = c.second if c.higher == c.second else c.first
    counts = f"{c.first_rate.k}/{c.first_rate.n} to {c.second_rate.k}/{c.second_rate.n}"
    if c.measure == "success":
        return f"{scope_text(c.scope)} ({higher} better, {counts})"
    what = f"{c.measure} failures" if c.measure in tuple(Kind) else c.measure
    return f"{what} ({higher} more, {counts})"


def _sequential(c: SequentialContrast, alpha: float, contrasts: int) -> str:
    n = c.process.n
    counts = f"{c.first} alone solves {c.table.only_first}/{n}, {c.second} alone {c.table.only_second}/{n}"
    reach = f"the evidence is {c.process.value:.3g}; {contrasts / alpha:g} is decisive"
    left = c.planned - n
    if c.different:
        better = c.first if c.table.only_first > c.table.only_second else c.second
        worse = c.second if better == c.first else c.first
        stop = f" The runs may stop: {left} of {c.planned} pairs are left." if left else ""
        at = "" if c.process.decided_at is None else f" after {plural(c.process.decided_at, 'pair')}"
        return (
            f"Decided{at}, valid for any number of inspections: {better} is better than {worse} ({counts}; "
            f"{reach}).{stop}"
        )
    rest = (
        f"{left} of {c.planned} pairs are left to run"
        if left
        else f"{'the only pair is' if n == 1 else f'all {n} pairs are'} used"
    )
    return f"Not decided between {c.first} and {c.second} after {plural(n, 'pair')} ({counts}; {reach}); {rest}."
