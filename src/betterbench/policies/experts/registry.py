"""Addresses of the privileged policies: "expert", "zoo:lexical", "zoo:lexical?strength=0.3&action_noise=0.002"."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from urllib.parse import parse_qsl

from betterbench.errors import InvalidInputError
from betterbench.policies.decisions import Situation
from betterbench.policies.faulty import (
    BrokenRule,
    Clumsy,
    Color,
    Crash,
    HabitPlace,
    Halt,
    Inertia,
    Layout,
    Length,
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

MAX_ACTION_NOISE_M = 0.02
"""Largest action noise that can be asked for [m]; with more, everything is knocked over."""


@dataclass(frozen=True, slots=True)
class ExpertEntry:
    """One privileged policy.

    Attributes:
        address: Its address.
        summary: What it does, one sentence.
        rule: Makes its rule from the trial and the strength of its rule.
    """

    address: str
    summary: str
    rule: Callable[[Situation, float], BrokenRule]


EXPERTS: dict[str, ExpertEntry] = {
    e.address: e
    for e in (
        ExpertEntry("expert", "Does what is asked, in order, and tries again after a missed grasp.", BrokenRule),
        ExpertEntry("zoo:lexical", "A word triggers the motion that went with it in training.", Lexical),
        ExpertEntry("zoo:layout", "The first pick is always at the same place.", Layout),
        ExpertEntry("zoo:inertia", "Begins with the step that most demonstrations began with.", Inertia),
        ExpertEntry("zoo:sequence", "After its first step it plays the step that followed in training.", Sequence),
        ExpertEntry("zoo:habit-place", "Brings the right thing where training brought it.", HabitPlace),
        ExpertEntry("zoo:progress-cue", "Reads progress from how many objects are left on the table.", ProgressCue),
        ExpertEntry("zoo:repeat", "Does a finished step again.", Repeat),
        ExpertEntry(
            "zoo:reorder", "Takes the second of two steps first, where the order is part of the goal.", Reorder
        ),
        ExpertEntry("zoo:color", "Any object of the right color will do.", Color),
        ExpertEntry("zoo:shape", "Any object of the right shape will do.", Shape),
        ExpertEntry("zoo:halt", "Stops for good if training never showed this instruction in this scene.", Halt),
        ExpertEntry("zoo:refuse", "Never starts if the scene holds an object that training never showed.", Refuse),
        ExpertEntry("zoo:phase", "Freezes or wanders if the scene looks like the middle of a task.", Phase),
        ExpertEntry("zoo:length", "Stops when it has done as many steps as the longest demonstration had.", Length),
        ExpertEntry("zoo:clumsy", "Correct target, failed manipulation.", Clumsy),
        ExpertEntry("zoo:slow", "The right decisions, too slowly for the step limit.", Slow),
        ExpertEntry("zoo:crash", "Breaks down in the middle of the episode.", Crash),
        ExpertEntry("probe:no-language", "Sees everything and follows another instruction of the task.", NoLanguage),
    )
}

REPLAYS = {
    "probe:no-images": "Plays a demonstration of the instruction, without looking.",
    "probe:replay": "Plays a demonstration of the twin's condition, without looking.",
}

WITNESS = "expert:witness"
"""The expert that also writes down which faulty rules decide as it does (see
:mod:`betterbench.policies.experts.witness`)."""


def witnessed() -> tuple[str, ...]:
    """Return the rules that a witness asks: those that move as well as the expert and never break down."""
    motion = (Clumsy, Slow, Crash)
    return tuple(name for name, e in EXPERTS.items() if e.rule not in (BrokenRule, *motion))


@dataclass(frozen=True, slots=True)
class Address:
    """A privileged policy and the noise in which it is asked for.

    Attributes:
        name: Its name without options.
        strength: Share of trials in which its rule applies.
        action_noise_m: Standard deviation of the noise on each control step's translation [m].
    """

    name: str
    strength: float = 1.0
    action_noise_m: float = 0.0

    def __str__(self) -> str:
        """Return the address, options that have their default left out."""
        options = [f"strength={self.strength:g}"] * (self.strength < 1.0) + [
            f"action_noise={self.action_noise_m:g}"
        ] * (self.action_noise_m > 0.0)
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
    if name not in EXPERTS and name not in REPLAYS and name != WITNESS:
        return None
    ranges = {"strength": (0.0, 1.0), "action_noise": (0.0, MAX_ACTION_NOISE_M)}
    found = {"strength": 1.0, "action_noise": 0.0}
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
    return Address(name, found["strength"], found["action_noise"])
