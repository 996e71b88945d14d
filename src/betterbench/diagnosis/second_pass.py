"""The second pass: which one rule explains the wrong first attempts of a policy in a task.

Four kinds of rule predict the slot of a first attempt: the *word* goes where it led in training; the *habit* begins
with the most frequent first step; *later* begins with what a later step asks for; the *place* is always the same slot,
or always the same one where the same slots are stocked, as "whatever is nearest" is.
A rule is judged as a policy that follows it with an unknown strength ``q`` and is right otherwise, apart from a small
share of slips. Its cost is the negative log-likelihood of all first attempts at the best ``q``, so a rule that is
applied in 30 % of the trials is found as well as one that is always applied, and right attempts where the rule predicts
a wrong one count against it. A place rule pays for the choice of its slot, or of each of its slots, because they are
fitted to the trials and the other rules come from training.
All rules compete with plain confusion: a policy that errs at one rate everywhere and without direction, no worse than
by guessing.

A wrong order is seen in each trial by itself, a favorite place only in several that differ in what is asked. So where
"later" explains all first attempts of a policy, in all its tasks together, at least as well as the other rules do,
what it went for too early is a step taken too early (:func:`mistakes_order`).

Evidence is pooled over a policy's tasks, so what is found in one task counts a little in the others: each kind of rule
has a weight, the share of the tasks with wrong attempts that it explains (:func:`family_costs`); and one that explains
all of them clearly better than any other is that of the policy (:func:`rule_of_all_tasks`). A single wrong attempt
that two rules predict alike is thereby read as the other tasks read theirs. A task of its own can always say otherwise:
over ten tasks the weights are worth 3.0 nats at most, as much as one attempt that a rule predicts and another does not.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from betterbench.diagnosis.ruling import CONFUSION, HABIT, LATER, PLACE, WORD, RuleStatus, Ruling
from betterbench.diagnosis.thresholds import (
    CLEARLY,
    HIGHEST_ERROR_RATE,
    HIGHEST_STRENGTH,
    LOWEST_ERROR_RATE,
    ONE_ATTEMPT,
    ORDER_TRIALS,
    OTHER_TASKS,
)
from betterbench.diagnosis.trial import Choice
from betterbench.tasks import THRESHOLDS

FAMILIES = (WORD, HABIT, LATER, PLACE, CONFUSION)

_LATER = (LATER, f"{LATER}:next", f"{LATER}:last")
"""What begins with a step that is not due yet: any of them, the next, or the last."""

_GRID = np.linspace(0.0, HIGHEST_STRENGTH, 100)
"""Strengths that are tried."""

_ROUNDING = 1e-9
"""Difference of two costs up to which they are equal [nats]."""


@dataclass(frozen=True, slots=True)
class PolicyRule:
    """One rule, judged on all first attempts of a task.

    Attributes:
        name: "word", "habit", "later", "place:SLOT", or "place" for one slot per set of slots that are stocked.
        cost: Negative log-likelihood at the best strength [nats], with the price of its choice and of its kind.
        strength: The best strength, from 0 to 1.
        explained: Wrong first attempts that it explains.
        opportunities: Trials in which it predicts a wrong first attempt.
        errors_elsewhere: Wrong first attempts in trials in which it predicts a right one.
        elsewhere: Trials in which it predicts a right first attempt.
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
        """The slot of a place rule."""
        return self.name.removeprefix("place:") if self.name.startswith("place:") else None

    @property
    def family(self) -> str:
        """The kind of rule: "word", "habit", "later" or "place"."""
        return _family(self.name)


@dataclass(frozen=True, slots=True)
class TaskRules:
    """What the second pass found out about a policy in one task.

    Attributes:
        rules: All rules, the cheapest first; at equal cost word, then habit, then place.
        confusion: Cost of plain confusion [nats].
        upheld: Names of the rules that are proven better than confusion and could be told apart.
        rulings: Per trial key, what holds for it.
        undecided: Number of wrong trials in which no rule can be told from another, or proven, for lack of trials.
    """

    rules: tuple[PolicyRule, ...]
    confusion: float
    upheld: tuple[str, ...]
    rulings: Mapping[str, Ruling]
    undecided: int


def judge_policy(choices: Mapping[str, Mapping[str, Choice]]) -> dict[str, TaskRules]:
    """Judge the rules on the first attempts of one policy in all tasks."""
    alone = {task: judge_rules(mine) for task, mine in choices.items()}
    ordered = mistakes_order(choices, alone)
    costs = family_costs([alone[task] for task in sorted(alone)])
    proven = {
        family: {task for task, found in alone.items() if any(_family(name) == family for name in found.upheld)}
        for family in (PLACE, LATER)
    }
    usual = rule_of_all_tasks(choices, alone)
    if usual is not None:
        costs |= {name: max(cost, ONE_ATTEMPT) for name, cost in costs.items() if name not in (usual, CONFUSION)}
        costs[usual] = 0.0
    return {
        task: judge_rules(
            mine,
            costs,
            known=[f for f in proven if len(proven[f] - {task}) >= OTHER_TASKS and costs[f] == 0.0],
            ordered=ordered,
        )
        for task, mine in choices.items()
    }


def rule_of_all_tasks(choices: Mapping[str, Mapping[str, Choice]], alone: Mapping[str, TaskRules]) -> str | None:
    """Return the kind of rule that explains a policy in all its tasks clearly better than any other, or None.

    A kind that leaves wrong attempts unexplained which another one explains is not that of the policy, even if it costs
    less because it has fewer rules to choose from.
    """
    mine = _with_errors(choices)
    totals = sorted((_total(family, mine, alone), family) for family in FAMILIES)
    best = totals[0][1]
    if len(mine) < 2 or best == CONFUSION or totals[1][0] - totals[0][0] < CLEARLY:
        return None
    explained = {family: _explained(family, mine, alone) for family in FAMILIES}
    return best if explained[best] == max(explained.values()) else None


def _explained(family: str, tasks: Iterable[str], alone: Mapping[str, TaskRules]) -> int:
    """Return how many wrong first attempts the rules of a kind explain, the best of them in each task."""
    return sum(max((r.explained for r in alone[t].rules if r.family == family), default=0) for t in tasks)


def _with_errors(choices: Mapping[str, Mapping[str, Choice]]) -> dict[str, list[Choice]]:
    """Return the choices of the tasks in which some are wrong."""
    return {task: list(of.values()) for task, of in choices.items() if any(not c.correct for c in of.values())}


def _total(family: str, tasks: Iterable[str], alone: Mapping[str, TaskRules]) -> float:
    """Return what the best rules of a kind cost in several tasks; where none fits, it is the cost of confusion."""
    return sum(min((r.cost for r in alone[t].rules if r.family == family), default=alone[t].confusion) for t in tasks)


def mistakes_order(choices: Mapping[str, Mapping[str, Choice]], alone: Mapping[str, TaskRules]) -> bool:
    """Tell whether "it begins with a later step" explains the first attempts of a policy as well as anything else.

    All tasks with wrong attempts are judged together: a later step, the next, or the last, against the word, a favorite
    place per task, and confusion.
    """
    mine = _with_errors(choices)
    if sum(not c.correct and _fits(LATER, c) for of in mine.values() for c in of) < ORDER_TRIALS:
        return False
    later = min(sum(_judge(name, of, 0.0).cost for of in mine.values()) for name in _LATER) + math.log(len(_LATER))
    return later <= min(_total(family, mine, alone) for family in (WORD, PLACE, CONFUSION)) + _ROUNDING


def family_costs(tasks: Sequence[TaskRules]) -> dict[str, float]:
    """Return what each kind of rule costs before a task is looked at, from all tasks together [nats, 0 for the usual].

    The weights of a mixture are fitted to the tasks that hold wrong attempts, by expectation maximization (Dempster,
    Laird & Rubin 1977), each kind with half a task of prior weight (Jeffreys' prior for a multinomial).
    """
    rows = [row for row in map(_family_row, tasks) if row is not None]
    weights = np.full(len(FAMILIES), 1.0 / len(FAMILIES))
    if rows:
        likelihood = np.exp(-(np.array(rows) - np.min(rows, axis=1, keepdims=True)))
        for _ in range(200):
            shares = weights * likelihood
            shares /= shares.sum(axis=1, keepdims=True)
            weights = (0.5 + shares.sum(axis=0)) / (0.5 * len(FAMILIES) + len(rows))
    return {name: float(np.log(weights.max() / weight)) for name, weight in zip(FAMILIES, weights, strict=True)}


def _family_row(task: TaskRules) -> list[float] | None:
    """Return the cost of the best rule of each kind in a task, or None if no attempt there was wrong."""
    if not task.rules:
        return None
    best = {name: min((r.cost for r in task.rules if r.family == name), default=math.inf) for name in FAMILIES}
    return [task.confusion if name == CONFUSION else best[name] for name in FAMILIES]


def judge_rules(
    choices: Mapping[str, Choice],
    costs: Mapping[str, float] | None = None,
    *,
    known: Sequence[str] | None = None,
    ordered: bool = False,
) -> TaskRules:
    """Judge the rules on the first attempts of one policy in one task.

    Args:
        choices: First attempt per trial key.
        costs: What each kind of rule costs to begin with [nats]; nothing if not given.
        known: Kinds of rule that other tasks have proven of the policy. A place then needs no pair of trials of its
            own here; "later" is judged by other tasks alone, because within one a favorite place may look like it.
            None if nothing is known of other tasks yet: all rules are then judged by the trials of this one.
        ordered: Whether the policy is known to mistake the order (:func:`mistakes_order`). What it goes for too early
            then proves neither word nor place.
    """
    before = dict.fromkeys(FAMILIES, 0.0) | dict(costs or {})
    places_known = known is not None and PLACE in known
    items = _with_favorites(sorted(choices.items()), paired=not places_known)
    all_choices = [c for _, c in items]
    slots = sorted({c.slot for c in all_choices if c.slot is not None})
    favorites = {(c.stocked, s) for c in all_choices for s in c.favorite_slots}
    several = [PLACE] if len({s for _, s in favorites}) > 1 else []
    names = [WORD, HABIT, LATER, *(f"place:{s}" for s in slots), *several]
    price = math.log(max((c.places for c in all_choices), default=2))
    prices = {name: before[name] for name in (WORD, HABIT, LATER)} | {PLACE: len(favorites) * price + before[PLACE]}
    rules = [_judge(name, all_choices, prices.get(name, price + before[PLACE])) for name in names]
    rank = {name: k for k, name in enumerate(names)}
    rules = sorted((r for r in rules if r.explained), key=lambda r: (round(r.cost, 9), rank[r.name]))
    confusion = _confusion(all_choices) + before[CONFUSION]
    proven = {r.name for r in rules if r.cost < confusion - _ROUNDING}
    if not places_known:
        proven -= {r.name for r in rules if r.slot is not None and not has_pair(all_choices, r.slot)}
    if known is not None and LATER not in known:
        proven.discard(LATER)
    rulings: dict[str, Ruling] = {}
    undecided = 0
    paid = price + before[PLACE]
    open_slots = {r.slot for r in rules if r.slot is not None and r.cost - paid < confusion}
    if not places_known:
        open_slots = {s for s in open_slots if not _provable(s, all_choices, paid, before[CONFUSION])}
    for key, choice in items:
        ruling = _rule_on(choice, rules, proven, all_choices, place_open=choice.slot in open_slots)
        if ordered and _fits(LATER, choice):
            ruling = replace(ruling, shortcut="rejected", place="rejected")
        rulings[key] = ruling
        undecided += not choice.correct and "open" in (rulings[key].shortcut, rulings[key].place)
    upheld = tuple(r.name for r in rules if r.name in proven)
    return TaskRules(tuple(rules), confusion, upheld, rulings, undecided)


def has_pair(choices: Iterable[Choice], slot: str) -> bool:
    """Tell whether the policy went to a slot although asked elsewhere, and was asked for different slots, in one scene.

    "The same place whatever the instruction" can only be seen where the instruction differs and the scene does not; or
    where the same slots are stocked with other things, so that it is not one of the things that the policy likes.
    """
    went = [c for c in choices if c.slot == slot and c.right]
    alike: dict[frozenset[object], list[Choice]] = {}
    for choice in went:
        alike.setdefault(choice.layout, []).append(choice)
    by_layout = list(alike.values())
    alike = {}
    for choice in went:
        alike.setdefault(choice.stocked, []).append(choice)
    of_several = [group for group in alike.values() if len({c.thing for c in group}) > 1]
    return any(
        len({c.right for c in group}) > 1 and any(not c.correct for c in group) for group in (*by_layout, *of_several)
    )


def _with_favorites(items: Sequence[tuple[str, Choice]], *, paired: bool) -> list[tuple[str, Choice]]:
    """Return the choices with the slot that each may favor: the most frequent one where the same slots are stocked.

    ``paired`` leaves it out where no pair of trials shows that the slot is favored whatever is asked.
    """
    groups: dict[frozenset[str], list[Choice]] = {}
    for _, choice in items:
        groups.setdefault(choice.stocked, []).append(choice)
    favorites: dict[frozenset[str], frozenset[str]] = {}
    for stocked, group in groups.items():
        times = Counter(c.slot for c in group if c.slot is not None)
        slot = max(sorted(times), key=lambda s: times[s], default=None)
        if slot is not None and (not paired or has_pair(group, slot)):
            favorites[stocked] = frozenset((slot,))
    return [(key, replace(c, favorite_slots=favorites.get(c.stocked, frozenset()))) for key, c in items]


def _provable(slot: str, choices: Sequence[Choice], price: float, confusion: float) -> bool:
    """Tell whether trials like these would prove a policy that always goes to a slot."""
    certain = [replace(c, slot=slot, correct=slot in c.right) for c in choices]
    rule = _judge(f"{PLACE}:{slot}", certain, price)
    return has_pair(certain, slot) and rule.cost < _confusion(certain) + confusion - _ROUNDING


def _rule_on(
    choice: Choice, rules: Sequence[PolicyRule], proven: set[str], choices: Sequence[Choice], *, place_open: bool
) -> Ruling:
    """Return the ruling on one trial: the cheapest proven rule that fits it.

    ``place_open`` tells that "always the slot of this trial" fits the trials, which could prove it of no policy.
    """
    if choice.correct or choice.slot is None:
        return Ruling("rejected")
    fits_word = _fits(WORD, choice)
    place = f"place:{choice.slot}"
    told_apart = bool({place, PLACE} & proven) or any(_fits(WORD, c) != _fits(place, c) for c in choices)
    for rule in rules:
        if rule.name not in proven or not _fits(rule.name, choice):
            continue
        if rule.name == WORD:
            return Ruling("upheld" if told_apart else "open")
        if rule.name in (place, PLACE):
            return Ruling("rejected", place="upheld")
        if rule.name == LATER:
            return Ruling("rejected", habit="rejected")
        return Ruling("rejected", "open" if choice.replaced and place_open else "rejected")
    shortcut: RuleStatus = "open" if fits_word and not told_apart else "rejected"
    return Ruling(shortcut, "open" if place_open else "rejected")


def _family(name: str) -> str:
    return name.partition(":")[0]


def _predicted(name: str, choice: Choice) -> frozenset[str]:
    if name == WORD:
        return choice.word_slots
    if name == HABIT:
        return choice.habit_slots
    if name in _LATER:
        steps = choice.step_slots or (choice.later_slots,)
        return {_LATER[1]: steps[0], _LATER[2]: steps[-1]}.get(name, choice.later_slots)
    if name == PLACE:
        return choice.favorite_slots
    return frozenset((name.removeprefix("place:"),))


def _fits(name: str, choice: Choice) -> bool:
    return choice.slot is not None and choice.slot in _predicted(name, choice)


def _judge(name: str, choices: Sequence[Choice], price: float) -> PolicyRule:
    """Return a rule with its likelihood at the best strength."""
    log = np.zeros_like(_GRID)
    explained = opportunities = errors_elsewhere = elsewhere = 0
    for choice in choices:
        predicted = _predicted(name, choice)
        if not predicted:
            log += math.log(_chance(choice, THRESHOLDS.slip))
            continue
        fits = _fits(name, choice)
        otherwise = _chance(choice, THRESHOLDS.slip)
        share = 1.0 / len(predicted) if name == LATER else 1.0  # it says that the step is a later one, not which
        log += np.log(_GRID * fits * share + (1.0 - _GRID) * otherwise)
        if predicted & choice.right:
            elsewhere += 1
            errors_elsewhere += not choice.correct and not fits
        else:
            opportunities += 1
        explained += fits and not choice.correct
    best = int(np.argmax(log))
    return PolicyRule(
        name, price - float(log[best]), float(_GRID[best]), explained, max(opportunities, explained), errors_elsewhere,
        elsewhere,
    )  # fmt: skip


def _chance(choice: Choice, error_rate: float) -> float:
    """Return the probability of a first attempt for a policy that errs at a rate and without direction."""
    return 1.0 - error_rate if choice.correct else error_rate / max(1, choice.places - len(choice.right))


def _confusion(choices: Sequence[Choice]) -> float:
    """Return the cost of plain confusion at its best rate of errors, which is at most that of guessing."""
    if not choices:
        return 0.0
    guessing = float(np.mean([1.0 - min(1, len(c.right)) / c.places for c in choices]))
    highest = min(HIGHEST_ERROR_RATE, max(2.0 * LOWEST_ERROR_RATE, guessing))
    rates = np.linspace(LOWEST_ERROR_RATE, highest, 100)
    costs = [-sum(math.log(_chance(c, float(rate))) for c in choices) for rate in rates]
    return min(costs)
