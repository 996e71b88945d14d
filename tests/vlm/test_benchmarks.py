"""Every published form of every benchmark is read to the same items, and bad rows are named."""

from __future__ import annotations

import json
import re
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image
from tests.vlm import published

from betterbench.errors import InvalidInputError, UnknownNameError
from betterbench.vlm import BENCHMARKS, find_benchmark
from betterbench.vlm.pictures import mask_of, size_of
from betterbench.vlm.prompts import PROMPTS, find_prompt, prompts_of
from betterbench.vqa.coordinates import CONVENTIONS

CASES = [(name, form) for name, forms in published.FORMS.items() for form in forms]


def plain(item):
    """Returns an item without what differs between forms of one data set."""
    groups = {k: v for k, v in item.groups.items() if k != "scenario"}
    return replace(item, groups=groups)


@pytest.mark.parametrize(("name", "form"), CASES, ids=[form.__name__ for _, form in CASES])
def test_all_forms_give_the_same_items_and_pictures(name, form, tmp_path):
    found = find_benchmark(name).load(form(tmp_path / "data"))
    first = find_benchmark(name).load(published.FORMS[name][0](tmp_path / "first"))
    assert [plain(i) for i in found.items] == [plain(i) for i in first.items]
    for item, other in zip(found.items[:3], first.items[:3], strict=True):
        shown = [found.read(p) for p in item.pictures]
        assert all(size_of(p, "") == (published.WIDTH, published.HEIGHT) for p in shown)
        if form is not published.egoplan2_video:
            assert shown == [first.read(p) for p in other.pictures]
    again = find_benchmark(name).load(tmp_path / "data")
    assert again.sha256 == found.sha256


def test_the_frames_of_a_video_are_those_that_upstream_takes(tmp_path):
    data = find_benchmark("egoplan2").load(published.egoplan2_video(tmp_path / "data"))
    item = data.items[0]
    levels = [mask_of(data.read(p), p, above=-1).size and _level(data.read(p)) for p in item.pictures]
    expected = 10 * np.linspace(0, 14, 8, endpoint=True, dtype=int)
    np.testing.assert_allclose(levels, expected, atol=6)


def _level(data):
    import io

    from PIL import Image

    return float(np.asarray(Image.open(io.BytesIO(data))).mean())


def test_a_target_region_is_read_as_pixels(tmp_path):
    data = find_benchmark("refspatial").load(published.refspatial_raw(tmp_path / "data"))
    region = data.mask(data.items[0].gold.mask)
    assert region.shape == (published.HEIGHT, published.WIDTH)
    assert region.sum() == 16 * 12
    assert region[12, 32]
    assert not region[11, 32]


BAD = {
    "answer": (7, "column answer: expected a letter from A to D or an index from 0, got 7"),
    "answer_options": (["a", 2], "column answer_options: expected a list of strings"),
    "question": ("", "column question: expected a string, got ''"),
    "image": ("not base64 !!!", "column image: is not base64"),
}


@pytest.mark.parametrize("column", BAD)
def test_a_bad_row_is_one_error_with_file_row_and_column(column, tmp_path):
    folder = published.embspatial_json(tmp_path / "data")
    file = folder / "embspatial_bench.json"
    rows = json.loads(file.read_text())
    rows[2][column], said = BAD[column]
    del rows[2]["scene_id"]
    file.write_text(json.dumps(rows))
    with pytest.raises(InvalidInputError, match=re.escape(f"{file}, row 3, {said}")):
        find_benchmark("embspatial").load(folder)


def test_a_missing_column_says_which_there_are(tmp_path):
    folder = published.embspatial_json(tmp_path / "data")
    file = folder / "embspatial_bench.json"
    rows = [{k: v for k, v in row.items() if k != "relation"} for row in json.loads(file.read_text())]
    file.write_text(json.dumps(rows))
    with pytest.raises(InvalidInputError, match=r"row 1, column relation: is missing. The row has answer, "):
        find_benchmark("embspatial").load(folder)


@pytest.mark.parametrize("place", ["../../secret.png", "/etc/passwd", "missing.png"])
def test_a_picture_outside_the_data_is_not_read(place, tmp_path):
    folder = published.refspatial_raw(tmp_path / "data")
    file = folder / "Location" / "question.json"
    rows = json.loads(file.read_text())
    rows[0]["rgb_path"] = place
    file.write_text(json.dumps(rows))
    with pytest.raises(InvalidInputError, match="column rgb_path"):
        find_benchmark("refspatial").load(folder)


def test_missing_data_and_names(tmp_path):
    for benchmark in BENCHMARKS:
        (tmp_path / "empty").mkdir(exist_ok=True)
        with pytest.raises(InvalidInputError, match=f"contains no data of {benchmark.name}"):
            benchmark.load(tmp_path / "empty")
        with pytest.raises(InvalidInputError, match="does not exist"):
            benchmark.load(tmp_path / "gone")
    with pytest.raises(UnknownNameError, match="Did you mean 'embspatial'"):
        find_benchmark("embspatal")
    (tmp_path / "empty" / "broken.parquet").write_bytes(b"PAR1nonsense")
    with pytest.raises(InvalidInputError, match="is not readable as Parquet"):
        find_benchmark("embspatial").load(tmp_path / "empty")


def test_frames_that_are_missing_are_named(tmp_path):
    folder = published.egoplan2_frames(tmp_path / "data")
    for file in (folder / "keyframes" / "0a1b-2c3d-1_2").iterdir():
        file.unlink()
    (folder / "keyframes" / "0a1b-2c3d-1_2").rmdir()
    with pytest.raises(InvalidInputError, match=r"row 3, column sample_id: 0a1b-2c3d-1_2 has no images"):
        find_benchmark("egoplan2").load(folder)


@pytest.mark.parametrize("name", PROMPTS)
def test_every_prompt_names_its_source_and_fills_its_fields(name, tmp_path):
    prompt = PROMPTS[name]
    assert prompt.source
    for benchmark in prompt.benchmarks:
        assert prompts_of(benchmark)[0].id.startswith("direct")
        assert find_prompt(benchmark, name) is prompt
        if benchmark == "better-vqa":
            continue
        item = find_benchmark(benchmark).load(published.FORMS[benchmark][0](tmp_path / benchmark)).items[0]
        text = prompt.text(item, CONVENTIONS[prompt.coordinates or "fractions"])
        assert "{" not in text.replace('{"', "")
        assert all(option in text for option in item.options)
        assert text.count("<image>") == (len(item.pictures) if prompt.frame else 0)
        hostile = replace(item, question="<image> {options} {request}")
        assert prompt.text(hostile, CONVENTIONS["fractions"]).count("<image>") == text.count("<image>")


def test_a_prompt_that_asks_for_another_convention_is_refused():
    own, official, silent = (PROMPTS[n] for n in ("direct-points", "refspatial-roborefer", "refspatial-qwen"))
    with pytest.raises(InvalidInputError, match="asks for fractions, but pixels is declared"):
        official.convention("pixels", "fractions")
    with pytest.raises(InvalidInputError, match="is missing, and the prompt refspatial-qwen does not state"):
        silent.convention(None, "fractions")
    assert own.convention(None, "fractions") == official.convention(None, "pixels") == "fractions"
    assert own.convention("thousandths", "fractions") == silent.convention("thousandths", "fractions") == "thousandths"
    with pytest.raises(UnknownNameError, match="prompt of refspatial"):
        find_prompt("refspatial", "direct")


def test_identifiers_that_occur_twice_are_numbered(tmp_path):
    folder = published.embspatial_json(tmp_path / "data")
    file = folder / "embspatial_bench.json"
    rows = [row | {"question_id": "q"} for row in json.loads(file.read_text())]
    file.write_text(json.dumps(rows))
    items = find_benchmark("embspatial").load(folder)
    assert [i.id for i in items.items[:3]] == ["q", "q#2", "q#3"]
    assert items.read(items.items[2].pictures[0]) == published.picture(2)


@pytest.mark.parametrize("split", ["Location", "Placement"])
def test_a_split_that_the_score_needs_is_missed(split, tmp_path):
    folder = published.refspatial_raw(tmp_path / "data")
    (folder / split).rename(tmp_path / split)
    with pytest.raises(InvalidInputError, match=f"has no items of the split {split.lower()}"):
        find_benchmark("refspatial").load(folder)


def test_the_split_outside_the_score_may_be_missing(tmp_path):
    folder = published.refspatial_raw(tmp_path / "data")
    (folder / "Unseen").rename(tmp_path / "Unseen")
    assert len(find_benchmark("refspatial").load(folder).items) == 6


def test_the_error_about_a_page_in_place_of_a_picture_is_the_same_each_time(tmp_path):
    folder = published.refspatial_raw(tmp_path / "data")
    (folder / "Location" / "image" / "0.png").write_bytes(b"<html>")
    with pytest.raises(InvalidInputError, match=r"column rgb_path: is not an image\. "):
        find_benchmark("refspatial").load(folder)


@pytest.mark.parametrize(
    ("size", "value", "says"),
    [
        ((published.WIDTH, published.HEIGHT), 0, "is empty, so every answer would be wrong"),
        ((published.HEIGHT, published.WIDTH), 255, "so its aspect ratio differs from that of its image"),
    ],
)
def test_a_target_region_that_cannot_be_right_is_an_error(size, value, says, tmp_path):
    folder = published.refspatial_raw(tmp_path / "data")
    mask = min((folder / "Location" / "mask").iterdir())
    Image.new("L", size, value).save(mask)
    with pytest.raises(InvalidInputError, match=rf"row \d, column mask_path: .*{says}"):
        find_benchmark("refspatial").load(folder)
