"""A task and an asset in a user's own file: run, resumed, diagnosed, reported, and refused where that is not safe."""

from __future__ import annotations

import itertools
import json
import os
import re
from pathlib import Path

import pytest
from tests.prepared_process import COMMAND_LINE, OTHERS, prepared

PAGE = Path(__file__).parents[2] / "docs" / "own-tasks.md"
(MINE,) = re.findall(r"```py\n(.*?)```", PAGE.read_text(encoding="utf-8"), flags=re.DOTALL)
"""The file that the documentation shows."""


@pytest.fixture(scope="module")
def better():
    """Run the command in a process of its own: what a file registers stays there."""
    inherited = {key: value for key, value in os.environ.items() if key != "BETTERBENCH_TASK_FILES"}

    def run(*arguments, **environment):
        done = prepared(*COMMAND_LINE).run(
            *("-m", "betterbench.cli", *map(str, arguments)), env={**inherited, "COLUMNS": "1000", **environment}
        )
        return done.returncode, done.stdout, " ".join(done.stderr.split())

    return run


@pytest.fixture(scope="module")
def mine(tmp_path_factory):
    file = tmp_path_factory.mktemp("mine") / "my_tasks.py"
    file.write_text(MINE, encoding="utf-8")
    return file


EVAL = ("eval", "--policy", "expert", "--tasks", "my_coffee", "--trials", "1", "--uncertified")
EVAL += ("--variations", "L1", "--observation", "state_only")


@pytest.fixture(scope="module")
def run(better, mine):
    out = mine.parent / "run"
    status, printed, err = better(*EVAL, "--task-file", mine, "--workers", "1", "--out", out)
    assert status == 0, err
    assert f"better report {out} --task-file {mine}\n" in printed
    return out


def test_lists_show_the_users_names(better, mine):
    given, named = {"--task-file": mine}, {"BETTERBENCH_TASK_FILES": str(mine)}
    for what, name, arguments, environment in (
        ("tasks", "my_coffee", given, {}),
        ("tasks", "my_coffee", {}, named),
        ("variations", "my_coffee/L1", given, {}),
        ("assets", "enamel_mug", {}, named),
    ):
        _, out, _ = better("list", what, "--json", *itertools.chain(*arguments.items()), **environment)
        assert name in [row[what.removesuffix("s")] for row in json.loads(out)]


def test_the_run_knows_its_file_and_keeps_a_copy(run, mine):
    form = json.loads((run / "run.json").read_text())
    (planned,) = form["plan"]["task_files"]
    assert planned["name"] == "my_tasks.py"
    assert form["context"]["task_files"] == [{"path": str(mine), "sha256": planned["sha256"]}]
    assert [copy.read_text() for copy in (run / "task_files").iterdir()] == [MINE]


def test_every_trial_was_solved_and_the_run_is_resumed(better, run, mine):
    done = [json.loads(line) for line in (run / "journal.jsonl").read_text().splitlines()]
    trials = [line for line in done if "task" in line]
    assert {(t["task"], t["status"]) for t in trials} == {("my_coffee", "done")}
    first = trials[0]
    record = run / "records" / first["task"] / first["condition"] / f"{first['seed']}.parquet"
    before = record.read_bytes()
    lines = (run / "journal.jsonl").read_text().splitlines()
    kept = [line for line in lines if line != lines[-1]]
    (run / "journal.jsonl").write_text("\n".join(kept) + "\n")
    status, out, err = better(*EVAL, "--task-file", mine, "--workers", "1", "--out", run, "--json")
    assert status == 0, err
    counts = json.loads(out)
    assert counts["variations"]["k"] == counts["variations"]["n"] == 1
    assert counts["training"]["k"] == counts["training"]["n"]
    assert len((run / "journal.jsonl").read_text().splitlines()) == len(lines)
    assert record.read_bytes() == before


def test_diagnosis_and_report_want_the_file(better, run, mine, tmp_path):
    for arguments in (("diagnose", run), ("report", run, "--films", "0"), ("compare", run, tmp_path)):
        status, _, err = better(*arguments)
        assert status == 2
        assert "my_tasks.py (sha256 " in err
        assert "not executed automatically" in err
        assert str(run / "task_files") in err
    (copy,) = (run / "task_files").iterdir()
    for file in (mine, copy):
        status, out, err = better("diagnose", run, "--json", "--task-file", file)
        assert status == 0, err
        assert {t["label"] for t in json.loads(out)["trials"]} == {"success"}
    status, _, err = better("report", run, "--films", "0", "--out", tmp_path, "--task-file", copy)
    assert status == 0, err
    assert "My Coffee" in (tmp_path / "index.html").read_text()


def test_another_text_is_another_file(better, run, tmp_path):
    changed = tmp_path / "my_tasks.py"
    changed.write_text(MINE + "\n# changed\n", encoding="utf-8")
    status, _, err = better("diagnose", run, "--task-file", changed)
    assert status == 2
    assert "which is not loaded" in err
    status, _, err = better(*EVAL, "--task-file", changed, "--out", run)
    assert status == 2


def test_a_replay_is_the_same_bit_for_bit(better, run, mine):
    record = next((run / "records").rglob("*.parquet"))
    status, out, err = better("replay", record, "--check", "--json", "--task-file", mine)
    assert status == 0, err
    assert json.loads(out)["identical"] is True


def test_without_a_certificate_the_error_names_both_cures(better, mine, tmp_path):
    arguments = ("eval", "--policy", "expert", "--tasks", "my_coffee", "--trials", "1", "--out", tmp_path / "run")
    status, _, err = better(*arguments, "--task-file", mine)
    assert status == 2
    assert f"better certify --task-file {mine} --tasks my_coffee" in err
    assert "--uncertified" in err


def test_a_certificate_wants_measured_demonstrations(better, mine, tmp_path):
    chosen = ("--task-file", mine, "--tasks", "my_coffee")
    status, _, err = better("certify", *chosen, "--trials", "1", "--workers", "1", "--out", tmp_path / "certificate")
    assert status == 2
    assert "demonstrations of my_coffee have not been measured" in err
    assert f"better certify --task-file {mine} --tasks my_coffee --demonstrations 120." in err


@pytest.mark.slow
def test_the_cure_works(better, tmp_path):
    mine = tmp_path / "my_tasks.py"
    mine.write_text(MINE.replace("base.variations[:1]", "(base.variations[0], base.variations[-1])"), encoding="utf-8")
    chosen = ("--task-file", mine, "--tasks", "my_coffee", "--trials", "1")
    measured = ("--task-file", mine, "--tasks", "my_coffee", "--demonstrations", "8")
    status, out, err = better("certify", *measured, "--workers", "2", "--out", tmp_path / "certificate")
    assert status == 0, err
    assert "my_coffee: 8 demonstrations" in out
    assert set(json.loads((tmp_path / "my_tasks.demonstrations.json").read_text())["tasks"]) == {"my_coffee"}
    status, _, err = better("certify", *chosen, "--workers", "2", "--out", tmp_path / "certificate")
    assert status == 0, err
    certificate = ("--certificate", tmp_path / "certificate")
    status, _, err = better("eval", "--policy", "expert", *chosen, *certificate, "--out", tmp_path / "run")
    assert status == 0, err
    (copy,) = (tmp_path / "run" / "task_files").glob("*.demonstrations.json")
    assert copy.read_bytes() == (tmp_path / "my_tasks.demonstrations.json").read_bytes()
    record = tmp_path / "run" / "records" / "my_coffee" / "T1" / "0.parquet"
    script = next((tmp_path / "run" / "task_files").glob("*.py"))
    status, out, err = better("replay", record, "--check", "--json", "--task-file", script)
    assert status == 0, err
    assert json.loads(out)["identical"] is True


REMOTE = """
import pathlib, sys
from betterbench.evaluation.ray_engine.remote_worker import RemoteWorker
from betterbench.evaluation.trials.trial import WorkerSettings
from betterbench.tasks.user_files import TaskFile

source, run = (pathlib.Path(name).read_text() for name in sys.argv[1:])
file = TaskFile("/on/another/machine/my_tasks.py", source)
settings = WorkerSettings(
    "unused", "expert", "ee_delta", "default", "standard", "panda", task_files=(file,)
)
worker = RemoteWorker(settings, run.encode(), ())
print("problem" in worker.prepare({}))
worker.close()
"""


def test_a_worker_on_another_machine_needs_no_file(run, mine):
    environment = {key: value for key, value in os.environ.items() if key != "BETTERBENCH_TASK_FILES"}
    done = prepared(*COMMAND_LINE).run("-c", REMOTE, str(mine), str(run / "run.json"), env=environment)
    assert done.stdout.strip() == "False", done.stderr


ERRORS = {
    "syntax": ("x = 1\nx = = 2\n", ", line 2: SyntaxError: invalid syntax."),
    "import": ("\nimport no_such_module\n", ", line 2: ModuleNotFoundError: No module named 'no_such_module'."),
    "build": (MINE.replace('get_task("morning_coffee")', "1 / 0"), ": ZeroDivisionError: division by zero."),
    "unknown": (MINE.replace('get_task("morning_coffee")', 'get_task("morning_cofee")'), "Did you mean 'morning_"),
    "built in": (MINE.replace("def my_coffee", "def fast_food"), "task 'fast_food': "),
    "asset": (MINE.replace('"enamel_mug", colors', '"mug", colors'), "asset 'mug': "),
}


@pytest.mark.parametrize("name", ERRORS)
def test_an_error_in_the_file_is_one_line_with_its_place(better, name, tmp_path):
    source, text = ERRORS[name]
    file = tmp_path / "wrong.py"
    file.write_text(source, encoding="utf-8")
    status, out, err = better("list", "tasks", "--task-file", file)
    assert (status, out) == (2, "")
    assert err.startswith("error: ")
    assert "Traceback" not in err
    assert str(file) in err
    assert text in err


def test_a_name_in_two_files_names_both(better, mine, tmp_path):
    other = tmp_path / "other.py"
    other.write_text(MINE + "\n# other\n", encoding="utf-8")
    status, _, err = better("list", "tasks", "--task-file", mine, "--task-file", other)
    assert status == 2
    assert str(mine) in err
    assert str(other) in err
    status, _, _ = better("list", "tasks", "--task-file", mine, "--task-file", mine)
    assert status == 0


def test_a_missing_file_is_named(better, tmp_path):
    status, _, err = better("list", "tasks", "--task-file", tmp_path / "nowhere.py")
    assert status == 2
    assert "nowhere.py" in err


def test_an_installed_package_adds_its_tasks(better, tmp_path):
    (tmp_path / "enamel.py").write_text(MINE, encoding="utf-8")
    info = tmp_path / "enamel-1.2.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: enamel\nVersion: 1.2\n")
    (info / "entry_points.txt").write_text("[betterbench.plugins]\nmugs = enamel\n")
    path = os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")])
    out = tmp_path / "run"
    command = ("-m", "betterbench.cli", *EVAL, "--workers", "1", "--out", str(out))
    environment = {key: value for key, value in os.environ.items() if key != "BETTERBENCH_TASK_FILES"}
    done = prepared(*OTHERS).run(*command, env={**environment, "PYTHONPATH": path})
    assert done.returncode == 0, done.stderr
    assert json.loads((out / "run.json").read_text())["plan"]["plugins"] == [{"name": "enamel", "version": "1.2"}]
    status, _, err = better("diagnose", out)
    assert status == 2
    assert "the package enamel 1.2, which is not installed" in err


def test_gymnasium_makes_the_users_task(mine):
    code = (
        "import gymnasium; env = gymnasium.make('betterbench:BeTTER/MyCoffee-v0', observation='state_only');"
        "env.reset(seed=0); env.close(); print(env.spec.id)"
    )
    environment = {**os.environ, "BETTERBENCH_TASK_FILES": str(mine)}
    done = prepared(*OTHERS).run("-c", code, env=environment)
    assert done.stdout.strip() == "BeTTER/MyCoffee-v0", done.stderr
