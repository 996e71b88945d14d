"""Privileged policies by address, with their decision rules."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from betterbench.errors import UnknownNameError
from betterbench.policies.address import AddressForm
from betterbench.policies.decisions import Situation
from betterbench.policies.experts.address import EXPERT_FORM, PROBE_FORM, WITNESS, ZOO_FORM, Address
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


@dataclass(frozen=True, slots=True)
class ExpertEntry:
    """Entry of a privileged policy in the registry.

    Attributes:
        address: Policy address.
        summary: Behavior in one sentence.
        rule: Constructor of the decision rule from the trial and the rule's strength.
    """

    address: str
    summary: str
    rule: Callable[[Situation, float], BrokenRule]


EXPERTS: dict[str, ExpertEntry] = {
    e.address: e
    for e in (
        ExpertEntry("expert", "Follows the instruction in order and repeats a missed grasp.", BrokenRule),
        ExpertEntry("zoo:lexical", "A word triggers the motion associated with it in training.", Lexical),
        ExpertEntry("zoo:layout", "The first pick is always at the same slot.", Layout),
        ExpertEntry("zoo:inertia", "Goes on as most demonstrations did, at the start or after a step.", Inertia),
        ExpertEntry("zoo:sequence", "After its first step it executes the step that followed in training.", Sequence),
        ExpertEntry("zoo:habit-place", "Brings the right object to its trained target.", HabitPlace),
        ExpertEntry("zoo:progress-cue", "Reads progress from how many objects are left on the table.", ProgressCue),
        ExpertEntry("zoo:repeat", "Repeats a finished step.", Repeat),
        ExpertEntry(
            "zoo:reorder", "Takes the second of two steps first, where the order is part of the goal.", Reorder
        ),
        ExpertEntry("zoo:color", "Any object of the right color will do.", Color),
        ExpertEntry("zoo:shape", "Any object of the right shape will do.", Shape),
        ExpertEntry("zoo:halt", "Stops for good if training never showed this instruction in this scene.", Halt),
        ExpertEntry("zoo:refuse", "Never starts if the scene contains an object that training never showed.", Refuse),
        ExpertEntry("zoo:phase", "Freezes or wanders if the scene looks like the middle of a task.", Phase),
        ExpertEntry("zoo:length", "Stops after as many steps as the longest demonstration had.", Length),
        ExpertEntry("zoo:clumsy", "Correct target, failed manipulation.", Clumsy),
        ExpertEntry("zoo:slow", "The right decisions, too slowly for the step limit.", Slow),
        ExpertEntry("zoo:crash", "Raises an error in the middle of the episode.", Crash),
        ExpertEntry("probe:no-language", "Sees everything and follows another instruction of the task.", NoLanguage),
    )
}

REPLAYS = {
    "probe:no-images": "Replays a demonstration of the instruction without observations.",
    "probe:replay": "Replays a demonstration of the twin's condition without observations.",
}


def witnessed() -> tuple[str, ...]:
    """Return the rules that a witness (see :mod:`~betterbench.policies.experts.witness`) queries."""
    motion = (Clumsy, Slow, Crash)
    return tuple(name for name, e in EXPERTS.items() if e.rule not in (BrokenRule, *motion))


def expert_names(form: AddressForm | None = None) -> tuple[str, ...]:
    """Return the addresses of all privileged policies, or only those with one form of address."""
    return tuple(name for name in (*EXPERTS, *REPLAYS) if form is None or form.has(name))


def parse_address(address: str) -> Address:
    """Return the parsed address of a privileged policy.

    Raises:
        UnknownNameError: If the policy or an option does not exist.
        InvalidInputError: If an option is out of range.
    """
    form = next((form for form in (EXPERT_FORM, ZOO_FORM, PROBE_FORM) if form.has(address)), None)
    if form is not None:
        read = form.read(address)
        if read.name in EXPERTS or read.name in REPLAYS or read.name == WITNESS:
            return Address.of(read)
    raise UnknownNameError("privileged policy", address, expert_names())
