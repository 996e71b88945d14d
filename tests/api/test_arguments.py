"""A wrong argument of a public function is an error that names the argument, the value and the types to use."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import betterbench
from betterbench.errors import InvalidInputError, UnknownNameError

PLAN = {"tasks": ["morning_coffee"], "variations": ["L1"], "trials": 1, "observation": "state_only"}


def evaluate(**changes):
    return betterbench.evaluate("noop", **{**PLAN, "out": "run", **changes})


def plan(**changes):
    return betterbench.make_plan("mine", **{**PLAN, **changes})


@pytest.mark.parametrize(
    ("call", "text"),
    [
        (lambda: evaluate(tasks=None), "tasks: it is None. Use text or a list of texts."),
        (lambda: evaluate(tasks=["fast_food", 3]), "tasks[1]: 3 is of type int. Use text."),
        (lambda: evaluate(tasks={"fast_food"}), "tasks: {'fast_food'} is of type set. Use text or a list of texts."),
        (lambda: evaluate(tasks=b"fast_food"), "tasks: b'fast_food' is of type bytes. Use text or a list of texts."),
        (lambda: evaluate(trials="3"), "trials: '3' is of type str. Use a whole number."),
        (lambda: evaluate(trials=np.float64(3)), "trials: np.float64(3.0) is of type float64. Use a whole number."),
        (lambda: evaluate(trials=True), "trials: True is of type bool. Use a whole number."),
        (lambda: evaluate(workers=1.5), "workers: 1.5 is of type float. Use a whole number or None."),
        (lambda: evaluate(uncertified="no"), "uncertified: 'no' is of type str. Use True or False."),
        (lambda: evaluate(policy_timeout_s="9"), "policy_timeout_s: '9' is of type str. Use a number."),
        (lambda: evaluate(on_progress=3), "on_progress: 3 is of type int. Use a function or None."),
        (lambda: evaluate(out=3), "out: 3 is of type int. Use a path or text or None."),
        (lambda: betterbench.evaluate("noop", "fast_food"), "evaluate(): too many positional arguments."),
        (lambda: plan(seed=None), "seed: it is None. Use a whole number."),
        (lambda: betterbench.make_plan(None), "policy: it is None. Use text."),
        (lambda: betterbench.ExternalRun("mine", "run"), "plan: 'mine' is of type str. Use a Plan."),
        (lambda: betterbench.ExternalRun(plan(), None), "out: it is None. Use a path or text."),
        (lambda: betterbench.load_run(["run"]), "path: ['run'] is of type list. Use a path or text."),
        (lambda: betterbench.diagnose(3), "run: 3 is of type int. Use a RunFolder or a path or text."),
        (lambda: betterbench.compare(["a", "b"]), "runs[0]: ['a', 'b'] is of type list. Use a RunFolder or a path"),
        (lambda: betterbench.write_report("run", films=1.5), "films: 1.5 is of type float. Use a whole number."),
        (lambda: betterbench.make_env(3), "task: 3 is of type int. Use text."),
        (lambda: betterbench.load_task_files(3), "paths: 3 is of type int. Use a path or text or a list of paths or"),
        (lambda: betterbench.load_asset_folders([3]), "folders[0]: 3 is of type int. Use a path or text."),
    ],
)
def test_a_wrong_type_is_named(call, text, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InvalidInputError) as caught:
        call()
    assert str(caught.value).startswith(text)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("call", "closest"),
    [
        (lambda: evaluate(trails=3), "trials"),
        (lambda: betterbench.make_env("fast_food", variaton="T1"), "variation"),
        (lambda: betterbench.ExternalRun(plan(), "run", need_images=False), "needs_images"),
    ],
)
def test_a_misspelt_argument_is_answered_with_the_closest_one(call, closest):
    with pytest.raises(UnknownNameError, match="Unknown argument of") as caught:
        call()
    assert caught.value.closest[0] == closest


def test_numbers_of_numpy_and_single_texts_are_accepted():
    given = plan(tasks="morning_coffee", variations="L1", trials=np.int64(1), seed=np.uint8(3), until_decided=np.False_)
    assert given.trials == plan(tasks=(name for name in ["morning_coffee"]), seed=3).trials


def test_paths_are_texts_or_paths_and_may_begin_with_the_home_folder(tmp_path, monkeypatch):
    monkeypatch.setenv("HOME", str(tmp_path))
    for out in ("~/run", Path("~/run"), str(tmp_path / "run")):
        with betterbench.ExternalRun(plan(), out) as run:
            assert run.folder.path == tmp_path / "run"
    assert betterbench.load_run("~/run").plan["policy"] == "mine"
