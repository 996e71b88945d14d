"""Class for registering a failure mode, used by each file in ``modes``, and the input of the detectors."""

from __future__ import annotations

import functools
from collections import Counter
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType

from betterbench.diagnosis.analysis.episode_analysis import EpisodeAnalysis
from betterbench.diagnosis.exposure import Exposure
from betterbench.diagnosis.thresholds import SHARE_OF_ALL
from betterbench.diagnosis.verdict import Evidence, TrialDiagnosis
from betterbench.errors import InvalidInputError, Place, one_line, registering_place
from betterbench.records import Record
from betterbench.tasks.labels import Kind, Label, all_labels
from betterbench.tasks.user_files import registered


@dataclass(frozen=True, slots=True, eq=False)
class TrialView:
    """Input of a detector: the record of a trial and the analysis of the record.

    Attributes:
        record: Record of the trial, with its outcome.
        episode: Analysis of the record, including every grasp attempt and placement.
        unexplained: Whether this is the second call of the detectors, after none of them found evidence in the first
            call.
    """

    record: Record
    episode: EpisodeAnalysis
    unexplained: bool = False

    @property
    def out_of_time(self) -> bool:
        """Whether the episode reached its step limit before or in the step in which the last subgoal was done."""
        done = self.episode.trace.done
        all_done_once = bool(done.shape[1]) and bool(done.any(axis=0).all())
        just_reached = bool(self.record.goal[self.episode.trace.rows - 1])
        return self.record.outcome.termination == "step_limit" and (just_reached or not all_done_once)


Finder = Callable[[TrialView], Evidence | None]
"""Function that returns the first evidence of a failure mode in a trial, or None if there is none."""


@dataclass(frozen=True, slots=True)
class FailureMode:
    """Failure mode or other outcome label, with its detector and its texts for tables and reports.

    An instance is used as the decorator of its detector. This registers the label and the detector together.

    Attributes:
        label: Label of the mode.
        short: Name of one or two words, for bar charts.
        definition: Condition that the record must meet, in one sentence.
        conclusion: Conclusion about a policy that fails mostly in this mode, in one sentence.
        sharper: Function that returns a more specific conclusion from the trials with this mode, or an empty string.
        finding: Beginning of the sentence that counts the trials with this mode. Empty if the mode yields no finding.
        detail: Function that returns the end of that sentence, with the properties that these trials have in common.
        rule: Kind of decision rule that explains the mode in the second pass (see ``ruling``). None if no rule does.
        needs_rule: Whether the second pass must confirm the rule before the mode is assigned. Without this
            confirmation, the trial is labeled ``wrong_object``.
        exposed_by: Function that returns whether a variation can reveal this mode. None if every variation can.
        title: Full name, if it differs from the label.
        find: The detector.
    """

    label: Label
    short: str
    definition: str
    conclusion: str = ""
    sharper: Callable[[Sequence[TrialDiagnosis]], str] | None = None
    finding: str = ""
    detail: Callable[[Sequence[TrialDiagnosis]], str] | None = None
    rule: str | None = None
    needs_rule: bool = False
    exposed_by: Callable[[Exposure], bool] | None = None
    title: str = ""
    find: Finder = field(default=lambda _: None, repr=False)

    def __call__(self, find: Finder) -> Finder:
        """Register the failure mode with its detector.

        Raises:
            InvalidInputError: If the label already has a failure mode.
        """
        if self.label in _MODES:
            raise InvalidInputError(
                "failure mode", f"{self.label} is already registered", "Register the failure mode with a new label"
            )
        here = registering_place()
        find = registered("failure mode", self.label.value, _checked(find, self.label, here), _MODES)
        known = {**_MODES, self.label: replace(self, find=find)}
        _MODES.clear()
        _MODES.update((label, known[label]) for label in all_labels() if label in known)
        _REGISTERED_AT[self.label] = here
        return find

    @property
    def name(self) -> str:
        """Full name of the failure mode."""
        return self.title or self.label.value.replace("_", " ").capitalize()

    def conclude(self, trials: Sequence[TrialDiagnosis]) -> str:
        """Return the conclusion about a policy from its trials with this failure mode."""
        return (self.sharper(trials) if self.sharper is not None and trials else "") or self.conclusion

    @property
    def family(self) -> str:
        """Group of the label: "right", "reasoning", "execution" or "system". It determines the color in figures."""
        return "right" if self.label.kind is Kind.NONE else self.label.kind.value


def _checked(find: Finder, label: Label, here: Place) -> Finder:
    """Return the finder with a check of its result. Errors name the place at which its failure mode is registered."""

    @functools.wraps(find)
    def checked(trial: TrialView) -> Evidence | None:
        found: object = find(trial)
        if found is None or isinstance(found, Evidence):
            return found
        problem = f"the finder of {label} returned {one_line(repr(found), most=80)}, not Evidence or None"
        raise InvalidInputError(str(here), problem, "Return trial.episode.evidence(rule, text, ...), or None")

    return checked


def sharper_by_rule(sentences: Mapping[str, str]) -> Callable[[Sequence[TrialDiagnosis]], str]:
    """Return a function that chooses one of the given sentences for a list of trials.

    It returns the sentence of the evidence rule that decided the label in nearly all of the trials. It returns an empty
    string if there is no such rule, or if no sentence is given for the rule.
    """

    def sharper(trials: Sequence[TrialDiagnosis]) -> str:
        rule, count = Counter(trial.evidence.rule for trial in trials).most_common(1)[0]
        return sentences.get(rule, "") if count >= SHARE_OF_ALL * len(trials) else ""

    return sharper


_MODES: dict[Label, FailureMode] = {}

MODES: Mapping[Label, FailureMode] = MappingProxyType(_MODES)
"""All failure modes by label, in label order. They are registered when ``diagnosis.modes`` is imported."""

_REGISTERED_AT: dict[Label, Place] = {}


def places_of_modes() -> Collection[Place]:
    """Return the places at which failure modes have been registered."""
    return _REGISTERED_AT.values()


def remove_mode(label: Label) -> None:
    """Remove a registered failure mode. This is meant for tests."""
    del _MODES[label], _REGISTERED_AT[label]


def labels_of_second_pass() -> tuple[Label, ...]:
    """Return the labels that only the second pass assigns, because it considers all trials of a policy together."""
    return tuple(mode.label for mode in MODES.values() if mode.needs_rule)


def exposed_labels(task_id: str, variation: str) -> tuple[Label, ...]:
    """Return the labels of the failure modes that a variation can reveal, in label order.

    Raises:
        UnknownNameError: If the task or variation does not exist.
    """
    exposure = Exposure.of(task_id, variation)
    return tuple(m.label for m in MODES.values() if m.exposed_by is not None and m.exposed_by(exposure))
