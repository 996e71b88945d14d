"""``better study`` on the command line: its plan, its page, and what it says when something is missing."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))

from workshop import made_up_workshop

from betterbench.cli.main import EXIT_BAD_INPUT, EXIT_INTERRUPTED, main
from betterbench.cli.verbs import study
from betterbench.learning.study import work
from betterbench.learning.study.plan import PRESETS, preset_text

PLAN = "tasks: [morning_coffee]\nseeds: [0]\ntrials: 2\nrecipe: {steps: 10}\n"


@pytest.fixture
def plan(tmp_path):
    path = tmp_path / "plan.yaml"
    path.write_text(PLAN)
    return path


def let_work(monkeypatch, *arguments):
    workshop, calls = made_up_workshop(*arguments)
    monkeypatch.setattr(work, "usual_workshop", lambda **_: workshop)
    return calls


@pytest.mark.parametrize("name", PRESETS)
def test_each_preset_is_a_plan_in_a_file_of_ones_own_too(tmp_path, name):
    """A lever whose eyes have a window is nested deepest."""
    (tmp_path / "plan.yaml").write_text(preset_text(name))
    assert study._plan(tmp_path / "plan.yaml", None, None) == study._plan(None, name, None)


def test_a_plan_becomes_a_page_and_the_same_command_resumes(plan, tmp_path, monkeypatch, capsys):
    def interrupt():
        raise KeyboardInterrupt

    out = tmp_path / "out"
    let_work(monkeypatch, 6, interrupt)
    assert main(["study", str(plan), "--out", str(out)]) == EXIT_INTERRUPTED
    assert "run the same command again" in capsys.readouterr().err
    calls = let_work(monkeypatch)
    assert main(["study", str(plan), "--out", str(out), "--json"]) == 0
    names = ("evaluate morning_coffee-balanced-seed0", "train morning_coffee-covered-seed0")
    assert calls == [*names, "evaluate morning_coffee-covered-seed0"]
    document = json.loads(capsys.readouterr().out)
    assert document == json.loads((out / "study.json").read_text())
    assert document["learners"] == 3
    calls = let_work(monkeypatch)
    assert main(["study", str(plan), "--out", str(out)]) == 0
    assert calls == []
    said = capsys.readouterr().out
    assert "confounded" in said
    assert str(out / "study.html") in said.replace("\n", "")


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ([], "expected exactly one plan"),
        (["PLAN", "--preset", "small"], "Pass either a YAML file or a preset"),
        (["--preset", "huge"], "'huge' is not a preset"),
        (["NONE"], "cannot be read"),
    ],
)
def test_a_study_without_one_plan_is_one_line(words, said, plan, tmp_path, capsys):
    places = {"PLAN": str(plan), "NONE": str(tmp_path / "none.yaml")}
    given = [places.get(word, word) for word in words]
    assert main(["study", *given, "--out", str(tmp_path / "out")]) == EXIT_BAD_INPUT
    assert said in capsys.readouterr().err.replace("\n", " ")


def test_without_torch_the_extra_is_named_before_anything_is_begun(plan, tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "torch", None)
    assert main(["study", str(plan), "--out", str(tmp_path / "out")]) == EXIT_BAD_INPUT
    assert "setup EXTRAS=train" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
