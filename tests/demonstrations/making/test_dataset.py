"""Training sets: proven from records, counted, split by seed, and made again to the same bytes."""

from __future__ import annotations

import json
import os
import shlex
import signal
import subprocess
import sys
import time
from dataclasses import replace

import numpy as np
import pytest
from rich import filesize

from betterbench.cli.main import main
from betterbench.cli.verbs import dataset as verb
from betterbench.demonstrations.export.job import validation_seeds
from betterbench.demonstrations.sets.build import make_dataset
from betterbench.demonstrations.sets.numbers import STATE, SetNumbers
from betterbench.demonstrations.sets.pairs import shared_rows
from betterbench.demonstrations.sets.proof import RegimeBounds, proven_facts
from betterbench.demonstrations.sets.recipe import SetRecipe, keep_recipe, read_recipe
from betterbench.demonstrations.shortcuts.shown import conditions_shown, every_condition
from betterbench.errors import InvalidInputError, RecordError, RunConflictError
from betterbench.records import RunFolder
from betterbench.records.twins import read_pairs
from betterbench.tasks import get_task

pytestmark = pytest.mark.physics
TASK = "morning_coffee"


def test_a_record_shows_its_own_condition_and_no_other(sources, amplified):
    for run in (sources, amplified):
        for record in run.records():
            shown = conditions_shown(record, every_condition(get_task(TASK)))
            assert [c.name for c in shown] == [record.metadata.condition]


def test_what_a_demonstration_shows_is_told_from_its_states(amplified):
    bounds = RegimeBounds.of(get_task(TASK), "training")
    for record in amplified.records():
        facts = proven_facts(record, bounds, "record")
        condition = get_task(TASK).train(record.metadata.condition)
        goal = condition.instruction.subgoals[0]
        (mug,) = condition.resolve(goal.reference)
        assert facts.steps[0].word == goal.word
        assert facts.steps[0].origin == condition.layout[mug]
        assert facts.instruction == condition.instruction.text


def test_what_is_outside_the_regime_is_refused_in_one_line(sources):
    record = next(sources.records())
    bounds = RegimeBounds.of(get_task(TASK), "training")
    meta = record.metadata
    own = next(c for c in bounds.shown if c.name == meta.condition)
    for other, problem in (
        (replace(record, metadata=replace(meta, seed=3)), "its seed 3 is a test seed"),
        (replace(record, outcome=replace(record.outcome, success=False)), "it did not succeed"),
        (replace(record, metadata=replace(meta, instruction="Wave.")), "its initial state or instruction differs"),
        (replace(record, metadata=replace(meta, condition="train9")), "its initial state or instruction differs"),
    ):
        with pytest.raises(RecordError, match=problem):
            proven_facts(other, bounds, "record")
    with pytest.raises(RecordError, match=f"it demonstrates the test condition {own.id}"):
        proven_facts(record, replace(bounds, forbidden=(own,)), "record")
    tests = RegimeBounds.of(get_task(TASK), "balanced").forbidden
    assert {c.name for c in tests} == {v.name for v in get_task(TASK).variations}


def test_statistics_are_those_of_the_training_frames(sources):
    records = {record.metadata.seed: record for record in sources.records()}
    held_out = next(iter(records))
    numbers = SetNumbers(frozenset({held_out}))
    for entry in sources.entries():
        numbers.add(entry.key, records[entry.seed])
    found = numbers.statistics()
    kept = [r for seed, r in records.items() if seed != held_out]
    actions = np.concatenate([r.action[1:] for r in kept])
    assert np.allclose(found["action"]["mean"], actions.mean(axis=0), atol=1e-7)
    assert np.allclose(found["action"]["max"], actions.max(axis=0), atol=1e-7)
    widths = np.concatenate([r.finger_width[:-1] for r in kept])
    assert np.allclose(found["state"]["std"][STATE.index("finger_width_m")], widths.std(), atol=1e-7)
    counts = numbers.counts()
    assert sum(c.demonstrations for c in counts) == len(records)
    assert sum(c.validation for c in counts) == 1
    assert numbers.steps == sum(r.n_steps for r in records.values())


def test_the_split_is_by_seed_and_does_not_depend_on_the_order():
    seeds = set(range(1_000_000, 1_000_100))
    held_out = validation_seeds(seeds, 0.1)
    assert len(held_out) == 10
    assert held_out == validation_seeds({*range(1_000_099, 999_999, -1)}, 0.1)
    assert validation_seeds(seeds, 0.0) == set()


def test_rows_are_shared_up_to_the_first_that_differs(sources):
    record = next(sources.records())
    assert shared_rows(record, record) == len(record)
    action = np.array(record.action)
    action[17, 0] += 1e-9
    assert shared_rows(record, replace(record, action=action)) == 17


def test_the_printed_command_is_the_recipe(monkeypatch, tmp_path):
    caught = []

    def caught_recipe(recipe, *_, **__):
        caught.append(recipe)
        raise InvalidInputError("here", "it stops", "Go on")

    monkeypatch.setattr("betterbench.demonstrations.sets.build.make_dataset", caught_recipe)
    monkeypatch.setattr("betterbench.cli.verbs.evaluate.prepare_robot", lambda *_: None)
    for recipe in (
        SetRecipe(("fruit_lunch", "fast_food"), "balanced", 20, 3, 1_000_500, 0.05, 0.2),
        SetRecipe(("morning_coffee",), pairs=True),
    ):
        words = shlex.split(recipe.command("0" * 64, out=str(tmp_path / "set")))
        assert main(words[1:]) == 2
        assert caught.pop() == recipe
    assert verb.dataset_command.__doc__


def test_a_folder_holds_one_recipe_which_may_grow(tmp_path):
    recipe = SetRecipe((TASK,), demos=5)
    keep_recipe(recipe, tmp_path / "set")
    keep_recipe(replace(recipe, demos=7), tmp_path / "set")
    assert read_recipe(tmp_path / "set").demos == 7
    with pytest.raises(
        RunConflictError, match=r"recipe\.regime is .*training.* in the folder but .*balanced.* in the request"
    ):
        keep_recipe(replace(recipe, demos=7, regime="balanced"), tmp_path / "set")
    with pytest.raises(InvalidInputError, match="--validation"):
        replace(recipe, validation=1.0).check()
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "file").touch()
    with pytest.raises(RunConflictError, match="contains other files"):
        keep_recipe(recipe, tmp_path / "other")


def files_of(path):
    """The bytes of everything that a set promises: records and what is derived from them."""
    kept = [*path.glob("*.json"), path / "README.md", *path.glob("demonstrations/records/*/*/*.parquet")]
    kept += path.glob("demonstrations/pairs.jsonl")
    return {str(p.relative_to(path)): p.read_bytes() for p in kept}


@pytest.mark.slow
def test_killed_and_resumed_makes_the_same_bytes(tmp_path):
    undisturbed = make_dataset(SetRecipe((TASK,), demos=1, sources=1), tmp_path / "a", pictures=False)
    words = shlex.split(undisturbed.command.replace("DATASET", str(tmp_path / "b")))
    command = [sys.executable, "-m", "betterbench.cli", *words[1:], "--no-pictures", "--workers", "2"]
    for delay in (5.0, 10.0, 20.0):
        process = subprocess.Popen(command, start_new_session=True, stdout=subprocess.DEVNULL)
        time.sleep(delay)
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert files_of(tmp_path / "a") == files_of(tmp_path / "b")
    document = json.loads((tmp_path / "a" / "dataset.json").read_text())
    assert document["sha256"] == undisturbed.sha256
    wrong = subprocess.run(
        [*command[:-5], "--expect", "0" * 64, "--no-pictures"], capture_output=True, text=True, check=False
    )
    assert wrong.returncode == 2
    assert "the set has a different hash" in wrong.stderr
    smaller = files_of(tmp_path / "a")
    grown = make_dataset(SetRecipe((TASK,), demos=2, sources=1), tmp_path / "a", pictures=False)
    assert grown.demonstrations == 2 * undisturbed.demonstrations
    variety = json.loads((tmp_path / "a" / "dataset.json").read_text())["variety"]
    assert [t["task"] for t in variety["set"]] == [TASK]
    assert variety["set"][0]["spread"]["height_cm"] > 0.5
    assert variety["sources"] == []  # one of each condition
    assert f"| {TASK} | set |" in (tmp_path / "a" / "README.md").read_text()
    larger = files_of(tmp_path / "a")
    assert all(larger[name] == data for name, data in smaller.items() if name.endswith(".parquet"))


@pytest.mark.slow
def test_twins_share_their_history_until_the_instruction_makes_them_differ(tmp_path, capsys):
    made = make_dataset(SetRecipe(("fruit_lunch",), demos=2, pairs=True), tmp_path / "set", pictures=False)
    assert made.pairs
    for pair in made.pairs:
        assert pair.instructions[0] != pair.instructions[1]
        assert 0.3 * min(pair.rows) < pair.shared_rows < min(pair.rows)  # the apple comes first in both
    assert read_pairs(RunFolder.open(tmp_path / "set" / "demonstrations")) == made.pairs
    *_, seal = (tmp_path / "set" / "demonstrations" / "pairs.jsonl").read_text().splitlines()
    assert json.loads(seal).keys() == {"seal"}
    verb._tell(made, 75.5, as_json=True)
    document = json.loads(capsys.readouterr().out)
    assert document["seconds"] == 75.5
    assert document["bytes"] == sum(f.stat().st_size for f in made.path.rglob("*") if f.is_file())
    verb._tell(made, 3675.5, as_json=False)
    assert f"{filesize.decimal(document['bytes'])} on disk, 1:01:15 in this session" in capsys.readouterr().out


@pytest.mark.slow
def test_leaving_things_alone_is_demonstrated_and_carried_over(tmp_path):
    made = make_dataset(SetRecipe(("fruit_lunch",), "covered", 1, 1), tmp_path / "set", pictures=False)
    assert made.demonstrations == 6
    assert made.missing == 0
    entries = {entry.condition for entry in RunFolder.open(tmp_path / "set" / "demonstrations").entries()}
    assert entries == {"L1", "R1", "O1", "O2", "T1", "T2"}
