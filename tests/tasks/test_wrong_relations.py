"""Mistakes of the author of a relation are one clear error, when the relation is registered where possible."""

from __future__ import annotations

import dataclasses
import re

import pytest
from tests.tasks.posing import where

from betterbench.errors import BetterError
from betterbench.tasks import authoring as a
from betterbench.tasks import broken_premises, get_task
from betterbench.tasks.relations import RELATIONS
from betterbench.tasks.relations.authoring import Relation, offers, register, single, threshold
from betterbench.tasks.thresholds import threshold_table
from betterbench.tasks.user_files import load_task_files


def there(state, name, target) -> bool:
    return state.touching(name, target)


def there_unannotated(state, name, target):
    return state.touching(name, target)


def goals_of(_state, _name, _target, _region):
    return ()


RIGHT = {
    "name": "perched",
    "words": "{object} stands on {target}",
    "where": single(there),
    "regions": offers("top"),
    "needs": ("top",),
    "tolerances": ("upright_tilt",),
    "goals": goals_of,
}


@pytest.fixture(autouse=True)
def _registry_is_kept():
    yield
    RELATIONS.pop("perched", None)


def test_a_right_relation_is_accepted():
    assert register(Relation(**RIGHT)).name == "perched"


@pytest.mark.parametrize(
    ("fields", "text"),
    [
        (
            {"tolerances": ("upright_tlit",)},
            "tolerances of the relation perched 'upright_tlit'. Did you mean 'upright_tilt'",
        ),
        ({"tolerances": "upright_tilt"}, "tolerances must be a tuple of names, got 'upright_tilt'. Write tolerances=("),
        ({"needs": ("tops",)}, "an asset with the regions in needs (tops) is not a target for regions. Name the same"),
        ({"regions": offers("tpo")}, "an asset with the regions in needs (top) is not a target for regions"),
        ({"regions": ("top",)}, "regions is not a function, but ('top',). Use regions=offers(\"top\")"),
        ({"words": "{thing} is on {target}"}, "words is '{thing} is on {target}'. Write a phrase such as"),
        ({"words": "an object on another"}, "words is 'an object on another'. Write a phrase such as"),
        ({"goals": None}, "it has no goals, so the expert cannot achieve it. Give goals, or roles="),
        ({"goals": lambda _state, _name: ()}, "goals must be callable as goals(state, object, target, region)"),
        ({"where": there}, "where returns True or False, not a region. Use where=single(test)"),
        ({"where": lambda _state, _name: None}, "where must be callable as where(state, object, target)"),
        ({"loosely": lambda _state: None}, "loosely must be callable as loosely(state, object, target)"),
        ({"surface": "top"}, "surface is not a function, but 'top'. Use surface=surface_of("),
    ],
)
def test_a_wrong_relation_is_refused_when_it_is_registered(fields, text):
    with pytest.raises(BetterError, match=re.escape(text)) as caught:
        register(Relation(**{**RIGHT, **fields}))
    assert "relation perched" in str(caught.value)


def test_a_test_that_was_not_made_single_is_named_when_it_first_holds(at_reset, posed):
    wrong = register(Relation(**{**RIGHT, "where": there_unannotated}))
    state = posed(at_reset("fast_food", "train1"), contacts=(("fries", "box"),))
    with pytest.raises(
        BetterError, match=r"relation perched: where or loosely returned True, .* Use where=single\(test\)"
    ):
        wrong.where(state, "fries", "box")


def test_a_name_that_is_taken_names_both_files(tmp_path):
    file = tmp_path / "a_inside.py"
    file.write_text(
        "from dataclasses import replace\nfrom betterbench.tasks.relations.authoring import *\n\n"
        "register(replace(relation('inside')))\n"
    )
    with pytest.raises(BetterError) as caught:
        load_task_files([file])
    assert re.fullmatch(
        rf"\S+/relations/inside\.py, line \d+, and {re.escape(str(file))}, line 4: "
        r"both register the relation 'inside'\. Change the name at one of the two places\.",
        str(caught.value),
    )


@pytest.mark.parametrize(
    ("source", "text"),
    [
        (
            "single(lambda state, name: True)",
            "single(<lambda>): test must be callable as test(state, object, target) (too many positional arguments)",
        ),
        (
            "def near(state, name, target, far): ...\nsingle(near)",
            "single(near): test must be callable as test(state, object, target)",
        ),
        ("single(True)", "single(test): the test is not a function, but True. Pass the name of the test, without"),
    ],
)
def test_a_wrong_test_in_single_is_named_when_the_file_is_loaded(tmp_path, source, text):
    file = tmp_path / "perched.py"
    file.write_text(f"from betterbench.tasks.relations.authoring import *\n{source}\n")
    line = len(source.splitlines()) + 1
    with pytest.raises(BetterError, match=re.escape(f"{file}, line {line}: ")) as caught:
        load_task_files([file])
    assert text in str(caught.value)


@pytest.mark.parametrize("value", ["0.02", None, True, float("nan")])
def test_a_threshold_must_be_a_number(value):
    known = {entry.name for entry in threshold_table()}
    with pytest.raises(ValueError, match=f"'perched_offset' must be a finite number, got {value!r}"):
        threshold("perched_offset", value, "m", "A reason.")
    assert {entry.name for entry in threshold_table()} == known


def test_a_step_names_its_relation_by_the_relation():
    with pytest.raises(TypeError, match=r"relation must be a Relation such as a\.INSIDE, got 'inside'"):
        a.subgoal("pack", "inside", a.item("lemon"), a.container("box"), word="lemon")


def test_a_contact_with_a_body_that_does_not_exist_fails_the_truth_table(at_reset):
    register(Relation(**{**RIGHT, "where": single(lambda state, name, _: state.touching(name, "tabel"))}))
    with pytest.raises(AssertionError, match="the contacts of 'tabel', which does not exist"):
        where("perched", at_reset("fast_food", "train1"), "fries", "box")


def test_a_target_without_the_region_of_a_step_breaks_the_premise(at_reset):
    condition = get_task("desk_meeting").train("train1")
    (first, *rest) = condition.instruction.subgoals
    wrong = dataclasses.replace(first, region="lfet")
    asked = condition.with_(instruction=dataclasses.replace(condition.instruction, subgoals=(wrong, *rest)))
    text = "the asset of the target laptop lacks the region 'lfet' for the relation beside"
    assert broken_premises(asked, at_reset("desk_meeting", "train1")) == (text,)


def test_a_mistake_in_a_file_names_the_file_and_the_line(tmp_path):
    file = tmp_path / "perched.py"
    file.write_text(
        "from betterbench.tasks.relations.authoring import *\n\nthreshold('perched_gap', '0.02', 'm', 'Why.')\n"
    )
    with pytest.raises(BetterError, match=r"perched\.py, line 3: .*'perched_gap' must be a finite number, got '0\.02'"):
        load_task_files([file])
