"""The offline author: distinct scenarios that make sense, in natural English, with the measures of the library."""

from __future__ import annotations

import itertools
import json
import re
from collections import Counter

import numpy as np
import pytest
from tests.daily import others_slow

from betterbench.cli.main import main
from betterbench.errors import InvalidInputError
from betterbench.generation.grammar import distinct_goals, goal_key, nouns_of_library, write_scenarios
from betterbench.generation.grammar.nouns import described, measure, measured, measured_categories, short_name
from betterbench.generation.grammar.theme import GRAMMARS
from betterbench.generation.scenario_form import scenario_from_json, scenario_to_json
from betterbench.generation.sense import sense_problems
from betterbench.sim.assets import categories, colors
from betterbench.sim.assets.catalogue.search import Catalogue
from betterbench.tasks.authoring.templates import TEMPLATES

NAMES = sorted(TEMPLATES)


def kinds_of(scenario):
    """The kinds of the library in a scenario, from the tags."""
    return {group: tuple(o.tags for o in objects) for group, objects in scenario.groups.items()}


def test_each_template_has_a_grammar_with_its_groups():
    assert sorted(GRAMMARS) == NAMES
    for name, grammar in GRAMMARS.items():
        needed = {g.group_id for g in TEMPLATES[name].groups if g.count_range[0]}
        for theme in grammar.themes:
            assert needed <= theme.groups.keys() <= {g.group_id for g in TEMPLATES[name].groups}


@pytest.mark.parametrize("template", others_slow(NAMES, 3))
def test_ten_scenarios_of_a_template_differ_and_make_sense(template):
    assert distinct_goals(template) >= 10
    written = write_scenarios(template, 10, seed=3)
    assert len({goal_key(kinds_of(s)) for s in written}) == 10
    assert len({s.context for s in written}) >= 3
    for scenario in written:
        assert sense_problems(scenario) == ()
        assert scenario_from_json(json.dumps(scenario_to_json(scenario))) == scenario


@pytest.mark.parametrize("samples", [4, pytest.param(24, marks=pytest.mark.slow)])
@pytest.mark.parametrize("template", NAMES)
def test_every_wording_of_every_theme_makes_sense(template, samples):
    """All instructions, with a sample of the objects of their theme."""
    from betterbench.generation.grammar.author import scenario_of

    draw = np.random.default_rng(0)
    for theme in GRAMMARS[template].themes:
        choices = list(itertools.islice(theme.choices(), 3000))
        for wording in theme.instructions:
            single = type(theme)(theme.name, theme.context, (wording,), theme.groups)
            for index in draw.choice(len(choices), size=min(len(choices), samples), replace=False):
                scenario = scenario_of(template, single, choices[index], draw)
                assert sense_problems(scenario) == (), (scenario.instruction, choices[index])


@pytest.mark.parametrize("template", others_slow(NAMES, 3))
def test_the_same_seed_gives_the_same_scenarios_and_more_do_not_change_the_first(template):
    first = write_scenarios(template, 5, seed=1)
    assert write_scenarios(template, 5, seed=1) == first
    assert [goal_key(kinds_of(s)) for s in write_scenarios(template, 9, seed=1)[:5]] == [
        goal_key(kinds_of(s)) for s in first
    ]
    assert write_scenarios(template, 9, seed=1)[:5] == first
    assert write_scenarios(template, 5, seed=2) != first


@pytest.mark.parametrize("template", others_slow(NAMES, 3))
def test_different_categories_come_before_different_colors(template):
    """Among the first scenarios, sets of categories repeat only where the themes have no other."""
    grammar = GRAMMARS[template]
    group = "layers" if template == "logical_assembly" else "plates" if template == "recursive_stacking" else "items"
    possible = {
        tuple(sorted(category for category, _ in choice[group]))
        for theme in grammar.themes
        for choice in theme.choices()
    }
    written = write_scenarios(template, 10, seed=0)
    seen = Counter(tuple(sorted(category for category, _ in kinds_of(s)[group])) for s in written)
    assert len(seen) >= min(len(possible), 5)


def test_all_scenarios_of_a_template_can_be_written_and_no_more():
    count = distinct_goals("recursive_stacking")
    assert len(write_scenarios("recursive_stacking", count)) == count
    with pytest.raises(InvalidInputError, match=f"has {count} different scenarios .*, not {count + 1}"):
        write_scenarios("recursive_stacking", count + 1)
    with pytest.raises(InvalidInputError, match="--num"):
        write_scenarios("recursive_stacking", 0)


def test_phrases_have_the_right_article_and_name_the_color_that_the_asset_has():
    for category in measured_categories():
        for color in colors(category):
            made = described(category, color)
            assert not re.search(r"\b[Aa] [aeio]|\b[Aa]n [^aeiou]", made.description), made.description
            assert made.tags == (category.replace("_", " "), color)
            if len(colors(category)) > 1 and category != "spice_jar":
                assert color in made.description
                assert color in made.asset_query
                assert short_name(category, color).startswith(color) or category == "spice_jar"


def test_the_grammar_uses_only_categories_of_the_library():
    assert set(measured_categories()) <= set(categories())
    for template in NAMES:
        for nouns in nouns_of_library(template).values():
            assert nouns


@pytest.mark.parametrize("category", ["apple", "lunchbox", "fork"])
def test_measures_are_those_of_the_assets(category):
    assert measured(category) == measure(category)


@pytest.mark.slow
def test_all_measures_are_those_of_the_assets():
    """Run tools/grammar_measures.py after a change of an asset."""
    for category in measured_categories():
        assert measured(category) == measure(category), category


def test_the_plates_of_a_stack_have_different_colors_and_the_drawers_that_of_the_cabinet():
    for scenario in write_scenarios("recursive_stacking", 20, seed=5):
        assert len({color for _, color in kinds_of(scenario)["plates"]}) == 3
    for scenario in write_scenarios("container_loading", 20, seed=5):
        found = kinds_of(scenario)
        assert {color for _, color in found["drawers"]} == {found["cabinet"][0][1]}
    for scenario in write_scenarios("constrained_positioning", 20, seed=5):
        assert len({color for _, color in kinds_of(scenario)["items"]}) == 2


@pytest.mark.slow
def test_every_query_finds_its_object_in_the_catalogue(tmp_path):
    assert main(["assets", "index", "procedural", "--encoder", "none", "--catalogue", str(tmp_path)]) == 0
    with Catalogue(tmp_path) as catalogue:
        for category in measured_categories():
            for color in colors(category):
                query = described(category, color).asset_query
                assert catalogue.search(query, limit=1)[0].entry.id == f"procedural/{category}-{color}", query
