"""Pairwise comparison of how often policies succeed and fail, with p-values that are corrected for multiple testing."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

from betterbench.comparison.contrast import (
    Contrast,
    Counted,
    Group,
    OutcomeCounts,
    SequentialContrast,
    could_have_shown,
    judged,
    rate_of,
)
from betterbench.comparison.matching import Matching, match_sides
from betterbench.comparison.side import Side
from betterbench.comparison.verdict import sequential_sentences, verdict_sentences
from betterbench.diagnosis import Kind, TrialDiagnosis
from betterbench.diagnosis.measures.standing import Standing, standing_of
from betterbench.errors import InvalidInputError
from betterbench.statistics import PairedTable, Rate, compact_letters, discordant_e_process, holm
from betterbench.tasks import Axis, all_labels
from betterbench.tasks.worlds.facts import facts_of_task, outcomes_note


@dataclass(frozen=True, slots=True)
class Comparison:
    """Comparison of the outcomes of several runs.

    Attributes:
        sides: The compared runs.
        matching: Trials that were compared.
        alpha: Significance level.
        groups: Comparisons of success overall, on training conditions, per axis and per task, followed by comparisons
            of the kinds of failure and the labels over all variations.
        sequential: Comparisons of success that are valid even while runs are unfinished. Empty unless requested.
        verdict: Sentences that state the result, most important first.
        notes: Notes about the limits of the comparison.
        standings: Comparison of each policy with the pretenders (simulated policies that lack the tested abilities), on
            the compared trials.
    """

    sides: tuple[Side, ...]
    matching: Matching
    alpha: float
    groups: tuple[Group, ...]
    sequential: tuple[SequentialContrast, ...]
    verdict: tuple[str, ...]
    notes: tuple[str, ...]
    standings: tuple[Standing, ...] = ()

    def group(self, measure: str, scope: str = "overall") -> Group | None:
        """Return the comparison by one measure (such as "success") within one scope, or None if there is none."""
        return next((g for g in self.groups if (g.measure, g.scope) == (measure, scope)), None)

    @property
    def first_is_worse(self) -> bool:
        """Whether any other policy succeeds significantly more often than the first policy over all variations."""
        overall = self.group("success")
        mine = () if overall is None else (c for c in overall.contrasts if c.first == self.sides[0].name)
        return any(c.different and c.higher == c.second for c in mine)

    def to_json(self) -> dict[str, Any]:
        """Return the JSON-serializable dict that ``better compare --json`` prints."""
        rows = zip(self.sides, self.matching.trials, self.matching.left_out, strict=True)
        runs = [
            {
                "name": side.name,
                "policy": side.diagnosis.policy,
                "path": side.path,
                "compared": len(trials),
                "left_out": left_out,
                "unfinished": sum(t.key in side.unfinished for t in trials),
                "without_record": sum(t.record is None for t in trials),
            }
            for side, trials, left_out in rows
        ]
        return {
            "runs": runs,
            "alpha": self.alpha,
            "paired": self.matching.paired,
            "verdict": list(self.verdict),
            "notes": list(self.notes),
            "groups": [g.to_json() for g in self.groups],
            "sequential": [s.to_json() for s in self.sequential],
            "power": [s.to_json() for s in self.standings],
        }


def compare(
    sides: Sequence[Side], *, alpha: float = 0.05, sequential: bool = False, allow_mixed: bool = False
) -> Comparison:
    """Compare runs of several policies on the trials that all of them contain.

    All planned trials are included, even trials that could not be run. Two policies differ significantly if the
    Holm-corrected p-value is at most ``alpha`` and the confidence interval of the difference excludes zero. The exact
    test treats pairs as independent, whereas the interval accounts for pairs that share a scene.

    Args:
        sides: The runs to compare. There must be at least two, with different names.
        alpha: Significance level of each family of tests. The intervals have confidence 1 - alpha.
        sequential: Whether to add evidence that remains valid if unfinished runs are inspected repeatedly.
        allow_mixed: Whether to compare runs with different versions or engines.

    Raises:
        InvalidInputError: If a number is out of range, if the runs have no condition in common, or if ``sequential`` is
            set and the runs have no trial in common.
        RunConflictError: If versions or engines differ and ``allow_mixed`` is False.
    """
    if not 0.0 < alpha < 1.0:
        raise InvalidInputError(
            "--alpha", f"{alpha:g} is not a significance level", "Use a number between 0 and 1, such as 0.05"
        )
    if len(sides) < 2:
        raise InvalidInputError(
            "runs", f"a comparison needs at least two runs, got {len(sides)}", "Pass at least two runs"
        )
    matching = match_sides(sides, allow_mixed=allow_mixed)
    if sequential and not matching.paired:
        raise InvalidInputError(
            "--sequential",
            "the runs have no trial in common",
            "Run the policies with the same --seed, or leave out --sequential",
        )
    names = tuple(s.name for s in sides)
    groups = tuple(g for family in _families(matching) for g in _judged(family, names, matching, alpha))
    evidence = tuple(_sequential(sides, matching, alpha)) if sequential else ()
    verdict = (*sequential_sentences(evidence, alpha), *verdict_sentences(groups, paired=matching.paired, alpha=alpha))
    compared = [replace(s.diagnosis, trials=tuple(t)) for s, t in zip(sides, matching.trials, strict=True)]
    measured = any(facts_of_task(t.task).measured for d in compared for t in d.trials)
    standings = tuple(map(standing_of, compared)) if measured else ()
    notes = (*matching.notes, *map(outcomes_note, _unjudged_worlds(matching)))
    return Comparison(tuple(sides), matching, alpha, groups, evidence, verdict, notes, standings)


def _unjudged_worlds(matching: Matching) -> list[str]:
    """Return the titles of the compared worlds in which the causes of failures are not judged."""
    worlds = {task: facts_of_task(task) for task in {t.task for side in matching.trials for t in side}}
    return sorted({world.title for world in worlds.values() if not world.judges_causes})


class _Question(NamedTuple):
    """Question to test. The measure is the outcome that is counted, and the scope is the set of trials."""

    measure: str
    scope: str

    def counted(self, trials: Sequence[TrialDiagnosis]) -> Counted:
        """Return the trials in the scope of the question, each with a flag for the counted outcome."""
        return tuple((t, self._shows(t)) for t in trials if self._holds(t))

    def _holds(self, t: TrialDiagnosis) -> bool:
        if self.scope == "training":
            return t.variation is None
        return t.variation is not None and self.scope in ("overall", f"axis:{t.axis}", t.task)

    def _shows(self, t: TrialDiagnosis) -> bool:
        return t.success if self.measure == "success" else self.measure in (t.kind.value, t.label.value)


def _families(matching: Matching) -> Iterator[list[_Question]]:
    """Yield the families of questions to test.

    The p-values within a family are corrected together for multiple testing. If the causes of failures are not judged,
    only system failures are compared besides success.
    """
    varied = [t for side in matching.trials for t in side if t.variation is not None]
    yield [_Question("success", "overall")]
    yield [_Question("success", "training")]
    yield [_Question("success", f"axis:{axis.value}") for axis in Axis if any(t.axis == axis.value for t in varied)]
    yield [_Question("success", task) for task in sorted({t.task for t in varied})]
    causes = () if _unjudged_worlds(matching) else (Kind.REASONING, Kind.EXECUTION)
    kinds = (*causes, Kind.SYSTEM)
    yield [_Question(kind.value, "overall") for kind in kinds]
    # A label that occurs for no policy cannot differ. It can be left out of the correction, because this decision does
    # not depend on any difference between policies.
    shown = {t.label for t in varied if t.kind in kinds}
    yield [_Question(label.value, "overall") for label in all_labels() if label in shown]


def _judged(family: Sequence[_Question], names: tuple[str, ...], matching: Matching, alpha: float) -> Iterator[Group]:
    """Compare the policies on each question of a family, and correct the p-values together.

    A question is skipped if a policy has no trials for it.
    """
    counted = {q: [q.counted(side) for side in matching.trials] for q in family}
    asked = [q for q, sides in counted.items() if all(sides)]
    pairs = list(itertools.combinations(range(len(names)), 2))
    drafts: list[tuple[_Question, OutcomeCounts, Contrast]] = []
    for q in asked:
        for i, j in pairs:
            tally = OutcomeCounts(counted[q][i], counted[q][j])
            found = _contrast(q, tally, (names[i], names[j]), paired=matching.paired, alpha=alpha)
            drafts.append((q, tally, found))
    corrected = holm([c.p_value for _, _, c in drafts])
    contrasts: list[Contrast] = []
    for (question, tally, c), p in zip(drafts, corrected, strict=True):
        different = p <= alpha and c.difference.excludes_zero
        # The detectable difference is computed only for success, because it is the same for the failures of these
        # trials.
        smallest = (
            could_have_shown(tally, paired=matching.paired, alpha=alpha / len(drafts))
            if question.measure == "success" and not different
            else None
        )
        contrasts.append(replace(c, p_adjusted=p, family=len(drafts), different=different, smallest=smallest))
    for k, question in enumerate(asked):
        mine = contrasts[k * len(pairs) : (k + 1) * len(pairs)]
        rates = tuple(rate_of(side) for side in counted[question])
        yield Group(question.measure, question.scope, names, rates, _letters(rates, mine, pairs), tuple(mine))


def _contrast(
    question: _Question, tally: OutcomeCounts, names: tuple[str, str], *, paired: bool, alpha: float
) -> Contrast:
    """Compare two policies on one question. The p-value of the result is not corrected yet."""
    purpose = f"{question.measure}:{question.scope}"
    difference, test, p = judged(tally, paired=paired, purpose=purpose, confidence=1.0 - alpha)
    return Contrast(
        *question, *names, *tally.rates, table=tally.table if paired else None, difference=difference, test=test,
        p_value=p, p_adjusted=p, family=1, different=False,
    )  # fmt: skip


def _letters(rates: Sequence[Rate], contrasts: Sequence[Contrast], pairs: Sequence[tuple[int, int]]) -> tuple[str, ...]:
    """Return the compact letter display of the policies. The policy with the highest rate has the letter "a"."""
    order = sorted(range(len(rates)), key=lambda i: -(rates[i].value or 0.0))
    apart = {frozenset(pair) for pair, c in zip(pairs, contrasts, strict=True) if c.different}
    letters = compact_letters([[frozenset((i, j)) in apart for j in order] for i in order])
    return tuple(letters[order.index(i)] for i in range(len(rates)))


def _sequential(sides: Sequence[Side], matching: Matching, alpha: float) -> Iterator[SequentialContrast]:
    """Yield the sequential evidence for every pair of compared policies.

    Paired trials are used in the order of the run, up to the first pair that one of the runs has not finished. The
    selected pairs therefore do not depend on the outcomes, and a later inspection only adds pairs.
    """
    order = sorted(
        (k for k, t in enumerate(matching.trials[0]) if t.variation is not None),
        key=lambda k: (matching.trials[0][k].task, matching.trials[0][k].seed),
    )
    found = []
    chosen = list(itertools.combinations(range(len(sides)), 2))
    for i, j in chosen:
        outcomes = []
        for k in order:
            a, b = matching.trials[i][k], matching.trials[j][k]
            if a.key in sides[i].unfinished or b.key in sides[j].unfinished:
                break
            outcomes.append((a.success, b.success))
        process = discordant_e_process(outcomes, alpha=alpha / len(chosen))
        table = PairedTable.from_outcomes(outcomes)
        p = process.p_value
        found.append(SequentialContrast(sides[i].name, sides[j].name, len(order), table, process, p, False))
    for contrast, p in zip(found, holm([c.process.p_value for c in found]), strict=True):
        yield replace(contrast, p_adjusted=p, different=p <= alpha)
