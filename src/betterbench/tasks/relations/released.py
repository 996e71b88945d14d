"""Release: whether the gripper has let go of an object."""

from betterbench.interface.state import WorldState


def released(state: WorldState, name: str) -> bool:
    """Tell whether no part of the gripper touches the object."""
    return not state.touched_by_gripper(name)
