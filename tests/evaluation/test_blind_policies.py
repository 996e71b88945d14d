"""A policy is told nothing of its trial but the instruction: not the task, the condition or the seed."""

from __future__ import annotations

import dataclasses
import json

import numpy as np
import pytest

from betterbench.evaluation import evaluate, make_plan, open_server
from betterbench.interface import episode_number
from betterbench.tasks import get_task
from betterbench.tasks.trial import Trial

CURIOUS = """
import dataclasses, json, pathlib
import numpy as np
from betterbench.interface import PolicyInfo

OUT = pathlib.Path(__file__).with_name("told.jsonl")


def plain(value, depth=0):
    if isinstance(value, np.ndarray):
        return [str(value.dtype), list(value.shape), value.tolist()]
    if isinstance(value, dict):
        return {str(key): plain(inner, depth + 1) for key, inner in value.items()}
    if isinstance(value, (str, int, float, bool, type(None))):
        return value
    if depth > 4:
        return repr(value)
    parts = {name: getattr(value, name) for name in dir(value) if not name.startswith("__")}
    parts = {name: plain(part, depth + 1) for name, part in parts.items() if not callable(part)}
    return {"repr": repr(value), **parts}


class Curious:
    info = PolicyInfo("curious", needs_images=False)

    def __getattr__(self, name):
        if name == "name_trial":
            note({"asked": name})
        raise AttributeError(name)

    def reset(self, start):
        note({"reset": plain(start)})

    def act(self, observation):
        if observation.step == 0:
            note({"act": plain(observation)})
        return np.tile([0, 0, 0, 0, 0, 0, -1.0], (400, 1))


def note(entry):
    with OUT.open("a") as stream:
        stream.write(json.dumps(entry) + "\\n")
"""


@pytest.fixture
def curious(tmp_path):
    (tmp_path / "curious.py").write_text(CURIOUS, encoding="utf-8")
    return tmp_path


def told(folder):
    """Returns everything that the policy was given, and forgets it."""
    file = folder / "told.jsonl"
    entries = [json.loads(line) for line in file.read_text(encoding="utf-8").splitlines()]
    file.unlink()
    return entries


def plan_of(policy, condition):
    plan = make_plan(policy, tasks=["fast_food"], trials=1, seed=40_321, observation="state_only", quality="fast")
    kept = tuple(t for t in plan.trials if (t.condition, t.seed) == (condition, 40_321))
    assert len(kept) == 1
    return dataclasses.replace(plan, trials=kept)


def shortened(trial, ordinary=Trial.resolve):
    """Resolves a trial to a task with a short step limit: what a policy is given is noted at its first question."""
    found = ordinary(trial)
    template = dataclasses.replace(found.task.template, base_steps=20, steps_per_subgoal=0, still_steps=20)
    return dataclasses.replace(found, task=dataclasses.replace(found.task, template=template))


@pytest.mark.parametrize("served", [False, True])
def test_two_conditions_differ_in_instruction_and_images_only(monkeypatch, curious, served):
    """Directly and through our own server, which is told no more than the policy."""
    monkeypatch.setattr(Trial, "resolve", shortened)
    address = f"python:{curious / 'curious.py'}:Curious"
    task = get_task("fast_food")
    base = task.variation("L1").base
    given = {}
    for condition in ("L1", base):
        if served:
            with open_server(address, port=0) as server:
                evaluate(plan_of(server.address, condition), curious / f"run-{condition}", workers=1)
        else:
            evaluate(plan_of(address, condition), curious / f"run-{condition}", workers=1)
        given[condition] = told(curious)
    texts = {name: json.dumps(entries) for name, entries in given.items()}
    for name, text in texts.items():
        assert "reset" in text
        assert "asked" not in text
        for secret in ("fast_food", "40321", "40_321", f'"{name}"', "condition", "seed", "variation", "expected"):
            assert secret not in text, secret
    resets = [[e["reset"] for e in entries if "reset" in e] for entries in given.values()]
    for (reset,) in resets:
        assert set(reset) == {"repr", "action_space", "episode", "instruction"}
        assert reset["episode"] == episode_number(40_321)
        for name in ("instruction", "repr"):
            del reset[name]
    assert resets[0] == resets[1]
    seen = [next(e["act"] for e in entries if "act" in e) for entries in given.values()]
    assert set(seen[0]) == set(seen[1])
    for name in set(seen[0]) - {"instruction", "repr", "images", "depth", "masks"}:
        assert seen[0][name] == seen[1][name], name


def test_episode_numbers_are_not_seeds_and_do_not_collide():
    numbers = [episode_number(seed) for seed in range(2000)]
    assert len(set(numbers)) == len(numbers)
    assert min(numbers) > len(numbers)
    assert 0 <= min(numbers) <= max(numbers) < 2**31
    steps = np.diff(numbers)
    assert len(np.unique(steps)) > 1900
