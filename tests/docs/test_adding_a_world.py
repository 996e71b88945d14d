"""The page on worlds is carried out: its file registers a world, and policies are evaluated in it."""

from __future__ import annotations

import csv
import inspect
import io
import json
import re
import shlex
from dataclasses import replace
from pathlib import Path

import pytest
from tests.docs.copies import copy_checkout, run

from betterbench.api.report import ReportListener, _media
from betterbench.cli.main import main
from betterbench.cli.output.comparison import print_comparison
from betterbench.comparison import Side, compare
from betterbench.diagnosis import Label, diagnose_run
from betterbench.errors import MissingDependencyError, RecordError
from betterbench.records import RunFolder
from betterbench.report.figures.charts import outcomes_chart
from betterbench.report.headline import verdict_line
from betterbench.report.legend import modes_of
from betterbench.report.tables.exports import trial_table, variation_table
from betterbench.report.tables.table import to_csv
from betterbench.sim.worlds import PlanRequest, World, world_named
from betterbench.sim.worlds.bare import BareScene
from betterbench.sim.worlds.registry import forget_world
from betterbench.tasks import user_files
from betterbench.tasks.trial import Trial
from betterbench.tasks.worlds.facts import Suite, WorldFacts

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "adding-a-world.md").read_text(encoding="utf-8")
WORLD, POLICY, _ = re.findall(r"```python\n(.*?)```", PAGE, flags=re.DOTALL)
(COMMANDS,) = re.findall(r"```sh\n(.*?)```", PAGE, flags=re.DOTALL)


@pytest.fixture
def forgotten():
    yield
    forget_world("point")


@pytest.fixture
def follow(tmp_path, monkeypatch, capfd, forgotten):
    """Runs commands of the page in a folder, and returns the folder and what they said."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(user_files, "_files", {})
    monkeypatch.setattr(user_files, "_origins", dict(user_files._origins))
    monkeypatch.setenv(user_files.VARIABLE, "")
    (tmp_path / "point.py").write_text(WORLD, encoding="utf-8")
    (tmp_path / "goes.py").write_text(POLICY, encoding="utf-8")

    def run(lines):
        said = []
        for line in lines:
            name, *words = shlex.split(line)
            assert name == "better"
            assert main(words) == 0, capfd.readouterr().err
            said.append(capfd.readouterr())
        return tmp_path, said

    return run


def test_the_world_of_the_page_is_evaluated_and_reported_and_read_with_its_file_alone(follow, monkeypatch):
    lines = [line + " --workers 1" if " eval " in line else line for line in COMMANDS.splitlines()]
    folder, (suites, goes, noop, report) = follow(lines)
    assert "a mark on the left" in " ".join(suites.out.split())
    assert "10 trials of point." in goes.err
    assert "100.0 % success (10/10" in goes.out
    assert "0.0 % success (0/10" in noop.out
    runs = {name: RunFolder.open(folder / "runs" / name) for name in ("goes", "noop")}
    records = list(runs["goes"].records())
    assert {r.metadata.task for r in records} == {"point-left", "point-right"}
    assert all(r.outcome.success and r.metadata.engine["simulator"] == "point" for r in records)
    assert {r.metadata.predicate_names for r in records} == {("at(hand, mark)",)}
    assert {t.label.value for t in diagnose_run(runs["goes"]).trials} == {"success"}
    assert {t.label.value for t in diagnose_run(runs["noop"]).trials} == {"timeout"}
    found = diagnose_run(runs["noop"])
    assert {m.name for m in found.metrics} == {"success_rate", "system_failure_rate", "progress"}
    said = " ".join((*found.findings, verdict_line(found)))
    assert "The step limit is reached: 5/5 trials of point-left base." in said
    assert "It does not reach the goal before the step limit" in said
    assert not re.search("attempt|grasp|mistake|execution|wrong", said)
    chart = outcomes_chart([found])
    assert [name for _, name in chart.key] == ["Right", "Failure, cause not judged", "System failure"]
    assert not re.search("reasoning|execution", chart.caption, re.IGNORECASE)
    without_failure = diagnose_run(runs["goes"])
    same = outcomes_chart([without_failure])
    assert (same.key, same.caption) == (chart.key, chart.caption)
    assert modes_of([without_failure]) == modes_of([found])
    page = (folder / "runs" / "goes" / "report" / "index.html").read_text(encoding="utf-8")
    assert "move the hand to the left" in page
    assert "Point" in page
    assert "Rendering" not in report.err
    stored = json.loads((folder / "runs" / "goes" / "run.json").read_text())["plan"]
    assert stored["world"]["facts"] == world_named("point").facts.to_json()
    assert [file["name"] for file in stored["task_files"]] == ["point.py"]
    monkeypatch.setattr(user_files, "_files", {})
    monkeypatch.setenv(user_files.VARIABLE, "")
    with pytest.raises(RecordError, match=r"point\.py.*--task-file"):
        RunFolder.open(folder / "runs" / "goes")


def test_a_report_announces_no_films_in_a_world_that_cannot_render_them(follow):
    folder, _ = follow([f"{COMMANDS.splitlines()[2]} --trials 1 --workers 1"])
    said = []
    run = RunFolder.open(folder / "runs" / "noop")
    found = diagnose_run(run)
    varied = replace(found, trials=tuple(replace(t, variation="far") for t in found.trials))
    with pytest.raises(MissingDependencyError, match="trials in Point have no images, because this world cannot"):
        _media([run], [varied], 2, ReportListener(say=said.append))
    assert said == []


def test_no_command_states_the_cause_of_a_failure_that_was_not_judged(follow, capfd):
    _, *evaluate, _ = COMMANDS.splitlines()
    folder, _ = follow([line.replace("--suite", "--trials 4 --workers 1 --suite") for line in evaluate])
    goes, noop = (diagnose_run(RunFolder.open(folder / "runs" / name)) for name in ("goes", "noop"))
    sides = [
        Side(d.policy, replace(d, trials=tuple(replace(t, variation="far") for t in d.trials))) for d in (goes, noop)
    ]
    result = compare(sides)
    assert {(g.measure, g.scope) for g in result.groups} == {
        ("success", "overall"), ("success", "point-left"), ("success", "point-right"), ("system", "overall"),
    }  # fmt: skip
    assert "In Point, only the end of each trial is judged, not the cause of a failure." in result.notes
    print_comparison(result)
    said = capfd.readouterr().out + json.dumps(result.to_json())
    assert "noop" in said
    assert not re.search("execution|reasoning|timeout", said)
    variations = rows_of(variation_table([side.diagnosis for side in sides]))
    assert [(row["reasoning"], row["execution"], row["system"]) for row in variations] == [("", "", "0")] * 4
    assert [row["k"] for row in variations] == ["4", "4", "0", "0"]
    printed = {(t["success"], t["kind"]) for d in (goes, noop) for t in d.to_json()["trials"]}
    assert printed == {(True, "none"), (False, None)}
    trials = rows_of(trial_table([goes, noop]))
    assert {(row["success"], row["label"], row["kind"]) for row in trials} == {
        ("true", "success", "none"), ("false", "timeout", ""),
    }  # fmt: skip
    (mode,) = (mode for mode in modes_of([noop]) if mode.label is Label.TIMEOUT)
    assert mode.definition == "The step limit was reached before the goal."


def rows_of(table):
    return list(csv.DictReader(io.StringIO(to_csv(table))))


def test_commands_for_own_scenes_say_that_they_serve_no_other_world(follow, capfd):
    (makes_a_record,) = (line for line in COMMANDS.splitlines() if line.endswith("--out runs/noop"))
    follow([f"{makes_a_record} --trials 1 --workers 1"])
    record, ours = "runs/noop/records/point-left/base/0.parquet", "betterbench's own scenes"
    task = f"task 'point-left': it is a task of Point, .*{ours} only.*fast_food"
    for words, message in (
        (["list", "tasks", "--suite", "point"], f"suite 'point': it is a suite of Point, .*{ours} only.*better60"),
        (["list", "tasks", "--tasks", "point-left"], task),
        (["show", "point-left"], task),
        (["replay", record, "--check"], task),
        (["replay", record], f"no MuJoCo model.*{ours} only"),
        (["view", record], f"no MuJoCo model.*{ours} only"),
    ):
        assert main([*words, "--task-file", "point.py"]) == 2
        assert re.search(message, " ".join(capfd.readouterr().err.split())), words
    assert main(["show", "fast_fod"]) == 2
    assert "Unknown task 'fast_fod'" in capfd.readouterr().err


def test_each_member_of_a_world_is_explained():
    for name in WorldFacts.__dataclass_fields__:
        assert f"`{name}`" in PAGE
    for name in (*Suite.__dataclass_fields__, *Trial.__dataclass_fields__, *PlanRequest.__dataclass_fields__):
        assert f"`{name}`" in PAGE
    for name in (*BareScene.__abstractmethods__, *inspect.signature(BareScene.__init__).parameters):
        assert name == "self" or f"`{name}`" in PAGE or f"`{name}(" in PAGE
    for name in vars(World):
        assert name.startswith("_") or name in ("facts", "name", "is_ready") or f"`{name}`" in PAGE


def test_the_named_test_passes_with_the_world_in_its_real_folder(tmp_path):
    (home,) = re.findall(r"folder with its name in `src/betterbench/(.*?)/`", " ".join(PAGE.split()))
    (named,) = re.findall(r"`(tests/\S+\.py)` tests all worlds", PAGE)
    checkout = copy_checkout(tmp_path, {f"src/betterbench/{home}/point/__init__.py": WORLD})
    names = "from betterbench.sim.worlds import world_names; print(world_names())"
    both = f"import sys, pytest; {names}; sys.exit(pytest.main(sys.argv[1:]))"
    said = run(checkout, "-c", both, "-q", "-p", "no:cacheprovider", named)
    assert "'point'" in said.splitlines()[0]
    assert "passed" in said
