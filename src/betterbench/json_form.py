"""Validation of JSON from files and untrusted sources, using dataclasses.

Decorate the dataclass with :data:`strict_form`, and parse the text with its ``TypeAdapter``::

    @strict_form
    @dataclass(frozen=True, slots=True)
    class Metric: ...

    _METRIC = TypeAdapter(Metric)
    metric = read_form(_METRIC, path.read_bytes(), where=str(path), cure="Restore the file")

A sealed document contains a checksum of its content. :func:`open_seal` checks it before any field is read.
"""

from __future__ import annotations

import hashlib
import json
import logging
import re
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any, TypeVar

from pydantic import BeforeValidator, ConfigDict, Field, TypeAdapter, ValidationError, with_config

from betterbench.errors import BetterError, InvalidInputError, encodable, one_line
from betterbench.ordinary_file import NotOrdinaryError, open_ordinary, read_ordinary

logger = logging.getLogger(__name__)

FormT = TypeVar("FormT")

SEAL = "seal"
"""Key of the checksum in a sealed document.

The checksum is the SHA-256 of all other content. It detects damage, but does not prove who wrote the document.
"""

# Validators are built at first use, because a process imports about twenty of these classes but uses one or two.
_STRICT = ConfigDict(strict=True, allow_inf_nan=False, defer_build=True)

strict_form = with_config(ConfigDict(**_STRICT, extra="forbid"))
"""Class decorator that rejects unknown keys, numbers that are not finite, and values of a wrong type, such as 1 for
true.
"""

open_form = with_config(_STRICT)
"""Class decorator like :data:`strict_form` that ignores unknown keys.

Use it for parts of a file that another version may have written.
"""


growing_form = with_config(ConfigDict(**_STRICT, extra="allow"))
"""Decorator like :data:`strict_form` for a ``TypedDict`` that keeps unknown keys.

Use it for parts of a file that are read and written back.
"""


def json_schema_of(adapter: TypeAdapter[Any], *, title: str) -> dict[str, Any]:
    """Return the JSON schema (draft 2020-12) of a dataclass.

    Underscores at the beginning of class names are removed.
    """
    text = json.dumps(adapter.json_schema())
    names = {name: name.lstrip("_") for name in json.loads(text).get("$defs", {})}
    for name, plain in names.items():
        text = text.replace(f'"#/$defs/{name}"', f'"#/$defs/{plain}"').replace(f'"{name}": {{', f'"{plain}": {{')
        text = text.replace(f'"title": "{name}"', f'"title": "{plain}"')
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **json.loads(text), "title": title}


def _no_truth(value: object) -> object:
    if isinstance(value, bool):
        raise ValueError("expected a number, got a boolean")  # noqa: TRY004 - pydantic passes a TypeError on
    return value


Digest = Annotated[str, Field(pattern="^[0-9a-f]{64}$")]
"""SHA-256 digest in a file, in hexadecimal digits."""

NO_TRUTH = BeforeValidator(_no_truth)
"""Validator that rejects booleans in Literal fields with numbers. pydantic alone would accept false as 0."""


def read_form(
    adapter: TypeAdapter[FormT],
    form: object,
    *,
    where: str,
    cure: str,
    raises: type[BetterError] = InvalidInputError,
    sealed: bool = False,
) -> FormT:
    """Parse and validate JSON, and return the resulting value.

    Args:
        adapter: Type adapter of the expected class.
        form: JSON as bytes or text (fastest), or a value that has already been parsed.
        where: File and location in it, for error messages.
        cure: Remedy, for error messages.
        raises: Class of the error to raise.
        sealed: Whether a digest of the text has already been verified. The slow check for duplicate keys is then
            skipped.

    Raises:
        BetterError: An error of the class ``raises``, if a field is missing, unknown, malformed or given twice. The
            message names the first such field.
    """
    with form_errors(where, cure, raises):
        text = form if isinstance(form, bytes | str) else json.dumps(form)
        if _HUGE.search(text if isinstance(text, bytes) else text.encode("utf-8", "replace")):
            json.loads(text, parse_int=_whole_number)  # the digits may be part of a string
        value = adapter.validate_json(text)
        if not sealed and isinstance(form, bytes | str):
            json.loads(text, object_pairs_hook=unique_keys)
        return value


def seal_of(form: Mapping[str, Any]) -> str:
    """Return the seal of a JSON object, i.e. the SHA-256 of its canonical text without the seal itself.

    Raises ValueError if a number is not finite or the object is nested too deep, and TypeError if a value is not JSON.
    """
    rest = {name: value for name, value in form.items() if name != SEAL}
    try:
        text = json.dumps(rest, sort_keys=True, separators=(",", ":"), allow_nan=False)
    except RecursionError as error:
        raise ValueError("it is nested too deep") from error
    return hashlib.sha256(text.encode()).hexdigest()


def content_digest(name: str, data: bytes) -> str:
    """Return the SHA-256 of a name together with its content.

    If the same content is stored under two names, the digests differ.
    """
    return hashlib.sha256(f"{name}\n".encode() + data).hexdigest()


def sealed_form(form: Mapping[str, Any]) -> dict[str, Any]:
    """Return a JSON object with its seal (a checksum) added."""
    return {**form, SEAL: seal_of(form)}


def open_seal(
    raw: bytes | str,
    *,
    where: str,
    cure: str,
    raises: type[BetterError] = InvalidInputError,
    since: tuple[str, int] | None = None,
) -> dict[str, Any]:
    """Check the seal of a document, and return its JSON object without the seal.

    Args:
        raw: The document.
        where: File, for error messages.
        cure: Remedy for a changed document, for error messages.
        raises: Class of the error to raise.
        since: Field that contains the version of the format, and the first version that has a seal. Older documents,
            and documents without this field, are read with a warning. None means that every document has a seal.

    Raises:
        BetterError: An error of the class ``raises``, if the document is not a JSON object, or if its seal is missing
            or wrong.
    """
    with form_errors(where, cure, raises):
        form = parse_json(raw, unique=True)
        seal = seal_of(form) if isinstance(form, dict) and SEAL in form else ""
    problem = ""
    if not isinstance(form, dict):
        problem = "is not a JSON object"
    elif seal and form.pop(SEAL) != seal:
        problem = "was changed after it was written: its seal is wrong"
    elif not seal:
        version = None if since is None else form.get(since[0], 0)
        if since is None or type(version) is not int or version >= since[1]:
            problem = "has no seal, so a change would not be detected"
        else:
            say_unsealed(where)
    if problem:
        raise _as(raises, InvalidInputError(where, problem, cure))
    found: dict[str, Any] = form
    return found


def sealed_lines(lines: bytes) -> bytes:
    """Return JSON lines followed by a checksum line, which contains the SHA-256 of all lines before it."""
    return lines + json.dumps({SEAL: hashlib.sha256(lines).hexdigest()}).encode() + b"\n"


def open_sealed_lines(
    data: bytes, *, where: str, cure: str, raises: type[BetterError] = InvalidInputError
) -> list[bytes]:
    """Return the lines of a text that :func:`sealed_lines` has created, without the checksum line.

    Raises an error of the class ``raises`` if the checksum line is wrong or missing.
    """
    *lines, _ = data.splitlines(keepends=True) or [b""]
    if sealed_lines(b"".join(lines)) != data:
        problem = (
            "its last line is not a valid seal: the file was changed after it was written, or written by an earlier "
            "version"
        )
        raise _as(raises, InvalidInputError(where, problem, cure))
    return lines


def say_unsealed(where: str) -> None:
    """Warn that a document was written by an earlier version without a checksum. Warn once per document."""
    if where not in _SAID:
        _SAID.add(where)
        logger.warning(
            "%s: was written by an earlier version without a seal, so changes to it cannot be detected", where
        )


_SAID: set[str] = set()
"""Documents for which :func:`say_unsealed` has already logged a warning."""


def unique_keys(pairs: Sequence[tuple[Any, Any]]) -> dict[Any, Any]:
    """Return a dictionary of key-value pairs, to be used as ``object_pairs_hook`` of ``json.loads``.

    Raises InvalidInputError if a key occurs twice, because JSON readers disagree on which of the values to use.
    """
    found = dict(pairs)
    if len(found) < len(pairs):
        twice = next(key for key, times in Counter(key for key, _ in pairs).items() if times > 1)
        raise InvalidInputError(one_line(twice, most=80), "is given twice", "Keep only one of the values")
    return found


_HUGE_DIGITS = 20
_HUGE = re.compile(rb"[\[,:]\s*-?\d{%d}" % _HUGE_DIGITS)
"""Pattern of numbers that may exceed 64 bits. No valid value is that large, and such numbers cause errors elsewhere."""


def _whole_number(digits: str) -> int:
    """Return the integer that the digits represent. Raises InvalidInputError if it is far beyond 64 bits."""
    if len(digits.lstrip("-")) >= _HUGE_DIGITS:
        raise InvalidInputError("", "contains a number of 20 digits or more", "Use a smaller number")
    return int(digits)


@contextmanager
def form_errors(where: str, cure: str, raises: type[BetterError] = InvalidInputError) -> Iterator[None]:
    """Convert exceptions during JSON validation to a one-line error with the file, the field and the remedy.

    Raises:
        BetterError: If pydantic, ``json`` or the dataclass raises an exception.
    """
    try:
        yield
    except Exception as error:  # untrusted content can cause any exception in the code that reads it
        if isinstance(error, ValidationError):
            field, problem = first_problem(error)
            wrong = InvalidInputError(f"{where}: {field}" if field else where, problem, cure)
        elif isinstance(error, InvalidInputError):  # raised by the dataclass
            place = f"{where}: {error.where}" if error.where else where
            wrong = InvalidInputError(place, error.problem, f"{error.cure.rstrip('.')}. {cure}")
        elif isinstance(error, BetterError):
            raise
        else:  # raised by json.dumps
            said = (str(error).splitlines() or [type(error).__name__])[0]
            wrong = InvalidInputError(where, f"is not JSON ({said})", cure)
        raise _as(raises, wrong) from error


def parse_json(text: str | bytes, *, unique: bool = False, number: Callable[[str], Any] | None = None) -> Any:  # noqa: ANN401
    """Parse JSON. Raises ValueError if the text is not valid JSON or is nested more than 200 levels deep.

    Deeper nesting would cause errors in code that traverses the value. Integers may be arbitrarily large, as in JSON,
    so validate the value with a class that limits their size before you calculate with them. If ``unique`` is True, a
    key that occurs twice raises InvalidInputError. If a function ``number`` is given, it converts all numbers, and NaN
    and Infinity are rejected.
    """
    try:
        found = json.loads(
            text,
            object_pairs_hook=unique_keys if unique else None,
            parse_int=number,
            parse_float=number,
            parse_constant=_refuse if number is not None else None,
        )
    except RecursionError as error:
        raise ValueError("it is nested too deep") from error
    data = text.encode("utf-8", "replace") if isinstance(text, str) else text
    if data.count(b"[") + data.count(b"{") > _DEEPEST and _is_deep(found):
        raise ValueError("it is nested too deep")
    return found


def _refuse(constant: str) -> None:
    msg = f"{constant} is not a number"
    raise ValueError(msg)


_DEEPEST = 200
"""Maximum depth of nested lists and maps, as in pydantic."""


def _is_deep(value: Any) -> bool:  # noqa: ANN401 - as above
    level = [value]
    for _ in range(_DEEPEST):
        if not level:
            return False
        lists = (v if isinstance(v, list) else v.values() for v in level if isinstance(v, list | dict))
        level = [inner for found in lists for inner in found if isinstance(inner, list | dict)]
    return bool(level)


def read_object(path: Path, *, max_bytes: int, cure: str) -> dict[str, Any]:
    """Return the JSON object in a file.

    Raises:
        InvalidInputError: If the file is missing, is larger than ``max_bytes``, or does not contain a JSON object.
    """
    text = read_bounded(path, max_bytes=max_bytes, cure=cure)
    try:
        found = parse_json(text)
    except ValueError as error:
        raise InvalidInputError(str(path), f"is not JSON ({error})", cure) from error
    if not isinstance(found, dict):
        raise InvalidInputError(str(path), "is not a JSON object", cure)
    return found


def read_bounded(path: Path, *, max_bytes: int, cure: str, raises: type[BetterError] = InvalidInputError) -> bytes:
    """Return the content of a file, up to a size limit. Pipes and devices are rejected without blocking.

    Raises:
        BetterError: An error of the class ``raises``, if the file is missing, not a regular file, too large, or cannot
            be read.
    """
    cause: Exception | None = None
    try:
        return read_ordinary(path, max_bytes=max_bytes)
    except NotOrdinaryError as error:
        problem = str(error.strerror)
    except (OSError, ValueError) as error:  # ValueError: a name with a null character
        cause, problem = error, f"cannot be read ({getattr(error, 'strerror', None) or error})"
    raise _as(raises, InvalidInputError(str(path), problem, cure)) from cause


def _as(raises: type[BetterError], wrong: InvalidInputError) -> BetterError:
    return wrong if raises is InvalidInputError else raises(str(wrong))


_MOST_OF_A_FIELD = 200
"""Maximum number of characters of a field's name in a message. The name may come from an untrusted file."""
_MOST_OF_A_PROBLEM = 600
"""Maximum number of characters of a problem's description in a message, which may quote the value of the field."""


def first_problem(error: ValidationError) -> tuple[str, str]:
    """Return the field of the first validation problem ("trials[3].label") and a description of the problem.

    The field is empty if the problem concerns the whole object.
    """
    first = error.errors(include_url=False)[0]
    field = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in first["loc"]).lstrip(".")
    field = one_line(field, most=_MOST_OF_A_FIELD)
    match first["type"]:
        case "missing" | "missing_argument":
            return field, "is missing"
        case "extra_forbidden" | "unexpected_keyword_argument":
            return field, "is unknown"
        case "dataclass_type" | "dict_type" | "model_type":
            return field, "is not a JSON object"
        case "too_short" | "too_long":
            return field, first["msg"]
        case "json_invalid":
            return field, f"is not JSON ({first['ctx']['error']})"
        case "value_error":
            return field, one_line(first["ctx"]["error"], most=_MOST_OF_A_PROBLEM)
        case _:
            shown = repr(first["input"])
            return field, f"{first['msg']}, not {shown if len(shown) <= 80 else shown[:77] + '...'}"


def dump_json(form: object) -> bytes:
    """Return the canonical bytes of a JSON value: sorted keys, no spaces, no NaN.

    Raises InvalidInputError if JSON cannot represent the value.
    """
    try:
        text = json.dumps(form, sort_keys=True, separators=(",", ":"), ensure_ascii=False, allow_nan=False)
        return text.encode("utf-8")
    except UnicodeEncodeError as error:
        shown = one_line(encodable(error.object[max(0, error.start - 20) : error.end + 20]), most=80)
        problem = f"contains a lone surrogate, which has no encoding, in {shown!r}"
        raise InvalidInputError("metadata", problem, "Encode the text as UTF-8") from error
    except (TypeError, ValueError) as error:
        raise InvalidInputError(
            "metadata", str(error), "Use only strings, finite numbers, lists and mappings"
        ) from error


def file_digest(path: Path) -> str:
    """Return the SHA-256 of a file, as journals store it. The file is read in blocks."""
    with open_ordinary(path) as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
