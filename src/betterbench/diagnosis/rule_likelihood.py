"""Likelihood of a policy's first attempts under each decision rule that might explain them.

A policy that follows a rule with strength ``q`` goes, with probability ``q``, to a slot that the rule predicts.
Otherwise, it goes to a correct slot, apart from occasional slips. The null hypothesis, "confusion", is a policy with a
constant error rate and no preferred slot. Each hypothesis has one parameter. The cost of a hypothesis is its negative
log-likelihood at the best value of this parameter [nats]. See docs/second-pass.md for the formulas and an example.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from betterbench.diagnosis.ruling import HABIT, LATER, PLACE, WORD
from betterbench.diagnosis.thresholds import HIGHEST_ERROR_RATE, HIGHEST_STRENGTH, LOWEST_ERROR_RATE
from betterbench.diagnosis.trial import Choice
from betterbench.tasks import THRESHOLDS

LATER_NEXT, LATER_LAST = f"{LATER}:next", f"{LATER}:last"
"""Names of the rules "begin with the step after the current one" and "begin with the last step"."""

ROUNDING = 1e-9
"""Maximum difference between two costs that count as equal [nats]."""

_GRID_POINTS = 100
_STRENGTHS = np.linspace(0.0, HIGHEST_STRENGTH, _GRID_POINTS)
"""Strengths of a rule that are tried, shape (100,)."""


@dataclass(frozen=True, slots=True)
class PolicyRule:
    """Decision rule, fitted to all first attempts of a policy in a task.

    Attributes:
        name: "word", "habit", "later", "place:SLOT", or "place" if the preferred slot depends on the occupied slots.
        cost: Negative log-likelihood at the best strength, plus the prior costs of the rule and of its kind [nats].
        strength: Best strength, from 0 to 1.
        explained: Number of wrong first attempts that the rule explains.
        opportunities: Number of trials where the rule predicts a wrong first attempt.
        errors_elsewhere: Number of wrong first attempts in trials where the rule predicts a correct one.
        elsewhere: Number of trials where the rule predicts a correct first attempt.
    """

    name: str
    cost: float
    strength: float
    explained: int
    opportunities: int
    errors_elsewhere: int
    elsewhere: int

    @property
    def slot(self) -> str | None:
        """Slot that a "place" rule prefers, or None for other rules."""
        return self.name.removeprefix("place:") if self.name.startswith("place:") else None

    @property
    def family(self) -> str:
        """Kind of rule: "word", "habit", "later" or "place"."""
        return family_of(self.name)


def place_rule(slot: str) -> str:
    """Return the name of the rule "always go to this slot" for a given slot."""
    return f"{PLACE}:{slot}"


def family_of(rule: str) -> str:
    """Return the kind of a rule, given the rule's name."""
    return rule.partition(":")[0]


def predicted_slots(rule: str, choice: Choice) -> frozenset[str]:
    """Return the slots that a rule predicts in a trial.

    The set is empty if the rule predicts nothing for this trial.
    """
    steps = choice.step_slots or (choice.later_slots,)
    predictions = {
        WORD: choice.word_slots,
        HABIT: choice.habit_slots,
        LATER: choice.later_slots,
        LATER_NEXT: steps[0],
        LATER_LAST: steps[-1],
        PLACE: choice.favorite_slots,
    }
    return predictions.get(rule, frozenset((rule.removeprefix(f"{PLACE}:"),)))


def fits(rule: str, choice: Choice) -> bool:
    """Return whether a first attempt went to a slot that the rule predicts."""
    return choice.slot is not None and choice.slot in predicted_slots(rule, choice)


def fit_rule(rule: str, choices: Sequence[Choice], price: float) -> PolicyRule:
    """Fit the strength of a rule by maximum likelihood.

    Args:
        rule: Name of the rule.
        choices: First attempts of all trials.
        price: Prior cost of the rule [nats].
    """
    log_likelihoods = np.zeros_like(_STRENGTHS)
    for choice in choices:
        log_likelihoods += _log_likelihoods(rule, choice)
    best = int(np.argmax(log_likelihoods))
    explained = sum(fits(rule, c) and not c.correct for c in choices)
    predicting = [c for c in choices if predicted_slots(rule, c)]
    elsewhere = [c for c in predicting if predicted_slots(rule, c) & c.right]
    return PolicyRule(
        name=rule,
        cost=price - float(log_likelihoods[best]),
        strength=float(_STRENGTHS[best]),
        explained=explained,
        # If a rule predicts several slots and one of them is correct, a wrong attempt may still follow the rule.
        opportunities=max(len(predicting) - len(elsewhere), explained),
        errors_elsewhere=sum(not c.correct and not fits(rule, c) for c in elsewhere),
        elsewhere=len(elsewhere),
    )


def _log_likelihoods(rule: str, choice: Choice) -> npt.NDArray[np.float64]:
    """Return the log-likelihood of a first attempt for each of the 100 strengths in the grid, shape (100,)."""
    predicted = predicted_slots(rule, choice)
    unguided = undirected_probability(choice, THRESHOLDS.slip)
    if not predicted:
        return np.full_like(_STRENGTHS, math.log(unguided))
    # "A later step" does not say which step, so the probability is divided among the later steps. For other rules with
    # several slots, each of the slots fits the rule equally well.
    guided = 1.0 / len(predicted) if rule == LATER else 1.0
    found: npt.NDArray[np.float64] = np.log(_STRENGTHS * fits(rule, choice) * guided + (1.0 - _STRENGTHS) * unguided)
    return found


def undirected_probability(choice: Choice, error_rate: float) -> float:
    """Return the probability of a first attempt for a policy that errs at a given rate and prefers no wrong slot.

    Each wrong slot is equally likely.
    """
    return 1.0 - error_rate if choice.correct else error_rate / max(1, choice.places - len(choice.right))


def confusion_cost(choices: Sequence[Choice]) -> float:
    """Return the cost of confusion (undirected errors): the negative log-likelihood at the best error rate [nats].

    The error rate is at most the error rate of guessing.
    """
    if not choices:
        return 0.0
    guessing = float(np.mean([1.0 - min(1, len(c.right)) / c.places for c in choices]))
    highest = min(HIGHEST_ERROR_RATE, max(2.0 * LOWEST_ERROR_RATE, guessing))
    rates = np.linspace(LOWEST_ERROR_RATE, highest, _GRID_POINTS)
    return min(-sum(math.log(undirected_probability(c, float(rate))) for c in choices) for rate in rates)
