"""Choice of the next template and context, and acceptance of certified tasks, so that the quotas are filled.

All choices depend only on the accepted tasks and on the drawn scenarios, not on the number of workers or on timing.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from betterbench.generation.growth.difficulty import Difficulty
from betterbench.generation.growth.quotas import Kind, Quota
from betterbench.generation.growth.sources import Cell
from betterbench.tasks import Axis

_LIKELY = 0.5
"""Minimum fraction of a template's tasks with the same level of difficulty.

Above this fraction, the next task of the template is expected to have this level too.
"""
_TASK_KINDS: tuple[Kind, ...] = ("template", "context", "difficulty")


@dataclass(frozen=True, slots=True)
class Traits:
    """Properties of a certified task that count toward quotas.

    Attributes:
        template: Name of the template.
        context: Context of the scenario.
        difficulty: Level of difficulty.
        variations: Number of variations by axis.
    """

    template: str
    context: str
    difficulty: str
    variations: Mapping[str, int]


_EXPECTED: Mapping[str, tuple[str, str]] = {
    "patterned_arrangement": ("LLRROT", "medium"),
    "loose_packing": ("LRROOTT", "medium"),
    "constrained_positioning": ("LLLLOOT", "easy"),
    "container_loading": ("LLROOTT", "hard"),
    "logical_assembly": ("LRROTT", "hard"),
    "precision_insertion": ("LLROT", "medium"),
    "recursive_stacking": ("LLROTT", "easy"),
}
"""Axes of the variations (one letter each) and difficulty of a typical task, by template. Used as initial estimates."""


class _Mix:
    """Mean properties of the tasks of a template.

    The properties are the number of variations on each axis, and the fraction of tasks with each level of difficulty.
    """

    def __init__(self, template: str) -> None:
        letters, level = _EXPECTED.get(template, ("LROT", ""))
        self._number = 1
        self._axes: Counter[str] = Counter({axis.value: letters.count(axis.letter) for axis in Axis})
        share = 1.0 / len(Difficulty)
        self._levels = {d.value: (1.0 if d.value == level else 0.0) if level else share for d in Difficulty}

    def add(self, traits: Traits) -> None:
        """Include the properties of a task in the means."""
        self._number += 1
        self._axes.update(traits.variations)
        self._levels[traits.difficulty] += 1.0

    def variations(self, axis: str) -> float:
        """Return the mean number of variations per task on an axis."""
        return self._axes[axis] / self._number

    @property
    def total(self) -> float:
        """Mean number of variations per task."""
        return sum(self._axes.values()) / self._number

    def share(self, axis: str) -> float:
        """Return the fraction of the variations that are on an axis."""
        return self.variations(axis) / self.total

    def level(self, difficulty: str) -> float:
        """Return the fraction of the tasks that have a given level of difficulty."""
        return self._levels[difficulty] / self._number


class _Tally:
    """Counts of accepted tasks, plus expected counts of the scenarios that are being built."""

    def __init__(self) -> None:
        self.tasks = 0
        self.counts: dict[tuple[Kind, str], float] = {}
        self.variations = 0.0

    def copy(self) -> _Tally:
        """Return an independent copy."""
        other = _Tally()
        other.tasks, other.counts, other.variations = self.tasks, dict(self.counts), self.variations
        return other

    def of(self, kind: Kind, value: str) -> float:
        """Return the number of tasks with a certain value of a property.

        For an axis, variations are counted instead of tasks.
        """
        return self.counts.get((kind, value), 0.0)

    def _count(self, kind: Kind, value: str, number: float) -> None:
        self.counts[kind, value] = self.of(kind, value) + number

    def add(self, traits: Traits) -> None:
        """Count an accepted task."""
        self.tasks += 1
        self._count("template", traits.template, 1.0)
        self._count("context", traits.context, 1.0)
        self._count("difficulty", traits.difficulty, 1.0)
        for axis, number in traits.variations.items():
            self._count("axis", axis, float(number))
            self.variations += number

    def expect(self, cell: Cell, mix: _Mix) -> None:
        """Count a scenario that is being built as an accepted task with the mean properties of its template."""
        self.tasks += 1
        self._count("template", cell.template, 1.0)
        self._count("context", cell.context, 1.0)
        for level in Difficulty:
            self._count("difficulty", level.value, mix.level(level.value))
        for axis in Axis:
            self._count("axis", axis.value, mix.variations(axis.value))
        self.variations += mix.total


class Steering:
    """Chooses the next template and context, and accepts certified tasks, so that the quotas are filled.

    Args:
        quotas: Quotas that the suite must fulfill.
        until: Requested number of tasks.
        templates: Names of the templates that the author can use.
    """

    def __init__(self, quotas: Sequence[Quota], until: int, templates: Sequence[str]) -> None:
        self._quotas, self._until = tuple(quotas), until
        self._mixes = {template: _Mix(template) for template in templates}
        self._tally = _Tally()
        self._drawn: Counter[str] = Counter()

    @property
    def left(self) -> int:
        """Number of tasks that are still missing."""
        return self._until - self._tally.tasks

    def note(self, cell: Cell) -> None:
        """Count a proposed scenario, so that templates and contexts without a quota are used in turn."""
        self._drawn.update([f"template {cell.template}", f"context {cell.context}"])

    def choose(self, cells: Iterable[Cell], pending: Sequence[Cell]) -> Cell | None:
        """Return the template and context of the next scenario, or None if the quotas allow no further scenario.

        The choice is the template and context with which a task would help to fill the most open quotas. If several are
        equally helpful, the least-used ones are chosen. If all missing tasks are needed to reach the minimums for a
        property, only values of this property that still lack tasks are chosen.

        Args:
            cells: Templates and contexts that the author has a new scenario for.
            pending: Templates and contexts of the scenarios that are being built. Each scenario counts as one task.
        """
        tally = self._tally.copy()
        for cell in pending:
            tally.expect(cell, self._mixes[cell.template])
        best: tuple[tuple[float, int, int], Cell] | None = None
        for cell in cells:
            if not self._is_allowed(cell, tally):
                continue
            drawn = self._drawn
            rank = (self._served(cell, tally), -drawn[f"template {cell.template}"], -drawn[f"context {cell.context}"])
            if best is None or rank > best[0]:
                best = rank, cell
        return None if best is None else best[1]

    def _is_allowed(self, cell: Cell, tally: _Tally) -> bool:
        values: Mapping[Kind, str] = {"template": cell.template, "context": cell.context}
        for quota in self._quotas:
            full = tally.of(quota.kind, quota.value) >= quota.most_of(self._until)
            if quota.kind in values and quota.value == values[quota.kind] and full:
                return False
            is_likely = quota.kind == "difficulty" and self._mixes[cell.template].level(quota.value) > _LIKELY
            if is_likely and full:
                return False
        places = self._until - tally.tasks
        return all(
            self._need(tally, kind, value) > 0.0 or self._needs(tally, kind) < places for kind, value in values.items()
        )

    def _need(self, tally: _Tally, kind: Kind, value: str) -> float:
        """Return the number of tasks that are missing to reach the minimum in the quota for a value."""
        for quota in self._quotas:
            if quota.kind == kind and quota.value == value:
                return max(0.0, quota.least_of(self._until) - tally.of(kind, value))
        return 0.0

    def _needs(self, tally: _Tally, kind: Kind) -> float:
        return sum(self._need(tally, kind, q.value) for q in self._quotas if q.kind == kind)

    def _served(self, cell: Cell, tally: _Tally) -> float:
        """Return the expected number of open quotas that a task with a given template and context helps to fill."""
        mix, found = self._mixes[cell.template], 0.0
        for quota in self._quotas:
            match quota.kind:
                case "template" | "context":
                    own = cell.template if quota.kind == "template" else cell.context
                    found += quota.value == own and self._need(tally, quota.kind, quota.value) > 0.0
                case "difficulty":
                    found += mix.level(quota.value) * (self._need(tally, quota.kind, quota.value) > 0.0)
                case "axis":
                    found += self._served_axis(quota, mix, tally)
        return round(found, 9)

    def _served_axis(self, quota: Quota, mix: _Mix, tally: _Tally) -> float:
        """Return how much a task of a given template helps to fill the quota for an axis, from 0 to 1.

        The value is relative to the template with the largest fraction of variations on this axis.
        """
        best = max(m.share(quota.value) for m in self._mixes.values()) or 1.0
        share = 100.0 * tally.of("axis", quota.value) / tally.variations if tally.variations else 0.0
        if share < quota.least:
            return mix.share(quota.value) / best
        if quota.most is not None and share > quota.most:
            return 1.0 - mix.share(quota.value) / best
        return 0.0

    def take(self, traits: Traits) -> str:
        """Accept a certified task and return an empty string, or return why a quota rules it out."""
        self._mixes[traits.template].add(traits)
        after = self._tally.copy()
        after.add(traits)
        places = self._until - after.tasks
        if places < 0:
            return f"{self._until} tasks are reached"
        for quota in self._quotas:
            if quota.kind != "axis" and after.of(quota.kind, quota.value) > quota.most_of(self._until):
                return f"the quota {quota} is full"
        for kind in _TASK_KINDS:
            if self._needs(after, kind) > places:
                return f"the open quotas of the {kind} need all remaining places"
        for quota in self._quotas:
            if quota.kind == "axis" and not self._is_reachable(quota, after, places):
                return f"the quota {quota} could not be reached any more"
        self._tally = after
        return ""

    def _is_reachable(self, quota: Quota, tally: _Tally, places: int) -> bool:
        """Return whether the quota for an axis can still be met if only the best template is used from now on."""
        low, high = quota.least / 100.0, 1.0 if quota.most is None else quota.most / 100.0
        number, total = tally.of("axis", quota.value), tally.variations
        surplus = max(m.variations(quota.value) - low * m.total for m in self._mixes.values())
        excess = min(m.variations(quota.value) - high * m.total for m in self._mixes.values())
        return number - low * total + places * surplus > -1e-9 and number - high * total + places * excess < 1e-9

    def best_share(self) -> dict[str, float]:
        """Return the largest expected fraction of a task's variations that are on each axis, over all templates."""
        return {axis.value: max(mix.share(axis.value) for mix in self._mixes.values()) for axis in Axis}

    def standing(self) -> list[tuple[Quota, float, bool]]:
        """Return the state of each quota: its current amount, and whether it is still open."""
        found = []
        for quota in self._quotas:
            have = self._tally.of(quota.kind, quota.value)
            least, most = float(quota.least_of(self._until)), float(quota.most_of(self._until))
            if quota.kind == "axis":
                have = 100.0 * have / self._tally.variations if self._tally.variations else 0.0
                least, most = quota.least, 100.0 if quota.most is None else quota.most
            found.append((quota, have, not least - 1e-9 <= have <= most + 1e-9))
        return found
