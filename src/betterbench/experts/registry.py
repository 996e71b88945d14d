"""Addresses of the privileged policies: "expert", "zoo:lexical", "zoo:lexical?strength=0.3&tremor=0.002"."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from urllib.parse import parse_qsl

from betterbench.errors import InvalidInputError, UnknownNameError
from betterbench.experts.mind import Situation
from betterbench.experts.privileged import Manner, PrivilegedAgent
from betterbench.experts.probes import make_replay
from betterbench.experts.zoo import (
    BrokenRule,
    Clumsy,
    Colour,
    Crash,
    HabitPlace,
    Halt,
    Inertia,
    Layout,
    Lexical,
    NoLanguage,
    Phase,
    ProgressCue,
    Refuse,
    Reorder,
    Repeat,
    Sequence,
    Shape,
    Slow,
)
from betterbench.scenes import Scene
from betterbench.state import PrivilegedPolicy

MAX_TREMOR_M = 0.02
"""Largest tremor that can be asked for [m]; a hand that shakes more knocks everything over."""


@dataclass(frozen=True, slots=True)
class ExpertEntry:
    """One privileged policy.

    Attributes:
        address: Its address.
        summary: What it does, one sentence.
        mind: Makes its mind from the trial and the strength of its rule.
    """

    address: str
    summary: str
    mind: Callable[[Situation, float], BrokenRule]


EXPERTS: dict[str, ExpertEntry] = {
    e.address: e
    for e in (
        ExpertEntry("expert", "Privileged; does what is asked, in order, and recovers from missed grasps.", BrokenRule),
        ExpertEntry("zoo:lexical", "A word triggers the motion that went with it in training.", Lexical),
        ExpertEntry("zoo:layout", "The first pick is always at the same place.", Layout),
        ExpertEntry("zoo:inertia", "Begins with the step that most demonstrations began with.", Inertia),
        ExpertEntry("zoo:sequence", "After its first step it plays the step that followed in training.", Sequence),
        ExpertEntry("zoo:habit-place", "Brings the right thing where training brought it.", HabitPlace),
        ExpertEntry("zoo:progress-cue", "Reads progress from how many things are left on the table.", ProgressCue),
        ExpertEntry("zoo:repeat", "Does a finished step again.", Repeat),
        ExpertEntry(
            "zoo:reorder", "Takes the second of two steps first, where the order is part of the goal.", Reorder
        ),
        ExpertEntry("zoo:colour", "Any object of the right colour will do.", Colour),
        ExpertEntry("zoo:shape", "Any object of the right shape will do.", Shape),
        ExpertEntry("zoo:halt", "Stops for good where sentence and scene were never met together.", Halt),
        ExpertEntry("zoo:refuse", "Never starts where the scene holds a thing that training never showed.", Refuse),
        ExpertEntry("zoo:phase", "Freezes or wanders where the scene looks like the middle of a task.", Phase),
        ExpertEntry("zoo:clumsy", "The right decision, a bad grasp.", Clumsy),
        ExpertEntry("zoo:slow", "The right decisions, too slowly for the step limit.", Slow),
        ExpertEntry("zoo:crash", "Breaks down in the middle of the episode.", Crash),
        ExpertEntry("probe:no-language", "Sees everything and obeys another sentence of the task.", NoLanguage),
    )
}

REPLAYS = {
    "probe:no-images": "Plays the demonstration that goes with the sentence, without looking.",
    "probe:replay": "Plays the demonstration of the twin, without looking or listening.",
}


@dataclass(frozen=True, slots=True)
class Address:
    """A privileged policy and the manner in which it is asked for.

    Attributes:
        name: Its name without options.
        strength: Share of trials in which its rule applies.
        tremor_m: Standard deviation of the noise on each control step's translation [m].
    """

    name: str
    strength: float = 1.0
    tremor_m: float = 0.0

    def __str__(self) -> str:
        """Return the address, options that have their default left out."""
        options = [f"strength={self.strength:g}"] * (self.strength < 1.0) + [f"tremor={self.tremor_m:g}"] * (
            self.tremor_m > 0.0
        )
        return self.name + ("?" + "&".join(options) if options else "")


def expert_names() -> tuple[str, ...]:
    """Return the addresses of all privileged policies."""
    return (*EXPERTS, *REPLAYS)


def parse_address(address: str) -> Address | None:
    """Return what an address asks for, or None if it names no privileged policy.

    Raises:
        InvalidInputError: If an option is unknown or out of range.
    """
    name, _, query = address.partition("?")
    if name not in EXPERTS and name not in REPLAYS:
        return None
    ranges = {"strength": (0.0, 1.0), "tremor": (0.0, MAX_TREMOR_M)}
    found = {"strength": 1.0, "tremor": 0.0}
    for key, text in parse_qsl(query, keep_blank_values=True):
        where = f"policy {address}"
        if key not in ranges:
            raise InvalidInputError(where, f"the option {key!r} is unknown", f"Use {' or '.join(ranges)}")
        low, high = ranges[key]
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not low <= value <= high:
            raise InvalidInputError(where, f"{key} is {text!r}", f"Give a number from {low:g} to {high:g}")
        found[key] = value
    return Address(name, found["strength"], found["tremor"])


def make_expert(address: str, scene: Scene) -> PrivilegedPolicy:
    """Return a privileged policy for one episode.

    Args:
        address: Its address.
        scene: The scene the episode runs in.

    Raises:
        UnknownNameError: If there is no such policy.
        InvalidInputError: If an option is unknown or out of range.
    """
    asked = parse_address(address)
    if asked is None:
        raise UnknownNameError("privileged policy", address, expert_names())
    if asked.name in REPLAYS:
        return make_replay(asked.name, scene, play=lambda other: make_expert("expert", other))
    mind = EXPERTS[asked.name].mind(Situation(scene.task, scene.condition, scene.seed), asked.strength)
    return PrivilegedAgent(address, scene, mind, manner=_manner(mind, asked))


def _manner(mind: BrokenRule, asked: Address) -> Manner:
    """Return how the body carries out what the mind decides."""
    slow = isinstance(mind, Slow) and mind.applies
    return Manner(
        fumble=mind.fumble if isinstance(mind, Clumsy) else None,
        tremor_m=asked.tremor_m,
        speed=Slow.speed if slow else 1.0,
        crash_step=mind.crash_step if isinstance(mind, Crash) else None,
    )
