"""Differences between a new diagnosis and the stored diagnosis of the same run, with reasons for each changed trial."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from typing import Any, Literal, TypeVar

from betterbench.diagnosis.failure_mode import labels_of_second_pass
from betterbench.diagnosis.stored import StoredDiagnosis, StoredMetric, StoredTrial

_Key = TypeVar("_Key")
_Value = TypeVar("_Value")

Sort = Literal["label", "rule", "evidence", "record", "new", "gone"]
"""How a trial differs between the stored and the new diagnosis.

- "label": the same record has a different label.
- "rule": the label is the same, but a different rule decided it.
- "evidence": the same rule decided, but the evidence differs.
- "record": the record was replaced, because the run continued.
- "new", "gone": only the new diagnosis, or only the stored one, contains the trial.
"""

_SAME_TIME = 1e-6
"""Times that differ by at most this much are treated as equal [s]. A control step is 0.05 s."""


@dataclass(frozen=True, slots=True)
class ThresholdChange:
    """Threshold with different values in two diagnoses.

    If a diagnosis lacks the threshold, its value is None.
    """

    name: str
    before: float | None
    now: float | None


@dataclass(frozen=True, slots=True)
class TrialChange:
    """Trial with a changed diagnosis.

    Attributes:
        key: Key of the trial ("fast_food/T1/3").
        sort: Kind of the difference.
        before: Stored diagnosis, or None if the trial is new.
        now: New diagnosis, or None if the trial is gone.
        reasons: Reasons for the change that can be seen from the two diagnoses, each as a sentence without a period.
    """

    key: str
    sort: Sort
    before: StoredTrial | None
    now: StoredTrial | None
    reasons: tuple[str, ...]

    @property
    def labels(self) -> tuple[str, str]:
        """Stored label and new label of the trial. If a diagnosis does not contain the trial, its label is "none"."""
        return ("none" if self.before is None else self.before.label, "none" if self.now is None else self.now.label)

    def to_json(self) -> dict[str, Any]:
        """Return a JSON-serializable dict."""
        form: dict[str, Any] = {"key": self.key, "sort": self.sort, "reasons": list(self.reasons)}
        for side, trial in (("before", self.before), ("now", self.now)):
            form[side] = None if trial is None else asdict(trial)
        return form


@dataclass(frozen=True, slots=True)
class MetricChange:
    """Metric that differs between two diagnoses. If a diagnosis lacks the metric, its value is None."""

    name: str
    scope: str
    before: StoredMetric | None
    now: StoredMetric | None


@dataclass(frozen=True, slots=True)
class DiagnosisChanges:
    """Differences between a new and a stored diagnosis of the same run, in thresholds, trials and metrics."""

    version_before: str
    version_now: str
    thresholds: tuple[ThresholdChange, ...]
    trials: tuple[TrialChange, ...]
    metrics: tuple[MetricChange, ...]

    @property
    def other_rules(self) -> bool:
        """Whether the stored diagnosis was made by a different betterbench version or with different thresholds."""
        return self.version_before != self.version_now or bool(self.thresholds)

    @property
    def any(self) -> bool:
        """Whether the two diagnoses differ."""
        return self.other_rules or bool(self.trials) or bool(self.metrics)

    @property
    def counts(self) -> dict[tuple[str, str], int]:
        """Number of trials for each change of label (stored, new), most frequent change first.

        Trials with a replaced record are not counted.
        """
        changed = Counter(t.labels for t in self.of_sort("label"))
        return dict(sorted(changed.items(), key=lambda item: (-item[1], item[0])))

    def of_sort(self, *sorts: Sort) -> tuple[TrialChange, ...]:
        """Return the trials with a difference of one of the given kinds."""
        return tuple(t for t in self.trials if t.sort in sorts)

    def to_json(self) -> dict[str, Any]:
        """Return a JSON-serializable dict."""
        return {
            "version_before": self.version_before,
            "version_now": self.version_now,
            "thresholds": [asdict(t) for t in self.thresholds],
            "counts": [{"before": a, "now": b, "trials": n} for (a, b), n in self.counts.items()],
            "trials": [t.to_json() for t in self.trials],
            "metrics": [asdict(m) for m in self.metrics],
        }


def find_changes(before: StoredDiagnosis, now: StoredDiagnosis) -> DiagnosisChanges:
    """Compare a new diagnosis of a run with the stored diagnosis."""
    thresholds = tuple(ThresholdChange(n, a, b) for n, a, b in _differences(before.thresholds, now.thresholds))
    names = tuple(t.name for t in thresholds)
    trials = tuple(_trial(key, a, b, names) for key, a, b in _differences(before.trials, now.trials))
    metrics = tuple(MetricChange(*key, a, b) for key, a, b in _differences(before.metrics, now.metrics))
    return DiagnosisChanges(before.package_version, now.package_version, thresholds, trials, metrics)


def _differences(
    before: Mapping[_Key, _Value], now: Mapping[_Key, _Value]
) -> Iterator[tuple[_Key, _Value | None, _Value | None]]:
    """Yield each key with different values in two mappings, together with both values.

    The keys are in the order of the new mapping.
    """
    for key in (*now, *(k for k in before if k not in now)):
        a, b = before.get(key), now.get(key)
        if a != b:
            yield key, a, b


def _trial(key: str, before: StoredTrial | None, now: StoredTrial | None, thresholds: tuple[str, ...]) -> TrialChange:
    if before is None or now is None:
        new = before is None
        reason = "the trial is not in the stored diagnosis" if new else "the trial is not in the plan"
        return TrialChange(key, "new" if new else "gone", before, now, (reason,))
    record = _of_record(before, now)
    if record is not None:
        return TrialChange(key, "record", before, now, (record,))
    sort: Sort = "label" if before.label != now.label else "rule" if before.rule != now.rule else "evidence"
    return TrialChange(key, sort, before, now, tuple(_reasons(before, now, thresholds)))


def _of_record(before: StoredTrial, now: StoredTrial) -> str | None:
    """Return a clause that describes how the record of a trial was replaced, or None if there is no sign of that."""
    if before.has_record != now.has_record:
        return "the trial has a record now" if now.has_record else "its record is missing"
    if (before.steps, before.success) != (now.steps, now.success):
        return f"its record was replaced ({_ended(before)} before, {_ended(now)} now)"
    return None


def _reasons(before: StoredTrial, now: StoredTrial, thresholds: tuple[str, ...]) -> Iterator[str]:
    """Yield the possible causes of a difference between two diagnoses of the same record."""
    if thresholds:
        yield f"{'threshold' if len(thresholds) == 1 else 'thresholds'} {', '.join(thresholds)} changed"
    same_attempts = before.attempts == now.attempts
    if not same_attempts:
        a, b = len(before.attempts), len(now.attempts)
        yield f"{b} grasp attempts are seen instead of {a}" if a != b else "the grasp attempts are read differently"
    given = {before.label, now.label} & set(labels_of_second_pass()) or before.candidates != now.candidates
    if same_attempts and given and (before.label, before.rule) != (now.label, now.rule):
        yield f"the second pass rules differently on the attempt at {min(before.start_s, now.start_s):.2f} s"
    else:
        yield _of_rules(before, now)


def _of_rules(before: StoredTrial, now: StoredTrial) -> str:
    """Return a clause that describes how the rule that decided the label has changed."""
    same = before.rule == now.rule
    later = now.start_s - before.start_s
    if later < -_SAME_TIME:
        there = "" if same else f" {before.rule}"
        return f"rule {now.rule} fires earlier, at {now.start_s:.2f} s before{there} at {before.start_s:.2f} s"
    if later > _SAME_TIME:
        if same:
            return f"rule {now.rule} fires later, at {now.start_s:.2f} s instead of {before.start_s:.2f} s"
        return (
            f"rule {before.rule} no longer decides at {before.start_s:.2f} s; rule {now.rule} does at "
            f"{now.start_s:.2f} s"
        )
    if not same:
        return f"at {now.start_s:.2f} s rule {now.rule} decides instead of {before.rule}"
    if before.label != now.label:
        return f"rule {now.rule} gives another label"
    if abs(before.end_s - now.end_s) > _SAME_TIME:
        return f"the evidence of rule {now.rule} ends at {now.end_s:.2f} s instead of {before.end_s:.2f} s"
    if before.text != now.text:
        return f"rule {now.rule} gives the same evidence with another text"
    return f"rule {now.rule} decides as before; only the listed attempts or candidates differ"


def _ended(trial: StoredTrial) -> str:
    return f"{trial.steps} steps and {'success' if trial.success else 'no success'}"
