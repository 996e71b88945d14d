"""Metadata of a record: the trial, the versions, and the outcome of the episode."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Annotated, Any, Literal, get_args

from pydantic import Field

from betterbench.errors import InvalidInputError
from betterbench.interface.state import NO_JITTER, SceneInfo, ViewJitter
from betterbench.json_form import strict_form
from betterbench.records.demonstration import Demonstrator, SubgoalSegment
from betterbench.tasks import Looks

SCHEMA_VERSION = 1
"""Version of the columns and metadata of a record.

Increase it when older versions of betterbench would misinterpret a new file.
"""

Termination = Literal["success", "failure", "step_limit", "policy_error", "interrupted"]
"""Reason why an episode ended.

- "success": the goal was met, or doing nothing was correct.
- "failure": the goal could no longer be met, or a forbidden interaction happened.
- "step_limit": the step limit was reached.
- "policy_error": the policy crashed, answered too late or violated the policy protocol.
- "interrupted": the operator stopped the episode.
"""

_Count = Annotated[int, Field(ge=0)]

TERMINATIONS: tuple[str, ...] = get_args(Termination)


@strict_form
@dataclass(frozen=True, slots=True)
class Outcome:
    """Outcome of an episode.

    Attributes:
        termination: Reason why the episode ended.
        success: Whether the trial is a success, i.e. whether the policy showed the expected behavior.
        error: Description of the error, for "policy_error" and "interrupted".
        clipped_actions: Number of actions that were clipped to the bounds of the action space.
        invalid_actions: Number of replies of the policy that could not be executed.
    """

    termination: Termination
    success: bool
    error: str | None = None
    clipped_actions: int = 0
    invalid_actions: int = 0

    def __post_init__(self) -> None:
        """Raise InvalidInputError if the outcome is inconsistent."""
        if self.termination not in TERMINATIONS:
            problem = f"{self.termination!r} is not a valid termination"
            raise InvalidInputError("termination", problem, f"Use one of {', '.join(TERMINATIONS)}")
        if self.success and self.termination in ("failure", "policy_error", "interrupted"):
            raise InvalidInputError(
                "success",
                f"is True although the episode ended by {self.termination}",
                "Correct either the success or the termination",
            )
        for name in ("clipped_actions", "invalid_actions"):
            if getattr(self, name) < 0:
                raise InvalidInputError(name, f"{getattr(self, name)} is negative", "Use a number ≥ 0")


@strict_form
@dataclass(frozen=True, slots=True, kw_only=True)
class RecordMetadata:
    """Metadata of an episode, which is fixed before the episode begins.

    Attributes:
        suite_version: Version of the suite. The random streams of the suite depend on it.
        condition: Name of the condition within the task ("train1", "L3").
        variation: Name of the variation ("L3"), or None for a training condition.
        axis: Axis of the variation, or None for a training condition.
        base_condition: Training condition from which a variation is derived. The variation's twin is the trial of this
            condition with the same seed.
        interventions: The interventions as text, in order.
        expected: Behavior that is expected of a correct policy ("succeed", "refuse", "stay_still").
        action_components: Name of each number in an action.
        camera_preset: Name of the observation preset, or None if no image was rendered.
        render_quality: Name of the render preset, or None if no image was rendered.
        engine: Versions that affect the results: the simulator with its version, the renderer, and the hash of the
            model.
        scene_hash: Name under which the scene is stored (``scenes/HASH.zip``).
        looks: Set of object variants and rooms that the run used ("seen" or "unseen").
        room: Name of the trial's room.
        view_jitter: Offsets of the cameras and the key light. Together with the scene and the state, these offsets
            determine the images.
        robot_dynamics: Drawn dynamics of the robot by quantity, with one value per joint of the arm and the gripper.
            "backlash" is in rad. All other quantities are factors applied to the model's values. Empty if the dynamics
            do not vary.
        predicate_names: Meaning of each column in ``predicates``.
        subgoal_names: Name of each column in ``subgoals``, in the order of the instruction.
        demonstrator: Source of a demonstration, or None for the trial of an evaluated policy.
        segments: Rows in which the robot works toward each subgoal, derived from the states. Empty unless the record is
            a demonstration.
    """

    task: str
    task_version: _Count
    suite_version: str
    package_version: str
    condition: str
    variation: str | None
    axis: str | None
    base_condition: str | None
    interventions: tuple[str, ...]
    seed: _Count
    policy: str
    instruction: str
    expected: str
    action_space: str
    action_components: tuple[str, ...]
    control_rate_hz: Annotated[float, Field(gt=0.0)]
    camera_preset: str | None
    render_quality: str | None
    engine: Mapping[str, str]
    scene_hash: str
    scene: SceneInfo
    predicate_names: tuple[str, ...]
    subgoal_names: tuple[str, ...]
    looks: Looks = "seen"
    room: str = ""
    view_jitter: ViewJitter = NO_JITTER
    robot_dynamics: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    demonstrator: Demonstrator | None = None
    segments: tuple[SubgoalSegment, ...] = ()
    schema_version: int = SCHEMA_VERSION

    def to_json(self) -> dict[str, Any]:
        """Return the metadata in JSON form.

        An empty ``robot_dynamics`` is omitted. The fields of demonstrations are included only for demonstrations.
        """
        form: dict[str, Any] = {}
        for f in fields(self):
            value = getattr(self, f.name)
            form[f.name] = list(value) if isinstance(value, tuple) else value
        form["engine"] = dict(self.engine)
        form["scene"] = self.scene.to_json()
        form["view_jitter"] = self.view_jitter.to_json()
        del form["robot_dynamics"]
        if self.robot_dynamics:
            form["robot_dynamics"] = {name: list(values) for name, values in self.robot_dynamics.items()}
        del form["demonstrator"], form["segments"]
        if self.demonstrator is not None:
            form["demonstrator"] = self.demonstrator.to_json()
            form["segments"] = [segment.to_json() for segment in self.segments]
        return form
