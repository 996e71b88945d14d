"""Registry of the privileged policies and their decision rules, by address."""

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
        address: Address of the policy.
        summary: Description of the policy's behavior in one sentence.
        rule: Function that creates the decision rule, given the trial and the strength of the fault.
    """

    address: str
    summary: str
    rule: Callable[[Situation, float], BrokenRule]


EXPERTS: dict[str, ExpertEntry] = {
    e.address: e
    for e in (
        ExpertEntry("expert", "Follows the instruction in order and repeats a missed grasp.", BrokenRule),
        ExpertEntry("zoo:lexical", "Executes the motion that training associated with a word.", Lexical),
        ExpertEntry("zoo:layout", "Always picks first at the same slot.", Layout),
        ExpertEntry("zoo:inertia", "Continues as most demonstrations did, at the start or after a step.", Inertia),
        ExpertEntry("zoo:sequence", "After its first step it executes the step that followed in training.", Sequence),
        ExpertEntry("zoo:habit-place", "Brings the right object to its trained target.", HabitPlace),
        ExpertEntry("zoo:progress-cue", "Infers progress from the number of objects left on the table.", ProgressCue),
        ExpertEntry("zoo:repeat", "Repeats a finished step.", Repeat),
        ExpertEntry("zoo:reorder", "Executes the second of two steps first if the order is part of the goal.", Reorder),
        ExpertEntry("zoo:color", "Takes any object of the right color.", Color),
        ExpertEntry("zoo:shape", "Takes any object of the right shape.", Shape),
        ExpertEntry("zoo:halt", "Stops for good if training never showed this instruction in this scene.", Halt),
        ExpertEntry("zoo:refuse", "Never starts if the scene contains an object that training never showed.", Refuse),
        ExpertEntry("zoo:phase", "Freezes or wanders if the scene looks like the middle of a task.", Phase),
        ExpertEntry("zoo:length", "Stops after as many steps as the longest demonstration had.", Length),
        ExpertEntry("zoo:clumsy", "Chooses the right target, but fails to manipulate the object.", Clumsy),
        ExpertEntry("zoo:slow", "Makes the right decisions, but moves too slowly for the step limit.", Slow),
        ExpertEntry("zoo:crash", "Raises an error in the middle of the episode.", Crash),
        ExpertEntry(
            "probe:no-language", "Gets the complete state, but follows another instruction of the task.", NoLanguage
        ),
    )
}

REPLAYS = {
    "probe:no-images": "Replays a demonstration of the instruction without observations.",
    "probe:replay": "Replays a demonstration of the twin's condition without observations.",
}


def witnessed() -> tuple[str, ...]:
    """Return the rules that a witness compares with the expert (see :mod:`~betterbench.policies.experts.witness`)."""
    motion = (Clumsy, Slow, Crash)
    return tuple(name for name, e in EXPERTS.items() if e.rule not in (BrokenRule, *motion))


def expert_names(form: AddressForm | None = None) -> tuple[str, ...]:
    """Return the addresses of all privileged policies, or of those with a given address format."""
    return tuple(name for name in (*EXPERTS, *REPLAYS) if form is None or form.has(name))


def parse_address(address: str) -> Address:
    """Parse the address of a privileged policy.

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
