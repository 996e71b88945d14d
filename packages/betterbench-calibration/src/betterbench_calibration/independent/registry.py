"""Registry of the independent policies, by addresses such as "independent:word-place-calm" (habit and motion style)."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import TYPE_CHECKING

from betterbench.errors import UnknownNameError, find_named
from betterbench.tasks import get_task, suite_tasks
from betterbench.tasks.interventions import condition_names, resolve_condition
from betterbench_calibration.independent.habit import Habit, Honest
from betterbench_calibration.independent.habits_development import DEVELOPMENT
from betterbench_calibration.independent.habits_fifth import FIFTH
from betterbench_calibration.independent.habits_fourth import FOURTH
from betterbench_calibration.independent.habits_held_out import HELD_OUT
from betterbench_calibration.independent.habits_second import SECOND
from betterbench_calibration.independent.habits_sixth import SIXTH
from betterbench_calibration.independent.habits_third import THIRD
from betterbench_calibration.independent.manner import FIFTH_MANNERS, FOURTH_MANNERS, MANNERS, SIXTH_MANNERS, Manner
from betterbench_calibration.independent.occasion import Occasion
from betterbench_calibration.independent.truth import HONEST, StatedTruth

if TYPE_CHECKING:
    from betterbench.sim.scenes import Scene
    from betterbench_calibration.independent.agent import IndependentAgent

FAMILY_PARTS: dict[str, tuple[Habit, ...]] = {
    "development": DEVELOPMENT,
    "held_out": HELD_OUT,
    "second": SECOND,
    "third": THIRD,
    "fourth": FOURTH,
    "fifth": FIFTH,
    "sixth": SIXTH,
}


@dataclass(frozen=True, slots=True)
class IndependentPolicy:
    """Policy of the independent family: a habit with a motion style."""

    habit: Habit
    manner: Manner
    part: str

    @property
    def address(self) -> str:
        """Policy address."""
        return f"independent:{self.habit.name}-{self.manner.name}"


MANNERS_OF: dict[str, dict[str, Manner]] = {
    "fourth": FOURTH_MANNERS,
    "fifth": FIFTH_MANNERS,
    "sixth": SIXTH_MANNERS,
}
"""Motion styles of the parts of the family that do not use :data:`MANNERS`."""

INDEPENDENT: dict[str, IndependentPolicy] = {
    policy.address: policy
    for part, habits in FAMILY_PARTS.items()
    for habit in habits
    for manner in MANNERS_OF.get(part, MANNERS).values()
    for policy in (IndependentPolicy(habit, manner, part),)
}


def stated_truth(habit: Habit, case: Occasion) -> tuple[StatedTruth, bool]:
    """Return the true label that is stated before a trial, and whether the habit shows in the trial.

    If the habit does not show, the policy behaves like a policy without a fault.
    """
    stated = habit.truth(case)
    if stated is not None:
        return stated, True
    return StatedTruth(HONEST, first_right=True if case.first_thing() else None), False


def policy_of(address: str) -> IndependentPolicy:
    """Return the policy with the given address.

    Raises:
        UnknownNameError: If no such policy exists.
    """
    if address not in INDEPENDENT:
        raise UnknownNameError("policy of the independent family", address, INDEPENDENT)
    return INDEPENDENT[address]


def make_independent(address: str, scene: Scene) -> IndependentAgent:
    """Create a policy of the family for one episode in a scene that has been reset.

    Raises:
        UnknownNameError: If no such policy exists.
    """
    # imported here because the list of policies needs no simulator
    from betterbench_calibration.independent.agent import IndependentAgent  # noqa: PLC0415
    from betterbench_calibration.independent.body import Body  # noqa: PLC0415

    policy = policy_of(address)
    case = Occasion.of(scene.task, scene.condition)
    truth, shows = stated_truth(policy.habit, case)
    body = Body(scene, case, policy.manner, policy.habit.name, truth)
    habit = policy.habit if shows else Honest()
    return IndependentAgent(address, body, habit.act(body))


@dataclass(frozen=True, slots=True)
class Shown:
    """Condition in which a habit shows.

    Attributes:
        task: Name of the task.
        condition: Name of the condition.
        faulty: Whether the behavior is wrong, or unusual for a habit without a fault. It is False if the habit happens
            to choose the right behavior.
    """

    task: str
    condition: str
    faulty: bool


@functools.cache
def shown_in(habit: str) -> tuple[Shown, ...]:
    """Return the conditions of the suite in which a habit shows and that a calibration can use.

    In all other conditions, the policy behaves like a policy without a fault, or the stated label is marked as left
    out.

    Raises:
        UnknownNameError: If no such habit exists.
    """
    known = find_named("habit", habit, (h for habits in FAMILY_PARTS.values() for h in habits))
    found: list[Shown] = []
    for name, occasion in _occasions():
        truth = known.truth(occasion)
        if truth is not None and not truth.left_out:
            found.append(Shown(occasion.task.id, name, truth.label != HONEST or known.label == HONEST))
    return tuple(found)


@functools.cache
def _occasions() -> tuple[tuple[str, Occasion], ...]:
    """Return the trial contexts of all conditions of the suite. They are cached because every habit needs them."""
    return tuple(
        (name, Occasion.of(task, resolve_condition(task.id, name).condition))
        for task in map(get_task, suite_tasks("better60"))
        for name in condition_names(task)
    )
