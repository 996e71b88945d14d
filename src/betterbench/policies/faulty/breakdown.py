"""``zoo:slow`` and ``zoo:crash``: policies that decide correctly, but are too slow or crash during the episode."""

from __future__ import annotations

from betterbench.interface.state import WorldState
from betterbench.policies.decisions import Bring, Decision, Draw
from betterbench.policies.faulty.rules import BrokenRule, Fault
from betterbench.tasks import Expected, Label


class Slow(BrokenRule):
    """Rule of a policy that decides like the expert, but moves too slowly to finish within the step limit."""

    speed = 0.1
    """Fraction of the expert's speed. The step limit is three times the time that the expert needs."""

    def broken(self, state: WorldState, history: tuple[Decision, ...]) -> Decision:
        """Return the expert's next decision."""
        decision = super().broken(state, history)
        if self.fault is None and isinstance(decision, Bring | Draw) and self.condition.expected is Expected.SUCCEED:
            self.fault = Fault(Label.TIMEOUT, len(history), f"{decision}, too slowly")
        return decision


class Crash(BrokenRule):
    """Rule of a policy that decides like the expert, but crashes after some control steps."""

    @property
    def crash_step(self) -> int | None:
        """Control step at which the policy crashes in this episode, or None if it does not crash in this episode."""
        return 5 + int(60 * self.draw("when")) if self.applies else None

    def broken(self, state: WorldState, history: tuple[Decision, ...]) -> Decision:
        """Return the expert's next decision."""
        if self.fault is None:
            self.fault = Fault(Label.POLICY_ERROR, len(history), f"crash at step {self.crash_step}")
        return super().broken(state, history)
