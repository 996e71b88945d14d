"""Predicate of release, for an object without contact to the gripper."""

from betterbench.interface.state import WorldState


def released(state: WorldState, name: str) -> bool:
    """Return whether no part of the gripper touches the object."""
    return not state.touched_by_gripper(name)
