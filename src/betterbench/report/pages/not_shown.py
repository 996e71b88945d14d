"""Abilities that a passed variation does not prove, because a policy without them also passes."""

from __future__ import annotations

from betterbench.diagnosis.measures.power_matrix import BLIND, FLOOR, Key, PowerMatrix
from betterbench.diagnosis.thresholds import FAILS_AT, REPLAY_LIMIT
from betterbench.tasks import Axis, get_task

_LOOKS = "looks at the scene"
_ABILITIES = {
    BLIND[0]: "follows the instruction",
    BLIND[1]: _LOOKS,
    BLIND[2]: _LOOKS,
    FLOOR[0]: "aims at any object",
    FLOOR[1]: "moves to the correct position",
    "zoo:lexical": "finds the named object outside its training slot",
    "zoo:layout": "chooses its first target by cues other than position",
    "zoo:color": "distinguishes the requested object from objects of the same color",
    "zoo:shape": "distinguishes the requested object from objects of the same shape",
}
"""Ability that each pretender lacks, and which is therefore not required where the pretender succeeds."""
_OF_LOOK_ALIKES = ("zoo:color", "zoo:shape")
"""Pretenders that are considered only if objects were exchanged for look-alikes."""
_MOVING_BLIND = (*BLIND[1:], FLOOR[0])


def passing_pretenders(matrix: PowerMatrix, key: Key) -> tuple[str, ...]:
    """Return the pretenders that pass a variation: in over half of its trials, or in a quarter if they move blindly."""
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
    """Return a sentence on the abilities that passing a variation does not show, from the measured trials."""
    if all(matrix.cell(name, key) is None for name in _ABILITIES):
        return "The power of this variation was not measured."
    passing = passing_pretenders(matrix, key)
    if not passing:
        return "No measured policy passes this variation without the tested ability."
    abilities = {_ABILITIES[name]: [n for n in passing if _ABILITIES[n] == _ABILITIES[name]] for name in passing}
    parts = [f"that a policy {ability} ({_counts(matrix, key, names)})" for ability, names in abilities.items()]
    return f"A pass does not show {' or '.join(parts)}."


def _counts(matrix: PowerMatrix, key: Key, names: list[str]) -> str:
    cells = ((name, matrix.cells[name][key]) for name in names)
    return ", ".join(f"`{name}` passes {cell.k} of {cell.n}" for name, cell in cells)
