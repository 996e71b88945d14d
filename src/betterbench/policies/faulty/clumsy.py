"""``zoo:clumsy``: a policy that decides correctly, but misses or drops the object."""

from __future__ import annotations

from betterbench.interface.state import WorldState
from betterbench.policies.decisions import Bring, Decision, GraspOffset
from betterbench.policies.faulty.rules import BrokenRule, Fault
from betterbench.tasks import Expected, Label


class Clumsy(BrokenRule):
    """Rule of a policy that decides like the expert, but drops the object in mid-air or closes the gripper beside it.

    The trial's random stream determines which of the two happens, and by how much the gripper misses the object.
    """

    @property
    def grasp_offset(self) -> GraspOffset | None:
        """Deliberate grasp error in this episode, or None if the policy makes no error."""
        if not self.applies:
            return None
        if self.draw("how") < 0.5:
            return GraspOffset(drop=True)
        return GraspOffset(miss_by_m=0.006 + 0.006 * self.draw("gap"))

    def broken(self, state: WorldState, history: tuple[Decision, ...]) -> Decision:
        """Return the expert's next decision."""
        decision = super().broken(state, history)
        if self.fault is None and isinstance(decision, Bring) and self.condition.expected is Expected.SUCCEED:
            self.fault = Fault(Label.EXECUTION_FAILURE, len(history), f"{decision} with a bad grasp")
        return decision
