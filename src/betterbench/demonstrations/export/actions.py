"""Convert the actions of a recorded episode to any action space."""

from __future__ import annotations

import numpy as np

from betterbench.errors import InvalidInputError
from betterbench.geometry import Quaternion, from_axis_angle, multiply, normalize, to_axis_angle, turn_between
from betterbench.interface.actions import (
    EE_DELTA,
    EE_DELTA_MEASURED,
    EE_POSE,
    JOINT_DELTA,
    JOINT_POSITION,
    JOINT_SPACES,
    JOINT_STEP_PER_UNIT_RAD,
    ROBOT_ACTION_SPACES,
    ROTATION_PER_UNIT_RAD,
    TRANSLATION_PER_UNIT_M,
    ActionSpace,
    action_space,
)
from betterbench.records import Record
from betterbench.sim.robots import robot_of_space


def actions_in(record: Record, space: ActionSpace) -> np.ndarray:
    """Return the actions of a record in the given action space, as an (n_steps, dim) float64 array.

    In the action space of the record, these are the intended actions: the executed actions without the noise that a
    demonstrator added. For any other action space, the actions are computed from the recorded controller commands.
    These are the joint references at the end of each control step, or the corresponding poses. Each delta starts from
    the pose that results from the earlier deltas. If a delta is clipped, the following deltas therefore compensate for
    the lost motion. Noise is removed from poses but not from joint references, because the record does not show how the
    controller would have responded to another pose.

    Raises:
        InvalidInputError: If the record does not have a reference for every joint, or the action space is unknown.
    """
    meant = _meant(record)
    if record.metadata.action_space == space.name:
        return meant
    gripper = commands(meant[:, -1])[:, None]
    positions, quaternions = _goals(record, meant)
    joints = space.dim - 1
    if space.name in JOINT_SPACES and record.act.shape[1] != joints:
        problem = f"{space.name} needs {joints} joint references, but the record has {record.act.shape[1]}"
        raise InvalidInputError(
            f"record of {record.metadata.task}", problem, "Export it in the action space of the record"
        )
    if space.name in ROBOT_ACTION_SPACES:
        motion, gripper = record.act[1:] / space.scale[:-1], _openings(record, space)
    elif space.name == JOINT_POSITION.name:
        motion = np.array(record.act[1:])
    elif space.name == JOINT_DELTA.name:
        motion = _joint_steps(record.act)
    elif space.name == EE_POSE.name:
        motion = np.concatenate([positions, quaternions], axis=1)
    elif space.name in (EE_DELTA.name, EE_DELTA_MEASURED.name):
        motion = _pose_steps(record, positions, quaternions, measured=space.name == EE_DELTA_MEASURED.name)
    else:
        raise InvalidInputError("action space", f"{space.name!r} is unknown", "Choose another preset")
    actions = np.concatenate([motion, gripper], axis=1)
    return np.array([space.clip(action) for action in actions]).reshape(-1, space.dim)


def _openings(record: Record, space: ActionSpace) -> np.ndarray:
    """Return the commanded gripper openings (n_steps, 1) in motor units.

    The last joint reference of each control step is the reference of the gripper.
    """
    jaw, unit = robot_of_space(space.name).jaw, space.scale[-1]
    return np.array([[jaw.share_at(jaw.width_at_control(c)) / unit] for c in record.ctrl[1:, -1].tolist()])


def _noise(record: Record) -> float:
    """Return the standard deviation of the noise on the executed actions of a record, in action units."""
    demonstrator = record.metadata.demonstrator
    return 0.0 if demonstrator is None else demonstrator.action_noise


def _meant(record: Record) -> np.ndarray:
    """Return the intended actions (n_steps, dim), clipped to the bounds of the record's action space."""
    if not _noise(record):
        return np.array(record.applied[1:])
    space = action_space(record.metadata.action_space)
    return np.array([space.clip(action) for action in record.action[1:]]).reshape(-1, space.dim)


def _goals(record: Record, meant: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the intended poses: positions (n_steps, 3) [m] and quaternions (n_steps, 4).

    Raises InvalidInputError if the executed actions contain noise and are not deltas of the commanded pose. In this
    case the noise cannot be removed.
    """
    if not _noise(record):
        return record.commanded_position[1:], record.commanded_quaternion[1:]
    if record.metadata.action_space != EE_DELTA.name:
        problem = (
            f"its {record.metadata.action_space} actions contain noise, which can only be removed from pose deltas"
        )
        raise InvalidInputError(
            f"record of {record.metadata.task}", problem, "Export it in the action space of the record"
        )
    positions = record.commanded_position[:-1] + TRANSLATION_PER_UNIT_M * meant[:, :3]
    turns = (ROTATION_PER_UNIT_RAD * meant[:, 3:6]).tolist()
    before = [_quaternion(values) for values in record.commanded_quaternion[:-1]]
    quaternions = [normalize(multiply(from_axis_angle(t), q)) for t, q in zip(turns, before, strict=True)]
    return positions, np.array(quaternions).reshape(-1, 4)


def commands(gripper: np.ndarray) -> np.ndarray:
    """Replace zeros in gripper commands (n,) with the previous nonzero command, and leading zeros with -1 (open)."""
    signs = np.sign(gripper)
    last = np.maximum.accumulate(np.where(signs != 0.0, np.arange(len(signs)), -1))
    return np.where(last >= 0, np.where(signs != 0.0, gripper, signs[np.maximum(last, 0)]), -1.0)


def _joint_steps(references: np.ndarray) -> np.ndarray:
    """Convert joint references (n + 1, joints) to joint deltas (n, joints) that are clipped to the bounds per step."""
    here, steps = np.array(references[0]), []
    for goal in references[1:]:
        step = np.clip((goal - here) / JOINT_STEP_PER_UNIT_RAD, -1.0, 1.0)
        here = here + JOINT_STEP_PER_UNIT_RAD * step
        steps.append(step)
    return np.array(steps).reshape(-1, references.shape[1])


def _pose_steps(record: Record, positions: np.ndarray, quaternions: np.ndarray, *, measured: bool) -> np.ndarray:
    """Convert tool poses to Cartesian deltas (n, 6) that are clipped to the bounds per step.

    If ``measured`` is True, each delta is relative to the measured pose of the tool instead of the commanded pose.
    """
    position = np.array(record.commanded_position[0])
    quaternion = _quaternion(record.commanded_quaternion[0])
    steps = []
    for row in range(record.n_steps):
        if measured:
            position, quaternion = np.array(record.ee_position[row]), _quaternion(record.ee_quaternion[row])
        move = (positions[row] - position) / TRANSLATION_PER_UNIT_M
        turn = turn_between(quaternion, _quaternion(quaternions[row]))
        step = np.clip([*move, *np.divide(to_axis_angle(turn), ROTATION_PER_UNIT_RAD)], -1.0, 1.0)
        position = position + TRANSLATION_PER_UNIT_M * step[:3]
        quaternion = normalize(multiply(from_axis_angle((ROTATION_PER_UNIT_RAD * step[3:]).tolist()), quaternion))
        steps.append(step)
    return np.array(steps).reshape(-1, 6)


def _quaternion(values: np.ndarray) -> Quaternion:
    w, x, y, z = values.tolist()
    return (w, x, y, z)
