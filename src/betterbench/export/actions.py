"""The actions of a record in an action space: those that were applied, or those that command the same motion."""

from __future__ import annotations

import numpy as np

from betterbench.errors import InvalidInputError
from betterbench.geometry import Quaternion, conjugate, from_axis_angle, multiply, normalize, to_axis_angle
from betterbench.interface.actions import (
    EE_DELTA,
    EE_DELTA_MEASURED,
    EE_POSE,
    JOINT_DELTA,
    JOINT_POSITION,
    JOINT_STEP_PER_UNIT_RAD,
    ROTATION_PER_UNIT_RAD,
    TRANSLATION_PER_UNIT_M,
    ActionSpace,
)
from betterbench.recording import Record

JOINTS = 7


def actions_in(record: Record, space: ActionSpace) -> np.ndarray:
    """Return the actions of a record in an action space, (n_steps, dim) float64.

    In the space in which it was recorded these are the applied actions, bit for bit. In another one they are computed
    from what the controller was commanded, which every record holds: the joint references at the end of each control
    step, or the pose that they stand for. A delta is the step from what the deltas before it add up to, so that what
    one step loses to the bounds of the space, the next one catches up.

    Raises:
        InvalidInputError: If the record lacks the seven joint references, or the space is none of ours.
    """
    if record.metadata.action_space == space.name:
        return np.array(record.applied[1:])
    gripper = commands(record.applied[1:, -1])[:, None]
    if space.name in (JOINT_POSITION.name, JOINT_DELTA.name) and record.act.shape[1] != JOINTS:
        problem = f"it has {record.act.shape[1]} joint references, and {JOINTS} are needed for {space.name}"
        raise InvalidInputError(f"record of {record.metadata.task}", problem, "Export it in its own action space")
    if space.name == JOINT_POSITION.name:
        motion = np.array(record.act[1:])
    elif space.name == JOINT_DELTA.name:
        motion = _joint_steps(record.act)
    elif space.name == EE_POSE.name:
        motion = np.concatenate([record.commanded_position[1:], record.commanded_quaternion[1:]], axis=1)
    elif space.name in (EE_DELTA.name, EE_DELTA_MEASURED.name):
        motion = _pose_steps(record, measured=space.name == EE_DELTA_MEASURED.name)
    else:
        raise InvalidInputError("action space", f"{space.name!r} is unknown", "Choose another preset")
    actions = np.concatenate([motion, gripper], axis=1)
    return np.array([space.clip(action) for action in actions]).reshape(-1, space.dim)


def commands(gripper: np.ndarray) -> np.ndarray:
    """Return gripper commands (n,) without the zeros that keep the last one; before the first one it is open, -1."""
    signs = np.sign(gripper)
    last = np.maximum.accumulate(np.where(signs != 0.0, np.arange(len(signs)), -1))
    return np.where(last >= 0, np.where(signs != 0.0, gripper, signs[np.maximum(last, 0)]), -1.0)


def _joint_steps(references: np.ndarray) -> np.ndarray:
    """Return joint deltas (n, 7) that follow joint references (n + 1, 7) within the bounds of a step."""
    here, steps = np.array(references[0]), []
    for goal in references[1:]:
        step = np.clip((goal - here) / JOINT_STEP_PER_UNIT_RAD, -1.0, 1.0)
        here = here + JOINT_STEP_PER_UNIT_RAD * step
        steps.append(step)
    return np.array(steps).reshape(-1, JOINTS)


def _pose_steps(record: Record, *, measured: bool) -> np.ndarray:
    """Return Cartesian deltas (n, 6) that follow the commanded poses of a record within the bounds of a step."""
    position = np.array(record.commanded_position[0])
    quaternion = _quaternion(record.commanded_quaternion[0])
    steps = []
    for row in range(record.n_steps):
        if measured:
            position, quaternion = np.array(record.ee_position[row]), _quaternion(record.ee_quaternion[row])
        move = (record.commanded_position[row + 1] - position) / TRANSLATION_PER_UNIT_M
        turn = multiply(_quaternion(record.commanded_quaternion[row + 1]), conjugate(quaternion))
        step = np.clip([*move, *np.divide(to_axis_angle(turn), ROTATION_PER_UNIT_RAD)], -1.0, 1.0)
        position = position + TRANSLATION_PER_UNIT_M * step[:3]
        quaternion = normalize(multiply(from_axis_angle((ROTATION_PER_UNIT_RAD * step[3:]).tolist()), quaternion))
        steps.append(step)
    return np.array(steps).reshape(-1, 6)


def _quaternion(values: np.ndarray) -> Quaternion:
    w, x, y, z = values.tolist()
    return (w, x, y, z)
