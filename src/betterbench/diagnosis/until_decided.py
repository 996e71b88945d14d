"""Verdicts of runs with ``--until-decided``, and the trials of these runs that do not depend on earlier outcomes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from betterbench.statistics import Answer, Decisions, Question, StoppingRule, Verdict, decide
from betterbench.tasks import Expected, TrialId
from betterbench.tasks.interventions.resolve import resolve_condition
from betterbench.wording import plural


@dataclass(frozen=True, slots=True)
class UntilDecided:
    """Stopping rule of a run with ``--until-decided``, and the decisions that have been made so far.

    Attributes:
        rule: Rule that determines when a variation is decided.
        first_seeds: Seeds of the first round, which is run for every variation regardless of the outcomes.
        decisions: Decisions after the last complete round.
    """

    rule: StoppingRule
    first_seeds: tuple[int, ...]
    decisions: Decisions

    def answer(self, condition: str) -> Answer | None:
        """Return the answer for a variation ("fast_food/T1"), which may be undecided.

        Return None if the variation is not in the run.
        """
        return next((a for a in self.decisions.answers if a.question.condition == condition), None)

    @property
    def waiting(self) -> frozenset[TrialId]:
        """Trials of the current round that have no record yet. The set is empty if the run is complete."""
        return frozenset(_trial(name, seed) for name, seed in self.decisions.waiting)

    @property
    def summary(self) -> str:
        """Sentence that states the number of variations with each verdict."""
        found = self.decisions
        counts = {verdict: found.count(verdict) for verdict in Verdict}
        points = f"{100 * self.rule.margin:.0f} points"
        parts = [
            f"{counts[Verdict.DROP]} drop against their training twins",
            f"{counts[Verdict.NO_DROP]} drop by less than {points}",
        ]
        if counts[Verdict.NOT_LEARNED]:
            parts.append(f"{counts[Verdict.NOT_LEARNED]} cannot drop, because their twins mostly fail")
        return (
            f"{found.decided} of {plural(len(found.answers), 'variation')} are decided ({', '.join(parts)}), and "
            f"{counts[Verdict.OPEN]} are open."
        )

    def notes(self) -> tuple[str, ...]:
        """Return notes that explain the verdicts and the rates of the run."""
        points, level = f"{100 * self.rule.margin:.0f} points", f"{100 * self.rule.level:.0f} %"
        seeds = plural(len(self.first_seeds), "seed")
        verdicts = (
            f"The run continued until its variations were decided. {self.summary} At most {level} of the verdicts that "
            f"find a drop, and of those that exclude a drop of {points}, are expected to be wrong, regardless of when "
            "the run stopped."
        )
        numbers = (
            "A variation stops after its verdict, so its rates are biased toward the verdict. Their intervals are "
            f"valid regardless of when a run stops. Numbers over several variations use only the first {seeds}, "
            "which every variation got regardless of the outcomes."
        )
        return verdicts, numbers

    def to_json(self) -> dict[str, Any]:
        """Return a JSON-serializable dict."""
        return {
            "rule": asdict(self.rule),
            "first_seeds": list(self.first_seeds),
            "verdicts": [
                {**asdict(a), "question": a.question.condition, "twin": a.question.twin, "verdict": a.verdict.value}
                for a in self.decisions.answers
            ],
        }


def decided_of(rule: StoppingRule, plan: Sequence[TrialId], outcome: Callable[[TrialId], bool | None]) -> UntilDecided:
    """Return the stopping rule and the decisions of a run with ``--until-decided``.

    Args:
        rule: Rule that determines when a variation is decided.
        plan: All trials that the run may need.
        outcome: Function that returns whether a trial succeeded, or None if the trial has no record.

    Raises:
        UnknownNameError: If the plan names an unknown task, variation or training condition.
    """
    bases: dict[tuple[str, str], str] = {}
    unasked: list[tuple[str, str]] = []
    for task, condition in dict.fromkeys((t.task, t.condition) for t in plan):
        resolved = resolve_condition(task, condition)
        if resolved.variation is None:
            continue
        if resolved.condition.expected is Expected.AMBIGUOUS:
            unasked.append((task, condition))
        else:
            bases[task, condition] = resolved.base
    questions = [Question(f"{task}/{name}", f"{task}/{base}") for (task, name), base in bases.items()]
    seeds = sorted({t.seed for t in plan if (t.task, t.condition) in {*bases, *unasked}})
    names = [f"{task}/{name}" for task, name in unasked]
    decisions = decide(questions, seeds, lambda name, seed: outcome(_trial(name, seed)), rule=rule, unasked=names)
    return UntilDecided(rule, tuple(seeds[: rule.first]), decisions)


def _trial(condition: str, seed: int) -> TrialId:
    task, _, name = condition.rpartition("/")
    return TrialId(task, name, seed)
