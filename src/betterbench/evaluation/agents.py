"""From a policy's address to a mind for one episode."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from betterbench.episodes.episode import Mind
from betterbench.errors import InvalidInputError, UnknownNameError
from betterbench.evaluation.plan import Trial
from betterbench.experts import EXPERTS, REPLAYS, make_expert, parse_address
from betterbench.interface import Policy
from betterbench.interface.actions import EE_DELTA
from betterbench.policies import Noop, Random, Replay, load_plugin
from betterbench.recording import RunFolder
from betterbench.scenes import Scene


@dataclass(frozen=True, slots=True)
class PolicyEntry:
    """One policy as ``better list policies`` shows it.

    Attributes:
        address: How to ask for it.
        summary: What it is, one sentence.
        privileged: True if it sees the truth instead of observations.
    """

    address: str
    summary: str
    privileged: bool


_PLAIN = {
    "noop": PolicyEntry("noop", "Never moves.", privileged=False),
    "random": PolicyEntry("random", "A seeded random walk with a gripper that opens and closes.", privileged=False),
}
_PREFIXES = {
    "replay": PolicyEntry("replay:RUN", "Plays the recorded actions of another run, open loop.", privileged=False),
    "python": PolicyEntry("python:MODULE:CLASS", "A class of yours with info, reset and act.", privileged=False),
}


def known_policies() -> tuple[PolicyEntry, ...]:
    """Return all policies that can be asked for."""
    privileged = tuple(PolicyEntry(e.address, e.summary, privileged=True) for e in EXPERTS.values())
    privileged += tuple(PolicyEntry(name, text, privileged=True) for name, text in REPLAYS.items())
    return (*privileged, *_PLAIN.values(), *_PREFIXES.values())


def check_policy(address: str, *, action_space: str | None = None) -> None:
    """Check that an address means something, before a run is planned for it.

    Args:
        address: Address of the policy.
        action_space: Action space of the run, which the policy has to answer in; None where there is no run yet.

    Raises:
        UnknownNameError: If the address means nothing.
        InvalidInputError: If a plugin cannot be loaded, or the policy answers in another action space.
        RecordError: If the run to replay does not exist.
    """
    if address.startswith("replay:"):
        RunFolder.open(Path(address.removeprefix("replay:")))
        return  # Its action space is that of each record, which it compares itself.
    if is_privileged(address):
        declared = EE_DELTA.name
    elif address in _PLAIN or address.startswith("python:"):
        declared = _make(address).info.action_space
    else:
        raise UnknownNameError("policy", address, (e.address for e in known_policies()))
    if action_space not in (None, declared):
        raise InvalidInputError(
            "action space",
            f"the policy {address} answers in {declared!r}, the run asks for {action_space!r}",
            f"Give --action-space {declared}, or another policy",
        )


def _make(address: str) -> Policy:
    """Return a policy that sees observations and needs to know nothing of the trial."""
    if address == "noop":
        return Noop()
    if address == "random":
        return Random()
    return load_plugin(address.removeprefix("python:"))


def is_privileged(address: str) -> bool:
    """Tell whether a policy sees the truth instead of observations."""
    return parse_address(address) is not None


class Minds:
    """Makes minds for the episodes of one worker; policies that keep weights or connections are made once."""

    def __init__(self, address: str) -> None:
        """Prepare for one policy.

        Raises:
            UnknownNameError: If there is no such policy.
        """
        check_policy(address)
        self.address = address
        self._kept: Policy | None = None

    def mind(self, scene: Scene, trial: Trial) -> Mind:
        """Return the mind for one episode.

        Args:
            scene: The scene of the episode.
            trial: The trial.
        """
        if is_privileged(self.address):
            return make_expert(self.address, scene)
        if self.address.startswith("replay:"):
            return Replay(
                self.address.removeprefix("replay:"),
                task=trial.task,
                condition=trial.condition,
                base=trial.base_condition or trial.condition,
                seed=trial.seed,
            )
        if self._kept is None:
            self._kept = _make(self.address)
        return self._kept
