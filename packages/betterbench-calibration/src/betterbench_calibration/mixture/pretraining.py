"""Pre-training mixture in appendices A.1 and A.2 of the paper, with the printed rows and recomputed sums."""

from __future__ import annotations

import importlib.resources
from dataclasses import dataclass
from functools import cache
from typing import Literal

from pydantic import TypeAdapter

from betterbench.json_form import read_form, strict_form
from betterbench_calibration.mixture.shares import MixturePart, WeightedGroup, Within, shares_of

ItemKind = Literal["actions", "image-text", "video-text"]

Inside = Literal["items", "equal", "magic-soup-plus"]
"""Division of the action draws among the six sets of Open X-Embodiment, which the paper does not state.

``magic-soup-plus`` are OpenVLA's weights (openvla/openvla@c8f03f48, ``prismatic/vla/datasets/rlds/oxe/mixtures.py``),
which are multiplied by the numbers of frames.
"""

_RULES: dict[Inside, Within] = {"items": "items", "equal": "equal", "magic-soup-plus": "weights-times-items"}


@strict_form
@dataclass(frozen=True, slots=True)
class PrintedSet:
    """Row of the paper's mixture table, in action frames or text samples. ``of`` lists the rows that a total sums."""

    name: str
    items: int
    episodes: int | None = None
    of: str = ""
    magic_soup_plus: float = 1.0


@strict_form
@dataclass(frozen=True, slots=True)
class PrintedGroup:
    """Group of data sets that share one weight in the mixture."""

    name: str
    kind: ItemKind
    weight: float
    datasets: tuple[PrintedSet, ...]

    @property
    def items(self) -> int:
        """Sum of the rows."""
        return sum(row.items for row in self.datasets)


@strict_form
@dataclass(frozen=True, slots=True)
class PretrainingRun:
    """A pre-training run in the appendix, with its groups, number of A800 GPUs and steps."""

    name: str
    groups: tuple[str, ...]
    gpus: int
    steps: int


@strict_form
@dataclass(frozen=True, slots=True)
class PrintedTotals:
    """Printed totals of episodes, and of frames and samples in millions with two decimals."""

    episodes: int
    frames_millions: float
    samples_millions: float


@dataclass(frozen=True, slots=True)
class CheckedTotal:
    """A printed total and the sum of its rows, in the printed unit and decimals."""

    what: str
    printed: float
    rows: int
    computed: float
    note: str

    @property
    def agrees(self) -> bool:
        """Whether the rounded sum equals the printed total."""
        return self.printed == self.computed


@strict_form
@dataclass(frozen=True, slots=True)
class PaperMixture:
    """The printed mixture of the paper."""

    source: str
    groups: tuple[PrintedGroup, ...]
    printed: PrintedTotals
    runs: tuple[PretrainingRun, ...]

    def totals(self) -> tuple[CheckedTotal, ...]:
        """Return each printed total with the sum of its rows."""
        actions = [row for group in self.groups if group.kind == "actions" for row in group.datasets]
        texts = [row for group in self.groups if group.kind != "actions" for row in group.datasets]
        episodes = sum(row.episodes or 0 for row in actions)
        frames, samples = sum(row.items for row in actions), sum(row.items for row in texts)
        p = self.printed
        return (
            CheckedTotal("episodes", p.episodes, episodes, episodes, ""),
            CheckedTotal(
                "frames [million]",
                p.frames_millions,
                frames,
                round(frames / 1e6, 2),
                "cut after two decimals, not rounded" if int(frames / 1e4) / 100 == p.frames_millions else "",
            ),
            CheckedTotal(
                "samples [million]",
                p.samples_millions,
                samples,
                round(samples / 1e6, 2),
                "the rows are themselves rounded to 0.01 million",
            ),
        )

    def parts(self, groups: tuple[str, ...] = (), inside: Inside = "items") -> tuple[MixturePart, ...]:
        """Return the data sets with their shares, restricted to ``groups`` if any are named.

        Raises:
            InvalidInputError: If no group has one of the names.
        """
        weighted = [
            WeightedGroup(
                group.name,
                group.weight,
                tuple(MixturePart(row.name, group.name, row.items, row.magic_soup_plus) for row in group.datasets),
                _RULES[inside] if len(group.datasets) > 1 else "items",
            )
            for group in self.groups
            if not groups or group.name in groups
        ]
        return shares_of(weighted)

    def kind_of(self, group: str) -> ItemKind:
        """Return the kind of a group's items."""
        return next(g.kind for g in self.groups if g.name == group)


_FORM = TypeAdapter(PaperMixture)


@cache
def paper_mixture() -> PaperMixture:
    """Return the mixture of the paper."""
    file = importlib.resources.files("betterbench_calibration.mixture") / "data" / "pretraining.json"
    return read_form(_FORM, file.read_bytes(), where="pretraining.json", cure="Install betterbench again")
