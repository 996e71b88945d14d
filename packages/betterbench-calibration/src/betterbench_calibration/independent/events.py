"""Log of grasps, losses, releases and displaced objects for the independent family. The diagnosis does not use it."""

from __future__ import annotations

from dataclasses import dataclass, field

from betterbench.geometry import Vector, distance, horizontal_distance
from betterbench.interface.state import WorldState

LOST_STEPS = 3
"""Number of control steps without contact with either finger after which an object counts as lost."""
DISPLACED_M = 0.05


@dataclass(frozen=True, slots=True)
class Closing:
    """Closing of the gripper, with the nearest object.

    Attributes:
        step: Control step at which the fingers stopped.
        tool: Position of the tool in the world frame [m].
        nearest: Movable object whose origin had the smallest horizontal distance to the tool.
        beside_m: Horizontal distance from the tool to the origin of that object [m].
        above_m: Height of the tool above the top of that object [m]. Negative if the tool was below the top.
        gripped: Object that both fingers touched after the closing, or None.
    """

    step: int
    tool: Vector
    nearest: str
    beside_m: float
    above_m: float
    gripped: str | None


@dataclass(slots=True)
class EventLog:
    """Log of the events in one episode, derived from its states.

    Attributes:
        first: State at the reset.
        closings: All closings of the gripper.
        lost: Objects that lost contact with both fingers while the gripper was commanded to close, with the step.
        released: Objects that were in the gripper when it was commanded to open, with the step.
        first_touch: Step at which the gripper first touched an object, by name of the object.
        gripped: Object that is in the gripper now, or None.
        longest_rest: Largest number of consecutive steps in which the tool did not move.
    """

    first: WorldState
    closings: list[Closing] = field(default_factory=list)
    lost: list[tuple[int, str]] = field(default_factory=list)
    released: list[tuple[int, str]] = field(default_factory=list)
    first_touch: dict[str, int] = field(default_factory=dict)
    gripped: str | None = None
    longest_rest: int = 0
    _rest: int = 0
    _without: int = 0

    def see(self, before: WorldState, now: WorldState, grip: float) -> None:
        """Process the state after one step. ``grip`` is the gripper command of that step."""
        for name in (o.name for o in now.info.objects):
            if name not in self.first_touch and now.touched_by_gripper(name):
                self.first_touch[name] = now.step
        moved = distance(before.ee_pose.position, now.ee_pose.position)
        self._rest = self._rest + 1 if moved < 0.0005 else 0
        self.longest_rest = max(self.longest_rest, self._rest)
        if self.gripped is not None and grip > 0.0:
            touched = now.touched_by_gripper(self.gripped)
            self._without = 0 if touched else self._without + 1
            if self._without >= LOST_STEPS:
                self.lost.append((now.step, self.gripped))
                self.gripped = None

    def closed(self, state: WorldState) -> None:
        """Record that the gripper has closed."""
        tool = state.ee_pose.position
        loose = [o for o in state.info.objects if not o.fixed]
        near = min(loose, key=lambda o: horizontal_distance(state.pose(o.name).position, tool))
        at = state.pose(near.name).position
        self.gripped = in_gripper(state)
        self._without = 0
        beside, above = horizontal_distance(at, tool), tool[2] - at[2] - near.size_m[2]
        self.closings.append(Closing(state.step, tool, near.name, beside, above, self.gripped))

    def opening(self, state: WorldState) -> None:
        """Record that the gripper begins to open."""
        if self.gripped is not None:
            self.released.append((state.step, self.gripped))
            self.gripped = None

    def displaced(self, state: WorldState, name: str) -> float:
        """Return the horizontal distance of an object from its initial position [m]."""
        return horizontal_distance(self.first.pose(name).position, state.pose(name).position)


def in_gripper(state: WorldState) -> str | None:
    """Return the movable object that both fingers touch, or None."""
    for o in state.info.objects:
        if not o.fixed and state.touching("left_finger", o.name) and state.touching("right_finger", o.name):
            return o.name
    return None
