"""What a learner is shown: never what would hand over the answer."""

from __future__ import annotations

import dataclasses
import sys
from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st
from tests.looping import each

from betterbench.errors import InvalidInputError
from betterbench.geometry import rotate
from betterbench.interface import CameraSpec, observation_spec
from betterbench.interface.state import ObjectInfo
from betterbench.policies.learned import TrainingRecipe, read_training_recipe
from betterbench.policies.learned.eyes import looked_at
from betterbench.policies.learned.tokens import six_numbers, things_of
from betterbench.policies.learned.vocabulary import MOST_WORDS, UNKNOWN, Vocabulary

sys.path.insert(0, str(Path(__file__).parent))
from small_recipes import PIXELS, tiny

MUG = ObjectInfo(
    "mug_1", "blue mug", "mug#1", "mug", "blue", "cylinder", "item", fixed=False, mass_kg=0.2, size_m=(0.1, 0.1, 0.1)
)
KNOWN = Vocabulary.of(["Put the blue mug away."], ["mug"], ["blue", "red"])


def same(a, b) -> bool:
    return all(np.array_equal(getattr(a, f.name), getattr(b, f.name)) for f in dataclasses.fields(a))


@pytest.mark.parametrize(
    "hidden",
    [{"name": "x"}, {"role": "distractor"}, {"slot": "far"}, {"kind": "red mug"}, {"fixed": True}, {"asset": "x"}],
)
def test_name_role_and_slot_change_nothing(hidden):
    other = dataclasses.replace(MUG, **hidden)
    assert same(things_of("put the mug", [MUG], KNOWN), things_of("put the mug", [other], KNOWN))


@pytest.mark.parametrize("visible", [{"category": "cup"}, {"color": "red"}, {"size_m": (0.1, 0.1, 0.2)}])
def test_category_color_and_size_are_shown(visible):
    other = dataclasses.replace(MUG, **visible)
    assert not same(things_of("put the mug", [MUG], KNOWN), things_of("put the mug", [other], KNOWN))


def test_unknown_words_share_a_number_and_are_named():
    assert list(KNOWN.word_ids("Put the GREEN mug!")) == [*KNOWN.word_ids("put the"), UNKNOWN, *KNOWN.word_ids("mug")]
    assert KNOWN.unknown_words("Put the GREEN mug!") == ("green",)
    assert len(KNOWN.word_ids("mug " * 1000)) == MOST_WORDS


@given(st.lists(st.floats(-1, 1), min_size=4, max_size=4).filter(lambda q: np.linalg.norm(q) > 0.1))
def test_six_numbers_are_the_turned_axes(numbers):
    q = np.array(numbers) / np.linalg.norm(numbers)
    wanted = [*rotate(tuple(q.tolist()), (1.0, 0.0, 0.0)), *rotate(tuple(q.tolist()), (0.0, 1.0, 0.0))]
    assert six_numbers(q) == pytest.approx(wanted, abs=1e-9)


EMPTY = {"camera": "front", "window": [0.5, 0, 0.5, 1]}


@each(
    "form, named",
    [
        ({}, "data"),
        ({"data": []}, "data"),
        ({"data": ["x"], "stepps": 3}, "stepps"),
        ({"data": ["x"], "steps": 0}, "steps"),
        ({"data": ["x"], "learning_rate": float("nan")}, ""),
        ({"data": ["x"], "chunk": 4, "execute": 5}, "execute"),
        ({"data": ["x"], "loss": "l2"}, "loss"),
        ({"data": ["x"], "frozen": ["trunk"]}, "frozen"),
        ({"data": ["x"], "capacity": {"width": 10, "layers": 1, "heads": 3}}, "width"),
        ({"data": ["x"], "version": 2}, "version"),
        ({"data": ["x"], "eyes": {"size": 64}}, "eyes"),
        ({"data": ["x"], "augmentation": {"light": 0.1}}, "light"),
        ({"data": ["x"], "start": "y", "frozen": ["eyes"]}, "eyes"),
        ({"data": ["x"], "family": "pixels", "augmentation": {"shift_m": 0.01}}, "shift_m"),
        ({"data": ["x"], "family": "pixels", "start": "y", "frozen": ["objects"]}, "objects"),
        ({"data": ["x"], "family": "pixels", "eyes": {"size": 90}}, "size"),
        ({"data": ["x"], "family": "pixels", "eyes": {"views": []}}, "views"),
        ({"data": ["x"], "family": "pixels", "eyes": {"views": ["ceiling"]}}, "ceiling"),
        ({"data": ["x"], "family": "pixels", "eyes": {"observation": "nothing"}}, "nothing"),
        ({"data": ["x"], "family": "pixels", "eyes": {"views": [EMPTY]}}, "window"),
        ({"data": ["x"], "family": "pixels", "history": 2, "history_stride": 3, "execute": 2}, "history_stride"),
    ],
)
def test_a_wrong_recipe_is_one_line_that_names_the_field(form, named):
    with pytest.raises(InvalidInputError) as caught:
        read_training_recipe(form, where="r.yaml")
    assert named in str(caught.value)
    assert "\n" not in str(caught.value)


def test_the_page_shows_each_field_with_its_default():
    page = (Path(__file__).parents[3] / "docs/training.md").read_text()
    shown = yaml.safe_load(page.split("```yaml\n")[1].split("```")[0])
    assert read_training_recipe(shown) == read_training_recipe({"data": shown["data"]})
    assert set(shown) == {f.name for f in dataclasses.fields(TrainingRecipe)} - {"version"}


def test_each_lever_of_the_page_is_a_recipe():
    page = (Path(__file__).parents[3] / "docs/training.md").read_text()
    section = page.split("### Levers")[1].split("\n##")[0]
    levers = [yaml.safe_load(part.split("```")[0]) for part in section.split("```yaml\n")[1:]]
    assert len(levers) >= 5
    for lever in levers:
        assert read_training_recipe({"data": ["x"], **lever}) != read_training_recipe({"data": ["x"]})


@pytest.mark.parametrize(
    "changes",
    [
        {"proprioception": {"given": False}, "tasks": ["morning_coffee"]},
        {**PIXELS, "eyes": {"views": ["wrist", {"camera": "front", "window": [0.2, 0.2, 0.6, 0.6]}]}},
        {"co_training": {"sets": ["questions"], "weight": 0.5}},
    ],
)
def test_a_recipe_is_read_back_from_its_json(changes):
    recipe = tiny(**changes)
    assert read_training_recipe(recipe.to_json()) == recipe
    assert read_training_recipe(recipe.to_json(), changes={"seed": 7, "steps": None}) == dataclasses.replace(
        recipe, seed=7
    )


def pictures(seed: int = 0) -> dict[str, np.ndarray]:
    draw = np.random.default_rng(seed)
    return {name: draw.integers(0, 256, (256, 256, 3), dtype=np.uint8) for name in ("front", "wrist")}


def test_a_window_of_as_many_pixels_shows_them_one_to_one():
    window = [64 / 256, 32 / 256, 160 / 256, 128 / 256]
    eyes = tiny(**{**PIXELS, "eyes": {"views": ["wrist", {"camera": "front", "window": window}]}}).eyes
    seen, shown = looked_at(eyes, pictures()), pictures()
    assert np.array_equal(seen[1], shown["front"][32:128, 64:160])
    assert seen.shape == (2, 96, 96, 3)


def test_a_scaled_picture_keeps_its_mean():
    seen = looked_at(tiny(**{**PIXELS, "eyes": {"views": ["front"], "size": 64}}).eyes, pictures())
    blocks = pictures()["front"].reshape(64, 4, 64, 4, 3).mean(axis=(1, 3))
    assert np.abs(seen[0] - blocks).max() <= 1.0


def test_only_cameras_that_are_looked_at_are_named():
    window = {"camera": "wrist", "window": [0, 0, 0.5, 0.5]}
    eyes = tiny(**{**PIXELS, "eyes": {"views": [window, "wrist"]}}).eyes
    assert eyes.cameras == ("wrist",)
    assert observation_spec("default").only(eyes.cameras).cameras == (CameraSpec("wrist"),)


@pytest.mark.parametrize("shown", [{}, {"front": np.zeros((200, 200, 3), np.uint8)}])
def test_another_picture_than_in_training_is_refused(shown):
    with pytest.raises(InvalidInputError, match="--observation default"):
        looked_at(tiny(**PIXELS).eyes, shown)
