"""Addresses of the privileged policies: "expert", "zoo:lexical", "zoo:lexical?strength=0.3&action_noise=0.002"."""

from __future__ import annotations

from dataclasses import dataclass

from betterbench.policies.address import AddressForm, Option, PolicyAddress

MAX_ACTION_NOISE_M = 0.02
"""Largest allowed action noise [m]. With more noise, the robot knocks over objects in every trial."""

OPTIONS = (
    Option("strength", "the fraction of trials in which the faulty rule applies", "number", 1.0),
    Option(
        "action_noise",
        "the standard deviation of the noise added to the translation of each control step [m]",
        "number",
        MAX_ACTION_NOISE_M,
    ),
)

EXPERT_FORM = AddressForm(scheme="expert", example="expert", target="optional", options=OPTIONS)
ZOO_FORM = AddressForm(scheme="zoo", example="zoo:lexical", target="optional", options=OPTIONS)
PROBE_FORM = AddressForm(scheme="probe", example="probe:no-language", target="optional", options=OPTIONS)

WITNESS = "expert:witness"
"""Address of the expert that also records which faulty rules would make the same decisions (see
:mod:`betterbench.policies.experts.witness`).
"""


@dataclass(frozen=True, slots=True)
class Address:
    """Parsed address of a privileged policy, with options for the strength of its fault and for execution noise.

    Attributes:
        name: Address without the options.
        strength: Fraction of trials in which the faulty rule applies.
        action_noise_m: Standard deviation of the noise added to the translation of each control step [m].
    """

    name: str
    strength: float = 1.0
    action_noise_m: float = 0.0

    @classmethod
    def of(cls, read: PolicyAddress) -> Address:
        """Return the privileged policy that a parsed policy address describes."""
        return cls(read.name, read.number("strength", 1.0), read.number("action_noise", 0.0))

    def __str__(self) -> str:
        """Return the address. Options with their default value are omitted."""
        options = [f"strength={self.strength:g}"] * (self.strength < 1.0) + [
            f"action_noise={self.action_noise_m:g}"
        ] * (self.action_noise_m > 0.0)
        return self.name + ("?" + "&".join(options) if options else "")
