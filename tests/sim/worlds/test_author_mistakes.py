"""Mistakes of an author in a world's file: each is one error that names the file, the line and the remedy."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from betterbench.cli.main import main
from betterbench.errors import InvalidInputError, UnknownNameError
from betterbench.evaluation.planning.world_plan import make_world_plan
from betterbench.sim.worlds.registry import forget_world
from betterbench.tasks import user_files

ROOT = Path(__file__).parents[3]
WORLD = re.findall(r"```python\n(.*?)```", (ROOT / "docs" / "adding-a-world.md").read_text(), flags=re.DOTALL)[0]


@pytest.fixture
def load(tmp_path, monkeypatch):
    """Loads the world of the page after some of its text was replaced."""
    monkeypatch.setattr(user_files, "_files", {})
    monkeypatch.setattr(user_files, "_origins", dict(user_files._origins))
    monkeypatch.setattr(user_files, "_makers", dict(user_files._makers))
    monkeypatch.setenv(user_files.VARIABLE, "")
    monkeypatch.chdir(tmp_path)

    def loaded(*changes):
        text = WORLD
        for old, new in changes:
            assert text.count(old) == 1
            text = text.replace(old, new)
        path = tmp_path / "point.py"
        path.write_text(text, encoding="utf-8")
        user_files.load_task_files([path])
        return path

    yield loaded
    forget_world("point")


def test_a_misspelt_task_is_unknown_in_the_example_of_the_page(load):
    load()
    for tasks in (["point-lef"], ["point-left", "point-rihgt"]):
        with pytest.raises(UnknownNameError, match=rf"task '{tasks[-1]}'.*Did you mean 'point-.*Known: point-left"):
            make_world_plan("noop", suite="point", tasks=tasks)
    planned = make_world_plan("noop", suite="point", tasks=["point-right"], trials=2)
    assert {t.task for t in planned.trials} == {"point-right"}


def test_variations_are_not_chosen_in_another_world_and_the_message_says_what_is(load, capfd):
    path = load()
    words = ["--task-file", str(path), "--suite", "point", "--policy", "noop", "--out", "run"]
    assert main(["eval", *words, "--variations", "L1"]) == 2
    said = " ".join(capfd.readouterr().err.split())
    assert "--variations: the option applies only to betterbench's own scenes, not to the suite point." in said
    assert "Leave out --variations, and choose trials with --tasks, --trials and --seed." in said
    assert not Path("run").exists()


LAX = ("tasks = asked.chosen(SIDES)", "tasks = [task for task in SIDES if not asked.tasks or task in asked.tasks]")


def test_a_world_that_plans_no_trial_is_told_so(load):
    load(LAX)
    with pytest.raises(UnknownNameError, match=r"task 'point-purple'.*Known: point-left, point-right"):
        make_world_plan("noop", suite="point", tasks=["point-purple"])
    with pytest.raises(InvalidInputError, match=r"'point'.*no trial"):
        make_world_plan("noop", suite="point", trials=0)


def test_a_plan_of_another_form_names_the_file_and_what_it_must_return(load):
    path = load(("return tuple(trials), self", "return tuple(trials)"))
    with pytest.raises(InvalidInputError, match=rf"{re.escape(str(path))}.*plan.*must return .trials, world."):
        make_world_plan("noop", suite="point")


def test_an_error_in_a_plan_names_the_file_and_the_line(load):
    path = load(("tasks = asked.chosen(SIDES)", "tasks = asked.tsaks"))
    with pytest.raises(InvalidInputError, match=rf"{re.escape(str(path))}, line \d+: AttributeError: .*tsaks"):
        make_world_plan("noop", suite="point")


def test_the_next_command_loads_the_file_of_the_world(load, capfd):
    path = load()
    words = ["--task-file", str(path), "--suite", "point", "--tasks", "point-left", "--trials", "1"]
    assert main(["eval", *words, "--policy", "noop", "--out", "run"]) == 0
    (following,) = re.findall(r"^next +(.*)$", capfd.readouterr().out, flags=re.MULTILINE)
    assert following.endswith(f"report {path.parent / 'run'} --task-file {path}")


SUITE = re.search(r"Suite\(\n.*?\n +\)", WORLD, re.DOTALL).group()


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("register_world(PointWorld())", "register_world(PointWorld)", r"PointWorld: this is a class.*PointWorld\(\)"),
        ('title="Point",', 'title="Point", reading="outcome",', "Unknown reading 'outcome'.*Did you mean 'outcomes'"),
        ("    facts: ClassVar = WorldFacts(", "    facts: ClassVar = dict(", "'point'|facts.*WorldFacts"),
        (SUITE, SUITE.replace('base="point"', 'base="boat"'), "suite 'point'.*base.*'boat'"),
        (SUITE, SUITE.replace('name="point", base="point"', 'name="dot", base="point"'), "suite 'point'.*key.*'dot'"),
        (SUITE, '"a mark on the left"', "suite 'point'.*a str.*Suite"),
    ],
)  # fmt: skip
def test_a_mistake_in_the_facts_is_one_error_with_file_and_line(load, old, new, message):
    with pytest.raises(InvalidInputError, match=rf"point\.py, line \d+: .*(?:{message})"):
        load((old, new))


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('"succeed"', '"success"', "expected='success'.*'succeed'"),
        ('task=task, condition="base"', 'task=task[2:], condition="base"', "'int-left'.*does not begin with.*'point'"),
        ("return tuple(trials), self", 'return ("left",), self', "not a tuple of Trial"),
    ],
)
def test_a_trial_of_a_wrong_form_is_refused_before_the_run(load, old, new, message):
    load((old, new))
    with pytest.raises(InvalidInputError, match=message):
        make_world_plan("noop", suite="point")


WHOLE = """    def relations(self):
        \"\"\"Return whether the gripper is at the mark.\"\"\"
"""


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('return {"at(hand, mark)": bool(', "return (bool(", None),
        (WHOLE, WHOLE.replace("relations", "relation"), r"abstract.*relation.* \(point\.py, line \d+, in open_"),
        ("self.hand = np.zeros(3)", "self.hand = np.zeros(2)", r"\.start: self\.hand has shape \(2,\).*\(3,\)"),
        ("self.hand = np.zeros(3)", "self.hant = np.zeros(3)", r"PointScene\.start: self\.hand is missing.*\(3,\)"),
        ("away_m, 0.0]])", "away_m, 0.0]] * 2)", r"start: self\.positions has shape \(2, 3\).*\(1, 3\)"),
        ("away_m, 0.0]])", "away_m, np.nan]])", r"start: self\.positions.*finite"),
        ("self.task.id, self.seed", "self.tusk.id, self.seed", r"AttributeError.*tusk.*point\.py, line \d+, in start"),
    ],
)  # fmt: skip
def test_a_mistake_in_the_scene_is_the_message_of_its_trial(load, capfd, old, new, message):
    if message is None:  # the closing brace goes as well
        new_text = "return bool(np.linalg.norm(self.hand - self.positions[0]) < 0.03)"
        old, new = re.search(r"return \{\"at\(hand.*\}", WORLD).group(), new_text
        message = r"PointScene\.relations: it returned False.*dict"
    path = load((old, new))
    words = ["--task-file", str(path), "--suite", "point", "--tasks", "point-left", "--trials", "1"]
    assert main(["eval", *words, "--policy", "noop", "--out", "run"]) == 2
    assert re.search(message, " ".join(capfd.readouterr().err.split()))
