"""A power matrix of two variations, made by hand."""

from __future__ import annotations

from betterbench.diagnosis.measures.power_matrix import PowerCell, PowerMatrix, task_versions
from betterbench.tasks import Label, get_task

L1, R1, T1 = (("fast_food", name) for name in ("L1", "R1", "T1"))
LEXICAL = Label.LEXICAL_KINEMATIC_SHORTCUT.value
HALT = Label.EARLY_HALT.value


def failing(label: str, n: int = 6) -> PowerCell:
    return PowerCell(0, n, 0, wrong={label: n}, failed={label: n})


def solving(n: int = 6, **fields) -> PowerCell:
    return PowerCell(n, n, n, **fields)


def matrix(**rows: dict) -> PowerMatrix:
    """Returns a matrix of fast_food/L1 and R1, with rows changed by name ("zoo_lexical")."""
    cells = {
        "expert": {L1: solving(), R1: solving()},
        "zoo:lexical": {L1: failing(LEXICAL), R1: solving(shared=6)},
        "zoo:shape": {L1: PowerCell(3, 6, 3, wrong={LEXICAL: 6}, failed={LEXICAL: 3}), R1: solving(shared=6)},
        "zoo:halt": {L1: failing(HALT), R1: failing(HALT)},
        "probe:no-language": {L1: PowerCell(4, 14, 4), R1: PowerCell(14, 14, 14)},
        "probe:no-images": {L1: PowerCell(0, 7, 0), R1: PowerCell(0, 7, 0)},
        "probe:replay": {L1: PowerCell(1, 7, 1), R1: PowerCell(7, 7, 7)},
        "random": {L1: PowerCell(0, 7, 0), R1: PowerCell(0, 7, 0)},
        "noop": {L1: PowerCell(0, 2, 0), R1: PowerCell(0, 2, 0)},
    }
    cells |= {name.replace("_", ":", 1): row for name, row in rows.items()}
    return PowerMatrix(cells, {L1: 0.25, R1: 0.5}, task_versions(get_task("fast_food")))
