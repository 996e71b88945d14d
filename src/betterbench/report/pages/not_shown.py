"""Abilities that a policy may lack although it passes a variation.

They are found with pretenders, i.e. reference policies that lack an ability on purpose.
"""

from __future__ import annotations

from betterbench.diagnosis.measures.power_matrix import BLIND, FLOOR, Key, PowerMatrix
from betterbench.diagnosis.thresholds import FAILS_AT, REPLAY_LIMIT
from betterbench.tasks import Axis, get_task

_LOOKS = "looking at the scene"
_ABILITIES = {
    BLIND[0]: "following the instruction",
    BLIND[1]: _LOOKS,
    BLIND[2]: _LOOKS,
    FLOOR[0]: "aiming at any object",
    FLOOR[1]: "moving to the correct position",
    "zoo:lexical": "finding the named object outside its training slot",
    "zoo:layout": "recognizing its first target by its appearance",
    "zoo:color": "distinguishing the requested object from objects of the same color",
    "zoo:shape": "distinguishing the requested object from objects of the same shape",
}
"""Ability that each pretender lacks. If the pretender passes a variation, the variation does not require this ability.
"""
_OF_LOOK_ALIKES = ("zoo:color", "zoo:shape")
"""Pretenders that are only considered for variations in which objects were replaced by look-alikes."""
_MOVING_BLIND = (*BLIND[1:], FLOOR[0])


def passing_pretenders(matrix: PowerMatrix, key: Key) -> tuple[str, ...]:
    """Return the reference policies that pass a variation, i.e. solve more than half of its trials.

    Reference policies that replay a motion without looking pass if they solve more than a quarter of the trials.
    """
    perturbed = get_task(key[0]).variation(key[1]).axis is Axis.ADVERSARIAL_OBJECT_PERTURBATION
    found = []
    for name in _ABILITIES:
        cell = matrix.cell(name, key)
        if cell is None or (name in _OF_LOOK_ALIKES and not perturbed):
            continue
        if cell.k > (REPLAY_LIMIT if name in _MOVING_BLIND else FAILS_AT) * cell.n:
            found.append(name)
    return tuple(found)


def not_shown(matrix: PowerMatrix, key: Key) -> str:
    """Return a sentence about the abilities that a policy may lack although it passes a variation."""
    if all(matrix.cell(name, key) is None for name in _ABILITIES):
        return "The power of this variation was not measured."
    passing = passing_pretenders(matrix, key)
    if not passing:
        return "No measured policy passes this variation without the tested ability."
    abilities = {_ABILITIES[name]: [n for n in passing if _ABILITIES[n] == _ABILITIES[name]] for name in passing}
    parts = [f"without {ability} ({_counts(matrix, key, names)})" for ability, names in abilities.items()]
    return f"A policy can pass {', '.join(parts[:-1])}{' or ' if parts[1:] else ''}{parts[-1]}."


def _counts(matrix: PowerMatrix, key: Key, names: list[str]) -> str:
    cells = ((name, matrix.cells[name][key]) for name in names)
    return ", ".join(f"`{name}` passes {cell.k} of {cell.n} trials" for name, cell in cells)
