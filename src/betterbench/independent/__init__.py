"""The independent family: faulty policies with a controller and habits of their own, to test the diagnosis with."""

from betterbench.independent.registry import (
    HALVES,
    INDEPENDENT,
    PREFIX,
    IndependentPolicy,
    Shown,
    is_independent,
    make_independent,
    shown_in,
)

__all__ = [
    "HALVES",
    "INDEPENDENT",
    "PREFIX",
    "IndependentPolicy",
    "Shown",
    "is_independent",
    "make_independent",
    "shown_in",
]
