"""Addresses of the privileged policies."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from betterbench.errors import UnknownNameError
from betterbench.experts.mind import ExpertMind, Mind, Situation
from betterbench.experts.privileged import PrivilegedAgent
from betterbench.experts.skills import Fumble
from betterbench.experts.zoo import Colour, Halt, Inertia, Layout, Lexical, ProgressCue, clumsiness
from betterbench.scenes import Scene


@dataclass(frozen=True, slots=True)
class ExpertEntry:
    """One privileged policy.

    Attributes:
        address: Its address.
        summary: What it does, one sentence.
        mind: Makes its mind.
        fumble: Decides on a deliberate clumsiness, or None.
    """

    address: str
    summary: str
    mind: Callable[[Situation], Mind]
    fumble: Callable[[Situation], Fumble | None] | None = None


EXPERTS: dict[str, ExpertEntry] = {
    e.address: e
    for e in (
        ExpertEntry("expert", "Privileged; does what is asked, in order, and recovers from missed grasps.", ExpertMind),
        ExpertEntry("zoo:lexical", "A word triggers the motion that went with it in training.", Lexical),
        ExpertEntry("zoo:layout", "The first pick is always at the same place.", Layout),
        ExpertEntry("zoo:inertia", "Begins with the step that most demonstrations began with.", Inertia),
        ExpertEntry("zoo:progress-cue", "Reads progress from how many things are left on the table.", ProgressCue),
        ExpertEntry("zoo:colour", "Any object of the right colour will do.", Colour),
        ExpertEntry("zoo:halt", "Stops for good where sentence and scene were never met together.", Halt),
        ExpertEntry("zoo:clumsy", "The right decision, a bad grasp.", ExpertMind, clumsiness),
    )
}


def expert_names() -> tuple[str, ...]:
    """Return the addresses of all privileged policies."""
    return tuple(EXPERTS)


def make_expert(address: str, scene: Scene) -> PrivilegedAgent:
    """Return a privileged policy for one episode.

    Args:
        address: Its address.
        scene: The scene the episode runs in.

    Raises:
        UnknownNameError: If there is no such policy.
    """
    try:
        entry = EXPERTS[address]
    except KeyError:
        raise UnknownNameError("privileged policy", address, EXPERTS) from None
    return PrivilegedAgent(address, scene, entry.mind, fumble=entry.fumble)
