"""Questions about grounding: the box of an object, a point on an object, and the object in a given box."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence

from betterbench.interface.state import Box, SeenObject, inner_pixel
from betterbench.vqa.moment import Moment
from betterbench.vqa.nouns import definite
from betterbench.vqa.question import Form, QuestionDraft

CELLS = 8
"""Number of image cells per side over which boxes and points are balanced. A cell is about as large as an object."""
COARSE_CELLS = 4
"""Number of image cells per side for questions about a given box.

Answers are balanced within each cell, so that the coordinates of the box do not reveal them.
"""
MOST_OPTIONS = 4
"""Maximum number of objects to choose from in one question."""


def grounding(moment: Moment) -> Iterator[QuestionDraft]:
    """Yield questions that ask for the box of each object, a point on it, and the kind of the object in a box."""
    for kind, o in moment.named.items():
        seen = moment.view.objects[o.name]
        words, cell = {"thing": definite(kind)}, cell_of(seen, moment.view.width, CELLS)
        yield QuestionDraft(
            Form.BOX, "box of", (kind,), written(seen.box), words, (o.name,), bucket=cell, box=seen.box
        )  # fmt: skip
        point = written(inner_pixel(seen, moment.view.width))
        yield QuestionDraft(
            Form.POINT, "point at", (kind,), point, words, (o.name,), bucket=cell, box=seen.box, runs=seen.runs
        )  # fmt: skip
    for kinds in chunks(sorted(moment.named)):
        for kind in kinds:
            o = moment.named[kind]
            seen = moment.view.objects[o.name]
            if _is_alone(moment, o.name, seen.box):
                cell = cell_of(seen, moment.view.width, COARSE_CELLS)
                words = {"box": written(seen.box)}
                yield QuestionDraft(Form.CHOICE, "what is in box", (*kinds, cell), kind, words, (o.name,), box=seen.box)


def written(numbers: Sequence[int]) -> str:
    """Return coordinates as they are written in texts, such as "[12, 40, 30, 66]"."""
    return f"[{', '.join(map(str, numbers))}]"


def cell_of(seen: SeenObject, width: int, cells: int) -> str:
    """Return the image cell that contains the center of an object's box."""
    left, top, right, bottom = seen.box
    step = width / cells
    return f"cell {int(0.5 * (left + right) // step)},{int(0.5 * (top + bottom) // step)} of {cells}"


def chunks(kinds: Sequence[str]) -> list[tuple[str, ...]]:
    """Divide kinds of objects into groups of two to four.

    All questions about these kinds use the same groups.
    """
    if len(kinds) < 2:
        return []
    count = -(-len(kinds) // MOST_OPTIONS)
    edges = [round(i * len(kinds) / count) for i in range(count + 1)]
    return [tuple(kinds[a:b]) for a, b in itertools.pairwise(edges)]


def _is_alone(moment: Moment, name: str, box: Box) -> bool:
    """Return whether a box contains only one object, i.e. whether the centers of all other objects are outside it."""
    left, top, right, bottom = box
    others = (s.centroid for other, s in moment.view.objects.items() if other != name)
    return not any(left <= x < right and top <= y < bottom for x, y in others)
