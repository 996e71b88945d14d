"""A tiny random InternVL: tiles, tokens, placeholders, answers, and folders that are something else."""

from __future__ import annotations

import json

import numpy as np
import pytest
import torch
from pictures import png, stripes
from tests.vlm import published
from tiny_intern_vl import make_checkpoint
from transformers.models.got_ocr2.image_processing_pil_got_ocr2 import get_optimal_tiled_canvas

from betterbench.errors import InvalidInputError
from betterbench.vlm import RunSettings, evaluate_model, find_benchmark
from betterbench.vlm.models.eyes import Eyes, shown_picture
from betterbench.vlm.models.intern_vl import InternVl
from betterbench.vlm.models.tiles import grid_of
from betterbench.vlm.prompts import find_prompt

PLACE = "<IMG_CONTEXT>"


@pytest.fixture(scope="module")
def checkpoint(tmp_path_factory):
    return make_checkpoint(tmp_path_factory.mktemp("checkpoint"))


@pytest.fixture(scope="module")
def native(checkpoint):
    return InternVl(checkpoint, most_tiles=6, max_tokens=8)


def test_our_grids_are_those_of_transformers():
    rng = np.random.default_rng(0)
    for width, height, most in rng.integers((20, 20, 1), (3000, 3000, 13), (3000, 3)).tolist():
        grid = grid_of(width, height, most=most)
        assert get_optimal_tiled_canvas((height, width), (448, 448), 1, most) == (grid.columns, grid.rows)


@pytest.mark.parametrize(
    ("eyes", "tiles", "tokens", "side"),
    [
        (Eyes.NATIVE, 7, 256, 448), (Eyes.TILE_1, 1, 256, 448),
        (Eyes.BLUR_224, 1, 256, 448), (Eyes.NATIVE_224, 1, 64, 224),
    ],
)  # fmt: skip
def test_each_of_the_eyes_costs_its_tokens_and_answers(checkpoint, eyes, tiles, tokens, side):
    model = InternVl(
        checkpoint,
        most_tiles=6 if eyes is Eyes.NATIVE else 1,
        side=224 if eyes is Eyes.NATIVE_224 else None,
        max_tokens=4,
    )
    picture = shown_picture(stripes(640, 480, 8), eyes).data
    text, sight = model.request("Which is it?", [picture])
    assert sight.tiles == (tiles,)
    assert sight.pixels.shape == (tiles, 3, side, side)
    assert text.count(PLACE) == tiles * tokens
    assert isinstance(model.answer("Which is it?", [picture]), str)
    assert f"of {side} pixels" in model.name


def test_pictures_stand_where_the_prompt_has_their_marks(native):
    text, sight = native.request("Image-1: <image>\nImage-2: <image>\nWhat is next?", [stripes(640, 480, 8)] * 2)
    assert sight.tiles == (7, 7)
    first, second, rest = text.split("<img>")
    assert first.endswith("Image-1: ")
    assert second.endswith("Image-2: ")
    assert rest.rstrip().endswith("What is next?<|im_end|>\n<|im_start|>assistant")


def test_without_marks_pictures_come_first(native):
    text, _ = native.request("What is this?", [stripes(448, 448, 8)])
    assert text.index("<img>") < text.index("What is this?")


def test_a_prompt_without_pictures(native):
    text, sight = native.request("What is two and two?", [])
    assert sight is None
    assert PLACE not in text
    assert isinstance(native.answer("What is two and two?", []), str)


def test_a_text_cannot_add_pictures_of_its_own(native):
    text, _ = native.request(f"Count {PLACE}{PLACE} these.", [stripes(448, 448, 8)])
    assert text.count(PLACE) == 256
    assert isinstance(native.answer(f"Count {PLACE} these.", [stripes(448, 448, 8)]), str)


def test_the_same_request_has_the_same_answer(native):
    asked = ("What?", [stripes(640, 480, 6)])
    assert native.answer(*asked) == native.answer(*asked)


def test_the_model_is_shown_the_picture(checkpoint):
    model = InternVl(checkpoint, most_tiles=1, max_tokens=4)
    dark, light = (png(np.full((64, 64, 3), v, np.uint8)) for v in (10, 240))
    with torch.inference_mode():
        seen = [model.request("What?", [p])[1].pixels.mean().item() for p in (dark, light)]
    assert seen[1] - seen[0] > 3


def test_a_folder_without_a_checkpoint(tmp_path):
    with pytest.raises(InvalidInputError, match=r"no config\.json.*-HF"):
        InternVl(tmp_path)


def test_a_checkpoint_of_another_architecture(tmp_path):
    config = {"model_type": "qwen3", "architectures": ["Qwen3ForCausalLM"]}
    (tmp_path / "config.json").write_text(json.dumps(config))
    with pytest.raises(InvalidInputError, match="Qwen3ForCausalLM, expected InternVLForConditionalGeneration"):
        InternVl(tmp_path)


@pytest.mark.parametrize("name", ["model.safetensors", "tokenizer.json", "preprocessor_config.json"])
def test_a_checkpoint_with_a_file_missing_or_cut(checkpoint, tmp_path, name):
    for file in checkpoint.iterdir():
        (tmp_path / file.name).write_bytes(file.read_bytes())
    cut = tmp_path / name
    cut.write_bytes(cut.read_bytes()[:100])
    with pytest.raises(InvalidInputError, match="cannot be loaded"):
        InternVl(tmp_path)
    cut.unlink()
    with pytest.raises(InvalidInputError, match=r"cannot be loaded|chat template"):
        InternVl(tmp_path)


@pytest.mark.parametrize("name", published.FORMS)
def test_a_checkpoint_runs_each_benchmark_from_end_to_end(name, checkpoint, tmp_path):
    benchmark, model = find_benchmark(name), InternVl(checkpoint, most_tiles=1, max_tokens=4)
    items = benchmark.load(published.FORMS[name][0](tmp_path / "data"))
    settings = RunSettings(find_prompt(name, None), benchmark.coordinates or "pixels", at_once=1)
    found = evaluate_model(benchmark, items, model, tmp_path / "run", settings)
    assert found.score.all.n == len(items.items) == len(found.answers.answers)
    assert found.requests.sentences() == ["The model reported no token counts."]
    again = evaluate_model(benchmark, items, model, tmp_path / "again", settings)
    assert again.score.items == found.score.items


def test_an_import_that_fails_is_no_fault_of_the_checkpoint(checkpoint, monkeypatch):
    def load(*_, **__):
        raise ModuleNotFoundError("Could not import module 'AutoImageProcessor'")

    monkeypatch.setattr("transformers.AutoImageProcessor.from_pretrained", load)
    with pytest.raises(InvalidInputError, match=r"an import fails .* matching versions of torch, torchvision"):
        InternVl(checkpoint)
