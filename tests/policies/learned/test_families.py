"""Families of learners in a user's own file, as far as no network is needed."""

from __future__ import annotations

import pytest
from small_recipes import TINY, tiny
from users_files import loader

from betterbench.errors import InvalidInputError
from betterbench.policies.learned.families import Capacity, learner, learner_family

MINE = """
from betterbench.policies.learned.families import learner

@learner("mine", sees="pixels", parts=("eyes", "trunk"), options={"pool": "max", "depth": 2, "share": 0.5})
def mine(recipe, vocabulary):
    raise ValueError("no network today")
"""


@pytest.fixture
def load(tmp_path, monkeypatch):
    return loader(tmp_path, monkeypatch)


def test_a_family_of_ones_own_brings_what_recipes_may_ask_for(load):
    load(MINE)
    recipe = tiny(family="mine", capacity="small", options={"depth": 3, "share": 1}, eyes={"size": 32})
    assert (recipe.sees, recipe.size) == ("pixels", learner_family("pixels").capacities["small"])
    assert recipe.all_options == {"pool": "max", "depth": 3, "share": 1}
    assert recipe.to_json()["options"] == {"depth": 3, "share": 1}
    assert tiny(family="mine", start="before", frozen=["trunk", "head"]).frozen == ("trunk", "head")


def test_a_recipe_without_options_is_written_as_before_there_were_any():
    assert "options" not in tiny().to_json()


@pytest.mark.parametrize(
    ("changes", "named"),
    [
        ({"family": "mien"}, "family.*Did you mean 'mine'.*--task-file"),
        ({"family": "mine", "options": {"pol": "max"}}, "options.*Did you mean 'pool'"),
        ({"family": "mine", "options": {"depth": "deep"}}, "options.depth: expected int.*'deep'"),
        ({"family": "mine", "options": {"depth": True}}, "options.depth: expected int.*True"),
        ({"family": "mine", "options": {"depth": 2.5}}, "options.depth: expected int.*2.5"),
        ({"family": "mine", "options": {"depth": [2]}}, "options.depth"),
        ({"family": "mine", "augmentation": {"shift_m": 0.01}}, "shift_m"),
        ({"family": "mine", "start": "before", "frozen": ["words"]}, "frozen: words"),
        ({"options": {"pool": "max"}}, "option of the family objects"),
        ({"start": "before", "frozen": ["head", "legs"]}, "frozen: legs"),
    ],
)
def test_a_recipe_that_asks_for_what_a_family_does_not_have_is_one_line(load, changes, named):
    load(MINE)
    with pytest.raises(InvalidInputError, match=named) as error:
        tiny(**changes)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('"mine", sees', '"objects", sees', "in both .* and betterbench itself"),
        ('sees="pixels"', 'sees="sound"', "line 4.*expected .*, got 'mine' and 'sound'"),
        ('"mine", sees', '"", sees', "line 4.*expected a name .*, got '' and"),
        (
            'sees="pixels"',
            'sees="pixels", capacities={"small": None}',
            "line 4.*capacities have the names .'small'.*small, base",
        ),
        (
            'sees="pixels"',
            'sees="pixels", capacities=["small"]',
            "line 4.*capacities have the names .'small'.*small, base",
        ),
        ('sees="pixels"', 'sees="pixels", capacities=3', "line 4.*capacities have the names 3.*small, base, large"),
        ('sees="pixels"', 'sees="pixels", capacities=dict.fromkeys(("small", "base", "large"))', "Use a Capacity"),
        ('parts=("eyes", "trunk")', 'parts="trunk"', "line 4.*parts are 'trunk'.*names of modules"),
        ('parts=("eyes", "trunk")', "parts=(1,)", "line 4.*parts are .1,"),
        ('parts=("eyes", "trunk")', "parts=None", "line 4.*parts are None"),
        ('"depth": 2', '"depth": None', "line 4.*default of its option 'depth' is None.*Use a finite number"),
        ('"depth": 2', '"depth": [2]', "line 4.*default of its option 'depth' is .2."),
        ('"depth": 2', '"depth": float("nan")', "line 4.*default of its option 'depth' is nan"),
        ('"depth": 2', "2: 2", "line 4.*options are .*Map names to default values"),
        ('"mine", sees', "7, sees", "line 4.*expected a name .*, got 7 and"),
        ('"mine", sees="pixels"', '"mine", sees=["pixels"]', "line 4.*expected .*got 'mine' and .'pixels'"),
    ],
)
def test_a_wrong_registration_names_file_and_cure(load, old, new, said):
    with pytest.raises(InvalidInputError, match=said) as error:
        load(MINE.replace(old, new))
    assert "mine.py" in str(error.value)


def test_two_files_cannot_have_the_same_family(load):
    first = load(MINE)
    with pytest.raises(InvalidInputError, match="it is defined in both") as error:
        load(MINE + "# another one\n", name="other.py")
    assert str(first) in str(error.value)


def test_a_name_of_our_own_is_not_taken_from_python_either():
    with pytest.raises(InvalidInputError, match="is the name of a built-in family"):
        learner("pixels", sees="pixels")(object)


def test_capacities_of_its_own(load):
    load(MINE.replace('sees="pixels"', f'sees="objects", capacities={{n: Capacity(**{TINY}) for n in SIZES}}').replace(
        "import learner", "import Capacity, learner\n\nSIZES = ('small', 'base', 'large')"))  # fmt: skip
    assert tiny(family="mine", capacity="large").size == Capacity(**TINY)
