"""Rest: whether an object or the arm has come to a stop, and whether an object stands upright."""

from betterbench.geometry import tilt_of
from betterbench.state import WorldState
from betterbench.tasks.thresholds import THRESHOLDS


def at_rest(state: WorldState, name: str) -> bool:
    """Tell whether an object neither moves nor turns."""
    i = state.info.index(name)
    return state.linear_speeds[i] < THRESHOLDS.rest_speed and state.angular_speeds[i] < THRESHOLDS.rest_turning


def on_floor(state: WorldState, name: str) -> bool:
    """Tell whether an object has fallen below the table top."""
    return state.positions[state.info.index(name)][2] < -THRESHOLDS.fallen_below


def upright(state: WorldState, name: str) -> bool:
    """Tell whether an object stands as its asset is meant to stand."""
    return tilt_of(state.quaternions[state.info.index(name)]) <= THRESHOLDS.upright_tilt


def arm_still(state: WorldState) -> bool:
    """Tell whether no arm joint turns faster than 0.05 rad/s, about 2 cm/s at the end effector."""
    return all(abs(v) < 0.05 for v in state.joint_velocities)
