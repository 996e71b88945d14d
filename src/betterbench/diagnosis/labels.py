"""Functions that gather all evidence in a trial and choose the trial's label."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

from betterbench.diagnosis.analysis.episode_analysis import EpisodeAnalysis
from betterbench.diagnosis.failure_mode import TrialView, labels_of_second_pass
from betterbench.diagnosis.modes import MODES
from betterbench.diagnosis.ruling import ALONE, RuleStatus, Ruling
from betterbench.diagnosis.verdict import Evidence
from betterbench.records import Record
from betterbench.tasks.labels import Kind, Label, all_labels

FIRST_STEP = "most_frequent_first_step"
"""Evidence rule for behavioral inertia. The second pass may reject this evidence."""


class LabelEvidence(NamedTuple):
    """Evidence in a trial, with the label that it supports."""

    label: Label
    evidence: Evidence


def gather(record: Record, episode: EpisodeAnalysis) -> tuple[LabelEvidence, ...]:
    """Return all evidence in a trial, in label order.

    If the trial succeeded, or if something other than the policy's decisions ended it, only the evidence for this
    outcome is returned. Otherwise, the evidence includes labels that the second pass must confirm.

    Returns:
        At least one piece of evidence.
    """
    view = TrialView(record, episode)
    return (
        _found(view, Kind.NONE, Kind.SYSTEM)
        or _with_harm(view, _found(view, Kind.REASONING, Kind.EXECUTION))
        or _with_harm(view, _found(replace(view, unexplained=True), Kind.REASONING, Kind.EXECUTION))
    )


def _with_harm(view: TrialView, findings: tuple[LabelEvidence, ...]) -> tuple[LabelEvidence, ...]:
    """Append a sentence about harm to the text of the evidence, unless the text already mentions this harm."""
    said = []
    for label, evidence in findings:
        clauses = [words for words in view.episode.harm_words() if words not in evidence.text]
        more = f" No success: {', '.join(clauses)}." if clauses else ""
        said.append(LabelEvidence(label, replace(evidence, text=evidence.text + more)))
    return tuple(said)


def _found(view: TrialView, *kinds: Kind) -> tuple[LabelEvidence, ...]:
    asked = [mode for mode in MODES.values() if mode.label.kind in kinds]
    found = ((mode.label, mode.find(view)) for mode in asked)
    return tuple(LabelEvidence(label, evidence) for label, evidence in found if evidence is not None)


_OF_ORDER = ("attempted_in_wrong_order", "required_step_skipped")
"""Evidence rules for attempts that a policy's favorite slot could explain as well."""


def decide(findings: Sequence[LabelEvidence], ruling: Ruling = ALONE) -> LabelEvidence:
    """Return the evidence that decides the label of a trial.

    The earliest evidence decides. If several pieces of evidence concern the same attempt, the evidence whose label
    comes first in label order decides. If the second pass cannot decide between rules for an attempt, the label is
    ``wrong_object`` with the remaining candidates, unless the object's appearance or a training habit explains the
    attempt. A wrong order does not count as an explanation here, since the same favorite slot would then be labeled as
    an order violation in ordered tasks and as a wrong object in all other tasks.
    """
    order, waiting = all_labels(), labels_of_second_pass()
    undecided: dict[float, tuple[Label, ...]] = {}
    for f in findings:
        if _status(f, ruling) == "open":
            undecided[f.evidence.start_s] = (*undecided.get(f.evidence.start_s, ()), f.label)
    known = {f.evidence.start_s for f in findings if f.label not in waiting}
    kept: list[tuple[float, int, LabelEvidence]] = []
    for finding in findings:
        (label, evidence), status = finding, _status(finding, ruling)
        if status == "rejected" or (status == "open" and evidence.start_s in known):
            continue  # other evidence about the same attempt takes precedence over an unproven label
        if status == "open":
            possible = undecided[evidence.start_s]
            label, evidence = Label.WRONG_OBJECT, replace(evidence, rule="undecided", candidates=_values(possible))
        elif evidence.start_s in undecided and label not in waiting:
            possible = (*undecided[evidence.start_s], *([] if label is Label.WRONG_OBJECT else [label]))
            evidence = replace(evidence, candidates=_values(possible))
            label = Label.WRONG_OBJECT if evidence.rule in _OF_ORDER else label
        kept.append((evidence.start_s, order.index(label), LabelEvidence(label, evidence)))
    if not kept:  # the only explanation of the trial was a rule that the second pass rejected
        return LabelEvidence(Label.WRONG_OBJECT, findings[0].evidence)
    return min(kept, key=lambda entry: entry[:2])[2]


def _status(finding: LabelEvidence, ruling: Ruling) -> RuleStatus:
    mode = MODES[finding.label]
    ruled = mode.needs_rule or finding.evidence.rule == FIRST_STEP
    return ruling.status(mode.rule) if ruled and mode.rule is not None else "upheld"


def _values(labels: Sequence[Label]) -> tuple[str, ...]:
    return tuple(label.value for label in labels)
