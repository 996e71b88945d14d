"""The page about generated tasks: its vocabulary and its example are those of the code."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from betterbench.generation.grammar import distinct_goals
from betterbench.generation.grammar.author import shown_colors
from betterbench.generation.grammar.theme import GRAMMARS
from betterbench.generation.growth.difficulty import EASY_BELOW_S, HARD_FROM_S
from betterbench.generation.growth.job import ATTEMPTS_PER_TASK, ROUND
from betterbench.generation.growth.sources import OfflineSource
from betterbench.generation.scenario_form import scenario_from_answer
from betterbench.quoting import markdown_code
from betterbench.tasks.authoring.templates import TEMPLATES

PAGE = (Path(__file__).parents[2] / "docs/generating.md").read_text(encoding="utf-8")


def row(template):
    groups = "; ".join(
        f"{group}: "
        + ", ".join(markdown_code(c) + (f" ({', '.join(of)})" if len(of) > 1 else "") for c, of in all_.items())
        for group, all_ in shown_colors(template).items()
    )
    contexts = ", ".join(dict.fromkeys(theme.context for theme in GRAMMARS[template].themes))
    return f"| {markdown_code(template)} | {distinct_goals(template):,} | {contexts} | {groups} |"


@pytest.mark.parametrize("template", TEMPLATES)
def test_the_vocabulary_of_each_template_is_on_the_page(template):
    assert row(template) in PAGE


def test_the_example_of_the_page_has_the_form():
    (answer,) = json.loads(re.search(r"```json\n(.*?)```", PAGE, re.DOTALL)[1])
    scenario = scenario_from_answer(answer, "loose_packing")
    assert scenario.groups["container"][0].asset_query == "blue lunchbox"


def test_the_goals_of_each_template_are_on_the_page():
    goals, colored = OfflineSource(list(TEMPLATES)), OfflineSource(list(TEMPLATES), distinct="colors")
    for name, templates in [*((markdown_code(t), [t]) for t in TEMPLATES), ("all", list(TEMPLATES))]:
        assert f"| {name} | {goals.goals(templates):,} | {colored.goals(templates):,} |" in PAGE
    assert f"N is therefore at most {goals.goals(list(TEMPLATES)):,}." in PAGE
    assert f"easy below {EASY_BELOW_S:g} s and hard from {HARD_FROM_S:g} s on" in " ".join(PAGE.split())
    assert f"rounds of up to {ROUND}." in PAGE
    assert f"({('zero', 'one', 'two', 'three')[ATTEMPTS_PER_TASK]} per task by default)" in PAGE
