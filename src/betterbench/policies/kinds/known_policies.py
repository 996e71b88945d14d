"""The policies that can be evaluated, by address."""

from __future__ import annotations

from dataclasses import dataclass

from betterbench.policies.experts import EXPERTS, REPLAYS


@dataclass(frozen=True, slots=True)
class PolicyEntry:
    """One policy as ``better list policies`` shows it; a privileged one sees the state instead of observations."""

    address: str
    summary: str
    privileged: bool


PLAIN = {
    "noop": PolicyEntry("noop", "Never moves.", privileged=False),
    "random": PolicyEntry("random", "A seeded random walk with a gripper that opens and closes.", privileged=False),
}
INDEPENDENT_FAMILY = PolicyEntry(
    "independent:HABIT-MANNER", "A faulty policy of the second, independent family, for calibrations.", privileged=True
)
LEARNED = PolicyEntry("learned:CHECKPOINT", "A learner that better train has trained.", privileged=True)
PREFIXES = {
    "replay": PolicyEntry("replay:RUN", "Plays the recorded actions of another run, open loop.", privileged=False),
    "python": PolicyEntry(
        "python:FILE.py:CLASS",
        "Your own class with info, reset and act; arguments follow as ?key=value.",
        privileged=False,
    ),
}
CONNECTED = {
    "openpi": PolicyEntry("openpi://HOST:PORT", "A server of openpi, or of better serve.", privileged=False),
    "gr00t": PolicyEntry("gr00t://HOST:PORT", "An inference server of Isaac GR00T.", privileged=False),
    "vla-eval": PolicyEntry("vla-eval://HOST:PORT", "A model server of vla-evaluation-harness.", privileged=False),
    "being-h": PolicyEntry("being-h://HOST:PORT", "An inference server of Being-H.", privileged=False),
    "starvla": PolicyEntry("starvla://HOST:PORT", "A websocket server of starVLA.", privileged=False),
    "http": PolicyEntry(
        "http://HOST:PORT/act", "A server of OpenVLA, OpenVLA-OFT or X-VLA (POST /act).", privileged=False
    ),
    "https": PolicyEntry("https://HOST/act", "The same over an encrypted connection.", privileged=False),
    "lerobot": PolicyEntry("lerobot:CHECKPOINT", "A policy of LeRobot, in a process of its own.", privileged=False),
}
REFUSED = ("grpc",)
"""Schemes of addresses that are read only to say why such a server is not spoken to."""


def known_policies() -> tuple[PolicyEntry, ...]:
    """Return all policies that can be evaluated."""
    privileged = tuple(PolicyEntry(e.address, e.summary, privileged=True) for e in EXPERTS.values())
    privileged += tuple(PolicyEntry(name, text, privileged=True) for name, text in REPLAYS.items())
    return (*privileged, INDEPENDENT_FAMILY, LEARNED, *PLAIN.values(), *PREFIXES.values(), *CONNECTED.values())
