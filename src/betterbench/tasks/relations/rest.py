"""Tests of whether objects are at rest, whether the arm is at rest, and whether objects are upright."""

from collections import deque

from betterbench.geometry import Quaternion, Vector, angle_between, distance, tilt_of
from betterbench.interface.state import WorldState
from betterbench.tasks.thresholds import THRESHOLDS


class RestWatch:
    """Detector of objects at rest, i.e. objects that have not moved or rotated for a short time.

    Displacement is used instead of speed, because in contact, a resting object can tremble at 1 rad/s without moving by
    a tenth of a millimeter. The detector must be given every state in order, starting at reset. At reset, all objects
    count as at rest.
    """

    def __init__(self, *, rate_hz: float) -> None:
        self._states: deque[WorldState] = deque(maxlen=1 + max(1, round(THRESHOLDS.rest_time * rate_hz)))
        self._seen = 0
        self._found: dict[str, tuple[int, Vector, Quaternion]] = {}

    def see(self, state: WorldState) -> None:
        """Process the next state."""
        self._states.append(state)
        self._seen += 1

    def at_rest(self, name: str) -> bool:
        """Return whether an object has kept its position and rotation for at least ``rest_time``."""
        now = self._states[-1]
        i = now.info.index(name)
        position, quaternion = now.positions[i], now.quaternions[i]
        # An object that was at rest in the last state and has not moved since is still at rest.
        if self._found.get(name) != (self._seen - 1, position, quaternion) and not self._stayed(i):
            return False
        self._found[name] = (self._seen, position, quaternion)
        return True

    def _stayed(self, i: int) -> bool:
        position, quaternion = self._states[-1].positions[i], self._states[-1].quaternions[i]
        return all(
            distance(before.positions[i], position) <= THRESHOLDS.rest_travel
            and angle_between(before.quaternions[i], quaternion) <= THRESHOLDS.rest_turn
            for before in self._states
            if before.positions[i] != position or before.quaternions[i] != quaternion
        )


def on_floor(state: WorldState, name: str) -> bool:
    """Return whether an object has fallen below the table top."""
    return state.position(name)[2] < -THRESHOLDS.fallen_below


def upright(state: WorldState, name: str) -> bool:
    """Return whether an object is in the upright posture of its asset."""
    return tilt_of(state.quaternion(name)) <= THRESHOLDS.upright_tilt


def lies_on_side(state: WorldState, name: str) -> bool:
    """Return whether an object is tilted so far from its upright posture that it counts as knocked over."""
    return tilt_of(state.quaternion(name)) > THRESHOLDS.knocked_tilt


def arm_still(state: WorldState) -> bool:
    """Return whether all arm joints are slower than 0.05 rad/s, which is about 2 cm/s at the end effector."""
    return all(abs(v) < 0.05 for v in state.joint_velocities)
