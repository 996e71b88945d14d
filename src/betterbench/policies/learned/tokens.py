"""Inputs of a learner in the ``objects`` family: the state of the tool, and visible properties of each object.

The names, roles and slots of objects, the held object and the goal of the task are not inputs, because they would
reveal the task.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from betterbench.interface.state import ObjectInfo, WorldState
from betterbench.policies.learned.vocabulary import Vocabulary

TOOL_NUMBERS = 10
"""Number of values of a tool state: position [m], rotation and opening width [m]."""
POSE_NUMBERS = 9
"""Number of values of an object's pose: position [m] and rotation."""


@dataclass(frozen=True, slots=True, eq=False)
class Things:
    """Inputs of a learner that do not change during an episode: the instruction, and the appearance of n objects.

    Attributes:
        words: (w,) indices of the words of the instruction.
        sizes: (n, 3) extents of the objects [m].
        categories: (n,) indices of the categories.
        colors: (n,) indices of the colors.
    """

    words: np.ndarray
    sizes: np.ndarray
    categories: np.ndarray
    colors: np.ndarray


def things_of(instruction: str, objects: Sequence[ObjectInfo], vocabulary: Vocabulary) -> Things:
    """Return the inputs of a learner that do not change during an episode. The objects keep their order."""
    return Things(
        vocabulary.word_ids(instruction),
        np.array([o.size_m for o in objects], dtype=np.float32).reshape(-1, 3),
        vocabulary.category_ids([o.category for o in objects]),
        vocabulary.color_ids([o.color for o in objects]),
    )


def six_numbers(quaternions: np.ndarray) -> np.ndarray:
    """Convert quaternions (w, x, y, z), (..., 4), to the first two columns of the rotation matrices, (..., 6).

    This representation is continuous (Zhou et al. 2019, "On the Continuity of Rotation Representations in Neural
    Networks").
    """
    w, x, y, z = np.moveaxis(quaternions, -1, 0)
    first = (1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y))
    second = (2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x))
    return np.stack([*first, *second], axis=-1)


def tool_numbers(positions: np.ndarray, quaternions: np.ndarray, widths: np.ndarray) -> np.ndarray:
    """Return tool states (T, 10) float32 from positions (T, 3) [m], quaternions (T, 4) and opening widths (T,) [m]."""
    return np.concatenate([positions, six_numbers(quaternions), widths[:, None]], axis=1).astype(np.float32)


def pose_numbers(positions: np.ndarray, quaternions: np.ndarray) -> np.ndarray:
    """Return poses as arrays (..., 9) float32, given positions (..., 3) [m] and quaternions (..., 4)."""
    return np.concatenate([positions, six_numbers(quaternions)], axis=-1).astype(np.float32)


def moment_of(state: WorldState) -> tuple[np.ndarray, np.ndarray]:
    """Return the inputs that a learner gets in a state: tool (10,) float32 and poses of n objects (n, 9) float32."""
    pose = state.ee_pose
    tool = tool_numbers(np.array([pose.position]), np.array([pose.quaternion]), np.array([state.finger_width_m]))
    poses = pose_numbers(np.array(state.positions).reshape(-1, 3), np.array(state.quaternions).reshape(-1, 4))
    return tool[0], poses
