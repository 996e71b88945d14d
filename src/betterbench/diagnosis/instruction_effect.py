"""Instruction effect: how often a different instruction changes the policy's first target.

Random streams do not depend on the condition. Trials with the same seed therefore begin with the same scene if their
conditions have the same objects in the same slots. A run thus contains pairs of trials that differ only in the
instruction. If the two instructions name different first objects, a policy that uses the instruction goes to different
objects, whether these are correct or not. A policy that ignores the instruction goes to the same object in both trials.
"""

from __future__ import annotations

import hashlib
import json
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence

import numpy as np

from betterbench.diagnosis.thresholds import LEAST_PAIRS, LEVEL, USED
from betterbench.diagnosis.verdict import Metric, TrialDiagnosis
from betterbench.records import Record
from betterbench.statistics import Rate
from betterbench.statistics.unpaired import binomial_probabilities
from betterbench.tasks.labels import Kind

Pair = tuple[TrialDiagnosis, TrialDiagnosis]

SAME_TARGET = "same_target_whatever_the_instruction"
"""Evidence rule for a wrong first attempt by a policy that provably does not use the instruction."""

SAME_THING = "same_thing_whatever_the_instruction"
"""Evidence rule for a wrong first attempt at the policy's favorite kind of object.

See :mod:`betterbench.diagnosis.favorite_thing`.
"""

_PLACE_DIGITS = 4
"""Number of decimals to which positions [m] and rotations are rounded to compare initial states (0.1 mm)."""


def scene_of(record: Record) -> str:
    """Return a digest of an episode's initial state, i.e. of all objects with their poses and of the arm's pose."""
    things = sorted(
        (thing.asset, thing.kind, np.round([*position, *quaternion], _PLACE_DIGITS).tolist())
        for thing, position, quaternion in zip(
            record.metadata.scene.objects, record.object_positions[0], record.object_quaternions[0], strict=True
        )
    )
    arm = np.round([*record.joint_positions[0], record.finger_width[0]], _PLACE_DIGITS).tolist()
    # Adding zero converts -0.0 to 0.0, so that equal numbers have equal JSON and equal hashes.
    form = json.dumps([[a, k, [x + 0.0 for x in numbers]] for a, k, numbers in things] + [[x + 0.0 for x in arm]])
    return hashlib.sha256(form.encode()).hexdigest()[:16]


def instruction_pairs(trials: Iterable[TrialDiagnosis]) -> list[Pair]:
    """Return pairs of trials that differ only in the instruction and whose instructions have different first targets.

    Each trial is in at most one pair, so that the pairs are independent. A variation trial is paired with its
    counterfactual twin (the training trial with the same seed) if possible, otherwise with the first remaining trial
    that has the same scene. Trials without an attempt at an object or slot are left out, and so are trials in which no
    object should be attempted.
    """
    groups: dict[tuple[int, str], list[TrialDiagnosis]] = defaultdict(list)
    for trial in trials:
        if trial.scene and trial.intended_any and first_target(trial) is not None:
            groups[trial.seed, trial.scene].append(trial)
    return [pair for group in groups.values() for pair in _matched(group)]


def _matched(group: Sequence[TrialDiagnosis]) -> Iterator[Pair]:
    left = {trial.key: trial for trial in sorted(group, key=lambda t: t.variation is None)}  # variations first
    while left:
        trial = left.pop(next(iter(left)))
        others = [t for t in left.values() if not set(t.intended_any) & set(trial.intended_any)]
        partner = min(others, key=lambda t: (t.key != trial.twin_key, t.variation is not None), default=None)
        if partner is not None:
            del left[partner.key]
            yield trial, partner


def first_target(trial: TrialDiagnosis) -> str | None:
    """Return the name of the object or empty slot that is the target of a trial's first attempt, or None.

    A drawer that is moved to reach an object does not count as a first target.
    """
    return trial.first_attempt or trial.first_slot


def changes_target(pair: Pair) -> bool:
    """Return whether the policy's first target changes with the instruction.

    The two trials begin with the same scene. If one of the two first grasps missed its object, only the slot of this
    grasp is known. In this case, the slots of both grasps are compared.
    """
    one, other = pair
    if one.first_attempt and other.first_attempt:
        return one.first_attempt != other.first_attempt
    return one.first_slot is None or one.first_slot != other.first_slot


def instruction_effects(trials: Sequence[TrialDiagnosis]) -> Iterator[Metric]:
    """Yield the instruction effect over all trials, and then the instruction effect in each task.

    Training trials and variation trials are treated alike. The p-value is the exact probability that a policy which
    picks one of two objects at random changes its first target in at most the observed number of pairs.
    """
    ended = [t for t in trials if t.kind is not Kind.UNFINISHED]
    pairs = instruction_pairs(ended)
    scopes = {"overall": pairs}
    for pair in pairs:
        scopes.setdefault(pair[0].task, []).append(pair)
    for scope, members in scopes.items():
        if not members:
            continue
        rate = Rate(sum(map(changes_target, members)), len(members))
        p = min(1.0, float(binomial_probabilities(rate.n, USED)[: rate.k + 1].sum()))
        yield Metric(
            "instruction_effect", scope, rate.k, rate.n, rate.value, rate.low, rate.high, p,
            method="wilson over pairs; exact binomial against 0.5",
        )  # fmt: skip


def is_unused(effect: Metric | None, *, tests: int = 1) -> bool:
    """Return whether an instruction effect proves that the policy does not use the instruction.

    The proof requires at least :data:`LEAST_PAIRS` pairs and a p-value below 2.5 %, corrected for the number of tests.
    For a single test, this means that the confidence interval lies below :data:`USED`.
    """
    if effect is None or effect.p_value is None:
        return False
    return effect.n >= LEAST_PAIRS and effect.p_value * tests < LEVEL


def tasks_without_effect(trials: Sequence[TrialDiagnosis]) -> dict[str, Metric]:
    """Return the tasks in which a policy provably ignores the instruction, each with the metric that proves it.

    If the pairs of all tasks together prove it, this applies to each task whose own pairs do not contradict it.
    Otherwise, it must be proven separately in each task.
    """
    effects = {m.scope: m for m in instruction_effects(trials)}
    overall = effects.pop("overall", None)
    tasks = {t.task: effects.get(t.task) for t in trials}
    if overall is not None and is_unused(overall):
        return {task: overall for task, own in tasks.items() if own is None or (own.value or 0.0) < USED}
    return {task: own for task, own in tasks.items() if own is not None and is_unused(own, tests=len(effects))}


def effect_words(effect: Metric) -> str:
    """Return a sentence that states in how many pairs of trials the policy has the same first target."""
    return f"In {_counted(effect)} the first target is the same."


def unused_sentence(effect: Metric) -> str:
    """Return the conclusion that the policy does not use the instruction, with the number of pairs that prove it."""
    return f"It does not use the instruction: the first target is the same in {_counted(effect)}."


def effect_sentence(effect: Metric | None) -> str:
    """Return the conclusion from an instruction effect: the instruction is used, is not used, or this is still open."""
    if effect is None or not effect.n:
        return (
            "This run has no two trials that differ only in the instruction and have different first targets, so "
            "it does not show whether the instruction is used."
        )
    pairs = "pair of trials that differs" if effect.n == 1 else "pairs of trials that differ"
    seen = f"The first target changes in {effect.k or 0} of {effect.n} {pairs} only in the instruction"
    if is_unused(effect):
        return f"{seen}: the instruction is not used."
    if effect.n < LEAST_PAIRS:
        return f"{seen}; fewer than {LEAST_PAIRS} pairs do not show whether the instruction is used."
    if (effect.low or 0.0) > USED:
        return f"{seen}: the instruction is used, correctly or not."
    return f"{seen}, which may be chance: this does not show whether the instruction is used."


def effect_findings(unused: Mapping[str, Metric], decider: str) -> Iterator[str]:
    """Yield one sentence for each proof that the policy does not use the instruction."""
    for effect in dict.fromkeys(unused.values()):
        where = "" if effect.scope == "overall" else f"{effect.scope}: "
        percent = (
            f"instruction effect {100 * (effect.value or 0.0):.0f} %, 95 % interval {100 * (effect.low or 0.0):.0f}"
        )
        yield (
            f"{where}It does not use the instruction: the first target is the same in {_counted(effect)} ({percent} to "
            f"{100 * (effect.high or 0.0):.0f}). The deciding cue is {decider}."
        )


def _counted(effect: Metric) -> str:
    return f"{effect.n - (effect.k or 0)} of {effect.n} pairs of trials that differ only in the instruction"
