"""Our own sets as a benchmark: one way of asking, reading and scoring with ``better vqa``."""

from __future__ import annotations

import dataclasses
import json
from functools import partial

import pytest
from tests.vlm.test_running import Scripted, run
from tests.vqa.small import OPTIONS, SIZE

from betterbench.cli.main import main
from betterbench.evaluation import evaluate, make_plan
from betterbench.evaluation.figures.views import ViewRenderer
from betterbench.vlm.benchmarks.better_vqa import items_of
from betterbench.vlm.prompts import find_prompt
from betterbench.vqa.asking import ask_set, prompt_for, read_answers, scores_of
from betterbench.vqa.coordinates import CONVENTIONS
from betterbench.vqa.dataset import make_set
from betterbench.vqa.llm import ScriptedChat

pytestmark = [pytest.mark.physics, pytest.mark.render]


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    folder = tmp_path_factory.mktemp("vlm")
    tasks = ("fruit_lunch", "morning_coffee")
    plan = make_plan("expert", tasks=tasks, variations=["L1"], trials=1, observation="state_only", quality="fast")
    plan = dataclasses.replace(plan, trials=tuple(t for t in plan.trials if t.variation))
    recorded = evaluate(plan, folder / "records", workers=1)
    photos = partial(ViewRenderer, recorded, size=SIZE, quality="fast")
    return make_set(recorded, folder / "set", OPTIONS, open_photos=photos)


def replies(asked, wrong=7):
    """Returns an answer per question: right, but for every seventh."""
    return {q.id: ("?" if i % wrong == 0 else q.reply) for i, q in enumerate(asked.questions)}


def test_both_verbs_ask_and_score_alike(made, tmp_path):
    items, prompt = items_of(made), find_prompt("better-vqa", None)
    for name in ("pixels", "thousandths-yx-json"):
        texts = [prompt.text(item, CONVENTIONS[name]) for item in items.items]
        assert texts == [prompt_for(q, name) for q in made.questions]
    told = iter(replies(made).values())
    answers = ask_set(made, ScriptedChat(lambda _: next(told), name="scripted"), tmp_path / "a.jsonl", at_once=1)
    told = iter(replies(made).values())
    found = run("better-vqa", made.path, tmp_path / "run", Scripted(lambda *_: next(told)), at_once=1)
    assert (tmp_path / "a.jsonl").read_bytes() == (tmp_path / "run" / "answers.jsonl").read_bytes()
    theirs = {s.name: s.rate for s in scores_of(made, answers)}
    assert found.score.all.means["parsed"].total == theirs["all"].k == len(made.questions) * 6 // 7
    for part in found.score.parts:
        if part.kind == "type":
            assert (part.means["parsed"].total, part.n) == (theirs[part.name].k, theirs[part.name].n)
            assert part.reference["chance"] > 0
        if part.kind == "difficulty":
            assert part.means["parsed"].total == theirs[f"difficulty: {part.name}"].k
    assert read_answers(tmp_path / "run" / "answers.jsonl", made).answers.keys() == replies(made).keys()
    assert items.sha256 == made.sha256


def test_the_command_prints_a_table_of_80_columns(made, serve, tmp_path, capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    line = ["vlm", "--data", str(made.path), "--model", f"{serve(lambda _: 'Yes').url}#tiny"]
    assert main([*line, "--out", str(tmp_path / "run")]) == 0
    out = capsys.readouterr().out
    assert "type: grounding" in out
    assert "difficulty: " in out
    assert "chance" in out
    assert main([*line, "--out", str(tmp_path / "run"), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["benchmark"] == "better-vqa"
