"""Draft of a generated task: training conditions, variations, and variations that could not be derived."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TypeVar

import numpy as np

from betterbench.errors import BetterError, InvalidInputError
from betterbench.generation.cast import Cast
from betterbench.generation.layout import Table, crowding
from betterbench.generation.patterns.pattern import GeneratedTask, Unbuilt
from betterbench.tasks import authoring as a
from betterbench.tasks.authoring.operations import Operation
from betterbench.tasks.authoring.template import Template
from betterbench.tasks.authoring.training_distribution import pairing
from betterbench.tasks.axes import Axis
from betterbench.tasks.condition import Condition, ObjectSpec, Slot

LEAST_VARIATIONS, LEAST_AXES = 4, 3
"""Minimum number of variations of a generated task, and minimum number of axes among them."""


@dataclass
class Draft:
    """Task under construction. :meth:`finish` checks and completes it.

    Attributes:
        training: Training conditions. They get the names train1, train2 and so on.
        variations: Variations added so far.
        unbuilt: Variations that could not be derived.
    """

    template: Template
    cast: Cast
    table: Table
    training: tuple[Condition, ...]
    description: str
    variations: list[a.Variation] = field(default_factory=list)
    unbuilt: list[Unbuilt] = field(default_factory=list)

    def __post_init__(self) -> None:
        """Name the training conditions."""
        self.training = tuple(c.with_(name=f"train{i}") for i, c in enumerate(self.training, start=1))

    def base_of(self, instruction: a.Instruction, layout: Mapping[ObjectSpec, Slot] | None = None) -> str:
        """Return the name of the first training condition with a given instruction.

        If a layout is given, the condition must have this layout too.
        """
        slots = None if layout is None else {o.name: slot.name for o, slot in layout.items()}
        return next(
            c.name
            for c in self.training
            if c.instruction == instruction and (slots is None or slots.items() >= c.layout.items())
        )

    def vary(
        self,
        axis: str,
        operations: Sequence[Operation],
        title: str,
        hypothesis: str,
        base: str = "train1",
        *,
        refuse: bool = False,
        mid_task: bool = False,
    ) -> bool:
        """Add a variation.

        If the variation is impossible, tests nothing new, or has objects that could touch, it is listed as unbuilt
        instead.

        Returns:
            Whether the variation was added.
        """
        number = 1 + sum(v.name.startswith(axis) for v in self.variations)
        made = a.Variation(
            f"{axis}{number}",
            tuple(operations),
            title,
            hypothesis,
            base,
            expected=a.Expected.REFUSE if refuse else a.Expected.SUCCEED,
            mid_task_look=mid_task,
            premise_broken=refuse,
        )
        problem = self._problem(made)
        if problem is None:
            self.variations.append(made)
        else:
            self.leave_out(axis, title, problem)
        return problem is None

    def leave_out(self, axis: str, title: str, reason: str) -> None:
        """List a variation as unbuilt because it cannot be derived."""
        self.unbuilt.append(Unbuilt(axis, title, reason))

    def _problem(self, variation: a.Variation) -> str | None:
        """Return the reason why a variation is impossible or tests nothing new, or None if it is valid."""
        try:
            condition = self._carried_out(variation)
        except BetterError as error:
            return str(error)
        if pairing(condition) in {pairing(c) for c in self.training}:
            return "training contains this condition"
        if pairing(condition) in {pairing(self._carried_out(v)) for v in self.variations}:
            return "another variation is the same condition"
        problems = (*self.template.problems(condition), crowding(condition, self._slots))
        return next((problem for problem in problems if problem), None)

    def _carried_out(self, variation: a.Variation) -> Condition:
        condition = next(c for c in self.training if c.name == variation.base)
        for operation in variation.interventions:
            condition, _ = operation.carry_out(condition)
        return condition

    def _tests(self) -> set[tuple[str, frozenset[tuple[str, str]]]]:
        return {pairing(self._carried_out(v)) for v in self.variations}

    def crossed(
        self,
        movers: Sequence[ObjectSpec],
        slots: Sequence[Slot],
        fixed: Mapping[ObjectSpec, Slot],
        asked: Sequence[a.Instruction],
    ) -> tuple[Condition, ...]:
        """Return balanced conditions with every order of the movable objects in the slots and with every instruction.

        If there are more than three movable objects, only the cyclic rotations of their order are used. An object that
        the instruction does not request is left out of one in four conditions, and of every condition that would be the
        same as a test with this object.
        """
        turned = ((*slots[i:], *slots[:i]) for i in range(len(slots)))
        orders = tuple(itertools.permutations(slots)) if len(slots) <= 3 else tuple(turned)
        tests, found = self._tests(), []
        for number, order in enumerate(orders):
            for which, instruction in enumerate(asked):
                layout = {**dict(zip(movers, order, strict=True)), **fixed}
                kinds = {goal.reference.kind for goal in instruction.subgoals}
                spare = next((o for o in reversed(movers) if o.kind not in kinds), None)
                if spare is not None and (
                    (number + which) % 4 == 2 or pairing(a.condition(layout, instruction)) in tests
                ):
                    del layout[spare]
                found.append(a.condition(layout, instruction))
        return tuple(found)

    @property
    def _slots(self) -> dict[str, Slot]:
        return {slot.name: slot for slot in self.table.slots}

    def finish(
        self, balanced: Iterable[Condition], *, confounds: Sequence[str], crossed: Sequence[str]
    ) -> GeneratedTask:
        """Check the draft, and return the finished task.

        Balanced conditions are left out if a test has the same initial scene and the same instruction.

        Raises:
            InvalidInputError: If a condition does not fit the template, its objects may touch, or there are too few
                variations.
        """
        tests = self._tests()
        kept = tuple(c for c in balanced if pairing(c) not in tests)
        where = f"cast {self.cast.scenario.name!r}"
        for condition in (*self.training, *kept):
            problems = (*self.template.problems(condition), crowding(condition, self._slots))
            found = next((problem for problem in problems if problem), None)
            if found:
                raise InvalidInputError(where, found, "Choose smaller objects")
        axes = {Axis.of(v.name) for v in self.variations}
        if len(self.variations) < LEAST_VARIATIONS or len(axes) < LEAST_AXES:
            left = "; ".join(f"{u.axis} {u.title}: {u.reason}" for u in self.unbuilt)
            problem = (
                f"{len(self.variations)} variations over {len(axes)} axes can be derived, but 4 over 3 axes are needed"
            )
            raise InvalidInputError(
                where, f"{problem} ({left})", "Choose objects that look alike, or objects of other sizes"
            )
        used = {slot for c in (*self.training, *kept) for slot in c.layout.values()}
        used |= {slot for v in self.variations for slot in self._carried_out(v).layout.values()}
        task = a.Task(
            version=1,
            title=self.cast.scenario.name,
            template=self.template,
            slots=tuple(slot for slot in self.table.slots if slot.name in used),
            training=self.training,
            variations=tuple(self.variations),
            description=self.description,
        )
        numbered = tuple(c.with_(name=f"balanced{i}") for i, c in enumerate(kept, start=1))
        return GeneratedTask(task, tuple(confounds), numbered, tuple(crossed), tuple(self.unbuilt))


Choice = TypeVar("Choice")


def first_that_fits(choices: Sequence[Choice], build: Callable[[Choice], GeneratedTask]) -> GeneratedTask:
    """Build a task from each choice in turn, and return the first task in which the objects have enough room.

    Raises:
        InvalidInputError: If no choice leaves enough room. The error of the last choice is raised.
    """
    errors = []
    for choice in choices:
        try:
            return build(choice)
        except InvalidInputError as error:
            errors.append(error)
    raise errors[-1]


def in_order(variations: Iterable[a.Variation]) -> tuple[a.Variation, ...]:
    """Sort variations by axis: layout shift, recomposition, object perturbation, temporal extrapolation."""
    return tuple(sorted(variations, key=lambda variation: "LROT".index(variation.name[0])))


def shuffled(cast: Cast, slots: Sequence[Slot]) -> tuple[Slot, ...]:
    """Return slots in a random order that depends on the seed of a cast (a scenario with chosen assets)."""
    order = np.random.default_rng(cast.seed).permutation(len(slots)).tolist()
    return tuple(slots[i] for i in order)
