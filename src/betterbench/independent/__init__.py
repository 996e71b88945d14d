"""The independent family: faulty policies with a controller and habits of their own, to test the diagnosis with."""

from betterbench.independent.registry import (
    FAMILY_PARTS,
    INDEPENDENT,
    PREFIX,
    IndependentPolicy,
    Shown,
    is_independent,
    make_independent,
    shown_in,
)

__all__ = [
    "FAMILY_PARTS",
    "INDEPENDENT",
    "PREFIX",
    "IndependentPolicy",
    "Shown",
    "is_independent",
    "make_independent",
    "shown_in",
]
