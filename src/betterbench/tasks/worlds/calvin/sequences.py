"""The 1,000 chains of CALVIN's long-horizon evaluation, each with a start state and a sequence of instructions."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib import resources
from itertools import product
from types import MappingProxyType

import numpy as np

from betterbench.errors import InvalidInputError
from betterbench.tasks.worlds.calvin.subtasks import Subtask, SymbolicState, SymbolValue, subtask_named, subtasks

CHAINS = 1000
"""Number of chains in one evaluation."""

CHAIN_LENGTH = 5
"""Number of subtasks in a chain."""

GOLDEN = "840cb992c69ce9b6d59f6020966b6300c15233f8e0b9667b6486c1962424d308"
"""SHA-256 of :func:`chain_text` for the 1,000 chains of the official generator.

The generator is that of mees/calvin@fa03f01 with NumPy 2.4.
"""

_PLACES = ("table", "slider_right", "slider_left")
_VALUES: Mapping[str, tuple[SymbolValue, ...]] = {
    "led": (0, 1),
    "lightbulb": (0, 1),
    "slider": ("right", "left"),
    "drawer": ("closed", "open"),
    "red_block": _PLACES,
    "blue_block": _PLACES,
    "pink_block": _PLACES,
    "grasped": (0,),
}


@dataclass(frozen=True, slots=True)
class Chain:
    """Chain of five subtasks that are to be done in a row, with its start state.

    Attributes:
        number: Index among the 1,000 chains.
        start: Symbolic start state, with the keys in CALVIN's order.
        names: Names of the subtasks.
    """

    number: int
    start: SymbolicState
    names: tuple[str, ...]

    @property
    def subtasks(self) -> tuple[Subtask, ...]:
        """Subtasks of the chain, looked up by their names."""
        return tuple(map(subtask_named, self.names))


def start_states() -> tuple[SymbolicState, ...]:
    """Return the 192 symbolic start states in CALVIN's order. In each, one or two blocks are on the table."""
    found = []
    for values in product(*_VALUES.values()):
        if values.count("table") in {1, 2} and all(values.count(place) < 2 for place in _PLACES[1:]):
            found.append(MappingProxyType(dict(zip(_VALUES, values, strict=True))))
    return tuple(found)


def draw_names(start: SymbolicState, count: int, *, seed: int) -> list[tuple[str, ...]]:
    """Draw the subtasks of chains from one start as CALVIN does.

    Five different subtasks are drawn. The draw is repeated until the subtasks can be done in the order of the draw.
    CALVIN draws with ``numpy.random.choice(34 names, size=5, replace=False)``. This call returns the beginning of a
    permutation by NumPy's legacy generator, which produces the same stream in all versions.

    Args:
        start: Symbolic start.
        count: Number of chains.
        seed: Index of the start among the 192 starts. CALVIN uses this index as the seed.
    """
    generator = np.random.RandomState(seed)
    every = subtasks()
    drawn: list[tuple[str, ...]] = []
    while len(drawn) < count:
        chosen = [every[i] for i in generator.permutation(len(every))[:CHAIN_LENGTH].tolist()]
        if _follow(start, chosen):
            drawn.append(tuple(subtask.name for subtask in chosen))
    return drawn


def _follow(start: SymbolicState, chosen: Sequence[Subtask]) -> bool:
    """Return whether subtasks can be done one after the other from a start state.

    Each subtask must be possible in exactly one way, and all subtasks must belong to different categories.
    """
    state = start
    for subtask in chosen:
        after = subtask.after(state)
        if after is None:
            return False
        state = after
    return len({subtask.category for subtask in chosen}) == len(chosen)


def draw_chains() -> tuple[Chain, ...]:
    """Draw all 1,000 chains again, as CALVIN's ``get_sequences(1000)`` does. This takes about a minute."""
    starts = start_states()
    counts = [len(part) for part in np.array_split(range(CHAINS), len(starts))]
    pairs = [
        (start, names)
        for seed, (start, count) in enumerate(zip(starts, counts, strict=True))
        for names in draw_names(start, count, seed=seed)
    ]
    np.random.RandomState(0).shuffle(pairs)  # type: ignore[arg-type] # a list is shuffled in place
    return tuple(Chain(number, start, names) for number, (start, names) in enumerate(pairs))


def chain_text(chains: Iterable[Chain]) -> str:
    """Return chains as the JSON string whose digest is :data:`GOLDEN`.

    The string is a list of pairs, each with a start state and the names of the subtasks.
    """
    return json.dumps([[dict(chain.start), list(chain.names)] for chain in chains])


@cache
def _every_chain() -> tuple[Chain, ...]:
    text = resources.files("betterbench.tasks.worlds.calvin").joinpath("data/chains.json").read_text(encoding="utf-8")
    known = subtasks()
    starts = start_states()
    chains = tuple(
        Chain(number, starts[start], tuple(known[i].name for i in names))
        for number, (start, *names) in enumerate(json.loads(text)["chains"])
    )
    digest = hashlib.sha256(chain_text(chains).encode()).hexdigest()
    if digest != GOLDEN:
        problem = f"its chains have the digest {digest[:12]}… instead of CALVIN's {GOLDEN[:12]}…"
        raise InvalidInputError("chains.json", problem, "Install betterbench again")
    return chains


def calvin_chains(count: int = CHAINS) -> tuple[Chain, ...]:
    """Return the first ``count`` of the 1,000 chains.

    CALVIN's own ``get_sequences(100)`` draws a hundred different chains. Results on those chains cannot be compared
    with results on the 1,000 chains.

    Raises:
        InvalidInputError: If ``count`` is out of range.
    """
    if not 1 <= count <= CHAINS:
        raise InvalidInputError(
            "chains", f"{count} is not between 1 and {CHAINS}", f"Use {CHAINS} to run as many chains as CALVIN"
        )
    return _every_chain()[:count]
