"""Parser for boxes and points in any notation.

The declared convention determines the order and the scale of the numbers. If the numbers are written in a different
form, such as a list instead of the declared JSON, they are accepted in the stage "tolerant". The form never changes the
order or the scale of the numbers.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from fractions import Fraction
from typing import Any

from betterbench.json_form import parse_json
from betterbench.vqa.parsing.answer import NOTHING, AnswerSpec, Read
from betterbench.vqa.parsing.choice import CLAIM, FENCE
from betterbench.vqa.question import Form

_NUMBER = r"-?(?:\d{1,6}(?:\.\d{0,12})?|\.\d{1,12})(?:[eE][+-]?\d{1,2})?"
_NUMBERS = re.compile(rf"(?<![\w.]){_NUMBER}(?![\w])")
_WRITTEN = re.compile(r"-?\d+(?:\.\d+)?")  # numbers in the format written by _shown, of any size
_GROUP = re.compile(rf"[\[(]\s*({_NUMBER}(?:\s*,\s*{_NUMBER}){{1,3}})\s*,?\s*[\])]")
_TUPLE = rf"[\[(]\s*{_NUMBER}(?:\s*,\s*{_NUMBER}){{1,3}}\s*[\])]"
_LIST = re.compile(rf"\[\s*{_TUPLE}(?:\s*,\s*{_TUPLE})*\s*,?\s*\]")
_BARE = re.compile(rf"{_NUMBER}(?:\s*,\s*{_NUMBER}){{1,3}}")
_TAG = re.compile(r"<points?\b([^<>]{0,4000})>", re.IGNORECASE)
_WHOLE_TAGS = re.compile(r"<points?\b[^<>]*>[^<>]*</points?>|<points?\b[^<>]*/?>", re.IGNORECASE)
_ATTRIBUTE = re.compile(rf"\b([xy])(\d{{0,3}})\s*=\s*[\"']?\s*({_NUMBER})\s*[\"']?", re.IGNORECASE)
_EXPONENT = re.compile(r"[+-]?0{0,9}\d{0,2}")
_KEYS = ("point_2d", "point", "points", "coordinates", "coordinate", "bbox_2d", "box_2d", "bbox", "box", "points_2d")
_CLAIM = re.compile(rf"(?i:{CLAIM}|final coordinates|result)\s*[:：=]?\s*")
_CLAIMS_TRIED = 3
_MOST = 10**6
MOST_POINTS = 10_000
"""Maximum number of points that are read from one text."""

Numbers = tuple[Fraction, ...]


def read_points(spec: AnswerSpec, text: str) -> Read:
    """Read the box, point or points in a text, in pixels, see :class:`~betterbench.vqa.parsing.answer.Read`."""
    text = " ".join(text.split())  # long runs of white space make the patterns slow
    groups, form = _whole(spec, text)
    stage = "strict" if form == spec.convention.form else "tolerant"
    if not groups:
        groups, stage = _inside(spec, text), "tolerant"
    if not groups:
        return NOTHING
    shown = [_shown(spec.convention.in_pixels(g, spec.width, spec.height)) for g in groups[:MOST_POINTS]]
    answer = f"[{', '.join(shown)}]" if spec.form is Form.POINTS else shown[-1]
    return Read(answer, "strict" if stage == "strict" else "tolerant")


def numbers_of(answer: str) -> list[list[float]]:
    """Return the numbers of each box or point in the answer of a :class:`Read`."""
    return [[float(v) for v in _WRITTEN.findall(part)] for part in re.findall(r"\[([^\[\]]*)\]", answer)]


def exact_groups(answer: str) -> list[list[Fraction]]:
    """Return the numbers of each box or point in the answer of a :class:`Read`, exactly as they are written there."""
    return [[Fraction(v) for v in _WRITTEN.findall(part)] for part in re.findall(r"\[([^\[\]]*)\]", answer)]


def _shown(values: Sequence[Fraction]) -> str:
    """Return numbers as text in brackets, with up to nine decimals and without exponents."""
    return f"[{', '.join(f'{float(v):.9f}'.rstrip('0').rstrip('.') for v in values)}]"


def _fitting(spec: AnswerSpec, groups: Sequence[Numbers]) -> list[Numbers]:
    """Return the groups of numbers with the right length for the form of the answer: 2 for a point, 4 for a box."""
    lengths = {Form.BOX: (4,), Form.POINT: (2,)}.get(spec.form, (2, 4))
    return [g for g in groups if len(g) in lengths and all(abs(v) < _MOST for v in g)]


def _whole(spec: AnswerSpec, text: str) -> tuple[list[Numbers], str]:
    """If a text consists only of coordinates, return their groups of numbers and the notation.

    Otherwise, the list of groups is empty.
    """
    text = text.strip()
    fence = FENCE.fullmatch(text)
    bare = (fence[1] if fence else text).strip()
    if _BARE.fullmatch(bare) or _GROUP.fullmatch(bare) or _LIST.fullmatch(bare):
        groups = [_split(m) for m in (_GROUP.findall(bare) or [bare])]
        fitting = _fitting(spec, groups)
        # A list with one point is a valid point. A list with several points is not.
        if len(fitting) == len(groups) and (spec.form is Form.POINTS or len(groups) == 1):
            return fitting, "tuples"
        return [], ""
    tags = _TAG.findall(bare)
    if tags and not _WHOLE_TAGS.sub("", bare).strip():
        return _fitting(spec, _tagged(tags)), "xml"
    found = _of_json(bare)
    return _fitting(spec, found), "json"


def _inside(spec: AnswerSpec, text: str) -> list[Numbers]:
    """Return the groups of numbers in a text that also contains other words.

    Groups after the last words that announce an answer come first.
    """
    parts = [text[m.end() :] for m in list(_CLAIM.finditer(text))[-_CLAIMS_TRIED:]]
    for part in (*reversed(parts), text):
        for groups in (_tagged(_TAG.findall(part)), _json_inside(part), _listed(part)):
            fitting = _fitting(spec, groups)
            if fitting:
                return fitting if spec.form is Form.POINTS else fitting[-1:]
    numbers = tuple(Fraction(v) for v in _NUMBERS.findall(text))
    return _fitting(spec, [numbers]) if len(numbers) in (2, 4) else []


def _listed(text: str) -> list[Numbers]:
    """Return the tuples in the last list of tuples in a text. If the text has no such list, return all tuples."""
    lists = _LIST.findall(text)
    return [_split(m) for m in _GROUP.findall(lists[-1] if lists else text)]


def _split(group: str) -> Numbers:
    return tuple(Fraction(v) for v in re.findall(_NUMBER, group))


def _tagged(tags: Sequence[str]) -> list[Numbers]:
    """Return the points in XML tags such as ``x="1" y="2"`` or ``x1="1" y1="2" x2=...``.

    Each point is returned with x first, regardless of the order in the tag.
    """
    found: list[Numbers] = []
    for tag in tags:
        values = {(name.lower(), number): Fraction(value) for name, number, value in _ATTRIBUTE.findall(tag)}
        found += [
            (x, values["y", number]) for (name, number), x in values.items() if name == "x" and ("y", number) in values
        ]
    return found


def _json_inside(text: str) -> list[Numbers]:
    for part in (*reversed(FENCE.findall(text)), *_brackets(text)):
        groups = _of_json(part)
        if groups:
            return groups
    return []


def _brackets(text: str) -> list[str]:
    """Return the parts of a text that may be JSON, from the first to the last bracket of each kind."""
    if "{" not in text:
        return []
    pairs = (("[", "]"), ("{", "}"))
    return [text[text.find(a) : text.rfind(b) + 1] for a, b in pairs if -1 < text.find(a) < text.rfind(b)]


def _of_json(text: str) -> list[Numbers]:
    """Return the groups of numbers that JSON contains under known keys, or an empty list if the JSON is invalid."""
    text = re.sub(r",\s*([\]}])", r"\1", text.strip())
    if "{" not in text:
        return []
    try:
        form = parse_json(text, number=_exactly)
    except (ValueError, ZeroDivisionError):
        return []
    found: list[Numbers] = []
    _collect(form, found)
    return found


def _exactly(text: str) -> Fraction:
    """Convert a number in JSON to an exact value.

    Raises:
        ValueError: If the exponent has more than two digits, because the conversion would then take hours.
    """
    if not _EXPONENT.fullmatch(text.lower().partition("e")[2]):
        msg = f"{text[:20]} is out of range"
        raise ValueError(msg)
    return Fraction(text)


def _collect(form: Any, found: list[Numbers]) -> None:  # noqa: ANN401 - any JSON
    if isinstance(form, list):
        for inner in form:
            _collect(inner, found)
    elif isinstance(form, dict):
        lower = {str(key).lower(): value for key, value in form.items()}
        if _is_number(lower.get("x")) and _is_number(lower.get("y")):
            found.append((lower["x"], lower["y"]))
            return
        for key in _KEYS:
            if key in lower:
                found += _groups_in(lower[key])
                return
        for value in form.values():
            _collect(value, found)


def _groups_in(value: Any) -> list[Numbers]:  # noqa: ANN401 - any JSON
    if isinstance(value, list) and value and all(map(_is_number, value)):
        return [tuple(value)]
    groups: list[Numbers] = []
    if isinstance(value, list | dict):
        for inner in value if isinstance(value, list) else [value]:
            if isinstance(inner, dict):
                _collect(inner, groups)
            else:
                groups += _groups_in(inner)
    return groups


def _is_number(value: Any) -> bool:  # noqa: ANN401 - any JSON
    return isinstance(value, Fraction) and abs(value) < _MOST
