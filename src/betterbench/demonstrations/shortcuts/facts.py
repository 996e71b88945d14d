"""Facts about demonstrations for the shortcut audit.

The facts of a demonstration are its instruction, the moved objects with their origins and targets, and the initial
layout. They are computed from the states of a record or from the specification of a condition. For an external data
set, they are computed from instructions, actions and proprioception. In this case, objects have no names, and places
are named by their positions.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from betterbench.demonstrations.shortcuts.words import instruction_words
from betterbench.records import Record, subgoal_segments
from betterbench.tasks import Condition
from betterbench.tasks.relations import RELATIONS

HANDLED_ROLES = ("item", "distractor")
"""Roles of loose objects on the table. All other objects are landmarks."""

SET_OUT_M = 0.05
"""Horizontal distance from the start at which the initial direction of the tool is determined [m]."""
HEADINGS = ("away", "away and left", "left", "back and left", "back", "back and right", "right", "away and right")
"""Directions relative to the robot, counterclockwise when seen from above.

The x axis points away from the robot, and the y axis points to its left.
"""


@dataclass(frozen=True, slots=True)
class ShownStep:
    """Manipulation step of a demonstration: the moved object, its origin and its target.

    Attributes:
        thing: Kind of the object; "" if unknown.
        word: Word that the instruction uses for the object; "" if unknown.
        origin: Slot that the object was taken from; "" for objects that have no slot, such as drawers.
        target: Target that the object was moved to.
    """

    thing: str
    word: str
    origin: str
    target: str


@dataclass(frozen=True, slots=True)
class EpisodeFacts:
    """Facts of one demonstration.

    Attributes:
        episode: Episode name.
        group: Group of demonstrations that are compared with each other, usually the task.
        instruction: Instruction of the demonstration.
        steps: Manipulation steps, in order of time.
        standing: Kind and slot of every loose object on the table at the start.
        landmarks: Kind and slot of every object that cannot be picked.
        heading: Initial direction of the gripper; "" if unknown.
    """

    episode: str
    group: str
    instruction: str
    steps: tuple[ShownStep, ...]
    standing: tuple[tuple[str, str], ...] = ()
    landmarks: tuple[tuple[str, str], ...] = ()
    heading: str = ""

    @property
    def words(self) -> frozenset[str]:
        """Words of the instruction, see :func:`~betterbench.demonstrations.shortcuts.words.instruction_words`."""
        return instruction_words(self.instruction)

    @property
    def privileged(self) -> bool:
        """Whether the initial layout is known, so that objects have names."""
        return bool(self.standing)

    def to_json(self) -> dict[str, Any]:
        """Return the facts as a JSON-serializable dict."""
        return asdict(self)


def facts_of_record(record: Record, condition: Condition) -> EpisodeFacts:
    """Return the facts of a recorded episode.

    Args:
        record: Record of the episode. Its states show which objects were moved.
        condition: Condition in which the episode started. The names of its slots are used as names of places.
    """
    meta = record.metadata
    goals = {goal.name: goal for goal in condition.instruction.subgoals}
    segments = subgoal_segments(record, condition)
    steps = [
        _step(condition, s.object, s.target, s.region, goals[s.subgoal].word) for s in segments if s.subgoal in goals
    ]
    name = f"{meta.task}/{meta.condition}/{meta.seed}"
    return _facts(condition, name, meta.instruction, steps, heading_of(record.ee_position))


def facts_of_condition(condition: Condition) -> EpisodeFacts:
    """Return the facts about correct behavior in a condition.

    If a word of the instruction can refer to several objects, the first of these objects is used.
    """
    steps = []
    taken: set[str] = set()
    for goal in condition.instruction.subgoals:
        names = [n for n in condition.resolve(goal.reference) if n not in taken]
        # A subgoal that is already met at the start is not a step.
        done = [n for n in condition.resolve(goal.reference) if n in condition.preplaced]
        if not names or (done and goal.count <= len(done)):
            continue
        on_table = [n for n in names if n in condition.layout or not RELATIONS[goal.relation].carried]
        if on_table:
            taken.add(on_table[0])
            steps.append(_step(condition, on_table[0], goal.target, goal.region, goal.word))
    return _facts(condition, condition.id, condition.instruction.text, steps, "")


def heading_of(positions: npt.NDArray[np.float64]) -> str:
    """Return the initial direction of a tool, as one of :data:`HEADINGS`, or "" if the tool moves too little.

    Args:
        positions: (T, 3) positions of the tool [m].
    """
    away = positions[:, :2] - positions[0, :2]
    far = np.flatnonzero(np.hypot(away[:, 0], away[:, 1]) >= SET_OUT_M)
    if not far.size:
        return ""
    x, y = away[far[0]]
    return HEADINGS[round(math.atan2(y, x) / (math.tau / len(HEADINGS))) % len(HEADINGS)]


def _step(condition: Condition, name: str, target: str, region: str, word: str) -> ShownStep:
    return ShownStep(
        condition.object(name).kind, word, condition.layout.get(name, ""), _place(condition, target, region)
    )


def _facts(condition: Condition, name: str, said: str, steps: Iterable[ShownStep], heading: str) -> EpisodeFacts:
    loose = {o.name for o in condition.objects if o.role in HANDLED_ROLES}
    # A plate on which other plates are stacked is never picked, so it is a landmark, like a rack.
    goals = condition.instruction.subgoals
    anchors = {g.target for g in goals} - {n for g in goals for n in condition.resolve(g.reference)}
    stands = [(n, slot) for n, slot in condition.layout.items()]
    return EpisodeFacts(
        name,
        condition.task,
        said,
        tuple(steps),
        tuple(sorted((condition.object(n).kind, slot) for n, slot in stands if n in loose - anchors)),
        tuple(sorted((condition.object(n).kind, slot) for n, slot in stands if n not in loose or n in anchors)),
        heading,
    )


def _place(condition: Condition, target: str, region: str) -> str:
    kind = condition.object(target).kind
    return f"{kind}, {region}" if region else kind
