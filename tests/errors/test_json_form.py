"""JSON from files: what is accepted, and one line about what is not."""

from __future__ import annotations

from dataclasses import dataclass

import pytest
from pydantic import TypeAdapter
from tests.looping import each

from betterbench.errors import InvalidInputError
from betterbench.json_form import parse_json, read_bounded, read_form, read_object, strict_form


@strict_form
@dataclass(frozen=True, slots=True)
class Part:
    count: int
    sizes: tuple[float, ...]
    note: str | None = None

    def __post_init__(self) -> None:
        if self.count < 0:
            raise InvalidInputError("count", f"{self.count} is negative", "Give 0 or more")
        if self.count > 100:
            msg = "there are too many"
            raise ValueError(msg)


WHOLE = TypeAdapter(tuple[Part, ...])


def test_a_form_is_read_from_bytes_and_from_a_value():
    part = (Part(1, (1.0, 2.5)),)
    assert read_form(WHOLE, b'[{"count": 1, "sizes": [1, 2.5]}]', where="f.json", cure="Mend it") == part
    assert read_form(WHOLE, [{"count": 1, "sizes": [1, 2.5]}], where="f.json", cure="Mend it") == part


@each(
    "form, text",
    [
        (b'[{"count": true, "sizes": []}]', "f.json: [0].count: Input should be a valid integer, not True. Mend it."),
        (b'[{"count": 1.0, "sizes": []}]', "f.json: [0].count: Input should be a valid integer, not 1.0. Mend it."),
        (b'[{"count": 1}]', "f.json: [0].sizes: is missing. Mend it."),
        (
            b'[{"count": 1, "sizes": [0, NaN]}]',
            "f.json: [0].sizes[1]: Input should be a finite number, not nan. Mend it.",
        ),
        (
            b'[{"count": 1, "sizes": [1e999]}]',
            "f.json: [0].sizes[0]: Input should be a finite number, not inf. Mend it.",
        ),
        (b'[{"count": 1, "sizes": ["1"]}]', "f.json: [0].sizes[0]: Input should be a valid number, not '1'. Mend it."),
        (b'[{"count": 1, "sizes": [], "q": 2}]', "f.json: [0].q: is unknown. Mend it."),
        (b'[{"count": -1, "sizes": []}]', "f.json: count: -1 is negative. Give 0 or more. Mend it."),
        (b'[{"count": 101, "sizes": []}]', "f.json: [0]: there are too many. Mend it."),
        (
            b'[{"count": 1, "sizes": [], "count": 2}]',
            "f.json: count: is given twice. Keep only one of the values. Mend it.",
        ),
        (b"[" * 5000, "f.json: is not JSON (recursion limit exceeded at line 1 column 202). Mend it."),
        (b"\xff", "f.json: is not JSON (expected value at line 1 column 1). Mend it."),
        ({1, 2}, "f.json: is not JSON (Object of type set is not JSON serializable). Mend it."),
    ],
)
def test_a_wrong_form_is_one_line_with_file_field_and_cure(form, text):
    with pytest.raises(InvalidInputError) as caught:
        read_form(WHOLE, form, where="f.json", cure="Mend it")
    assert str(caught.value) == text


def test_a_long_value_is_shortened():
    with pytest.raises(InvalidInputError, match=r"not 'a{76}\.\.\.\. Mend it\.$"):
        read_form(WHOLE, [{"count": "a" * 500, "sizes": []}], where="f.json", cure="Mend it")


def test_a_file_is_read_up_to_a_limit(tmp_path):
    file = tmp_path / "f.json"
    with pytest.raises(InvalidInputError, match=r"f\.json: cannot be read \(No such file or directory\)\. Give one\."):
        read_bounded(file, max_bytes=3, cure="Give one")
    file.write_bytes(b"123")
    assert read_bounded(file, max_bytes=3, cure="Give one") == b"123"
    with pytest.raises(InvalidInputError, match="is larger than 2 bytes"):
        read_bounded(file, max_bytes=2, cure="Give one")


def test_the_name_of_a_field_is_bounded_in_a_message():
    adapter = TypeAdapter(dict[str, int])
    with pytest.raises(InvalidInputError) as raised:
        read_form(adapter, {"x" * 100_000: "no number"}, where="f.json", cure="Mend it")
    assert len(str(raised.value)) < 500


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        (b"", "is not JSON (Expecting value: line 1 column 1 (char 0))"),
        (b"[" * 100_000, "is not JSON (it is nested too deep)"),
        (b"[1]", "is not a JSON object"),
        (b'{"a": "' + b"x" * 100 + b'"}', "is larger than 99 bytes"),
        (b"\xff{}", "is not JSON ("),
    ],
)
def test_a_file_that_holds_no_object_is_one_line(tmp_path, text, problem):
    file = tmp_path / "f.json"
    file.write_bytes(text)
    with pytest.raises(InvalidInputError) as error:
        read_object(file, max_bytes=99 if b"x" in text else 1 << 20, cure="Mend it")
    assert str(error.value).startswith(f"{file}: {problem}")
    assert str(error.value).endswith(". Mend it.")
    file.write_bytes(b'{"a": [1]}')
    assert read_object(file, max_bytes=99, cure="Mend it") == {"a": [1]}


def test_a_text_that_is_nested_too_deep_is_an_error_like_any_other():
    assert parse_json("[" * 50 + "]" * 50) is not None
    with pytest.raises(ValueError, match="nested too deep"):
        parse_json("[" * 100_000)
