"""Words and targets that a policy consistently confuses, inferred from the first attempts in a run.

A policy may use the instruction but misunderstand some of the words, for example by exchanging fork and spoon. In a
single trial, a wrong object may be chosen by chance, so the trial is labeled ``wrong_object``. Several trials with the
same words can show that the words are confused, because a policy that chooses at random would sometimes be correct.
"""

from __future__ import annotations

import itertools
from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from betterbench.diagnosis.thresholds import NEARLY_ALL, SHARE_OF_ALL, USED
from betterbench.diagnosis.verdict import TrialDiagnosis
from betterbench.errors import UnknownNameError
from betterbench.statistics import Rate, chance_p
from betterbench.statistics.power import DEFAULT_ALPHA
from betterbench.tasks import get_task
from betterbench.tasks.interventions import resolve_condition
from betterbench.tasks.labels import Label
from betterbench.wording import listed, plural

MEMORIZED_PLACE = "memorized_place"
"""Evidence rule for placing a correct object at its training target instead of the requested target."""

WRONG_PLACES = "It brings the correct objects to wrong targets; this run does not show why."
"""Conclusion about a policy that uses wrong targets for a reason other than training."""

_SHOWN = 4
"""Maximum number of confused words listed in a sentence."""


@dataclass(frozen=True, slots=True)
class _FirstWord:
    """Instruction word for the object that was requested first, and the words for the object that was attempted first.

    Attributes:
        word: Word of the instruction for the first requested object.
        taken: All words in the task's instructions that refer to the object of the first attempt.
    """

    word: str
    taken: frozenset[str]


def confused_words(trials: Sequence[TrialDiagnosis], failed: Sequence[TrialDiagnosis]) -> str:
    """Return a sentence about the instruction words that the policy mistakes for other words, or an empty string.

    A word is confused if the policy takes it for the same other word in nearly all trials with this word. These trials
    must be significantly more than half of the trials with confused words, and they must include at least half of the
    failures. At least two different words must be confused, because a single confused word may only show that the
    policy has a favorite object.

    Args:
        trials: All trials of the run.
        failed: The variation trials of the run that failed because of the policy's reasoning.
    """
    ended = [(trial, found) for trial in trials if (found := _first_word(trial)) is not None]
    taken = _taken_for([found for _, found in ended])
    if len(set(taken.values())) < 2:
        return ""
    known = [(trial, found) for trial, found in ended if found.word in taken]
    agreeing = {trial.key for trial, found in known if taken[found.word] in found.taken}
    rate = Rate(len(agreeing), len(known))
    explained = sum(trial.key in agreeing for trial in failed)
    if chance_p(rate, chance=USED) > DEFAULT_ALPHA or 2 * explained < len(failed):
        return ""
    times = Counter(found.word for _, found in known)
    words = sorted(taken, key=lambda word: (-times[word], word))
    pairs = [f"{word!r} for {taken[word]!r}" for word in words[:_SHOWN]]
    more = f" and {len(words) - _SHOWN} more" if len(words) > _SHOWN else ""
    counted = f"{rate.k} of {plural(rate.n, 'trial')} with these words"
    return f"It confuses words: {listed(pairs)}{more} ({counted})."


def _first_word(trial: TrialDiagnosis) -> _FirstWord | None:
    """Return the first word of a trial's instruction and the words for the attempted object.

    The result is None if the first word or the attempted object is unknown. It is also None if the same instruction
    requests the attempted object in a later step, because the policy then did the steps in the wrong order.
    """
    try:
        condition = resolve_condition(trial.task, trial.variation or trial.condition).condition
        task = get_task(trial.task)
    except UnknownNameError:
        return None
    at = trial.first_attempt or (trial.first_slot and condition.occupant(trial.first_slot))
    goals = condition.instruction.subgoals
    first = next((goal for goal in goals if set(condition.resolve(goal.reference)) & set(trial.intended_any)), None)
    if not at or first is None:
        return None
    meant = condition.resolve(first.reference)
    if at not in meant and any(at in condition.resolve(goal.reference) for goal in goals):
        return None
    conditions = (*task.training, condition)
    used = itertools.chain.from_iterable(c.instruction.subgoals for c in conditions)
    taken = {goal.word for goal in used if at in condition.resolve(goal.reference)}
    return _FirstWord(first.word, frozenset({first.word} if at in meant else taken))


def _taken_for(found: Sequence[_FirstWord]) -> Mapping[str, str]:
    """Return the confused words, each with the word that the policy mistakes it for.

    Each confused word needs evidence from two trials. If two words are mistaken for each other, one trial for each of
    them is enough.
    """
    cases: dict[str, list[frozenset[str]]] = defaultdict(list)
    for one in found:
        cases[one.word].append(one.taken)
    counts = {word: Counter(itertools.chain.from_iterable(seen)) for word, seen in cases.items()}
    taken: dict[str, str] = {}
    for word, count in counts.items():
        others = [w for w in count if w != word and count[w] >= NEARLY_ALL * len(cases[word])]
        if not others:
            continue
        best = min(others, key=lambda w: (-counts.get(w, Counter())[word], -count[w], w))
        if len(cases[word]) >= 2 or counts.get(best, Counter())[word]:
            taken[word] = best
    return taken


def wrong_places(failed: Sequence[TrialDiagnosis]) -> str:
    """Return a sentence if the policy brings correct objects to wrong targets in nearly all failures.

    Otherwise, return an empty string. The result is also empty if nearly all of these targets are those of training,
    because the failure is then a habit.

    Args:
        failed: The variation trials of the run that failed because of the policy's reasoning.
    """
    misplaced = [trial for trial in failed if _is_misplaced(trial)]
    habitual = sum(trial.evidence.rule == MEMORIZED_PLACE for trial in misplaced)
    if not misplaced or len(misplaced) < SHARE_OF_ALL * len(failed) or habitual >= SHARE_OF_ALL * len(misplaced):
        return ""
    return WRONG_PLACES


def _is_misplaced(trial: TrialDiagnosis) -> bool:
    """Return whether a trial's label was decided by evidence that a correct object was brought to a wrong target."""
    if trial.evidence.rule in ("place_of_another_instruction", MEMORIZED_PLACE):
        return True
    undecided = trial.label is Label.WRONG_OBJECT and trial.evidence.rule == "undecided"
    return undecided and bool(trial.intention_correct)
