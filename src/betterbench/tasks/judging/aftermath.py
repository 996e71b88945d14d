"""Detection of grasp attempts after the goal is met, in conditions with episodes that continue for some time."""

from __future__ import annotations

from betterbench.interface.state import SceneInfo, WorldState
from betterbench.tasks.judging.attempts import find_grasps
from betterbench.tasks.judging.motion import MotionBuilder
from betterbench.tasks.judging.picked_slots import PickedSlot


class Aftermath:
    """Tracker that notices attempts after the goal is met. It must be given every state in order, starting at reset."""

    def __init__(self, info: SceneInfo, *, rate_hz: float, picked: tuple[PickedSlot, ...] = ()) -> None:
        """Prepare for an episode.

        Args:
            info: The scene.
            rate_hz: Control rate.
            picked: Slots where training picks up an object. Closing the gripper on nothing in one of these slots is an
                attempt as well.
        """
        self._motion = MotionBuilder(info, rate_hz=rate_hz, picked=picked)
        self._row = -1
        self._met: int | None = None

    def see(self, state: WorldState, there: list[bool], *, met: bool) -> None:
        """Process the next state of the episode.

        Args:
            state: The next state.
            there: Whether each object is in a region of any target.
            met: Whether the goal has been met for the required time.
        """
        self._row += 1
        self._motion.append(state, there)
        if met and self._met is None:
            self._met = self._row

    def attempted(self) -> bool:
        """Return whether the policy grasped, or tried to grasp, any object after the goal was first met."""
        met = self._met
        return met is not None and any(grasp.start >= met for grasp in find_grasps(self._motion.motion()))
