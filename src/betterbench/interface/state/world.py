"""Time-varying part of the privileged state, with one value per control step."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np

from betterbench.geometry import Pose, Quaternion, Vector
from betterbench.interface.policy import Policy
from betterbench.interface.state.info import SceneInfo


class Contact(NamedTuple):
    """Pair of touching bodies, with the sum of the normal forces over all contact points [N].

    A body is an object's name, "left_finger", "right_finger", "hand", "arm", "table" or "floor". This is a named tuple
    for speed, because several are created at every control step.
    """

    a: str
    b: str
    force_n: float


@dataclass(frozen=True, slots=True)
class WorldState:
    """The privileged state at one control step.

    Objects are listed in the order of ``info.objects``. All values are in the world frame: positions [m], speeds [m/s]
    and angular speeds [rad/s].

    Attributes:
        step: Number of control steps taken since reset.
        time_s: Simulated time since reset [s].
        quaternions: Object rotations (w, x, y, z).
        ee_pose: Pose of the tool center point between the finger pads; z points along the approach.
        commanded_pose: Commanded pose of the tool center point.
        finger_width_m: Distance of the finger pads [m].
        gripper_command: Last applied gripper command, from -1 (open) to +1 (closed).
        joint_positions: Arm joint angles [rad].
        joint_velocities: Arm joint velocities [rad/s].
        contacts: Contacts that involve the gripper or an object. If some objects must not be touched, all contacts of
            the robot since the previous state are included.
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
        """Return ``T_world_object`` of a named object."""
        i = self.info.index(name)
        return Pose(self.positions[i], self.quaternions[i])

    def position(self, name: str) -> Vector:
        """Return the position of a named object in the world [m].

        It is the center of the object's bottom face at rest.
        """
        return self.positions[self.info.index(name)]

    def quaternion(self, name: str) -> Quaternion:
        """Return the rotation of a named object in the world as (w, x, y, z)."""
        return self.quaternions[self.info.index(name)]

    def touching(self, a: str, b: str) -> bool:
        """Return whether two named bodies touch."""
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
    """Policy with access to the privileged state, such as the expert or a faulty policy."""

    @property
    def name(self) -> str:
        """Policy address ("expert", "zoo:lexical")."""

    def act_on_state(self, state: WorldState) -> np.ndarray:
        """Return one action in the ``ee_delta`` action space, shape (7,)."""


AnyPolicy = Policy | PrivilegedPolicy
"""Policy that gets observations, or policy that gets the privileged state."""
