"""Decision rules of a policy in one task: their fit, their comparison with confusion, and the ruling on each trial.

A rule is upheld if it costs less than the null hypothesis of undirected errors (confusion). This is a likelihood-ratio
test with a penalty for choosing the rule. For a favorite place, there must also be a pair of trials that have different
instructions and both begin with an attempt at this place (:func:`has_pair`).
"""

from __future__ import annotations

import math
from collections import Counter, defaultdict
from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

from betterbench.diagnosis.rule_likelihood import ROUNDING, PolicyRule, confusion_cost, fit_rule, fits, place_rule
from betterbench.diagnosis.ruling import CONFUSION, HABIT, LATER, PLACE, WORD, RuleStatus, Ruling
from betterbench.diagnosis.thresholds import CLEARLY
from betterbench.diagnosis.trial import Choice

FAMILIES = (WORD, HABIT, LATER, PLACE, CONFUSION)
"""Kinds of rule, including confusion as the null hypothesis."""

_DECIMALS = 9
"""Number of decimals to which costs [nats] are rounded when rules are sorted."""


@dataclass(frozen=True, slots=True)
class TaskRules:
    """Result of the second pass for a policy in one task.

    Attributes:
        rules: All rules, lowest cost first. Rules with equal costs are in the order word, habit, later, place.
        confusion: Cost of confusion [nats].
        upheld: Names of the rules that explain the attempts better than confusion does and can be distinguished from
            similar rules.
        rulings: Ruling on each trial, by trial key.
        undecided: Number of trials with a wrong first attempt for which the run is too small to prove a rule or to
            distinguish it from another rule.
    """

    rules: tuple[PolicyRule, ...]
    confusion: float
    upheld: tuple[str, ...]
    rulings: Mapping[str, Ruling]
    undecided: int


def judge_rules(
    choices: Mapping[str, Choice],
    prior_costs: Mapping[str, float] | None = None,
    *,
    known: Sequence[str] | None = None,
    ordered: bool = False,
) -> TaskRules:
    """Judge which rules explain the first attempts of a policy in one task.

    Args:
        choices: First attempt of each trial, by trial key.
        prior_costs: Prior cost of each kind of rule [nats]. By default, all are zero.
        known: Kinds of rule that other tasks prove for the policy. If they include "place", this task needs no pair of
            trials. If they include "word", this task needs no trials that distinguish it from a place. "later" is only
            judged by other tasks, because in a single task it may look like a favorite place. If ``known`` is None, all
            rules are judged by the trials of this task.
        ordered: Whether the policy is known to do steps in the wrong order. If so, an attempt at a later step proves
            neither "word" nor "place".
    """
    prior = dict.fromkeys(FAMILIES, 0.0) | dict(prior_costs or {})
    place_known = known is not None and PLACE in known
    trials = _with_favorites(dict(sorted(choices.items())), paired=not place_known)
    attempts = list(trials.values())
    rules = _fit_rules(attempts, prior)
    confusion = confusion_cost(attempts) + prior[CONFUSION]
    proven = _proven(attempts, rules, confusion, known)
    open_slots = _open_slots(attempts, rules, confusion, prior, place_known=place_known)
    judged = _Judged(
        attempts,
        rules,
        proven,
        open_slots,
        ordered,
        word_known=known is not None and WORD in known,
        avoids_habit=_avoids_habit(rules, confusion),
    )
    rulings = {key: judged.ruling(choice) for key, choice in trials.items()}
    wrong = [rulings[key] for key, choice in trials.items() if not choice.correct]
    return TaskRules(
        rules=tuple(rules),
        confusion=confusion,
        upheld=tuple(rule.name for rule in rules if rule.name in proven),
        rulings=rulings,
        undecided=sum("open" in (ruling.shortcut, ruling.place) for ruling in wrong),
    )


def _fit_rules(attempts: Sequence[Choice], prior: Mapping[str, float]) -> list[PolicyRule]:
    """Fit the rules that explain at least one wrong first attempt, and sort them by cost.

    Rules with equal costs are in the order word, habit, later, place.
    """
    slots = sorted({c.slot for c in attempts if c.slot is not None})
    favorites = {(c.stocked, slot) for c in attempts for slot in c.favorite_slots}
    several = [PLACE] if len({slot for _, slot in favorites}) > 1 else []
    names = [WORD, HABIT, LATER, *map(place_rule, slots), *several]
    rules = [fit_rule(name, attempts, _price(name, attempts, len(favorites), prior)) for name in names]
    rank = {name: k for k, name in enumerate(names)}
    return sorted((r for r in rules if r.explained), key=lambda r: (round(r.cost, _DECIMALS), rank[r.name]))


def _price(name: str, attempts: Sequence[Choice], n_favorites: int, prior: Mapping[str, float]) -> float:
    """Return the prior cost of a rule [nats].

    The slots of a place rule are fitted to the trials, so each slot adds the cost of choosing it among all slots. The
    other rules are completely determined by training.
    """
    if name in (WORD, HABIT, LATER):
        return prior[name]
    return (n_favorites if name == PLACE else 1) * _choice_of_slot(attempts) + prior[PLACE]


def _choice_of_slot(attempts: Sequence[Choice]) -> float:
    """Return the prior cost of one slot if all slots are equally likely [nats]."""
    return math.log(max((c.places for c in attempts), default=2))


def _proven(
    attempts: Sequence[Choice], rules: Sequence[PolicyRule], confusion: float, known: Sequence[str] | None
) -> frozenset[str]:
    """Return the rules that cost less than confusion (undirected errors) and can be distinguished from others."""

    def told_apart(rule: PolicyRule) -> bool:
        if rule.family == LATER:
            return known is None or LATER in known
        return rule.slot is None or (known is not None and PLACE in known) or has_pair(attempts, rule.slot)

    return frozenset(rule.name for rule in rules if rule.cost < confusion - ROUNDING and told_apart(rule))


def has_pair(choices: Iterable[Choice], slot: str) -> bool:
    """Return whether a pair of trials shows that the policy goes to a slot regardless of what is requested.

    In both trials of the pair, the first attempt is at the slot, and at least one of the two attempts is wrong. The
    trials have the same scene and different correct slots, or different objects in the same slots. Only such pairs rule
    out that the policy prefers an object rather than a slot.
    """
    went = [c for c in choices if c.slot == slot and c.right]
    same_layout = _grouped(went, lambda c: c.layout)
    other_things = [group for group in _grouped(went, lambda c: c.stocked) if len({c.thing for c in group}) > 1]
    return any(
        len({c.right for c in group}) > 1 and any(not c.correct for c in group)
        for group in (*same_layout, *other_things)
    )


def _grouped(choices: Iterable[Choice], key: Callable[[Choice], Hashable]) -> list[list[Choice]]:
    groups: defaultdict[Hashable, list[Choice]] = defaultdict(list)
    for choice in choices:
        groups[key(choice)].append(choice)
    return list(groups.values())


def _with_favorites(trials: Mapping[str, Choice], *, paired: bool) -> dict[str, Choice]:
    """In each first attempt, set the slot that the policy may prefer.

    This is the slot of most first attempts in trials with the same occupied slots. If ``paired`` is True, a slot is
    only set if a pair of trials shows that the policy prefers it regardless of the instruction.
    """
    favorites: dict[frozenset[str], frozenset[str]] = {}
    for group in _grouped(trials.values(), lambda c: c.stocked):
        times = Counter(c.slot for c in group if c.slot is not None)
        slot = max(sorted(times), key=lambda s: times[s], default=None)
        if slot is not None and (not paired or has_pair(group, slot)):
            favorites[group[0].stocked] = frozenset((slot,))
    return {key: replace(c, favorite_slots=favorites.get(c.stocked, frozenset())) for key, c in trials.items()}


def _open_slots(
    attempts: Sequence[Choice],
    rules: Sequence[PolicyRule],
    confusion: float,
    prior: Mapping[str, float],
    *,
    place_known: bool,
) -> frozenset[str]:
    """Return the slots that may be favorites of the policy, although the trials do not prove it.

    Without its prior cost, the rule for such a slot is more likely than confusion. However, there are too few trials to
    prove the rule, even if the policy always went to this slot.
    """
    price = _choice_of_slot(attempts) + prior[PLACE]
    found = {rule.slot for rule in rules if rule.slot is not None and rule.cost - price < confusion}
    if place_known:
        return frozenset(found)
    return frozenset(slot for slot in found if not _is_provable(slot, attempts, price, prior[CONFUSION]))


def _is_provable(slot: str, attempts: Sequence[Choice], price: float, prior_of_confusion: float) -> bool:
    """Return whether there are enough trials to prove that a policy always goes to a slot, if it does."""
    certain = [replace(c, slot=slot, correct=slot in c.right) for c in attempts]
    rule = fit_rule(place_rule(slot), certain, price)
    return has_pair(certain, slot) and rule.cost < confusion_cost(certain) + prior_of_confusion - ROUNDING


def _avoids_habit(rules: Sequence[PolicyRule], confusion: float) -> bool:
    """Return whether the trials clearly contradict a habit, because the policy errs where the habit would be correct.

    A single trial is enough to show a habit. To reject it, at least two trials must contradict it, and they must be the
    majority.
    """
    habit = next((rule for rule in rules if rule.name == HABIT), None)
    if habit is None or habit.cost - confusion < CLEARLY:
        return False
    return habit.errors_elsewhere >= 2 and 2 * habit.errors_elsewhere > habit.elsewhere


@dataclass(frozen=True, slots=True)
class _Judged:
    """Rules of a task, with the evidence from the trials of the task.

    Attributes:
        attempts: First attempt of each trial.
        rules: Rules that may explain the attempts, lowest cost first.
        proven: Names of the rules that the trials prove.
        open_slots: Slots that the policy may favor, although there are too few trials to prove it.
        ordered: Whether the policy is known to do steps in the wrong order.
        word_known: Whether other tasks prove that the policy goes to the slot to which a word of the instruction led in
            training.
        avoids_habit: Whether the trials clearly contradict the habit.
    """

    attempts: Sequence[Choice]
    rules: Sequence[PolicyRule]
    proven: frozenset[str]
    open_slots: frozenset[str]
    ordered: bool
    word_known: bool
    avoids_habit: bool

    def ruling(self, choice: Choice) -> Ruling:
        """Return the ruling of the second pass on one trial."""
        found = self._by_cheapest_rule(choice)
        if self.ordered and fits(LATER, choice):
            return replace(found, shortcut="rejected", place="rejected")
        return found

    def _by_cheapest_rule(self, choice: Choice) -> Ruling:
        """Return the ruling on a trial, based on the cheapest proven rule that predicts the first attempt."""
        if choice.correct or choice.slot is None:
            return Ruling("rejected")
        open_place: RuleStatus = "open" if choice.slot in self.open_slots else "rejected"
        proven = (rule for rule in self.rules if rule.name in self.proven)
        rule = next((rule.name for rule in proven if fits(rule.name, choice)), None)
        if rule is None:
            word_too = fits(WORD, choice) and not self._word_is_told_from(choice.slot)
            habit: RuleStatus = "rejected" if self.avoids_habit else "upheld"
            return Ruling("open" if word_too else "rejected", place=open_place, habit=habit)
        if rule == WORD:
            return Ruling("upheld" if self._word_is_told_from(choice.slot) else "open")
        if rule in (place_rule(choice.slot), PLACE):
            return Ruling("rejected", place="upheld")
        if rule == LATER:
            return Ruling("rejected", habit="rejected")
        return Ruling("rejected", place=open_place if choice.replaced else "rejected")  # the proven rule is the habit

    def _word_is_told_from(self, slot: str) -> bool:
        """Return whether the trials can distinguish the rule "go where the word led" from "always go to this slot"."""
        if self.word_known:
            return True
        place = place_rule(slot)
        return bool({place, PLACE} & self.proven) or any(fits(WORD, c) != fits(place, c) for c in self.attempts)
