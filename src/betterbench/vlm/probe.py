"""Probe of a model's coordinate convention, based on its answers about images with known points and boxes.

Each of ten images shows one disk or one rectangle. For every order (column or row first) and every scale (pixels,
fractions, percent, thousandths), the answers are compared with the true positions. A convention is only reported if
exactly one combination of order and scale explains the answers. The positions are far from the diagonal, and the sides
of the images are shorter than 600 pixels. Therefore no two combinations agree within the tolerance.
"""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from fractions import Fraction
from itertools import product
from pathlib import Path
from statistics import median
from typing import Any, Literal, get_args

from PIL import Image, ImageDraw

from betterbench.errors import InvalidInputError
from betterbench.jobs import OnCount
from betterbench.vlm.models.eyes import Eyes, convention_for, shown_picture
from betterbench.vqa.asking import AnswersHead, ModelAnswer, Request, answer_line, ask_all
from betterbench.vqa.coordinates import CONVENTIONS, Coordinates
from betterbench.vqa.llm import Model
from betterbench.vqa.parsing import AnswerSpec, read_text
from betterbench.vqa.parsing.points import exact_groups
from betterbench.vqa.question import Form

TOLERANCE = 0.1
"""Maximum error of a matching answer, as a fraction of the image side. It is about three standard deviations of a
pointing noise of 3 %."""
_MOST_FITTING = 0.8
"""Minimum fraction of matching answers for a convention to be accepted."""
_FEWEST = 6
"""Minimum number of answers with coordinates for a convention to be determined."""

Order = Literal["xy", "yx"]
_SCALES: Mapping[int | None, str] = {None: "pixels", 1: "fractions", 100: "percent", 1000: "thousandths"}
_COLORS = {"red": "#d03030", "blue": "#2850c8", "green": "#2a9040"}


@dataclass(frozen=True, slots=True)
class Target:
    """Image for the probe, with one disk or one rectangle.

    Attributes:
        shape: "disk" if the model is asked for a point, "rectangle" if it is asked for a box.
        size: Width and height of the image [pixel].
        middle: Middle of the shape, as fractions of the image's width and height.
        half: Half of the shape's width and height, as fractions of the image's width and height.
    """

    shape: Literal["disk", "rectangle"]
    color: str
    size: tuple[int, int]
    middle: tuple[float, float]
    half: tuple[float, float] = (0.05, 0.05)

    @property
    def form(self) -> Form:
        """Format of the answer: a point or a box."""
        return Form.POINT if self.shape == "disk" else Form.BOX

    @property
    def edges(self) -> tuple[float, float, float, float]:
        """Left, top, right and bottom edge of the shape, as fractions of the image's width and height."""
        (x, y), (dx, dy) = self.middle, self.half
        return (x - dx, y - dy, x + dx, y + dy)

    def picture(self) -> bytes:
        """Return the image as a PNG file."""
        image = Image.new("RGB", self.size, "#dcd8d0")
        pen = ImageDraw.Draw(image)
        left, top, right, bottom = (v * self.size[i % 2] for i, v in enumerate(self.edges))
        if self.shape == "disk":
            radius = (right - left) / 2
            x, y = (self.middle[0] * self.size[0], self.middle[1] * self.size[1])
            pen.ellipse((x - radius, y - radius, x + radius, y + radius), fill=_COLORS[self.color])
        else:
            pen.rectangle((left, top, right, bottom), fill=_COLORS[self.color])
        file = io.BytesIO()
        image.save(file, "PNG")
        return file.getvalue()

    def error(self, numbers: Sequence[Fraction], order: Order, scale: tuple[int, int]) -> float:
        """Return the largest error of any coordinate in an answer, as a fraction of the image's width or height.

        Args:
            numbers: The two numbers of a point, or the four numbers of a box.
            order: Order of the numbers.
            scale: The numbers that correspond to the full width and the full height of the image.
        """
        if order == "yx":
            numbers = [numbers[i ^ 1] for i in range(len(numbers))]
        places = [float(v) / scale[i % 2] for i, v in enumerate(numbers)]
        true = self.edges if len(numbers) == 4 and self.shape == "rectangle" else self.middle
        if len(numbers) == 4 and self.shape == "disk":
            places = [(places[0] + places[2]) / 2, (places[1] + places[3]) / 2]
        return max(abs(place - value) for place, value in zip(places, true, strict=True))


_SMALL, _TALL, _WIDE = (320, 240), (240, 320), (512, 288)
TARGETS: tuple[Target, ...] = (
    Target("disk", "red", _SMALL, (0.80, 0.30)),
    Target("disk", "blue", _TALL, (0.25, 0.75)),
    Target("disk", "green", _WIDE, (0.65, 0.20)),
    Target("disk", "red", _WIDE, (0.35, 0.85)),
    Target("disk", "blue", _SMALL, (0.90, 0.55)),
    Target("rectangle", "green", _SMALL, (0.25, 0.70), (0.10, 0.15)),
    Target("rectangle", "red", _TALL, (0.75, 0.25), (0.12, 0.10)),
    Target("rectangle", "blue", _WIDE, (0.80, 0.40), (0.10, 0.20)),
    Target("rectangle", "green", _TALL, (0.35, 0.80), (0.20, 0.08)),
    Target("rectangle", "red", _SMALL, (0.60, 0.25), (0.08, 0.12)),
)
"""Images that a probe shows to the model."""


@dataclass(frozen=True, slots=True)
class Fit:
    """Agreement of a model's answers with one combination of coordinate order and scale.

    Attributes:
        order: "xy" for column before row, "yx" for row before column.
        scale: "pixels", "fractions", "percent" or "thousandths".
        fitting: Number of answers with an error within the tolerance.
        error: Median error, as a fraction of the image side.
    """

    order: Order
    scale: str
    fitting: int
    error: float

    @property
    def words(self) -> str:
        """Description of the coordinate order and the scale in words."""
        return f"{self.scale}, {'column before row' if self.order == 'xy' else 'row before column'}"


@dataclass(frozen=True, slots=True)
class Finding:
    """Result of a probe.

    Attributes:
        model: Name of the model.
        declared: Convention that the requests stated, or None if they did not state any.
        readable: Number of answers that contain coordinates.
        asked: Number of images. There is one request for each.
        fits: Agreement of the answers with each combination of order and scale, best first.
        found: The convention of the answers. None if no combination of order and scale fits, if several combinations
            fit, or if betterbench has no convention with the combination that fits.
    """

    model: str
    declared: Coordinates | None
    readable: int
    asked: int
    fits: tuple[Fit, ...]
    found: Coordinates | None

    @property
    def fitting(self) -> tuple[Fit, ...]:
        """Combinations of order and scale that explain the answers."""
        least = max(_FEWEST, _MOST_FITTING * self.readable)
        return tuple(fit for fit in self.fits if fit.fitting >= least)

    @property
    def sentence(self) -> str:
        """Result in words."""
        if self.readable < _FEWEST:
            return (
                f"{self.model} gave coordinates for {self.readable} of {self.asked} images, but {_FEWEST} are needed "
                "to determine its convention."
            )
        if not self.fitting:
            return f"{self.model} does not point at the shapes in any order and scale: the nearest is {self._nearest}."
        if len(self.fitting) > 1:
            listed = "; ".join(fit.words for fit in self.fitting)
            return (
                f"The convention of {self.model} remains unknown, because several conventions explain its answers: "
                f"{listed}."
            )
        fit = self.fitting[0]
        if self.found is None:
            return f"{self.model} answers in {fit.words}, for which betterbench has no convention."
        return (
            f"{self.model} answers in {fit.words} (--coordinates {self.found}) for {fit.fitting} of "
            f"{self.readable} images."
        )

    @property
    def _nearest(self) -> str:
        best = self.fits[0]
        return f"{best.words}, with a median error of {100 * best.error:.0f} % of the side"

    def require(self, declared: Coordinates) -> None:
        """Raise InvalidInputError if the answers have a different order or scale than the declared convention."""
        problem = f"{declared} are declared, but {self.sentence[:1].lower() + self.sentence[1:].rstrip('.')}"
        if self.found is None:
            if self.readable >= _FEWEST and len(self.fitting) == 1:
                cure = "Try a different --prompt (--no-probe runs anyway, but most positions will count as wrong)"
                raise InvalidInputError("--coordinates", problem, cure)
            return
        there, said = CONVENTIONS[self.found], CONVENTIONS[declared]
        if (there.order, there.side) != (said.order, said.side):
            cure = f"Use --coordinates {self.found}, or use --no-probe if the declared convention is right"
            raise InvalidInputError("--coordinates", problem, cure)

    def to_json(self) -> dict[str, Any]:
        """Return a JSON-serializable dict."""
        return {**asdict(self), "sentence": self.sentence}


def probe_model(
    model: Model,
    file: Path,
    *,
    declared: Coordinates | None = None,
    eyes: Eyes = Eyes.NATIVE,
    targets: Sequence[Target] = TARGETS,
    at_once: int = 4,
    on_progress: OnCount | None = None,
) -> Finding:
    """Ask a model for the positions of known shapes, and determine the coordinate convention of its answers.

    Args:
        model: The model.
        file: File for the answers. Answers that it already contains are not requested again.
        declared: Convention that the requests state, as in a run. If None, the requests do not state any.
        eyes: Resolution of the images.
        targets: The images.
        at_once: Number of simultaneous requests.
        on_progress: Called with the number of answers so far and the number of requests.

    Raises:
        ModelError: If the model cannot be reached. Earlier answers are kept.
        RunConflictError: If the file contains answers from a different probe.
    """
    answers = ask_targets(
        model, file, declared=declared, eyes=eyes, targets=targets, at_once=at_once, on_progress=on_progress
    )
    return finding_of(model.name, [answer.text for answer in answers], targets, declared=declared, eyes=eyes)


def ask_targets(
    model: Model,
    file: Path,
    *,
    declared: Coordinates | None = None,
    eyes: Eyes = Eyes.NATIVE,
    targets: Sequence[Target] = TARGETS,
    at_once: int = 4,
    on_progress: OnCount | None = None,
) -> list[ModelAnswer]:
    """Ask a model for the positions of known shapes, and return its answer for each image.

    The arguments and errors are the same as those of :func:`probe_model`.
    """
    requests = {str(i): request_for(target, declared, eyes) for i, target in enumerate(targets)}
    head = AnswersHead(model.name, f"probe-{declared}-{eyes.value}-{len(targets)}", declared or "pixels")
    answers = ask_all(requests, model, head, file, at_once=at_once, verb="vlm", on_progress=on_progress)
    return [answers.answers[name] for name in requests]


def finding_of(
    model: str,
    texts: Sequence[str],
    targets: Sequence[Target] = TARGETS,
    *,
    declared: Coordinates | None = None,
    eyes: Eyes = Eyes.NATIVE,
) -> Finding:
    """Determine the coordinate convention of a model, given its reply for each image."""
    read = [(target, numbers) for target, text in zip(targets, texts, strict=True) if (numbers := _numbers(text))]
    fits = tuple(
        sorted(
            (_fit(read, order, side, eyes) for order, side in product(get_args(Order), _SCALES)),
            key=lambda fit: (-fit.fitting, fit.error),
        )
    )
    open_finding = Finding(model, declared, len(read), len(targets), fits, None)
    if len(read) < _FEWEST or len(open_finding.fitting) != 1:
        return open_finding
    return Finding(model, declared, len(read), len(targets), fits, _convention(open_finding.fitting[0], texts))


def request_for(target: Target, declared: Coordinates | None = None, eyes: Eyes = Eyes.NATIVE) -> Request:
    """Return the request for the position of a shape.

    If a convention is declared, the request states it. Otherwise, the model is free to choose one.
    """
    shown = shown_picture(target.picture(), eyes)
    asked = "the coordinates of the center" if target.shape == "disk" else "the bounding box"
    prompt = f"Give {asked} of the {target.color} {target.shape} in the image."
    if declared is not None:
        spec = AnswerSpec(target.form, (), *target.size, convention_for(eyes, CONVENTIONS[declared]))
        prompt = f"{prompt}\n{answer_line(spec)}"
    return Request(prompt, lambda: (shown.data,))


def _numbers(text: str) -> list[Fraction]:
    """Return the numbers in the last point or box of a reply, as written. The list is empty if the reply has none."""
    value = read_text(AnswerSpec(Form.POINTS, convention=CONVENTIONS["pixels"]), text).answer
    return list(exact_groups(value)[-1]) if value else []


def _fit(read: Sequence[tuple[Target, list[Fraction]]], order: Order, side: int | None, eyes: Eyes) -> Fit:
    errors = []
    for target, numbers in read:
        square = convention_for(eyes, CONVENTIONS["pixels"]).side
        shown = target.size if square is None else (square, square)
        errors.append(target.error(numbers, order, shown if side is None else (side, side)))
    return Fit(order, _SCALES[side], sum(e <= TOLERANCE for e in errors), median(errors) if errors else float("inf"))


def _convention(fit: Fit, texts: Sequence[str]) -> Coordinates | None:
    """Return the convention with the given order and scale that matches the notation of most replies.

    Returns None if betterbench has no convention with this order and scale.
    """
    side = next(number for number, name in _SCALES.items() if name == fit.scale)
    known = [c for c in CONVENTIONS.values() if (c.order, c.side) == (fit.order, side)]
    forms = [_written_form(text) for text in texts if _numbers(text)]
    return max(known, key=lambda c: forms.count(c.form)).name if known else None


def _written_form(text: str) -> str:
    """Return the notation of coordinates in a reply: "xml", "json" or "tuples"."""
    return "xml" if "<point" in text.lower() else "json" if "{" in text else "tuples"
