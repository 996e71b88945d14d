"""Cues that a policy may follow instead of the instruction, such as an object's slot, kind, color or distance."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from betterbench.diagnosis.thresholds import NEARLY_ALL
from betterbench.diagnosis.trial import Choice

_BY_PLACE = "the place of the object"


@dataclass(frozen=True, slots=True)
class Decider:
    """Cues that explain the first targets of a policy that ignores the instruction.

    Attributes:
        names: Cues that can explain the first attempts. Each of them does so on its own. Empty if no known cue does.
    """

    names: tuple[str, ...]

    @property
    def may_be_place(self) -> bool:
        """Whether the policy may have chosen objects by their slot."""
        return _BY_PLACE in self.names

    def __str__(self) -> str:
        """Return a phrase that describes the cues that explain the first attempts."""
        if not self.names:
            return (
                "not a slot, a kind, a color or the nearest object, but another cue that is constant within a seed, "
                "such as the arm's start pose"
            )
        more = "" if len(self.names) == 1 else ", which these trials do not distinguish"
        return f"{' or '.join(self.names)}{more}"


def decider_of(choices: Mapping[str, Sequence[Choice]]) -> Decider:
    """Return the cues that explain the choices of a policy that does not use the instruction.

    The favored slot or kind of object may differ between tasks. The favored slot may also differ between layouts if it
    is empty in some of them.

    Args:
        choices: The first attempts in each task, by task.
    """
    every = [choice for mine in choices.values() for choice in mine if choice.slot is not None]
    things = [choice for choice in every if choice.thing]
    found = {
        _BY_PLACE: all(_by_place([c for c in mine if c.slot is not None]) for mine in choices.values()),
        "the kind of object": all(_usual([c.thing for c in mine if c.thing]) for mine in choices.values()),
        "the color of the object": _usual([c.color for c in things]) is not None,
        "the smallest distance to the gripper at the start": _usual([str(c.slot == c.nearest) for c in every])
        == "True",
    }
    return Decider(tuple(name for name, holds in found.items() if holds and every))


def _by_place(attempts: Sequence[Choice]) -> bool:
    """Return whether nearly all attempts are at the policy's favorite slot.

    If the favorite slot is empty in a trial, the attempt may be at the second favorite slot instead.
    """
    rest, followed = list(attempts), 0
    while rest:
        slots = [c.slot for c in rest]
        favorite = max(sorted({str(slot) for slot in slots}), key=slots.count)
        # Slots at the same position share one name in `slot`, but not in `stocked`.
        named = any(favorite in c.stocked for c in rest if c.slot == favorite)
        followed += slots.count(favorite)
        rest = [c for c in rest if named and c.slot != favorite and favorite not in c.stocked]
    return followed >= NEARLY_ALL * len(attempts) and bool(attempts)


def _usual(names: Sequence[str]) -> str | None:
    """Return the name that nearly all choices have in common, or None if there is no such name."""
    most = max(sorted(set(names)), key=names.count, default=None)
    return most if most is not None and names.count(most) >= NEARLY_ALL * len(names) else None
