"""Scorers of RefSpatial-Bench that reproduce RoboRefer's evaluation, lmms-eval, and VLMEvalKit's EASI scorer.

In RoboRefer's evaluation, each coordinate convention has its own pattern for points. The score of an item is the mean
mask value at the points in the reply. If the program fails to read a reply, it omits the item from the denominator.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction

from betterbench.vlm.items import Item, ItemSet
from betterbench.vlm.official.upstream import DroppedError, StoppedError, UpstreamScorer

_SIGNED = r"[+-]?\d+\.?\d*"
_TUPLE = re.compile(rf"\(({_SIGNED}(?:,\s*{_SIGNED})*?)\)")
_NUMBERED = re.compile(r'x\d+="(-?\d+\.?\d*)"\s+y\d+="(-?\d+\.?\d*)"')
_FENCED = re.compile(r"```(?:\w+)?\n(.*?)```", re.DOTALL)
_MOST_DIGITS = 18
"""Maximum number of digits of an integer. Longer integers do not fit into the program's 64-bit arrays, and no image is
that large."""

Point = tuple[int | float, int | float]


@dataclass(frozen=True, slots=True)
class Rectangle:
    """Box in a reply. The program scores all pixels inside the box.

    The box is given by its first column and row, and by the column and row after its last column and row.
    """

    left: int
    top: int
    right: int
    bottom: int

    @property
    def area(self) -> int:
        """Number of pixels in the box."""
        return (self.right - self.left) * (self.bottom - self.top)


Shape = Point | Rectangle


def tuples_of(text: str, width: int, height: int, *, absolute: bool = False) -> list[Shape]:
    """Return the points ``(x, y)`` and the boxes ``(x0, y0, x1, y1)`` that the upstream program finds in a reply.

    If ``absolute`` is False, the program treats a pair of integers as pixels. It scales a pair by the image size if at
    least one of the two numbers has a decimal point. It does not find tuples with spaces next to their brackets, or
    with numbers such as ".5".

    Raises:
        DroppedError: If the upstream program raises an error while it reads the reply.
    """
    shapes: list[Shape] = []
    for found in _TUPLE.findall(text):
        numbers = [_number(part) for part in found.split(",")]
        if len(numbers) == 2:
            x, y = numbers
            if not absolute and (isinstance(x, float) or isinstance(y, float)):
                x, y = _scaled(x, width), _scaled(y, height)
            shapes.append((x, y))
        elif len(numbers) == 4:
            if not absolute:
                numbers = [_scaled(v, side) for v, side in zip(numbers, (width, height) * 2, strict=True)]
            shapes += _rectangle(numbers)
    return shapes


def _number(part: str) -> int | float:
    digits = part.strip()
    if "." in digits:
        return float(digits)
    if len(digits) > _MOST_DIGITS:
        raise DroppedError
    return int(digits)


def _scaled(value: float, side: int) -> int:
    if abs(value) > 10.0**15:
        raise DroppedError
    return int(value * side)


def _rectangle(numbers: Sequence[int | float]) -> list[Shape]:
    if any(isinstance(v, float) for v in numbers):
        raise DroppedError  # the upstream program raises an error, since the size of an array must be an integer
    box = Rectangle(*map(int, numbers))
    if box.right < box.left or box.bottom < box.top:
        raise DroppedError  # the upstream program raises an error for a negative size
    return [box] if box.area else []


def tags_of(text: str, width: int, height: int) -> list[Shape]:
    """Return the points in Molmo's ``points`` tags, which have numbered attributes (x1, y1).

    The attributes of a single point (x, y) are not numbered. The upstream program does not find them.
    """
    return [(int(float(x) / 100 * width), int(float(y) / 100 * height)) for x, y in _NUMBERED.findall(text)]


def fenced_points_of(text: str, width: int, height: int) -> list[Shape]:
    """Return the points in a JSON list inside a code fence, which is the format of Gemini's replies.

    The result is empty if the code fence is missing or the JSON is broken.

    Raises:
        DroppedError: If the upstream program raises an error, for example because the JSON is an object instead of a
            list.
    """
    fence = _FENCED.search(text)
    if fence is None:
        return []
    try:
        form = json.loads(fence[1].strip())
    except json.JSONDecodeError:
        return []
    except (RecursionError, ValueError) as error:
        raise DroppedError from error
    shapes: list[Shape] = []
    try:
        for entry in form:
            if "point" in entry and isinstance(entry["point"], list) and len(entry["point"]) == 2:
                y, x = entry["point"]
                shapes.append((int(x / 1000 * width), int(y / 1000 * height)))
    except (TypeError, KeyError, ValueError, OverflowError) as error:
        raise DroppedError from error
    return shapes


def share_of(items: ItemSet, item: Item, shapes: Sequence[Shape], *, above: int = 0) -> Fraction:
    """Return the fraction of points, and of pixels in boxes, that are in the mask.

    Points outside the image count as wrong.

    Raises:
        StoppedError: If a pixel coordinate is not an integer, because the upstream program would stop with an error.
    """
    if not shapes:
        return Fraction(0)
    if any(isinstance(v, float) for shape in shapes if isinstance(shape, tuple) for v in shape):
        raise StoppedError
    mask = items.mask(item.gold.mask or "", above=above)
    rows, columns = mask.shape
    right, count = 0, 0
    for shape in shapes:
        if isinstance(shape, Rectangle):
            count += shape.area
            inside = mask[max(0, shape.top) : max(0, shape.bottom), max(0, shape.left) : max(0, shape.right)]
            right += int(inside.sum())
        else:
            x, y = map(int, shape)
            count += 1
            right += 0 <= x < columns and 0 <= y < rows and bool(mask[y, x])
    return Fraction(right, count)


def _sides(items: ItemSet, item: Item) -> tuple[int, int]:
    """Return the width and the height of the mask. The upstream programs use them to scale coordinates."""
    rows, columns = items.mask(item.gold.mask or "").shape
    return columns, rows


def _roborefer(items: ItemSet, item: Item, text: str, coordinates: str) -> Fraction:
    readers: dict[str, Callable[[str, int, int], list[Shape]]] = {
        "fractions": tuples_of,
        "pixels": lambda t, w, h: tuples_of(t, w, h, absolute=True),
        "percent-xml": tags_of,
        "thousandths-yx-json": fenced_points_of,
    }
    return share_of(items, item, readers[coordinates](text, *_sides(items, item)))


def _lmms_eval(items: ItemSet, item: Item, text: str, coordinates: str) -> Fraction:  # noqa: ARG001 - one signature
    """Score a reply as lmms-eval does.

    All pairs of numbers, even pairs of integers, are treated as fractions of the image size. Boxes are ignored. If all
    values of a mask are small, the mask is treated as empty.
    """
    pairs = [[_number(part) for part in found.split(",")] for found in _TUPLE.findall(text)]
    width, height = _sides(items, item)
    shapes: list[Shape] = [(_scaled(x, width), _scaled(y, height)) for x, y in (p for p in pairs if len(p) == 2)]
    return share_of(items, item, shapes, above=127)


def _easi(items: ItemSet, item: Item, text: str, coordinates: str) -> Fraction:  # noqa: ARG001 - one signature
    """Return 0, because the EASI scorer fails with an AttributeError (its logger is undefined) for every reply."""
    return Fraction(0)


REFSPATIAL_ROBOREFER = UpstreamScorer(
    "RoboRefer",
    "Zhoues/RoboRefer@d97a995 Evaluation/summarize_acc.py",
    _roborefer,
    group="split",
    among=("location", "placement"),
    conventions=("fractions", "pixels", "percent-xml", "thousandths-yx-json"),
)
"""The authors' program. Its score is the mean of the splits Location and Placement."""
REFSPATIAL_LMMS_EVAL = UpstreamScorer(
    "lmms-eval",
    "EvolvingLMMs-Lab/lmms-eval@110165a tasks/refspatial/utils.py",
    _lmms_eval,
    conventions=("fractions",),
)
"""lmms-eval. Its score is the micro mean over all three splits."""
REFSPATIAL_EASI = UpstreamScorer("VLMEvalKit (EASI)", "open-compass/VLMEvalKit@e8e78f0 refspatialbench.py", _easi)
"""VLMEvalKit's EASI scorer. Its score is 0 on every item, because the program fails."""
