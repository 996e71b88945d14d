"""Confusion matrix of the diagnosis, and recall and precision of each label, measured on policies with known faults."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from importlib import resources
from typing import Any

from pydantic import TypeAdapter

from betterbench.diagnosis.measures.forms import LabelField
from betterbench.errors import RecordError
from betterbench.json_form import open_form, open_seal, read_form, sealed_form
from betterbench.statistics import Rate
from betterbench.tasks.labels import Kind, Label, all_labels

FAMILIES: dict[str, str] = {
    "faulty": "Every faulty policy moves as well as the expert and follows one wrong rule. It reports its own first "
    "wrong decision; the diagnosis uses only the records.",
    "development": "Every policy of the independent family has one faulty behavior in one of three motion styles, with "
    "its own controller. Its true label is stated before the first action. The diagnosis was developed on this part.",
    "held_out": "Every policy of the independent family has one faulty behavior in one of three motion styles, with "
    "its own controller. Its true label is stated before the first action. This part was not used to develop the "
    "diagnosis.",
    "second": "Every policy of the independent family has one faulty behavior in one of three motion styles, with its "
    "own controller. Its true label is stated before the first action. The author of this part had not seen the "
    "diagnosis.",
    "third": "Every policy of the independent family has one faulty behavior in one of three motion styles, with its "
    "own controller. Its true label is stated before the first action. The author of this part had not seen the "
    "diagnosis, and excluded conditions with debatable labels.",
    "fourth": "Every policy of the independent family has one faulty behavior in one of three new motion styles, with "
    "its own controller. Its true label is stated before the first action. The author of this part had not seen the "
    "diagnosis, and chose behaviors whose label follows from the suite's definitions alone.",
    "fifth": "Every policy of the independent family has one faulty behavior in one of three new motion styles, with "
    "its own controller. Its true label is stated before the first action. The author of this part had not seen the "
    "diagnosis or its results on other parts, and a third of the failures are without a grasp attempt.",
    "sixth": "Every policy of the independent family has one faulty behavior in one of three new motion styles, with "
    "its own controller. Its true label is stated before the first action. The author of this part had not seen the "
    "diagnosis or its results on other parts, and chose faults that are known from learned policies.",
}
"""Descriptions of the sets of policies on which the diagnosis is measured, in the order in which they were written.

The first set contains the faulty policies of betterbench. The others are parts of the independent family. The accuracy
that the documentation states was measured on the last set, which was used only once.
"""

CLAIMED = next(reversed(FAMILIES))
"""Set of policies on which the stated accuracy of the diagnosis was measured."""


def packaged_file(family: str) -> str:
    """Return the name of the calibration file for a set of policies. The file is in the package's folder ``data``."""
    return "calibration.json" if family == "faulty" else f"calibration_{family}.json"


@open_form
@dataclass(frozen=True, slots=True)
class Judged:
    """Trial of a policy with a known fault, with the true label and the diagnosed label.

    Attributes:
        policy: Name of the policy.
        trial: Key of the trial ("fast_food/T1/3").
        truth: True label.
        label: Label given by the diagnosis.
        fault: Wrong decision that the policy made, as stated by the policy itself.
        rule: Evidence rule that decided the diagnosed label.
        text: Explanation given by the diagnosis.
        grasped: Whether the record contains a grasp attempt.
        honest: Whether the policy has no fault.
        debatable: Reason why a careful reader of the suite might assign a different label. Empty if there is none.
    """

    policy: str
    trial: str
    truth: LabelField
    label: LabelField
    fault: str
    rule: str
    text: str
    grasped: bool = True
    honest: bool = False
    debatable: str = ""

    @property
    def right(self) -> bool:
        """Whether the diagnosed label is the true label."""
        return self.truth is self.label

    @property
    def crossed(self) -> bool:
        """Whether a reasoning failure was diagnosed as an execution failure or vice versa."""
        return {self.truth.kind, self.label.kind} == {Kind.REASONING, Kind.EXECUTION}


@dataclass(frozen=True, slots=True)
class LabelScore:
    """Recall and precision of one label.

    Attributes:
        label: The label.
        recall: Fraction of correct diagnoses among the trials with this true label.
        precision: Fraction of correct diagnoses among the trials that were diagnosed with this label.
    """

    label: Label
    recall: Rate
    precision: Rate


@dataclass(frozen=True, slots=True)
class Calibration:
    """Measured accuracy of the diagnosis on policies with known faults.

    Attributes:
        counts: Number of trials by true label and diagnosed label.
        policies: For each policy, the fraction of its trials that were labeled correctly.
        wrong: Trials that were labeled incorrectly.
        crossed: Number of trials in which a reasoning failure was labeled as an execution failure, or vice versa.
        versions: Versions used to measure the calibration.
        without_grasp: Fraction of correctly labeled trials among the failed trials without a grasp attempt.
        accused: Fraction of trials of policies without a fault that were labeled as a reasoning failure (false alarms).
        left_out: Number of trials that were left out, because they are not evidence about the policy's fault.
    """

    counts: dict[tuple[Label, Label], int]
    policies: dict[str, Rate]
    wrong: tuple[Judged, ...]
    crossed: int
    versions: dict[str, str]
    without_grasp: Rate
    accused: Rate
    left_out: int

    @classmethod
    def of(cls, trials: Iterable[Judged], *, versions: dict[str, str] | None = None, left_out: int = 0) -> Calibration:
        """Compute the accuracy of the diagnosis from trials with their true and diagnosed labels."""
        judged = list(trials)
        per_policy: dict[str, list[bool]] = {}
        for j in judged:
            per_policy.setdefault(j.policy, []).append(j.right)
        return cls(
            dict(Counter((j.truth, j.label) for j in judged)),
            {policy: Rate(sum(found), len(found)) for policy, found in per_policy.items()},
            tuple(j for j in judged if not j.right),
            sum(j.crossed for j in judged),
            dict(versions or {}),
            _share(j.right for j in judged if not j.grasped and j.truth.kind is not Kind.NONE),
            _share(j.label.kind is Kind.REASONING for j in judged if j.honest),
            left_out,
        )

    @property
    def total(self) -> int:
        """Number of judged trials."""
        return sum(self.counts.values())

    @property
    def overall(self) -> Rate:
        """Fraction of all trials that were labeled correctly."""
        return Rate(sum(n for (truth, label), n in self.counts.items() if truth is label), self.total)

    @property
    def failed(self) -> Rate:
        """Fraction of correctly labeled trials among the trials that are truly failures.

        Successes are left out because they are easier to label.
        """
        counts = [(truth is label, n) for (truth, label), n in self.counts.items() if truth.kind is not Kind.NONE]
        return Rate(sum(n for right, n in counts if right), sum(n for _, n in counts))

    @property
    def failed_kinds(self) -> Rate:
        """Fraction of trials labeled with the correct kind of failure, among the trials that are truly failures."""
        counts = [(t.kind is g.kind, n) for (t, g), n in self.counts.items() if t.kind is not Kind.NONE]
        return Rate(sum(n for right, n in counts if right), sum(n for _, n in counts))

    @property
    def crossed_rate(self) -> Rate:
        """Fraction of all reasoning and execution failures that were labeled as the opposite kind of failure."""
        kinds = (Kind.REASONING, Kind.EXECUTION)
        return Rate(self.crossed, sum(n for (truth, _), n in self.counts.items() if truth.kind in kinds))

    @property
    def labels(self) -> tuple[Label, ...]:
        """All labels that occur as true or diagnosed labels, in the order of the suite's table."""
        met = {label for pair in self.counts for label in pair}
        return tuple(label for label in all_labels() if label in met)

    def scores(self) -> tuple[LabelScore, ...]:
        """Return the recall and precision of every label that occurs as a true label."""
        scores = []
        for label in self.labels:
            deserved = sum(n for (truth, _), n in self.counts.items() if truth is label)
            given = sum(n for (_, found), n in self.counts.items() if found is label)
            both = self.counts.get((label, label), 0)
            if deserved:
                scores.append(LabelScore(label, Rate(both, deserved), Rate(both, given)))
        return tuple(scores)

    def to_json(self) -> dict[str, Any]:
        """Return a JSON-serializable dict."""
        return {
            "counts": [
                {"truth": truth.value, "label": label.value, "n": n}
                for (truth, label), n in sorted(self.counts.items(), key=lambda item: [x.value for x in item[0]])
            ],
            "policies": {name: {"k": rate.k, "n": rate.n} for name, rate in sorted(self.policies.items())},
            "wrong": [{**asdict(j), "truth": j.truth.value, "label": j.label.value} for j in self.wrong],
            "crossed": self.crossed,
            "without_grasp": asdict(self.without_grasp),
            "accused": asdict(self.accused),
            "left_out": self.left_out,
            "versions": self.versions,
        }

    def file_bytes(self) -> bytes:
        """Serialize the calibration to JSON bytes, including a checksum."""
        return (json.dumps(sealed_form({"version": 2, **self.to_json()}), indent=1) + "\n").encode()

    @classmethod
    def from_json(cls, raw: bytes, *, where: str) -> Calibration:
        """Read the calibration from a JSON document.

        Args:
            raw: Content of the document.
            where: Name of the document in error messages.

        Raises:
            RecordError: If a field is missing or malformed, or the checksum does not match.
        """
        cure = "Run `better calibrate` again to write a new file"
        form = open_seal(raw, where=where, cure=cure, raises=RecordError, since=("version", 2))
        file = read_form(_FILE, form, where=where, cure=cure, raises=RecordError)
        return cls(
            {(c.truth, c.label): c.n for c in file.counts},
            file.policies,
            file.wrong,
            file.crossed,
            file.versions,
            file.without_grasp,
            file.accused,
            file.left_out,
        )


@open_form
@dataclass(frozen=True, slots=True)
class _CountForm:
    truth: LabelField
    label: LabelField
    n: int


@open_form
@dataclass(frozen=True, slots=True)
class _File:
    counts: list[_CountForm]
    policies: dict[str, Rate]
    wrong: tuple[Judged, ...]
    crossed: int
    without_grasp: Rate
    accused: Rate
    left_out: int
    versions: dict[str, str]


_FILE = TypeAdapter(_File)


def packaged_calibration(family: str = "faulty") -> Calibration | None:
    """Return the packaged calibration for a set of policies, or None if the package does not contain it.

    Raises:
        RecordError: If the packaged file is corrupt.
    """
    file = resources.files("betterbench.diagnosis").joinpath("data", packaged_file(family))
    return Calibration.from_json(file.read_bytes(), where=packaged_file(family)) if file.is_file() else None


def _share(found: Iterable[bool]) -> Rate:
    """Return the fraction of True values as a rate with its numerator and denominator."""
    values = list(found)
    return Rate(sum(values), len(values))
