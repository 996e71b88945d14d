"""Rows of JSON files, read block by block so that embedded images stay on disk."""

from __future__ import annotations

import json
import tracemalloc

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from betterbench.errors import InvalidInputError
from betterbench.vlm import rows as reading
from betterbench.vlm.rows import read_rows

VALUES = st.recursive(
    st.none() | st.booleans() | st.integers(-9, 9) | st.text(alphabet='ab"\\[]{},:\n é', max_size=9),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=3), inner, max_size=3),
    max_leaves=6,
)
ROWS = st.lists(st.fixed_dictionaries({"image": st.text(max_size=40), "more": VALUES}), min_size=1, max_size=5)


@settings(max_examples=60)
@given(ROWS, st.sampled_from([7, 64, 4096]), st.sampled_from([None, 0, 2]), st.booleans())
def test_any_list_of_rows_is_read_as_json_reads_it(tmp_path_factory, forms, block, indent, lines):
    folder = tmp_path_factory.getbasetemp() / "rows"
    folder.mkdir(exist_ok=True)
    file = folder / ("a.jsonl" if lines else "a.json")
    text = "".join(json.dumps(form) + "\n\n" for form in forms) if lines else json.dumps(forms, indent=indent)
    file.write_text(text)
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(reading, "_BLOCK", block)
        patched.setattr(reading, "_parsed_rows", lambda _: pytest.fail("the complete document was parsed"))
        found = read_rows(file, large=("image",))
    assert [{**row.values, "image": row.large("image")} for row in found] == forms
    assert [row.number for row in found] == list(range(1, len(forms) + 1))
    assert all(row.columns == {"image", "more"} and "image" not in row.values for row in found)


@pytest.mark.parametrize("text", ['[{"a": 1},]', '[{"a": 1} {"a": 2}]', '[{"a": 1}', '[{"a": "1}]', '[{"a": 1}] x',
                                  '[{"a": 1}][{"a": 2}]', '[{"a"}]', "{]", '"a"]', "", "[[{}]"])  # fmt: skip
def test_what_is_not_json_is_an_error(text, tmp_path):
    (tmp_path / "a.json").write_text(text)
    with pytest.raises(InvalidInputError, match="is not JSON"):
        read_rows(tmp_path / "a.json", large=())


@pytest.mark.parametrize("text", ["[]", "[1]", '[{"a": 1}, 2]', '[{"a": 1}, [2]]', "7", '{"a": 1}'])
def test_other_documents_are_errors_that_name_the_row(text, tmp_path):
    (tmp_path / "a.json").write_text(text)
    with pytest.raises(InvalidInputError, match=r"is not a list of rows|row [12]: expected an object"):
        read_rows(tmp_path / "a.json", large=())


def test_wrapped_rows_and_a_byte_order_mark_are_read(tmp_path):
    (tmp_path / "a.json").write_text('{"rows": [{"a": 1}]}')
    (tmp_path / "b.json").write_bytes(b'\xef\xbb\xbf[{"a": 1}]')
    assert [read_rows(tmp_path / name, large=())[0].values for name in ("a.json", "b.json")] == [{"a": 1}] * 2


def test_embedded_images_are_not_held_in_memory(tmp_path):
    file = tmp_path / "a.json"
    with file.open("w") as written:
        written.write("[" + ",".join(json.dumps({"id": i, "image": "A" * 400_000}) for i in range(60)) + "]")
    tracemalloc.start()
    found = read_rows(file, large=("image",))
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert len(found) == 60
    assert peak < 20_000_000 < file.stat().st_size
    assert found[59].large("image") == "A" * 400_000


def test_a_file_that_changes_is_named(tmp_path):
    file = tmp_path / "a.json"
    file.write_text('[{"id": 1, "image": "abc"}]')
    row = read_rows(file, large=("image",))[0]
    file.write_text("[]")
    with pytest.raises(InvalidInputError, match="row 1, column image: cannot be read again"):
        row.large("image")
