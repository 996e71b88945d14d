"""Variations as data: a training condition, the interventions that turn it, and what they are meant to show."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from betterbench.tasks.axes import Axis, Expected, Support


@dataclass(frozen=True, slots=True)
class Intervention:
    """One operation ``do(...)`` on a condition, as data; the package ``interventions`` carries it out.

    Attributes:
        operation: Name of the operation ("swap", "replace").
        arguments: Its arguments.
    """

    operation: str
    arguments: Mapping[str, Any] = field(default_factory=dict)

    def __str__(self) -> str:
        """Return the form ``do(swap a=burger_1 b=fries)``."""
        shown = (f"{k}={getattr(v, 'text', getattr(v, 'name', v))}" for k, v in self.arguments.items())
        return f"do({' '.join((self.operation, *shown))})"


def do(operation: str, **arguments: object) -> Intervention:
    """Return an intervention as data.

    Args:
        operation: Name of the operation.
        **arguments: Its arguments, by name.
    """
    return Intervention(operation, dict(arguments))


@dataclass(frozen=True, slots=True)
class Variation:
    """A training condition turned into a test condition.

    Attributes:
        name: Axis letter and running number ("L3").
        axis: Axis of the intervention.
        base: Name of the training condition it is derived from; the same seed of it is the counterfactual twin.
        interventions: Operations, applied in order.
        title: A few words for tables.
        hypothesis: What a failure would mean.
        exposes: Outcome labels it can bring out.
        expected: What a right policy does.
        support: Whether all poses lie inside the training regime.
        mid_task_look: True if the initial state looks like the middle of a demonstration.
        premise_broken: True if the instruction deliberately presupposes what is not there.
    """

    name: str
    axis: Axis
    base: str
    interventions: tuple[Intervention, ...]
    title: str
    hypothesis: str
    exposes: tuple[str, ...]
    expected: Expected = Expected.SUCCEED
    support: Support = Support.SEEN
    mid_task_look: bool = False
    premise_broken: bool = False

    def __post_init__(self) -> None:
        """Check that the name begins with the letter of the axis."""
        if self.name[0] != self.axis.letter:
            msg = f"variation {self.name!r} of axis {self.axis.value} must begin with {self.axis.letter}"
            raise ValueError(msg)
