"""The page "Add a failure mode" works: its code is carried out, its label is given, and then it is taken out again."""

from __future__ import annotations

import importlib.util
import inspect
import json
import re
import sys
from pathlib import Path

import pytest
from tests.prepared_process import OTHERS, prepared

from betterbench.cli.main import main
from betterbench.diagnosis.failure_mode import remove_mode
from betterbench.diagnosis.modes import MODES
from betterbench.records import JournalEntry, RunFolder
from betterbench.tasks import THRESHOLDS, Label, all_labels, remove_label
from betterbench.tasks.thresholds import remove_threshold

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "adding-a-failure-mode.md").read_text()
# Under a name of its own: whoever follows the page has a mode put_back in the package.
MODE, TEST = re.findall(r"```python\n(.*?)```", PAGE.replace("put_back", "put_back_again"), flags=re.DOTALL)


def imported(name: str, file: Path):
    spec = importlib.util.spec_from_file_location(name, file)
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    spec.loader.exec_module(module)
    return module


@pytest.fixture
def put_back(tmp_path):
    """The mode of the page, imported from a file outside the package and removed after the test."""
    labels, thresholds = all_labels(), THRESHOLDS.names()
    (tmp_path / "put_back.py").write_text(MODE)
    module = imported("put_back_again", tmp_path / "put_back.py")
    yield module
    remove_mode(module.PUT_BACK)
    remove_label(module.PUT_BACK)
    remove_threshold("put_back_again_radius")
    del sys.modules["put_back_again"]
    assert (all_labels(), THRESHOLDS.names()) == (labels, thresholds)


def test_the_tests_of_the_page_pass(put_back, tmp_path):
    stage = imported("stage_of_diagnosis", ROOT / "tests" / "diagnosis" / "conftest.py").Stage
    (tmp_path / "page.py").write_text(TEST)
    tests = [t for name, t in vars(imported("page", tmp_path / "page.py")).items() if name.startswith("test_")]
    assert len(tests) == 4
    for test in tests:
        assert list(inspect.signature(test).parameters) == ["stage"]
        test(stage)


def test_everything_else_follows_from_the_entry(put_back):
    mode = MODES[put_back.PUT_BACK]
    order = list(MODES)
    assert order == list(all_labels())
    assert order.index(mode.label) == order.index(Label.EARLY_HALT) + 1
    assert mode.family == "reasoning"
    assert THRESHOLDS.to_json()["put_back_again_radius"] == put_back.PUT_BACK_RADIUS
    assert Label("put_back_again") is put_back.PUT_BACK


def test_the_command_gives_the_label_with_the_file_and_not_without(tmp_path, capsys):
    """The mode is loaded in a process of its own, so that it is in no other test."""
    s = imported("stage_of_diagnosis", ROOT / "tests" / "diagnosis" / "conftest.py").Stage("fast_food", "train1")
    burger = s.at("first")
    trial = {"task": "fast_food", "condition": "train1", "variation": None, "seed": 0}
    run = RunFolder.start(tmp_path / "run", {"policy": "scripted", "trials": [trial]})
    stood = s.positions[burger].copy()
    run.write_record(s.grasp(burger).lift().carry(stood).home().wait(5).end())
    with run.journal() as journal:
        journal.append(JournalEntry("fast_food", "train1", None, 0))
    (tmp_path / "put_back.py").write_text(MODE)
    words = ["diagnose", str(run.path), "--json"]
    assert main(words) == 0
    told = [capsys.readouterr().out]
    done = prepared(*OTHERS).run("-m", "betterbench.cli", *words, "--task-file", str(tmp_path / "put_back.py"))
    assert done.returncode == 0, done.stderr
    told.append(done.stdout)
    labels = [json.loads(text)["trials"][0]["label"] for text in told]
    followed = "put_back" in {label.value for label in all_labels()}  # in a clone in which the page was carried out
    assert labels == ["put_back" if followed else "execution_failure", "put_back_again"]


def test_without_it_the_label_is_unknown():
    assert "put_back_again" not in {label.value for label in all_labels()}
