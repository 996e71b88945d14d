"""Predicate "released": an object has no contact with the gripper."""

from betterbench.interface.state import WorldState


def released(state: WorldState, name: str) -> bool:
    """Return whether no part of the gripper touches the object."""
    return not state.touched_by_gripper(name)
