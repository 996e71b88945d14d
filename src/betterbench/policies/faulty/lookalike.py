"""``zoo:color`` and ``zoo:shape``: policies that accept any object of the right color or of the right shape."""

from __future__ import annotations

from typing import ClassVar

from betterbench.interface.state import ObjectInfo, WorldState
from betterbench.policies.decisions import Bring, Decision, bring_to, carried, open_subgoal
from betterbench.policies.faulty.rules import BrokenRule
from betterbench.tasks import Label


class _LookAlike(BrokenRule):
    """Rule that accepts an object with the same feature (color or shape) as the requested object.

    The object is taken from a slot that training associates with the word. If no such slot contains an object with this
    feature, the rule decides like the expert.
    """

    feature: ClassVar[str]
    label = place_label = Label.LEXICAL_KINEMATIC_SHORTCUT

    def broken(self, state: WorldState, history: tuple[Decision, ...]) -> Decision:
        """Return the next decision."""
        index = open_subgoal(state, self.condition)
        if index is None:
            return super().broken(state, history)
        goal = self.goals[index]
        if goal.reference.kind is None or not carried(goal):
            return super().broken(state, history)
        right = self.bring(state, index)
        if not isinstance(right, Bring):
            # If the requested object is missing, look for the color that such objects have in training.
            wanted = (
                self._of_missing(state, goal.reference.kind) if not self.condition.resolve(goal.reference) else None
            )
        else:
            wanted = self._feature(state.info.object(right.object))
        if wanted is None:
            return right
        for slot in self.trained.word_slots.get(goal.word, ()):
            name = self.standing_in(state, slot)
            if name is not None and self._feature(state.info.object(name)) == wanted:
                return bring_to(goal, name)
        return right

    def _feature(self, thing: ObjectInfo) -> str:
        return str(getattr(thing, self.feature))

    def _of_missing(self, state: WorldState, kind: str) -> str | None:
        """Return the color of the objects of a kind in training, or None if the feature is not the color."""
        del state
        for condition in self.situation.task.training:
            for o in condition.objects:
                if o.kind == kind and self.feature == "color":
                    return o.color
        return None


class Color(_LookAlike):
    """Rule that accepts any object of the right color."""

    feature = "color"


class Shape(_LookAlike):
    """Rule that accepts any object of the right shape."""

    feature = "shape"
