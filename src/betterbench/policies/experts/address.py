"""Addresses of the privileged policies: "expert", "zoo:lexical", "zoo:lexical?strength=0.3&action_noise=0.002"."""

from __future__ import annotations

from dataclasses import dataclass

from betterbench.policies.address import AddressForm, Option, PolicyAddress

MAX_ACTION_NOISE_M = 0.02
"""Maximum action noise [m]. With more noise, the robot knocks over objects in every trial."""

OPTIONS = (
    Option("strength", "the share of the trials in which the faulty rule applies", "number", 1.0),
    Option(
        "action_noise",
        "the standard deviation of the noise on each control step's translation [m]",
        "number",
        MAX_ACTION_NOISE_M,
    ),
)

EXPERT_FORM = AddressForm(scheme="expert", example="expert", target="optional", options=OPTIONS)
ZOO_FORM = AddressForm(scheme="zoo", example="zoo:lexical", target="optional", options=OPTIONS)
PROBE_FORM = AddressForm(scheme="probe", example="probe:no-language", target="optional", options=OPTIONS)

WITNESS = "expert:witness"
"""Address of the expert that also records which faulty rules make the same decisions (see
:mod:`betterbench.policies.experts.witness`)."""


@dataclass(frozen=True, slots=True)
class Address:
    """Address of a privileged policy, with its execution noise.

    Attributes:
        name: Name without options.
        strength: Fraction of trials in which the rule applies.
        action_noise_m: Standard deviation of the noise on each control step's translation [m].
    """

    name: str
    strength: float = 1.0
    action_noise_m: float = 0.0

    @classmethod
    def of(cls, read: PolicyAddress) -> Address:
        """Return the privileged policy of a parsed address."""
        return cls(read.name, read.number("strength", 1.0), read.number("action_noise", 0.0))

    def __str__(self) -> str:
        """Return the address, without options at their default."""
        options = [f"strength={self.strength:g}"] * (self.strength < 1.0) + [
            f"action_noise={self.action_noise_m:g}"
        ] * (self.action_noise_m > 0.0)
        return self.name + ("?" + "&".join(options) if options else "")
