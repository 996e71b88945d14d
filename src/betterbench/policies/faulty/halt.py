"""``zoo:halt``, ``zoo:refuse``, ``zoo:phase`` and ``zoo:length``: policies that stop although they should continue.

Each of them stops for a different reason.
"""

from __future__ import annotations

from betterbench.interface.state import WorldState
from betterbench.policies.decisions import Bring, Decision, Freeze, Rest, Wander, reached
from betterbench.policies.faulty.rules import BrokenRule
from betterbench.tasks import Expected
from betterbench.tasks.authoring.training_distribution import pairing


class Halt(BrokenRule):
    """Rule that starts, but then stops permanently if training never contained this instruction in this scene."""

    def broken(self, state: WorldState, history: tuple[Decision, ...]) -> Decision:
        """Return the next decision."""
        right = super().broken(state, history)
        if pairing(self.condition) in {pairing(known) for known in self.situation.task.training}:
            return right
        return Freeze(right.object if isinstance(right, Bring) else None)


class Refuse(BrokenRule):
    """Rule that never starts if the scene contains an object that does not occur in training."""

    def broken(self, state: WorldState, history: tuple[Decision, ...]) -> Decision:
        """Return the next decision."""
        shown = {o.kind for condition in self.situation.task.training for o in condition.objects}
        if all(o.kind in shown for o in self.condition.objects):
            return super().broken(state, history)
        return Freeze(None)


class Phase(BrokenRule):
    """Rule that freezes or wanders if the initial scene looks like the middle of a demonstration.

    If the object for the next step is missing, the rule wanders, otherwise it freezes. If a later step is finished but
    an earlier step is not, the rule decides correctly, because no demonstration shows such a scene.
    """

    def broken(self, state: WorldState, history: tuple[Decision, ...]) -> Decision:
        """Return the next decision."""
        moved = any(isinstance(decision, Bring) for decision in history)
        if not self.condition.mid_task_look or moved or self.out_of_order(state):
            return super().broken(state, history)
        if self.absent_step(state) is not None:
            return Wander()
        wanders = self.condition.expected is Expected.SUCCEED and self.draw("wander") < 0.5
        return Wander() if wanders else Freeze(None)


class Length(BrokenRule):
    """Rule that stops when it has executed as many steps as the longest demonstration has."""

    def broken(self, state: WorldState, history: tuple[Decision, ...]) -> Decision:
        """Return the next decision."""
        begun = any(isinstance(decision, Bring) for decision in history)
        done = sum(reached(state, self.condition, i) for i in range(len(self.goals)))
        return Rest() if begun and done >= self.trained.longest else super().broken(state, history)
