"""Regularities in the training tasks of a LIBERO suite, such as the object positions that go with each word.

They are read from the task files of the base suite, because policies are trained on this suite. The initial states of a
task vary by a few centimeters around the positions in the task's file.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from betterbench.json_form import strict_form
from betterbench.tasks import TrainingDistribution

CARRIED = {"in": "inside", "on": "on_plate"}
"""Relations of LIBERO that are established by carrying an object. The values are similar relations of betterbench."""

_PICKED = re.compile(r"pick(?: up)? the (.+?) and (?:place|put)\b", re.IGNORECASE)


@strict_form
@dataclass(frozen=True, slots=True)
class TrainedTask:
    """Training task in a base suite, with its instruction, its steps and the start of each object.

    Attributes:
        instruction: Instruction of the task.
        steps: Subgoals. Each is given by the relation, the name and the kind of the object, and the kind of the target.
        starts: Kind and start position of each object, by the object's name.
    """

    instruction: str
    steps: tuple[tuple[str, str, str, str], ...]
    starts: Mapping[str, tuple[str, str]]

    def to_json(self) -> dict[str, Any]:
        """Return a JSON-serializable dict."""
        return {
            "instruction": self.instruction,
            "steps": [list(step) for step in self.steps],
            "starts": {name: list(start) for name, start in self.starts.items()},
        }


def word_of_sentence(instruction: str, kind: str) -> str:
    """Return the words of an instruction that identify the object to pick.

    If there are no such words, return the kind of the object.
    """
    found = _PICKED.search(instruction)
    return kind if found is None else found[1]


def trained_in(tasks: Sequence[TrainedTask]) -> TrainingDistribution:
    """Return the regularities of a suite.

    The tasks of a suite differ in the instruction and in the objects at each position. If all tasks begin with the same
    kind of object, the result contains no habit, because a policy that begins with this kind does what every task
    requires.
    """
    word_slots: dict[str, set[str]] = {}
    kind_slots: dict[str, set[str]] = {}
    standing: dict[str, set[str]] = {}
    targets: dict[str, set[tuple[str, str, str]]] = {}
    first: Counter[str] = Counter()
    sequences: list[tuple[str, ...]] = []
    for task in tasks:
        for kind, place in task.starts.values():
            standing.setdefault(place, set()).add(kind)
        carried = [step for step in task.steps if step[0] in CARRIED and step[1] in task.starts]
        for relation, name, kind, target in carried:
            place = task.starts[name][1]
            word = word_of_sentence(task.instruction, kind) if len(carried) == 1 else kind
            word_slots.setdefault(word, set()).add(place)
            kind_slots.setdefault(kind, set()).add(place)
            targets.setdefault(kind, set()).add((target, CARRIED[relation], ""))
        if carried:
            first[carried[0][2]] += 1
            sequences.append(tuple(step[2] for step in carried))
    return TrainingDistribution(
        {w: tuple(sorted(s)) for w, s in word_slots.items()},
        {k: tuple(sorted(s)) for k, s in kind_slots.items()},
        {s: tuple(sorted(k)) for s, k in standing.items()},
        tuple(sorted(first.items(), key=lambda item: (-item[1], item[0]))) if len(first) > 1 else (),
        {k: tuple(sorted(p)) for k, p in targets.items()},
        tuple(sequences),
        max((len(task.starts) for task in tasks), default=0),
    )
