"""Second pass: the search for a decision rule that explains a policy's wrong first attempts in all tasks.

Four kinds of rule predict the slot of a first attempt:

- *word* goes to the slot where a word of the instruction led in training.
- *habit* begins with the most frequent first step.
- *later* begins with the object of a later step.
- *place* always goes to the same slot, or to a fixed slot for each set of occupied slots. A policy that takes the
  nearest object follows such a rule.

All rules compete with undirected confusion. :mod:`betterbench.diagnosis.rule_likelihood` computes the likelihood of the
attempts under each rule, and :mod:`betterbench.diagnosis.task_rules` makes the ruling within a task. See
docs/second-pass.md for the complete model.

A single trial can show a wrong order, but several trials with different instructions are needed to show a favorite
place. Attempts at objects of later steps therefore count as a wrong order if "later" explains the first attempts in all
tasks at least as well as the other rules do (:func:`mistakes_order`).

Evidence is pooled over the tasks of a policy, so that findings in one task have some weight in the others. The prior
cost of each kind of rule depends on the fraction of tasks with wrong attempts that it explains
(:func:`pooled_prior_costs`). A kind that explains all these tasks clearly better than any other kind is the policy's
rule (:func:`rule_of_all_tasks`). If two rules both predict a wrong attempt, the other tasks decide between them. With
ten tasks, the prior costs are at most 3.0 nats. A single attempt that only one of two rules predicts has the same
weight, so the attempts in a task can outweigh the prior costs.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence

import numpy as np
import numpy.typing as npt

from betterbench.diagnosis.rule_likelihood import (
    LATER_LAST,
    LATER_NEXT,
    ROUNDING,
    PolicyRule,
    family_of,
    fit_rule,
    fits,
)
from betterbench.diagnosis.ruling import CONFUSION, LATER, PLACE, WORD
from betterbench.diagnosis.task_rules import FAMILIES, TaskRules, judge_rules
from betterbench.diagnosis.thresholds import CLEARLY, ONE_ATTEMPT, ORDER_TRIALS, OTHER_TASKS
from betterbench.diagnosis.trial import Choice

_ORDER_RULES = (LATER, LATER_NEXT, LATER_LAST)
"""Rules of a policy that confuses the order of steps: begin with any later step, the next step, or the last step."""

_PSEUDOCOUNT = 0.5
"""Prior number of tasks for each kind of rule (Jeffreys' prior of a multinomial)."""
_EM_STEPS = 200

_Attempts = Mapping[str, Mapping[str, Choice]]
"""First attempts by task and by trial key."""


def judge_policy(choices: _Attempts) -> dict[str, TaskRules]:
    """Judge which decision rules explain the first attempts of a policy, considering all tasks together."""
    alone = {task: judge_rules(mine) for task, mine in choices.items()}
    prior_costs = pooled_prior_costs([alone[task] for task in sorted(alone)])
    usual = rule_of_all_tasks(choices, alone)
    if usual is not None:
        prior_costs = _in_favor_of(usual, prior_costs)
    ordered = mistakes_order(choices, alone)
    return {
        task: judge_rules(
            mine, prior_costs, known=_proven_elsewhere(task, choices, alone, prior_costs), ordered=ordered
        )
        for task, mine in choices.items()
    }


def _in_favor_of(usual: str, prior_costs: Mapping[str, float]) -> dict[str, float]:
    """Return prior costs by which ambiguous attempts are assigned to the policy's rule over all tasks."""
    others = {name: max(cost, ONE_ATTEMPT) for name, cost in prior_costs.items() if name != CONFUSION}
    return {**prior_costs, **others, usual: 0.0}


def _proven_elsewhere(
    task: str, choices: _Attempts, alone: Mapping[str, TaskRules], prior_costs: Mapping[str, float]
) -> list[str]:
    """Return the kinds of rule that are proven for the policy by the tasks other than the given one.

    A favorite place or a wrong order must be proven in enough other tasks. The rule "go to the slot where the word led
    in training" must explain all other tasks together.
    """
    others = [found for name, found in alone.items() if name != task]
    here = {name: mine for name, mine in choices.items() if name != task}
    word = rule_of_all_tasks(here, {name: alone[name] for name in here}) == WORD
    return [WORD] * word + [
        family
        for family in (PLACE, LATER)
        if prior_costs[family] == 0.0
        and sum(any(family_of(rule) == family for rule in found.upheld) for found in others) >= OTHER_TASKS
    ]


def rule_of_all_tasks(choices: _Attempts, alone: Mapping[str, TaskRules]) -> str | None:
    """Return the kind of rule that explains a policy in all tasks clearly better than any other kind, or None.

    A kind of rule is rejected if another kind explains more wrong attempts. The lower cost may then only be due to a
    smaller number of rules of this kind.
    """
    tasks = [alone[task] for task in _with_errors(choices)]
    (least, best), (second, _), *_ = sorted((_total_cost(family, tasks), family) for family in FAMILIES)
    if len(tasks) < 2 or best == CONFUSION or second - least < CLEARLY:
        return None
    explained = {family: _explained(family, tasks) for family in FAMILIES}
    return best if explained[best] == max(explained.values()) else None


def mistakes_order(choices: _Attempts, alone: Mapping[str, TaskRules]) -> bool:
    """Return whether the rule "begin with a later step" explains a policy at least as well as any other rule.

    All tasks with wrong attempts are judged together. The rule has the variants "any later step", "the next step" and
    "the last step". They compete with the rule "word", with a favorite place in each task, and with confusion.
    """
    wrong_tasks = _with_errors(choices)
    too_early = sum(not c.correct and fits(LATER, c) for attempts in wrong_tasks.values() for c in attempts)
    if too_early < ORDER_TRIALS:
        return False
    costs = (sum(fit_rule(rule, attempts, 0.0).cost for attempts in wrong_tasks.values()) for rule in _ORDER_RULES)
    order = min(costs) + math.log(len(_ORDER_RULES))  # prior cost of choosing one of the variants
    tasks = [alone[task] for task in wrong_tasks]
    return order <= min(_total_cost(family, tasks) for family in (WORD, PLACE, CONFUSION)) + ROUNDING


def _with_errors(choices: _Attempts) -> dict[str, list[Choice]]:
    """Return the first attempts in the tasks with at least one wrong first attempt."""
    return {
        task: list(attempts.values())
        for task, attempts in choices.items()
        if any(not c.correct for c in attempts.values())
    }


def _explained(family: str, tasks: Iterable[TaskRules]) -> int:
    """Return the number of wrong first attempts explained by the best rule of the given kind in each task."""
    return sum(max((rule.explained for rule in _rules_of(family, task)), default=0) for task in tasks)


def _total_cost(family: str, tasks: Iterable[TaskRules]) -> float:
    """Return the total cost of the given tasks under the cheapest rule of the given kind in each task [nats].

    A task without a rule of this kind contributes the cost of confusion.
    """
    return sum(_least_cost(family, task, otherwise=task.confusion) for task in tasks)


def _least_cost(family: str, task: TaskRules, *, otherwise: float) -> float:
    return min((rule.cost for rule in _rules_of(family, task)), default=otherwise)


def _rules_of(family: str, task: TaskRules) -> list[PolicyRule]:
    return [rule for rule in task.rules if rule.family == family]


def pooled_prior_costs(tasks: Sequence[TaskRules]) -> dict[str, float]:
    """Return the prior cost of each kind of rule [nats], estimated from all tasks. The most frequent kind has cost 0.

    The model assumes that each task with wrong attempts is explained by one kind of rule. The fraction of tasks that
    each kind explains is estimated from all tasks (empirical Bayes). The cost of a kind is log(largest fraction /
    fraction of this kind).
    """
    costs = [
        [
            task.confusion if family == CONFUSION else _least_cost(family, task, otherwise=math.inf)
            for family in FAMILIES
        ]
        for task in tasks
        if task.rules
    ]
    shares = _mixture_shares(np.array(costs).reshape(len(costs), len(FAMILIES)))
    return {family: float(np.log(shares.max() / share)) for family, share in zip(FAMILIES, shares, strict=True)}


def _mixture_shares(costs: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Return the weight of each component of a mixture, estimated by expectation maximization.

    The algorithm is that of Dempster, Laird & Rubin (1977).

    Args:
        costs: (tasks, components) negative log-likelihood of each task under each component [nats].
    """
    n_tasks, n_components = costs.shape
    shares = np.full(n_components, 1.0 / n_components)
    if not n_tasks:
        return shares
    likelihood = np.exp(-(costs - np.min(costs, axis=1, keepdims=True)))
    for _ in range(_EM_STEPS):
        posterior = shares * likelihood
        posterior /= posterior.sum(axis=1, keepdims=True)
        shares = (_PSEUDOCOUNT + posterior.sum(axis=0)) / (_PSEUDOCOUNT * n_components + n_tasks)
    return shares
