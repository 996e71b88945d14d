"""Grasp attempts after the goal is met, in conditions that then continue for some time."""

from __future__ import annotations

from betterbench.interface.state import SceneInfo, WorldState
from betterbench.tasks.judging.attempts import find_grasps
from betterbench.tasks.judging.motion import MotionBuilder
from betterbench.tasks.judging.picked_slots import PickedSlot


class Aftermath:
    """Tracker of an episode after its goal is met. Pass it every state in order, starting at reset."""

    def __init__(self, info: SceneInfo, *, rate_hz: float, picked: tuple[PickedSlot, ...] = ()) -> None:
        """Prepare for an episode.

        Args:
            info: The scene.
            rate_hz: Control rate.
            picked: Slots from which training picked an object. Closing on nothing at one of them is an attempt.
        """
        self._motion = MotionBuilder(info, rate_hz=rate_hz, picked=picked)
        self._row = -1
        self._met: int | None = None

    def see(self, state: WorldState, there: list[bool], *, met: bool) -> None:
        """Process the next state.

        Args:
            state: The next state.
            there: Whether each object is in a region of any target.
            met: Whether the goal has been met for its dwell time.
        """
        self._row += 1
        self._motion.append(state, there)
        if met and self._met is None:
            self._met = self._row

    def attempted(self) -> bool:
        """Return whether an object was grasped or attempted after the goal was first met."""
        met = self._met
        return met is not None and any(grasp.start >= met for grasp in find_grasps(self._motion.motion()))
