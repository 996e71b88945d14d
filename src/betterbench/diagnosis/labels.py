"""Labels: which of all pieces of evidence decides a trial (suite, section 5)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

from betterbench.diagnosis import modes
from betterbench.diagnosis.episode_analysis import EpisodeAnalysis
from betterbench.diagnosis.verdict import Evidence
from betterbench.recording import Record
from betterbench.tasks import Expected
from betterbench.tasks.labels import Label

ORDER: tuple[Label, ...] = tuple(Label)
"""The order of the table of suite, section 5, with ``wrong_object`` after all other reasoning labels: it is general."""

_FIRST_ATTEMPT_RULES = (Label.LEXICAL_KINEMATIC_SHORTCUT, Label.VISUAL_LAYOUT_BIAS)


class LabelEvidence(NamedTuple):
    """One piece of evidence for one label.

    Attributes:
        label: The label it speaks for.
        evidence: The evidence.
    """

    label: Label
    evidence: Evidence


@dataclass(frozen=True, slots=True)
class Ruling:
    """What the second pass over a run says about one trial.

    Attributes:
        shortcut: Whether "the word leads there" is "upheld" by the policy's other trials, "rejected", or "open" because
            the run lacks the trials that would tell it from "always the same place".
        place: Whether "always the same place" is upheld and explains this trial.
    """

    shortcut: Literal["upheld", "rejected", "open"] = "open"
    place: bool = False


ALONE = Ruling()
"""The ruling on a trial that nobody compared with others."""


def success_label(expected: Expected) -> Label:
    """Return the label of a success under an expected behavior."""
    return {
        Expected.SUCCEED: Label.SUCCESS,
        Expected.STAY_STILL: Label.CORRECT_FREEZE,
        Expected.REFUSE: Label.CORRECT_REFUSAL,
    }[expected]


def gather(record: Record, episode: EpisodeAnalysis) -> tuple[LabelEvidence, ...]:
    """Return all evidence that a trial gives, in no order. The first two rules await the second pass.

    Args:
        record: The record.
        episode: Its episode.

    Returns:
        At least one finding.
    """
    expected = episode.condition.expected
    if record.outcome.success:
        label = success_label(expected)
        last = episode.trace.rows - 1
        text = {
            Label.SUCCESS: "The goal is met.",
            Label.CORRECT_FREEZE: "Nothing was to be done, and nothing was touched.",
            Label.CORRECT_REFUSAL: "The target is absent, and nothing forbidden was touched.",
        }[label]
        return (LabelEvidence(label, episode.evidence("goal", text, rows=(last, last))),)
    crashed = modes.policy_error.find(record)
    if crashed is not None:
        return (LabelEvidence(Label.POLICY_ERROR, crashed),)
    slot = None if episode.first_choice is None else episode.first_choice.grasp.slot
    found: dict[Label, Evidence | None] = {
        Label.LEXICAL_KINEMATIC_SHORTCUT: modes.lexical_kinematic_shortcut.find(episode),
        Label.VISUAL_LAYOUT_BIAS: modes.visual_layout_bias.find(episode, slot),
        Label.BEHAVIORAL_INERTIA: modes.behavioral_inertia.find(episode),
        Label.CAUSAL_CONFUSION: modes.causal_confusion.find(episode),
        Label.SEMANTIC_FEATURE_COLLAPSE: modes.semantic_feature_collapse.find(episode),
        Label.ORDER_VIOLATION: modes.order_violation.find(episode),
        Label.PHASE_CONFLICT: modes.phase_conflict.find(episode),
        Label.EARLY_HALT: modes.early_halt.find(episode),
        Label.WRONG_OBJECT: modes.wrong_object.find(episode),
        Label.EXECUTION_FAILURE: modes.execution_failure.find(episode),
    }
    findings = [LabelEvidence(label, evidence) for label, evidence in found.items() if evidence is not None]
    proven = [f for f in findings if f.label is not Label.VISUAL_LAYOUT_BIAS]
    if not proven:
        limit = record.outcome.termination == "step_limit"
        late = modes.timeout.find(episode, limit_reached=limit)
        findings.append(
            LabelEvidence(Label.EXECUTION_FAILURE, modes.timeout.unexplained(episode))
            if late is None
            else LabelEvidence(Label.TIMEOUT, late)
        )
    return tuple(findings)


def decide(findings: Sequence[LabelEvidence], ruling: Ruling = ALONE) -> LabelEvidence:
    """Return the finding that decides a trial.

    The first piece of evidence in time decides; for the same attempt the order of the table does. A shortcut that is
    neither upheld nor rejected keeps the label ``wrong_object`` with the labels that remain possible, unless something
    else explains the same attempt.

    Args:
        findings: All evidence of the trial.
        ruling: What the second pass says about it.
    """
    kept: list[tuple[float, int, LabelEvidence]] = []
    shortcut = {f.evidence.start_s for f in findings if f.label is Label.LEXICAL_KINEMATIC_SHORTCUT}
    for finding in findings:
        label, evidence = finding
        rank = ORDER.index(label)
        if label is Label.LEXICAL_KINEMATIC_SHORTCUT and ruling.shortcut != "upheld":
            if ruling.shortcut == "open":
                # What is not proven gives way to whatever else is known of the same attempt.
                undecided = replace(evidence, rule="undecided", candidates=tuple(r.value for r in _FIRST_ATTEMPT_RULES))
                rank = ORDER.index(Label.WRONG_OBJECT)
                kept.append((evidence.start_s, rank, LabelEvidence(Label.WRONG_OBJECT, undecided)))
            continue
        if label is Label.VISUAL_LAYOUT_BIAS and not ruling.place:
            continue
        if (
            ruling.shortcut == "open"
            and evidence.start_s in shortcut
            and label not in (*_FIRST_ATTEMPT_RULES, Label.WRONG_OBJECT)
        ):
            candidates = tuple(r.value for r in (*_FIRST_ATTEMPT_RULES, label))
            finding = LabelEvidence(label, replace(evidence, candidates=candidates))  # noqa: PLW2901 - the same finding, annotated
        kept.append((evidence.start_s, rank, finding))
    if not kept:  # only a place rule spoke, and it was not upheld
        return LabelEvidence(Label.WRONG_OBJECT, findings[0].evidence)
    return min(kept, key=lambda entry: (entry[0], entry[1]))[2]
