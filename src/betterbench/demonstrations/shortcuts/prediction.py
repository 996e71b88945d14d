"""Prediction, before training, of the variations that a policy trained on a data set will fail.

The prediction depends only on the shortcut audit. The risk of a variation increases with the number and the strength of
the rules that do not hold in it. A variation in which all rules hold has no predicted risk.
"""

from __future__ import annotations

import hashlib
import subprocess
from collections import Counter
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, TypeAdapter

from betterbench.demonstrations.shortcuts.examine import Finding, ShortcutAudit
from betterbench.demonstrations.shortcuts.questions import (
    COUNT,
    FIRST_OBJECT,
    FIRST_PLACE,
    HEADING,
    LANDMARK,
    LAST_PLACE,
    SEQUENCE,
    base_of,
)
from betterbench.diagnosis import modes as modes  # noqa: PLC0414 - registers the failure modes
from betterbench.diagnosis.failure_mode import exposed_labels
from betterbench.errors import InvalidInputError, MissingDependencyError, RecordError, last_line
from betterbench.jobs.durable import write_durably
from betterbench.json_form import Digest, dump_json, read_bounded, read_form, strict_form
from betterbench.ordinary_file import open_ordinary, read_ordinary
from betterbench.quoting import json_text
from betterbench.tasks import SUITE_VERSION, get_task, task_names
from betterbench.tasks.labels import Label
from betterbench.version import __version__

WEIGHTS = {
    "word_place": 0.9,
    "thing_place": 0.8,
    "first_step": 0.7,
    "thing_target": 0.7,
    "order": 0.6,
    "landmark_place": 0.6,
    LANDMARK: 0.6,
    FIRST_PLACE: 0.4,
    LAST_PLACE: 0.4,
    HEADING: 0.4,
    FIRST_OBJECT: 0.4,
    SEQUENCE: 0.4,
    "bystander_place": 0.2,
    COUNT: 0.3,
}
"""Assumed probability that a policy follows a rule of full strength, by question. These values were not measured.

Rules about two words or complete instructions have the same weight as rules about single words. A rule about the picked
object determines the complete trial, whereas a rule about other objects rarely has an effect.
"""

_LEXICAL, _LAYOUT = Label.LEXICAL_KINEMATIC_SHORTCUT, Label.VISUAL_LAYOUT_BIAS
_INERTIA, _ORDER, _COLLAPSE = Label.BEHAVIORAL_INERTIA, Label.ORDER_VIOLATION, Label.SEMANTIC_FEATURE_COLLAPSE
_CAUSAL, _PHASE, _HALT = Label.CAUSAL_CONFUSION, Label.PHASE_CONFLICT, Label.EARLY_HALT
LABELS: Mapping[str, tuple[Label, ...]] = {
    "word_place": (_COLLAPSE, _LEXICAL, _LAYOUT),
    "thing_place": (_COLLAPSE, _LAYOUT, _LEXICAL),
    "first_step": (_INERTIA, _ORDER, _PHASE),
    "thing_target": (_INERTIA, _LAYOUT),
    "order": (_ORDER, _INERTIA),
    "landmark_place": (_LAYOUT,),
    LANDMARK: (_LAYOUT,),
    FIRST_PLACE: (_LEXICAL, _INERTIA),
    LAST_PLACE: (_INERTIA, _PHASE),
    HEADING: (_LEXICAL, _INERTIA),
    FIRST_OBJECT: (_INERTIA, _ORDER),
    SEQUENCE: (_ORDER, _INERTIA),
    "bystander_place": (_CAUSAL, _LAYOUT),
    COUNT: (_PHASE, _CAUSAL),
}
"""Failure labels of a policy that follows a rule, by question, starting with the most likely label.

For each variation, only labels that are possible in the variation are used.
"""

NAMESPACE = "betterbench-prediction"
"""Namespace of the signatures that ``ssh-keygen -Y`` makes."""
_MAX_BYTES = 8 * 1024 * 1024
_CURE = "Use a file that `better dataset` or `better shortcuts` wrote"

Share = Annotated[float, Field(ge=0.0, le=1.0)]


@strict_form
@dataclass(frozen=True, slots=True)
class Forecast:
    """Prediction for one variation.

    Attributes:
        rank: Rank among all variations; 1 is the most likely failure.
        risk: Risk from 0 to 1. It is 0 if all rules found in the data hold in the variation.
        label: Most likely failure label; "" if the risk is 0.
        because: Rules that do not hold in the variation, each with the reason.
    """

    rank: int
    task: str
    variation: str
    axis: str
    risk: Share
    label: str
    because: tuple[str, ...]


@strict_form
@dataclass(frozen=True, slots=True)
class Prediction:
    """Predicted failures: the variations of a data set's tasks, ranked by their risk of failure.

    Attributes:
        source: Name of the audited data set.
        facts_sha256: SHA-256 of the facts on which the audit is based.
        dataset_sha256: SHA-256 of the demonstrations; "" if there is none.
        tasks: Tasks in the data set.
        variations: One forecast per variation of these tasks, in the order of the ranking.
        sha256: SHA-256 of all other fields.
    """

    format: Literal["betterbench-prediction"]
    schema_version: Literal[1]
    betterbench: str
    suite: str
    source: str
    facts_sha256: Digest
    dataset_sha256: Annotated[str, Field(pattern=r"^([0-9a-f]{64})?$")]
    tasks: tuple[str, ...]
    variations: tuple[Forecast, ...]
    sha256: Annotated[str, Field(pattern=r"^([0-9a-f]{64})?$")] = ""

    def sealed(self) -> Prediction:
        """Return a copy of the prediction with ``sha256`` computed from all other fields."""
        form = asdict(self)
        del form["sha256"]
        return replace(self, sha256=hashlib.sha256(dump_json(form)).hexdigest())

    def file_bytes(self) -> bytes:
        """Return the prediction as the JSON content of a file."""
        return (json_text(asdict(self), indent=1) + "\n").encode()

    def of(self, task: str, variation: str) -> Forecast:
        """Return the forecast for a variation of a task.

        Raises KeyError if the prediction does not cover the variation.
        """
        return {(f.task, f.variation): f for f in self.variations}[task, variation]


_FORM = TypeAdapter(Prediction)


def predict(audit: ShortcutAudit, *, dataset_sha256: str = "") -> Prediction:
    """Predict the variations of all audited tasks that a policy trained on the data set will fail.

    Raises InvalidInputError if no audited group is a known task.
    """
    groups = {group.group: group for group in audit.groups if group.group in task_names()}
    if not groups:
        cure = "Use demonstrations of tasks in the suite"
        raise InvalidInputError(audit.source, "it contains no known task", cure)
    found = []
    for name, group in groups.items():
        for variation in get_task(name).variations:
            broken = [(f, why) for f in group.shortcuts for test, why in f.separating if test == variation.name]
            risk = 1.0
            for finding, _ in broken:
                risk *= 1.0 - WEIGHTS[base_of(finding.question)] * finding.strength
            label = _label(name, variation.name, [finding for finding, _ in broken])
            because = tuple(f"{finding.title}: {why}" for finding, why in broken)
            found.append(
                Forecast(0, name, variation.name, variation.axis.value, round(1.0 - risk, 6), str(label), because)
            )
    found.sort(key=lambda f: (-f.risk, f.task, f.variation))
    ranked = tuple(replace(forecast, rank=rank) for rank, forecast in enumerate(found, start=1))
    version, suite = __version__, str(SUITE_VERSION)
    return Prediction(
        "betterbench-prediction",
        1,
        version,
        suite,
        audit.source,
        audit.facts_sha256,
        dataset_sha256,
        tuple(groups),
        ranked,
    ).sealed()


def _label(task: str, variation: str, broken: list[Finding]) -> str:
    """Return the most likely failure label in a variation, given the rules that do not hold in it.

    Each of these rules votes for the labels that it may cause, with its weight times its strength. Labels that cannot
    occur in the variation are not counted.
    """
    if not broken:
        return ""
    exposed = exposed_labels(task, variation)
    votes: Counter[Label] = Counter()
    for finding in broken:
        question = base_of(finding.question)
        for place, label in enumerate(LABELS[question]):
            if label in exposed:
                votes[label] += round(1000.0 * WEIGHTS[question] * finding.strength / (1 + place))
    if votes:
        return str(max(votes, key=lambda label: (votes[label], str(label))))
    others = [label for label in exposed if label != _HALT]
    return str(next(iter(others), _HALT if _HALT in exposed else Label.WRONG_OBJECT))


def read_prediction(path: Path) -> Prediction:
    """Read a prediction from a file.

    Raises RecordError if the file is not a prediction, or was changed after it was written.
    """
    data = read_bounded(path, max_bytes=_MAX_BYTES, cure=_CURE, raises=RecordError)
    found = read_form(_FORM, data, where=str(path), cure=_CURE, raises=RecordError)
    if found.sealed().sha256 != found.sha256:
        raise RecordError(f"{path}: its hash does not match, so the file was changed after it was written. {_CURE}.")
    return found


def write_prediction(path: Path, prediction: Prediction) -> None:
    """Write a prediction to a file. If the content changes, remove the signature of the earlier content."""
    data = prediction.file_bytes()
    if not path.exists() or read_ordinary(path) != data:
        _signature_of(path).unlink(missing_ok=True)
    write_durably(path, data)


def _signature_of(path: Path) -> Path:
    return path.with_name(f"{path.name}.sig")


def sign(path: Path, key: Path) -> Path:
    """Sign a file with an SSH key, using ``ssh-keygen -Y sign``. Return the path of the signature file.

    Raises:
        MissingDependencyError: If ssh-keygen is not installed.
        InvalidInputError: If the key cannot be used.
    """
    signature = _signature_of(path)
    try:
        open_ordinary(key).close()  # ssh-keygen would wait for a named pipe
    except (OSError, ValueError) as error:
        problem = f"{key} cannot be read ({getattr(error, 'strerror', None) or error})"
        raise InvalidInputError("--sign", problem, "Pass the file of a private SSH key") from error
    command = ["ssh-keygen", "-Y", "sign", "-n", NAMESPACE, "-f", str(key)]
    try:
        done = subprocess.run(  # noqa: S603 - the user's own key; the file goes in, and the signature comes out
            command, capture_output=True, input=read_ordinary(path), check=False
        )
    except FileNotFoundError as error:
        problem = "ssh-keygen is not installed. Install OpenSSH, or leave out --sign."
        raise MissingDependencyError(problem) from error
    if done.returncode or not done.stdout:
        problem = last_line(done.stderr.decode(errors="replace")) or f"ssh-keygen ended with {done.returncode}"
        raise InvalidInputError("--sign", problem, "Pass the file of a private SSH key without a passphrase")
    write_durably(signature, done.stdout)
    return signature
