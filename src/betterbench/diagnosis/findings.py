"""Sentences about findings from several trials of a policy, and notes about the limits of a run."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence

from betterbench.diagnosis.failure_mode import FailureMode
from betterbench.diagnosis.modes import MODES
from betterbench.diagnosis.rule_likelihood import PolicyRule, place_rule
from betterbench.diagnosis.ruling import PLACE
from betterbench.diagnosis.task_rules import TaskRules
from betterbench.diagnosis.verdict import OUTCOME_ALONE, TrialDiagnosis
from betterbench.statistics import Rate, fisher_p, smallest_paired_difference
from betterbench.statistics.power import DEFAULT_ALPHA
from betterbench.statistics.wording import p_text
from betterbench.tasks.labels import Kind, Label
from betterbench.wording import plural

_SHOWN = 5
"""Number of trials that a note lists before it ends with "…"."""


def find_findings(trials: Sequence[TrialDiagnosis], rules: Mapping[str, TaskRules]) -> tuple[str, ...]:
    """Return one sentence for each failure mode that occurs in a task.

    Reasoning failures come before execution failures, and frequent failure modes come first.
    """
    groups: dict[tuple[str, Label], list[TrialDiagnosis]] = defaultdict(list)
    planned: dict[tuple[str, str], int] = defaultdict(int)
    for t in trials:
        planned[t.task, t.variation or t.condition] += 1
        if MODES[t.label].finding:
            groups[t.task, t.label].append(t)
    ranked = sorted(
        groups.items(),
        key=lambda item: (item[0][1].kind is not Kind.REASONING, -len(item[1]), item[0][0], item[0][1].value),
    )
    sentences = []
    for (task, label), members in ranked:
        names = sorted({t.variation or t.condition for t in members})
        n = sum(planned[task, name] for name in names)
        mode = MODES[label]
        subject = mode.finding + ("" if mode.detail is None else mode.detail(members))
        if all(t.evidence.rule == OUTCOME_ALONE for t in members):
            subject = "The step limit is reached"
        sentence = f"{subject}: {len(members)}/{n} trials of {task} {', '.join(names)}"
        sentences.append(sentence + _proof(mode, members, rules.get(task)) + ".")
    return tuple(sentences)


def find_notes(
    trials: Sequence[TrialDiagnosis],
    rules: Mapping[str, TaskRules],
    missing: Sequence[str],
    pairs: int,
    *,
    pending: int = 0,
    even_pairs: int | None = None,
    cure: str = "run their training conditions with the same seeds",
) -> tuple[str, ...]:
    """Return one sentence for each limit of the run's evidence, such as missing trials.

    Args:
        trials: The trials of the run.
        rules: Rules that explain the first attempts, by task.
        missing: Keys of the trials that have no record because of an error.
        pairs: Number of pairs of a variation trial and its training twin (the training trial with the same seed).
        pending: Number of planned trials that are not done yet.
        even_pairs: Number of pairs in the first round of a run with ``--until-decided``. None for other runs.
        cure: Advice for variation trials without a training twin, as a clause.
    """
    notes = []
    if pending:
        notes.append(
            f"The run is in progress. {len(trials)} of {len(trials) + pending} planned trials are done, and the other "
            f"{pending} are not counted yet. The order of the trials depends on the machine, so the numbers will still "
            f"change."
        )
    if missing:
        one = len(missing) == 1
        notes.append(
            f"{plural(len(missing), 'planned trial')} {'has' if one else 'have'} no record and "
            f"{'counts' if one else 'count'} as policy_error: {_first_few(missing)}. Run the same command again to "
            f"repeat {'it' if one else 'them'}."
        )
    left = [t.key for t in trials if t.kind is Kind.UNFINISHED]
    if left:
        notes.append(
            f"{len(left)} of {len(trials)} planned trials are unfinished ({_first_few(left)}). They count in the "
            f"denominator of every rate, but not as failures of any kind, and not in pairs. Run the same command again "
            f"to finish them."
        )
    for task, found in sorted(rules.items()):
        if found.undecided:
            notes.append(
                f"{task}: {found.undecided} trials keep the label wrong_object, because the run is too small to prove "
                f"or distinguish the rules 'the word leads there' and 'always the same place'. Run the training "
                f"conditions "
                "and all variations of the task with the same seeds."
            )
    ambiguous = sum(t.ambiguous for t in trials)
    if ambiguous:
        have = "has" if ambiguous == 1 else "have"
        notes.append(
            f"{plural(ambiguous, 'trial')} with a broken premise {have} no right or wrong outcome, so no rate, gap or "
            f"finding counts them."
        )
    paired = [t for t in trials if t.variation is not None and not t.ambiguous]
    lonely = sum(t.kind is not Kind.UNFINISHED for t in paired) - pairs
    if lonely and pending:
        wait = "1 trial still lacks its" if lonely == 1 else f"{lonely} trials still lack their"
        notes.append(f"{wait} counterfactual twin and is not in the illusion gap yet.")
    elif lonely:
        notes.append(
            f"{lonely} trials have no counterfactual twin in the run and are left out of the illusion gap. To include "
            f"them, {cure}."
        )
    pairs = pairs if even_pairs is None else even_pairs
    if pairs:
        smallest = smallest_paired_difference(pairs)
        if smallest.value is None:
            notes.append(f"{plural(pairs, 'pair')} cannot detect any difference at 80 % power ({smallest.assumption}).")
        else:
            notes.append(
                f"The smallest difference that {plural(pairs, 'pair')} can detect at 80 % power is "
                f"{100 * smallest.value:.1f} percentage points ({smallest.assumption})."
            )
    return tuple(notes)


def _first_few(keys: Sequence[str]) -> str:
    return ", ".join(keys[:_SHOWN]) + (", …" if len(keys) > _SHOWN else "")


def _proof(mode: FailureMode, members: Sequence[TrialDiagnosis], found: TaskRules | None) -> str:
    """Return a clause with the statistical evidence for the decision rule that explains a failure mode.

    If no rule explains it, return an empty string.
    """
    if found is None or mode.rule is None:
        return ""
    slot = next((t.first_slot for t in members if t.first_slot is not None), None)
    if mode.rule == PLACE:  # Slots at the same position share one name.
        rule = _rule(found, place_rule(slot or "")) or next(
            (r for r in found.rules if r.family == PLACE and r.name in found.upheld), None
        )
    else:
        rule = _rule(found, mode.rule)
    if rule is None or rule.explained > rule.opportunities:
        return ""
    here, there = Rate(rule.explained, rule.opportunities), Rate(rule.errors_elsewhere, rule.elsewhere)
    place = f" (slot {rule.slot!r})" if rule.slot else " (one slot per arrangement)" if rule.name == PLACE else ""
    text = f"; followed in {here.k}/{here.n} trials in which the rule is wrong{place}"
    if there.n:
        p = fisher_p(here, there)
        text += f", against {there.k}/{there.n} errors in trials in which it is right (Fisher's exact test, {p_text(p)}"
        text += ")" if p <= DEFAULT_ALPHA else ": these counts alone do not show that it follows this rule)"
    return text


def _rule(found: TaskRules, name: str) -> PolicyRule | None:
    return next((r for r in found.rules if r.name == name and r.name in found.upheld), None)
