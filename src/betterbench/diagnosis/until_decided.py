"""Runs until decided: their verdicts, and the trials whose choice did not depend on outcomes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from betterbench.statistics import Answer, Decisions, Question, StoppingRule, Verdict, decide
from betterbench.statistics.wording import plural
from betterbench.tasks import TrialId
from betterbench.tasks.interventions.resolve import resolve_condition


@dataclass(frozen=True, slots=True)
class UntilDecided:
    """Stopping rule and decisions of a run that gives a variation no more trials once its verdict is certain.

    Attributes:
        rule: Rule by which a variation is decided.
        first_seeds: Seeds of the first round, which every variation gets whatever comes out.
        decisions: Decisions after the last complete round.
    """

    rule: StoppingRule
    first_seeds: tuple[int, ...]
    decisions: Decisions

    def answer(self, condition: str) -> Answer | None:
        """Return the state of a variation by its full name ("fast_food/T1"), or None if the run does not have it."""
        return next((a for a in self.decisions.answers if a.question.condition == condition), None)

    @property
    def waiting(self) -> frozenset[TrialId]:
        """The trials of the round under way that have no record; none if nothing is left to run."""
        return frozenset(_trial(name, seed) for name, seed in self.decisions.waiting)

    @property
    def summary(self) -> str:
        """The verdicts in one sentence."""
        found = self.decisions
        counts = {verdict: found.count(verdict) for verdict in Verdict}
        points = f"{100 * self.rule.margin:.0f} points"
        parts = [
            f"{counts[Verdict.DROP]} drop against their training twins",
            f"{counts[Verdict.NO_DROP]} do not drop by {points}",
        ]
        if counts[Verdict.NOT_LEARNED]:
            parts.append(f"{counts[Verdict.NOT_LEARNED]} could not, because their twins mostly fail")
        return (
            f"Decided: {found.decided} of {plural(len(found.answers), 'variation')}; {', '.join(parts)}; "
            f"{counts[Verdict.OPEN]} are open."
        )

    def notes(self) -> tuple[str, ...]:
        """Return notes on the meaning of the verdicts and of the numbers, one sentence or two each."""
        points, level = f"{100 * self.rule.margin:.0f} points", f"{100 * self.rule.level:.0f} %"
        seeds = plural(len(self.first_seeds), "seed")
        verdicts = (
            f"The run went on until its variations were decided. {self.summary} Of the verdicts that name a drop, and "
            f"of those that exclude one of {points}, at most {level} are expected to be wrong, whenever it stopped."
        )
        numbers = (
            "A variation got no more trials once its verdict stood, so its rates lean towards the verdict; their "
            "intervals are ones that hold whenever a run stops. Numbers over several variations are of the first "
            f"{seeds} alone, which every variation got whatever came out."
        )
        return verdicts, numbers

    def to_json(self) -> dict[str, Any]:
        """Return the JSON form."""
        return {
            "rule": asdict(self.rule),
            "first_seeds": list(self.first_seeds),
            "verdicts": [
                {**asdict(a), "question": a.question.condition, "twin": a.question.twin, "verdict": a.verdict.value}
                for a in self.decisions.answers
            ],
        }


def decided_of(rule: StoppingRule, plan: Sequence[TrialId], outcome: Callable[[TrialId], bool | None]) -> UntilDecided:
    """Return the rule and the decisions of a run until decided.

    Args:
        rule: Rule by which a variation is decided.
        plan: Trials that the run may run at most.
        outcome: Whether a trial succeeded, or None if it has no record.

    Raises:
        UnknownNameError: If the plan names an unknown task, variation or training condition.
    """
    bases = {}
    for task, condition in dict.fromkeys((t.task, t.condition) for t in plan):
        resolved = resolve_condition(task, condition)
        if resolved.variation is not None:
            bases[task, condition] = resolved.base
    questions = [Question(f"{task}/{name}", f"{task}/{base}") for (task, name), base in bases.items()]
    seeds = sorted({t.seed for t in plan if (t.task, t.condition) in bases})

    decisions = decide(questions, seeds, lambda name, seed: outcome(_trial(name, seed)), rule=rule)
    return UntilDecided(rule, tuple(seeds[: rule.first]), decisions)


def _trial(condition: str, seed: int) -> TrialId:
    task, _, name = condition.rpartition("/")
    return TrialId(task, name, seed)
