"""Families of learners in a user's own file, as far as no network is needed."""

from __future__ import annotations

import pytest
from small_recipes import TINY, tiny

from betterbench.errors import InvalidInputError
from betterbench.learned import families
from betterbench.learned.families import Capacity, learner, learner_family
from betterbench.tasks import user_files
from betterbench.tasks.user_files import load_task_files

MINE = """
from betterbench.learned.families import learner

@learner("mine", sees="pixels", parts=("eyes", "trunk"), options={"pool": "max", "depth": 2, "share": 0.5})
def mine(recipe, vocabulary):
    raise ValueError("no network today")
"""


@pytest.fixture
def load(tmp_path, monkeypatch):
    """Loads a text as a user's file; what it registers is forgotten after the test."""
    for module, name in [(families, "_FAMILIES"), *((user_files, n) for n in ("_files", "_origins", "_makers"))]:
        monkeypatch.setattr(module, name, dict(getattr(module, name)))
    monkeypatch.setenv(user_files.VARIABLE, "")

    def load(text, name="mine.py"):
        (tmp_path / name).write_text(text, encoding="utf-8")
        load_task_files([tmp_path / name])
        return tmp_path / name

    return load


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
        ({"family": "mine", "options": {"depth": "deep"}}, "options.depth.*'deep' is no int"),
        ({"family": "mine", "options": {"depth": True}}, "options.depth.*True is no int"),
        ({"family": "mine", "options": {"depth": 2.5}}, "options.depth.*2.5 is no int"),
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
        ('"mine", sees', '"objects", sees', "betterbench itself both define it"),
        ('sees="pixels"', 'sees="sound"', "line 4.*sees 'sound'"),
        ('"mine", sees', '"", sees', "line 4.*no name"),
        ('sees="pixels"', 'sees="pixels", capacities={"small": None}', "line 4.*capacities"),
    ],
)
def test_a_wrong_registration_names_file_and_cure(load, old, new, said):
    with pytest.raises(InvalidInputError, match=said) as error:
        load(MINE.replace(old, new))
    assert "mine.py" in str(error.value)


def test_two_files_cannot_have_the_same_family(load):
    first = load(MINE)
    with pytest.raises(InvalidInputError, match="both define it") as error:
        load(MINE + "# another one\n", name="other.py")
    assert str(first) in str(error.value)


def test_a_name_of_our_own_is_not_taken_from_python_either():
    with pytest.raises(InvalidInputError, match="has a family of this name"):
        learner("pixels", sees="pixels")(object)


def test_capacities_of_its_own(load):
    load(MINE.replace('sees="pixels"', f'sees="objects", capacities={{n: Capacity(**{TINY}) for n in SIZES}}').replace(
        "import learner", "import Capacity, learner\n\nSIZES = ('small', 'base', 'large')"))  # fmt: skip
    assert tiny(family="mine", capacity="large").size == Capacity(**TINY)
