"""A run file says what the command line says: each option under its name, and what is typed counts more."""

from __future__ import annotations

import contextlib
import inspect
import json
import typing
from dataclasses import fields

import numpy as np
import pytest

from betterbench.cli.main import main
from betterbench.cli.run_file import RunFile, read_run_file, with_run_file
from betterbench.cli.verbs.evaluate import RayOptions, TrialOptions, evaluate_command
from betterbench.errors import BetterError
from betterbench.evaluation import make_plan
from betterbench.records import RunFolder

OF_THE_CALL = {"from", "json", "allow_other_versions", "allow_changed_policy", "trust"}
"""What is decided anew each time the command is given, and so stands in no file."""


@pytest.fixture
def run_file(tmp_path):
    def write(text):
        path = tmp_path / "run.yaml"
        path.write_text(text)
        return path

    return write


def test_every_option_that_describes_a_run_can_stand_in_a_file():
    parameters = inspect.signature(evaluate_command).parameters
    hints = typing.get_type_hints(evaluate_command, include_extras=True)
    names = {getattr(hints[p], "__metadata__", [p])[0] for p in parameters}
    options = {n if isinstance(n, str) else (n.name or "") for n in names} - {""}
    options |= {f.name for cls in (TrialOptions, RayOptions) for f in fields(cls)}
    assert {f.name for f in fields(RunFile)} == (options | {"task_file", "asset_dir"}) - OF_THE_CALL


def test_the_file_stands_for_the_words_of_a_command_line(run_file):
    path = run_file("policy: zoo:lexical\ntasks: [fast_food, tidy_desk]\nuntil-decided: yes\nuncertified: false\n")
    words = with_run_file(["--run-file", str(path), "--seed", "3"])
    assert words == [
        *("--policy", "zoo:lexical", "--tasks", "fast_food", "tidy_desk", "--until-decided", "--no-uncertified"),
        *("--seed", "3"),
    ]
    assert with_run_file([f"--run_file={path}"])[:2] == ["--policy", "zoo:lexical"]


@pytest.mark.parametrize("typed", [["--trials", "2"], ["--trials=2"], ["--no-until-decided"], ["--until-decided"]])
def test_what_is_typed_counts_instead_of_the_file(run_file, typed):
    path = run_file("trials: 9\nuntil_decided: true\n")
    words = with_run_file(["--run-file", str(path), *typed])
    assert words[-len(typed) :] == typed
    rest = words[: -len(typed)]
    assert ("9" in rest) == ("trials" not in typed[0])
    assert ("--until-decided" in rest) == ("decided" not in typed[0])


def test_the_plan_of_a_file_is_that_of_its_options(run_file, tmp_path, monkeypatch, capsys):
    path = run_file(f"policy: noop\nout: {tmp_path / 'run'}\ntasks: [fast_food]\ntrials: 3\nseed: 5\nquality: fast\n")
    started = lambda plan, out, **_: RunFolder.start(out, plan.to_json())  # noqa: E731
    monkeypatch.setattr("betterbench.cli.verbs.evaluate.run_with_bar", started)
    assert main(["eval", "--run-file", str(path), "--trials", "2"]) == 0
    run = RunFolder.open(tmp_path / "run")
    plan = make_plan("noop", tasks=["fast_food"], trials=2, seed=5, quality="fast").to_json()
    assert run.plan == json.loads(json.dumps(plan))
    assert str(run.path) in " ".join(capsys.readouterr().out.split())


@pytest.mark.parametrize("in_file", [True, False])
def test_a_tilde_is_the_home_folder_where_the_shell_does_not_replace_it(run_file, tmp_path, monkeypatch, in_file):
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    monkeypatch.chdir(tmp_path)
    started = lambda plan, out, **_: RunFolder.start(out, plan.to_json())  # noqa: E731
    monkeypatch.setattr("betterbench.cli.verbs.evaluate.run_with_bar", started)
    path = run_file("policy: noop\ntasks: [fast_food]\ntrials: 1\n" + ("out: ~/run\n" if in_file else ""))
    assert main(["eval", "--run-file", str(path), *([] if in_file else ["--out=~/run"])]) == 0
    assert RunFolder.open(tmp_path / "home/run").plan["policy"] == "noop"
    assert not (tmp_path / "~").exists()


@pytest.mark.parametrize(
    ("text", "wrong"),
    [
        ("", "contains no fields"),
        ("- policy: noop\n", "contains no fields"),
        ("policy: [\n", "is not YAML"),
        ("trails: 5\n", "Did you mean 'trials'"),
        ("json: true\n", "Unknown option"),
        ("trials: many\n", "trials: "),
        ("trials: 1\ntrials: 2\n", "trials is given twice (line 2)"),
        ("until-decided: true\nuntil_decided: true\n", "until_decided: the option occurs twice"),
        ("tasks: fast_food\n", "tasks: "),
        ("seed: 2026-01-01\n", "is not JSON"),
        ("policy_timeout: .inf\n", "policy_timeout"),
        ("a: &a [x]\ntasks: *a\n", "alias"),
        ("out: --json\n", "begins with a dash"),
        ("tasks: ['--json']\n", "begins with a dash"),
        ("policy: !!python/object/apply:os.getcwd []\n", "is not YAML"),
        ("seed: !!int ''\n", "is not YAML"),
        ("until_decided: !!bool x\n", "is not YAML"),
        ("seed: !!timestamp x\n", "is not YAML"),
        ("policy: " + "[" * 50_000, "nested too deep"),
        ("- " * 30_000, "nested too deep"),
        ("a:\n" + "".join(" " * i + "a:\n" for i in range(1, 300)), "nested too deep"),
        ("policy: " + "x" * 70_000, "is larger than"),
        ("engine: cloud\n", "engine: "),
        ("? [a]\n: 1\n", "is not YAML"),
    ],
)
def test_what_is_wrong_in_a_file_is_one_line_that_names_it(run_file, text, wrong, capsys):
    path = run_file(text)
    assert main(["eval", "--run-file", str(path)]) == 2
    err = " ".join(capsys.readouterr().err.split())
    assert wrong in err
    assert "run.yaml" in err.replace(" ", "")
    assert len(err) < 700
    assert "Traceback" not in err


@pytest.mark.parametrize("words", [["--run-file"], ["--run-file="], ["--run-file", "a", "--run-file", "b"]])
def test_exactly_one_file_is_named(words, capsys):
    assert main(["eval", *words]) == 2
    assert "--run-file:" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("policy: python:evil.py:Policy\n", "runs the Python code of evil.py:Policy"),
        ("policy: lerobot:evil\n", "loads the checkpoint evil"),
        ("policy: openpi://stranger:1?api_key_env=SECRET\n", "the environment variable SECRET"),
        ("policy: gr00t://stranger:1?api_token_env=SECRET\n", "the environment variable SECRET"),
        ("task_file: [evil.py]\n", "evil.py runs its Python code"),
    ],
)
def test_what_would_run_code_or_send_a_secret_needs_a_yes(run_file, text, shown, capsys):
    path = run_file(text)
    assert main(["eval", "--run-file", str(path)]) == 2
    err = " ".join(capsys.readouterr().err.split())
    assert shown in err
    assert "--trust" in err
    assert with_run_file(["--run-file", str(path), "--trust"])[-1] == "--trust"
    assert with_run_file(["--run-file", str(path), "--policy", "noop", "--task-file", "mine.py"])[0] == "--policy"


def test_a_damaged_file_is_read_or_refused(run_file):
    generator = np.random.default_rng(0)
    seed = b"policy: zoo:lexical\ntasks: [fast_food, tidy_desk]\ntrials: 20\nuntil_decided: yes\nseed: 0\n"
    for _ in range(100):
        data = bytearray(seed)
        for at in generator.integers(0, len(data), 4):
            data[at] = generator.integers(0, 256)
        path = run_file("")
        path.write_bytes(bytes(data))
        with contextlib.suppress(BetterError):
            read_run_file(path)
