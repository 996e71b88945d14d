"""Coordinate conventions of vision-language models: the order, scale and notation of points and boxes.

The user declares the convention. It is never guessed, because the same numbers stand for different points in different
conventions. The table follows RoboRefer's evaluation (github.com/Zhoues/RoboRefer, ``Evaluation/``) and the
documentation of the models.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Literal, get_args

from betterbench.errors import UnknownNameError

Coordinates = Literal[
    "pixels", "thousandths", "fractions", "thousandths-json", "thousandths-yx-json", "percent-xml"
]  # fmt: skip
"""Name of a coordinate convention."""


@dataclass(frozen=True, slots=True)
class Convention:
    """Coordinate convention of a model.

    Attributes:
        name: Name of the convention.
        order: "xy" for column before row, "yx" for row before column.
        side: Value of a coordinate at the far edge of the image. None if coordinates are in pixels of the image that
            was sent.
        form: Notation: tuples of numbers, JSON objects, or XML tags.
        unit: Unit in words, for prompts. It may contain ``{width}`` and ``{height}``.
        models: Models that answer in this convention.
    """

    name: Coordinates
    order: Literal["xy", "yx"]
    side: int | None
    form: Literal["tuples", "json", "xml"]
    unit: str
    models: str

    def in_pixels(self, numbers: Sequence[Fraction], width: int, height: int) -> list[Fraction]:
        """Convert coordinates to pixels, with the column before the row.

        Args:
            numbers: Numbers of points or boxes in the order of the convention. There must be an even number of them.
            width: Number of columns of the image.
            height: Number of rows of the image.
        """
        pairs = list(zip(numbers[::2], numbers[1::2], strict=True))
        if self.order == "yx":
            pairs = [(x, y) for y, x in pairs]
        if self.side is None:
            return [v for pair in pairs for v in pair]
        return [v for x, y in pairs for v in (x * width / self.side, y * height / self.side)]

    def request(self, kind: Literal["box", "point", "points"], width: int, height: int) -> str:
        """Return the sentence of a prompt that asks for a box, a point, or one or more points in this convention."""
        unit = self.unit.format(width=width, height=height)
        return f"Answer with {self._shape(kind)} only, in {unit}."

    def _shape(self, kind: Literal["box", "point", "points"]) -> str:
        if kind == "box":
            edges = "[top, left, bottom, right]" if self.order == "yx" else "[left, top, right, bottom]"
            return f'[{{"{"box_2d" if self.order == "yx" else "bbox_2d"}": {edges}}}]' if self.form == "json" else edges
        several = kind == "points"
        match self.form:
            case "json":
                point = '{"point": [y, x]}' if self.order == "yx" else '{"point_2d": [x, y]}'
                return f"[{point}, ...]" if several else f"[{point}]"
            case "xml":
                return '<points x1="x" y1="y" x2="x" y2="y" ...>' if several else '<point x="x" y="y">'
            case "tuples":
                return "[(x, y), ...]" if several else "[x, y]"


_THOUSANDTHS = "thousandths of the width and the height of the image, from 0 to 1000"

CONVENTIONS: dict[Coordinates, Convention] = {
    c.name: c
    for c in (
        Convention(
            "pixels", "xy", None, "tuples",
            "pixels of the image, which is {width} pixels wide and {height} high", "RoboBrain, Qwen2.5-VL",
        ),
        Convention("thousandths", "xy", 1000, "tuples", _THOUSANDTHS, "InternVL in tuples"),
        Convention(
            "fractions", "xy", 1, "tuples",
            "fractions of the width and the height of the image, from 0 to 1", "RoboPoint, RoboRefer, GPT-4o, Claude",
        ),
        Convention("thousandths-json", "xy", 1000, "json", _THOUSANDTHS, "Qwen3-VL, InternVL in JSON"),
        Convention(
            "thousandths-yx-json", "yx", 1000, "json",
            "thousandths of the height and the width of the image, from 0 to 1000", "Gemini",
        ),
        Convention(
            "percent-xml", "xy", 100, "xml",
            "percent of the width and the height of the image, from 0 to 100", "Molmo",
        ),
    )
}  # fmt: skip
"""All conventions, by name."""


def convention(name: str) -> Convention:
    """Return a convention by its name.

    Raises:
        UnknownNameError: If there is no such convention.
    """
    for known, found in CONVENTIONS.items():
        if known == name:
            return found
    raise UnknownNameError("coordinate convention", name, get_args(Coordinates))
