"""What a record says about itself: which trial it is of, under which versions, and how the episode ended."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Any, Literal, get_args

from betterbench.errors import InvalidInputError, RecordError
from betterbench.state import SceneInfo

SCHEMA_VERSION = 1
"""Version of the record's columns and metadata; it moves when an older reader would misunderstand a newer file."""

Termination = Literal["success", "failure", "step_limit", "policy_error", "interrupted"]
"""Why an episode ended: the goal was met (or rightly left alone), it became unreachable or forbidden, the step limit
was reached, the policy broke its protocol, or the operator stopped it."""

TERMINATIONS: tuple[str, ...] = get_args(Termination)


@dataclass(frozen=True, slots=True)
class Outcome:
    """How an episode ended.

    Attributes:
        termination: Why it ended.
        success: Whether the trial counts as a success under its expected behavior.
        error: What went wrong, for "policy_error" and "interrupted".
        clipped_actions: Actions that had to be clipped to the bounds of the action space.
        invalid_actions: Answers of the policy that could not be executed.
    """

    termination: Termination
    success: bool
    error: str | None = None
    clipped_actions: int = 0
    invalid_actions: int = 0

    def __post_init__(self) -> None:
        """Refuse contradictory outcomes.

        Raises:
            InvalidInputError: If a field is out of range or success contradicts the termination.
        """
        if self.termination not in TERMINATIONS:
            problem = f"{self.termination!r} is no reason to end an episode"
            raise InvalidInputError("termination", problem, f"Use one of {', '.join(TERMINATIONS)}")
        if self.success and self.termination in ("failure", "policy_error", "interrupted"):
            raise InvalidInputError(
                "success", f"true although the episode ended by {self.termination}", "Give one of them"
            )
        for name in ("clipped_actions", "invalid_actions"):
            if getattr(self, name) < 0:
                raise InvalidInputError(name, f"{getattr(self, name)} is no count", "Give 0 or more")


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordMetadata:
    """What is known about an episode before it starts.

    Attributes:
        task: Task id.
        task_version: Version of the task.
        suite_version: Version of the suite, which also seeds its random streams.
        package_version: Version of betterbench that wrote the record.
        condition: Name of the condition within the task ("train1", "L3").
        variation: Name of the variation ("L3"), or None on a training condition.
        axis: Axis of the variation, or None on a training condition.
        base_condition: Training condition a variation is derived from; the same seed of it is the twin.
        interventions: The operations as text, in order.
        seed: Seed of the trial.
        policy: Address of the policy.
        instruction: The sentence the policy was given.
        expected: What a right policy does ("succeed", "refuse", "stay_still").
        action_space: Name of the action space.
        action_components: Name of each number of an action.
        control_rate_hz: Control steps per second [Hz].
        camera_preset: Name of the observation preset, or None when no image was rendered.
        render_quality: Name of the render preset, or None likewise.
        engine: Fingerprint of everything that can change the numbers: simulator and its version, renderer, model hash.
        scene_hash: Name of the stored scene ``scenes/HASH.zip``.
        scene: The unchanging truth about the scene.
        predicate_names: Meaning of each column of ``predicates``.
        subgoal_names: Meaning of each column of ``subgoals``, in the order asked for.
        schema_version: Version of the record format.
    """

    task: str
    task_version: int
    suite_version: str
    package_version: str
    condition: str
    variation: str | None
    axis: str | None
    base_condition: str | None
    interventions: tuple[str, ...] = ()
    seed: int
    policy: str
    instruction: str
    expected: str
    action_space: str
    action_components: tuple[str, ...]
    control_rate_hz: float
    camera_preset: str | None
    render_quality: str | None
    engine: Mapping[str, str]
    scene_hash: str
    scene: SceneInfo
    predicate_names: tuple[str, ...]
    subgoal_names: tuple[str, ...]
    schema_version: int = field(default=SCHEMA_VERSION)

    def to_json(self) -> dict[str, Any]:
        """Return the JSON form."""
        form: dict[str, Any] = {}
        for f in fields(self):
            value = getattr(self, f.name)
            form[f.name] = list(value) if isinstance(value, tuple) else value
        form["engine"] = dict(self.engine)
        form["scene"] = self.scene.to_json()
        return form

    @classmethod
    def from_json(cls, form: Mapping[str, Any]) -> RecordMetadata:
        """Read the JSON form.

        Raises:
            RecordError: If the schema version is another one, or a field is missing, unknown or of the wrong type.
        """
        version = form.get("schema_version")
        if version != SCHEMA_VERSION:
            raise RecordError(
                f"schema version {version!r} is not {SCHEMA_VERSION}, the one this version of betterbench reads; "
                "read it with the version that wrote it, or record the trial again"
            )
        values = dict(form)
        for name, check in _CHECKS.items():
            if name not in values:
                raise RecordError(f"metadata field {name!r} is missing; record the trial again")
            if not check(values[name]):
                raise RecordError(f"metadata field {name!r} cannot be {values[name]!r:.80}; record the trial again")
            if isinstance(values[name], list):
                values[name] = tuple(values[name])
        unknown = sorted(set(values) - set(_CHECKS))
        if unknown:
            raise RecordError(f"metadata field {unknown[0]!r} is unknown; read it with the version that wrote it")
        return cls(**{**values, "scene": SceneInfo.from_json(values["scene"])})


def _is_text(value: object) -> bool:
    return isinstance(value, str)


def _is_text_or_none(value: object) -> bool:
    return value is None or isinstance(value, str)


def _is_count(value: object) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and value >= 0


def _is_texts(value: object) -> bool:
    return isinstance(value, list) and all(isinstance(v, str) for v in value)


def _is_rate(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and 0.0 < value < float("inf")


def _is_text_map(value: object) -> bool:
    return isinstance(value, dict) and all(isinstance(v, str) for v in value.values())


def _is_object(value: object) -> bool:
    return isinstance(value, dict)


_CHECKS = {
    **dict.fromkeys(("task", "suite_version", "package_version", "condition", "policy", "instruction"), _is_text),
    **dict.fromkeys(("expected", "action_space", "scene_hash"), _is_text),
    **dict.fromkeys(("variation", "axis", "base_condition", "camera_preset", "render_quality"), _is_text_or_none),
    **dict.fromkeys(("task_version", "seed", "schema_version"), _is_count),
    **dict.fromkeys(("interventions", "action_components", "predicate_names", "subgoal_names"), _is_texts),
    "control_rate_hz": _is_rate,
    "engine": _is_text_map,
    "scene": _is_object,
}
"""What each field of the JSON form has to be. The form comes from files, which may come from strangers."""


def dump_json(form: object) -> bytes:
    """Return the one byte sequence that stands for a JSON value: sorted keys, no spaces, no NaN.

    Raises:
        InvalidInputError: If the value holds something that JSON cannot say.
    """
    try:
        text = json.dumps(form, sort_keys=True, separators=(",", ":"), ensure_ascii=False, allow_nan=False)
        return text.encode("utf-8")
    except (TypeError, ValueError) as error:
        raise InvalidInputError("metadata", str(error), "Use texts, finite numbers, lists and mappings only") from error
