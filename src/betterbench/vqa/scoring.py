"""Answer scoring: parse a text, from strict to tolerant, and compare it with the correct answer."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from betterbench.interface.state import in_runs
from betterbench.vqa.question import Form, Question, letter

Coordinates = Literal["pixels", "thousandths", "fractions"]
"""Unit of the numbers in a box or point: image pixels, thousandths of the image sides, or fractions of them."""

LEAST_OVERLAP = 0.5
"""Minimum intersection over union of a correct box: the usual threshold of detection benchmarks (PASCAL VOC)."""

_NUMBER_WORDS = ["zero", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten"]
_LONGEST = 4000


@dataclass(frozen=True, slots=True)
class Read:
    """Answer parsed from a text.

    Attributes:
        answer: The answer in the form of the correct answer, or None if none was found.
        stage: "strict" if the text consists only of the answer, "tolerant" if the answer had to be extracted, or
            "none".
    """

    answer: str | None
    stage: Literal["strict", "tolerant", "none"]


def parse_answer(question: Question, text: str, *, coordinates: Coordinates = "pixels") -> Read:
    """Return the answer to a question contained in a text."""
    text = text[:_LONGEST].strip()
    match question.form:
        case Form.YES_NO:
            return _named({"Yes": ("yes", "true"), "No": ("no", "false")}, text)
        case Form.CHOICE:
            return _option(question, text)
        case Form.NUMBER:
            return _count(text)
        case _:
            return _coordinates(question, text, coordinates)


def is_right(question: Question, answer: str | None) -> bool:
    """Return whether an answer, in the form of the correct answer, is correct."""
    if answer is None:
        return False
    if question.form is Form.BOX and question.box is not None:
        numbers = _numbers(answer)
        return len(numbers) == 4 and overlap(numbers, question.box) >= LEAST_OVERLAP
    if question.form is Form.POINT and question.runs is not None:
        numbers = _numbers(answer)
        if len(numbers) != 2:
            return False
        x, y = (int(v + 0.5) if v >= 0 else -1 for v in numbers)
        return in_runs(question.runs, question.width, x, y)
    return answer == question.answer


def overlap(a: Sequence[float], b: Sequence[float]) -> float:
    """Return the intersection over union of two boxes, given as left, top, right and bottom edge."""
    across, down = min(a[2], b[2]) - max(a[0], b[0]), min(a[3], b[3]) - max(a[1], b[1])
    if across <= 0.0 or down <= 0.0:
        return 0.0
    both = across * down
    return both / ((a[2] - a[0]) * (a[3] - a[1]) + (b[2] - b[0]) * (b[3] - b[1]) - both)


def _option(question: Question, text: str) -> Read:
    """Return the option in a text, given by its letter, by letter and words, or by the words."""
    letters = {letter(i): option for i, option in enumerate(question.options)}
    first = re.match(r"\(?([A-Z])\s*(?:[).:]\s*(.*))?$", text, flags=re.DOTALL)
    if first and first[1] in letters:
        said, option = (first[2] or "").strip().rstrip(".").lower(), letters[first[1]]
        return Read(option, "strict" if said in ("", option.lower()) else "tolerant")
    plain = text.rstrip(".").lower()
    for option in question.options:
        if plain == option.lower():
            return Read(option, "strict")
    last = re.findall(r"(?:answer|option|choice)(?: is)?[\s:]*\(?\**([A-Z])\b", text)
    if last and last[-1] in letters:
        return Read(letters[last[-1]], "tolerant")
    inside = [o for o in question.options if re.search(rf"(?<!\w){re.escape(o.lower())}(?!\w)", plain)]
    longest = [o for o in inside if not any(o != other and o in other for other in inside)]
    return Read(longest[0], "tolerant") if len(longest) == 1 else Read(None, "none")


def _named(names: dict[str, tuple[str, ...]], text: str) -> Read:
    words = re.findall(r"[a-z]+", text.lower())
    said = [name for name, spellings in names.items() if any(s in words for s in spellings)]
    if len(words) == 1 and len(said) == 1:
        return Read(said[0], "strict")
    for name, spellings in names.items():
        if words and words[0] in spellings:
            return Read(name, "tolerant")
    return Read(said[0], "tolerant") if len(said) == 1 else Read(None, "none")


def _count(text: str) -> Read:
    if re.fullmatch(r"\d{1,4}\.?", text):
        return Read(str(int(text.rstrip("."))), "strict")
    words = re.findall(r"[a-z]+|\d+", text.lower())
    found = [w if w.isdigit() else str(_NUMBER_WORDS.index(w)) for w in words if w.isdigit() or w in _NUMBER_WORDS]
    if not found and words[:1] in (["no"], ["none"]):
        return Read("0", "tolerant")
    return Read(str(int(found[0])), "tolerant") if len(set(found)) == 1 and len(found[0]) < 5 else Read(None, "none")


def _coordinates(question: Question, text: str, coordinates: Coordinates) -> Read:
    count = 4 if question.form is Form.BOX else 2
    strict = re.fullmatch(
        r"\[?\(?" + r"\s*,\s*".join([r"\s*(-?\d{0,5}\.?\d{1,6}|-?\d{1,5}\.?)"] * count) + r"\s*\)?\]?", text
    )
    numbers = _numbers(text)
    if strict is None:
        brackets = re.findall(r"[\[(]([^\[\]()]*)[\])]", text)
        inside = [_numbers(part) for part in brackets]
        numbers = next((n for n in reversed(inside) if len(n) == count), numbers)
    if len(numbers) != count:
        return Read(None, "none")
    scale = {"pixels": 1.0, "thousandths": 0.001, "fractions": 1.0}[coordinates]
    sides = (1.0, 1.0) if coordinates == "pixels" else (float(question.width), float(question.height))
    values = [v * scale * sides[i % 2] for i, v in enumerate(numbers)]
    return Read(f"[{', '.join(f'{v:g}' for v in values)}]", "strict" if strict else "tolerant")


def _numbers(text: str) -> tuple[float, ...]:
    return tuple(float(part) for part in re.findall(r"-?(?:\d{1,6}\.?\d{0,6}|\.\d{1,6})", text))
