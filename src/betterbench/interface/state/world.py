"""Part of the privileged state that changes over time. There is one :class:`WorldState` per control step."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np

from betterbench.geometry import Pose, Quaternion, Vector
from betterbench.interface.policy import Policy
from betterbench.interface.state.info import SceneInfo


class Contact(NamedTuple):
    """Pair of bodies in contact, and the sum of the normal forces at all their contact points [N].

    A body is given as the name of an object, or as "left_finger", "right_finger", "hand", "arm", "table" or "floor".
    The class is a named tuple for speed, because several contacts are created at every control step.
    """

    a: str
    b: str
    force_n: float


@dataclass(frozen=True, slots=True)
class WorldState:
    """Privileged state at one control step.

    Objects are listed in the order of ``info.objects``. All values are in the world frame: positions [m], speeds [m/s]
    and angular speeds [rad/s].

    Attributes:
        step: Number of control steps since reset.
        time_s: Simulated time since reset [s].
        quaternions: Rotations of the objects (w, x, y, z).
        ee_pose: Pose of the tool center point between the finger pads. z points along the approach direction.
        commanded_pose: Commanded pose of the tool center point.
        finger_width_m: Distance between the finger pads [m].
        gripper_command: Last applied gripper command, from -1 (open) to +1 (closed).
        joint_positions: Arm joint angles [rad].
        joint_velocities: Arm joint velocities [rad/s].
        contacts: Contacts that involve the gripper or an object. If the task forbids touching some objects, all
            contacts of the robot since the previous state are included.
        held: Name of the object that both fingers touch and that nothing else supports, or None.
    """

    info: SceneInfo
    step: int
    time_s: float
    positions: tuple[Vector, ...]
    quaternions: tuple[Quaternion, ...]
    linear_speeds: tuple[float, ...]
    angular_speeds: tuple[float, ...]
    ee_pose: Pose
    commanded_pose: Pose
    finger_width_m: float
    gripper_command: float
    joint_positions: tuple[float, ...]
    joint_velocities: tuple[float, ...]
    contacts: tuple[Contact, ...]
    held: str | None

    def pose(self, name: str) -> Pose:
        """Return the pose ``T_world_object`` of the object with the given name."""
        i = self.info.index(name)
        return Pose(self.positions[i], self.quaternions[i])

    def position(self, name: str) -> Vector:
        """Return the position of an object's frame in the world frame [m].

        The origin of the object's frame is the center of its bottom face.
        """
        return self.positions[self.info.index(name)]

    def quaternion(self, name: str) -> Quaternion:
        """Return the rotation of an object in the world frame, as (w, x, y, z)."""
        return self.quaternions[self.info.index(name)]

    def touching(self, a: str, b: str) -> bool:
        """Return whether two bodies, given by their names, are in contact."""
        for first, second, _ in self.contacts:  # noqa: SIM110 - three times as fast as any()
            if (first == a and second == b) or (first == b and second == a):
                return True
        return False

    def touched_by_gripper(self, name: str) -> bool:
        """Return whether any part of the gripper touches the object."""
        for a, b, _ in self.contacts:  # noqa: SIM110 - three times as fast as any()
            if (a == name and b in GRIPPER_BODIES) or (b == name and a in GRIPPER_BODIES):
                return True
        return False


GRIPPER_BODIES = frozenset({"left_finger", "right_finger", "hand"})


class PrivilegedPolicy(Protocol):
    """Policy that gets the privileged state, such as the expert or a faulty policy."""

    @property
    def name(self) -> str:
        """Address of the policy ("expert", "zoo:lexical")."""

    def act_on_state(self, state: WorldState) -> np.ndarray:
        """Return one action (7,) in the action space ``ee_delta``."""


AnyPolicy = Policy | PrivilegedPolicy
"""Any policy, whether it gets observations or the privileged state."""
