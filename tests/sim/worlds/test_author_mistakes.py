"""Mistakes of an author in a world's file: each is one error that names the file, the line and the remedy."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from betterbench.cli.main import main
from betterbench.diagnosis import diagnose_run
from betterbench.errors import InvalidInputError, RecordError, UnknownNameError
from betterbench.evaluation.planning.world_plan import make_world_plan
from betterbench.records import RunFolder
from betterbench.sim.worlds.registry import forget_world
from betterbench.tasks import user_files

ROOT = Path(__file__).parents[3]
PAGE = (ROOT / "docs" / "adding-a-world.md").read_text(encoding="utf-8")
WORLD, _, SEEING = re.findall(r"```python\n(.*?)```", PAGE, flags=re.DOTALL)


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


def test_the_advice_for_a_run_of_chains_loads_the_file_of_the_world(load):
    path = load(('title="Point",', 'title="Point", reading="chains",'))
    plan = make_world_plan("noop", suite="point")
    run = RunFolder.start(Path("run"), plan.to_json())
    with pytest.raises(RecordError, match=rf"Run `better compare \S+ --task-file {re.escape(str(path))}` for the five"):
        diagnose_run(run)


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
        ('{"default": "state_only",', '{"default": "defualt",', "observation preset 'defualt'.*Did you mean 'default'"),
        ("    def plan(", '    action_spaces: ClassVar = ("ee_dleta",)\n\n    def plan(',
         "action space 'ee_dleta'.*Did you mean 'ee_delta'"),
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


@pytest.mark.parametrize("base", ['"bas"', "None"])
def test_the_base_condition_of_a_variation_is_a_training_condition(load, base):
    varied = f'[replace(t, condition="far", variation="far", base_condition={base}) for t in trials]'
    path = load(
        ("from dataclasses import dataclass", "from dataclasses import dataclass, replace"),
        ("return tuple(trials), self", f"return (*trials, *{varied}), self"),
    )
    found = rf"base_condition \(a training condition of point-left\) '{base.strip(chr(34))}'.*Known: base"
    with pytest.raises(InvalidInputError, match=rf"{re.escape(str(path))}: Unknown {found}"):
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
        (" < 0.03)}", " < 0.03) or None}",
         r"PointScene\.relations \(point\.py, line \d+\): the value of 'at\(hand, mark\)' is None.*True or False"),
        (" < 0.03)}", " < 0.03)} if self._step > 99 else {}",
         r"PointScene\.relations .*it returned \{\}.*True or False"),
        (" < 0.03)}", " < 0.03)} if self._step < 1 else {'near': True}",
         r"PointScene\.relations .*it returned the relations \('near',\), but at the start \('at\(.*Return the same"),
        ("self.hand = np.zeros(3)", "self.hand = np.random.default_rng().uniform(size=3)",
         r"PointScene\.start \(point\.py, line \d+\): two starts of one trial differ.*stream\("),
        ("return PointScene(", "PointScene(", r"PointWorld\.open_scene \(point\.py, line \d+\): it returned None"),
        ("self.task.id, self.seed", "self.tusk.id, self.seed", r"AttributeError.*tusk.*point\.py, line \d+, in start"),
    ],
)  # fmt: skip
def test_a_mistake_in_the_scene_is_the_message_of_its_trial(load, capfd, old, new, message):
    if message is None:  # the closing brace goes as well
        new_text = "return bool(np.linalg.norm(self.hand - self.positions[0]) < 0.03)"
        old, new = re.search(r"return \{\"at\(hand.*\}", WORLD).group(), new_text
        message = r"PointScene\.relations \(point\.py, line \d+\): it returned False.*dict"
    path = load((old, new))
    words = ["--task-file", str(path), "--suite", "point", "--tasks", "point-left", "--trials", "1"]
    assert main(["eval", *words, "--policy", "noop", "--out", "run"]) == 2
    assert re.search(message, " ".join(capfd.readouterr().err.split()))


VIEWS = """
    def views(self, spec, renderers):
        \"\"\"Return the images.\"\"\"
        from betterbench.sim.worlds.authoring import Images

        return RETURNED


@dataclass(frozen=True, slots=True)
class PointWorld(World):"""
LOOKS = """
import numpy as np

from betterbench import PolicyInfo


class Looks:
    info = PolicyInfo("looks", action_space="ee_delta")

    def reset(self, start):
        pass

    def act(self, observation):
        y = 0.5 if observation.images["front"][0, 0, 0] > 128 else -0.5
        return np.array([0.0, y, 0.0, 0.0, 0.0, 0.0, -1.0])
"""
WITH_IMAGES = (
    'observations: ClassVar = {"default": "state_only", "state_only": "state_only"}',
    'observations: ClassVar = {"default": "default", "state_only": "state_only"}',
)
LOOKING = ["--suite", "point", "--tasks", "point-left", "--trials", "1", "--policy", "python:looks.py:Looks"]


def look(path, *words):
    """Evaluate a policy that uses images in the world of a file, and return the status."""
    (path.parent / "looks.py").write_text(LOOKS, encoding="utf-8")
    return main(["eval", "--task-file", str(path), *LOOKING, "--workers", "1", "--out", "run", *words])


@pytest.mark.parametrize(
    ("returned", "problem"),
    [
        ("{}", "no image of camera 'front'"),
        ("{c: Images(np.zeros((256, 256, 3), np.uint8), None, None) for c in spec.cameras}",
         r"no image of camera 'front', but of CameraSpec\(name='front'.*"),
        ("None", "it returned None"),
        ("{c.name: np.zeros((256, 256, 3), np.uint8) for c in spec.cameras}", "for 'front' is a ndarray"),
        ("{c.name: Images(None, None, None) for c in spec.cameras}", "for 'front' has the rgb None"),
        ("{c.name: Images([[0]], None, None) for c in spec.cameras}", r"for 'front' has the rgb \[\[0\]\]"),
        ("{c.name: Images(np.zeros((64, 64, 3), np.uint8), None, None) for c in spec.cameras}",
         r"for 'front' has shape \(64, 64, 3\)"),
        ("{c.name: Images(np.zeros((256, 256, 3), np.float32), None, None) for c in spec.cameras}",
         "for 'front' has dtype float32"),
    ],
)  # fmt: skip
def test_wrong_images_are_errors_of_the_world_and_not_of_the_policy(load, policies_here, capfd, returned, problem):
    head = "\n\n@dataclass(frozen=True, slots=True)\nclass PointWorld(World):"
    path = load((head, VIEWS.replace("RETURNED", returned)), WITH_IMAGES)
    assert look(path) == 2
    said = capfd.readouterr()
    cure = r"Return a dict with a value Images\(rgb, None, None\) for 'front', where rgb has shape \(256, 256, 3\) and"
    expected = rf"PointScene\.views \(point\.py, line \d+\): [^.]*{problem}.*{cure} dtype uint8"
    assert re.search(expected, " ".join(said.err.split()))
    assert "broken      1 trial " in said.out
    assert "error of the policy" not in said.out
    assert {e.status for e in RunFolder.open(path.parent / "run").entries()} == {"error"}


def test_a_world_without_images_says_so_to_a_policy_that_needs_them(load, policies_here, capfd):
    assert look(load(WITH_IMAGES)) == 2
    expected = r"PointScene\.views \(point\.py\): it returned no image.*or set observations of the world to .*_only"
    assert re.search(expected, " ".join(capfd.readouterr().err.split()))


def test_the_example_of_the_page_with_images_is_seen_by_a_policy(load, capfd):
    register = "register_world(PointWorld())"
    path = load(
        ("@dataclass(frozen=True, slots=True)", f"{SEEING}\n\n@dataclass(frozen=True, slots=True)"),
        ("return PointScene(", "return SeenPointScene("),
        (register, f"\n{register}"),
        WITH_IMAGES,
    )
    assert look(path, "--tasks", "point-left", "point-right", "--trials", "2") == 0
    assert "100.0 % success (4/4" in capfd.readouterr().out


def test_a_mistake_in_a_file_is_corrected_in_a_new_folder(load, capfd):
    load(("self.task.id, self.seed", "self.tusk.id, self.seed"))
    assert main(["eval", *LOOKING[:-2], "--task-file", "point.py", "--policy", "noop", "--out", "run"]) == 2
    said = capfd.readouterr().out
    assert "broken      1 trial could not be run; running the command again repeats it" in said
    assert "If the mistake is in point.py, correct the file and choose a new folder with --out" in said
