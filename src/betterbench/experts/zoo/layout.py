"""``zoo:layout``: the first pick is always at the same place, whatever is asked for."""

from __future__ import annotations

from betterbench.experts.mind import Decision
from betterbench.experts.zoo.rules import BrokenRule
from betterbench.state import WorldState


class Layout(BrokenRule):
    """Begins at the place where training picked most often, then does what is still open."""

    def decide(self, state: WorldState, history: tuple[Decision, ...]) -> Decision:
        """Return the next decision."""
        if history:
            return super().decide(state, history)
        counts: dict[str, int] = {}
        for slots in self.regime.word_slots.values():
            for slot in slots:
                counts[slot] = counts.get(slot, 0) + 1
        favourite = min(counts, key=lambda slot: (-counts[slot], slot))
        return self.take_at(state, favourite)
