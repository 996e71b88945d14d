"""Pre-training mixture from appendices A.1 and A.2 of the paper, with the printed rows and recomputed totals."""

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
"""Rule that divides the draws of actions among the six data sets of Open X-Embodiment. The paper does not state it.

``magic-soup-plus`` uses OpenVLA's weights (openvla/openvla@c8f03f48,
``prismatic/vla/datasets/rlds/oxe/mixtures.py``), multiplied by the number of frames.
"""

_RULES: dict[Inside, Within] = {"items": "items", "equal": "equal", "magic-soup-plus": "weights-times-items"}


@strict_form
@dataclass(frozen=True, slots=True)
class PrintedSet:
    """Row of the paper's table of data sets.

    Attributes:
        name: Name of the data set.
        items: Number of frames with actions, or of text samples.
        episodes: Number of episodes, or None for text samples.
        of: Names of the source data sets that the row combines.
        magic_soup_plus: OpenVLA's weight of the data set.
    """

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
        """Total number of items in the group."""
        return sum(row.items for row in self.datasets)


@strict_form
@dataclass(frozen=True, slots=True)
class PretrainingRun:
    """Pre-training run of the paper, with its groups, its number of A800 GPUs and its number of steps."""

    name: str
    groups: tuple[str, ...]
    gpus: int
    steps: int


@strict_form
@dataclass(frozen=True, slots=True)
class PrintedTotals:
    """Totals that the paper prints: episodes, and frames and samples in millions with two decimals."""

    episodes: int
    frames_millions: float
    samples_millions: float


@dataclass(frozen=True, slots=True)
class CheckedTotal:
    """Printed total, compared with the sum of its rows.

    Attributes:
        what: Name of the total with its unit.
        printed: Total as printed.
        rows: Exact sum of the rows.
        computed: Sum of the rows in the unit and with the decimals of the printed total.
        note: Explanation of a difference, or empty.
    """

    what: str
    printed: float
    rows: int
    computed: float
    note: str

    @property
    def agrees(self) -> bool:
        """Whether the rounded sum of the rows equals the printed total."""
        return self.printed == self.computed


@strict_form
@dataclass(frozen=True, slots=True)
class PaperMixture:
    """Pre-training mixture of the paper, as printed."""

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
        """Return the data sets with their shares. If ``groups`` is not empty, use only these groups.

        Raises:
            InvalidInputError: If no group has one of the given names.
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
