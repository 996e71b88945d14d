"""``zoo:lexical``: a word triggers the motion that went with it in training, whatever stands there now."""

from __future__ import annotations

from betterbench.experts.mind import Decision, Rest
from betterbench.experts.zoo.rules import BrokenRule
from betterbench.state import WorldState


class Lexical(BrokenRule):
    """Plays, word by word, the pick at the place where training picked for that word."""

    def decide(self, state: WorldState, history: tuple[Decision, ...]) -> Decision:
        """Return the next decision: one pick per word, at the next trained place of that word."""
        step = len(history)
        if step >= len(self.goals):
            return Rest()
        word = self.goals[step].word
        places = self.regime.word_slots[word]
        earlier = sum(goal.word == word for goal in self.goals[:step])
        return self.take_at(state, places[min(earlier, len(places) - 1)])
