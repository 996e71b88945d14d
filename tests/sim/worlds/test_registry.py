"""Laws of every world: all are asked through one interface, and nobody asks which one it is."""

from __future__ import annotations

import copy
import inspect
import re
from dataclasses import fields, is_dataclass
from pathlib import Path

import pytest

import betterbench
from betterbench.errors import InvalidInputError, UnknownNameError
from betterbench.evaluation.planning.plan import make_plan
from betterbench.evaluation.planning.world_plan import make_world_plan
from betterbench.interface import observation_spec
from betterbench.interface.actions import PLAYED_IN, action_space
from betterbench.sim.scenes import CONTROL_RATE_HZ
from betterbench.sim.worlds import (
    OWN_WORLD,
    PlanRequest,
    ProcessScene,
    SceneOptions,
    TrialScene,
    World,
    WorldProcesses,
    all_worlds,
    register_world,
    world_named,
    world_names,
    world_of_suite,
)
from betterbench.sim.worlds.bare import BareScene
from betterbench.tasks.worlds.facts import (
    OURS,
    facts_of_plan,
    facts_of_suite,
    facts_of_task,
    known_facts,
    register_facts,
)

SOURCES = Path(betterbench.__path__[0])


def test_all_worlds_are_found_and_ours_comes_first():
    folders = {path.parent.name for path in (SOURCES / "sim" / "worlds").glob("*/__init__.py")}
    assert {"betterbench", "calvin", "libero", "libero_plus"} <= folders
    assert world_names() == ("betterbench", *sorted(folders - {"betterbench"}))
    assert [world.name for world in all_worlds()] == list(world_names())
    assert world_named("betterbench") is OWN_WORLD
    with pytest.raises(UnknownNameError, match="libero_plus"):
        world_named("libero_pluss")


def world_files_that_register_nothing(folder: Path) -> list[str]:
    """Returns a sentence for each file or folder that looks like a world and is found under no name.

    A world is a folder whose ``__init__`` registers a world with the folder's name. A single file is never imported.
    """
    found, cure = [], "registers nothing. Make it a folder whose __init__.py calls register_world"
    for path in sorted(folder.glob("*.py")):
        if path.name != "registry.py" and re.search(r"\bregister_world\(", path.read_text(encoding="utf-8")):
            found.append(f"sim/worlds/{path.name} {cure} (docs/adding-a-world.md)")
    for path in sorted(folder.glob("*/__init__.py")):
        if not re.search(r"\bregister_world\(", path.read_text(encoding="utf-8")):
            name = path.parent.name
            cure = f"Call register_world with the world {name!r} there (docs/adding-a-world.md)"
            found.append(f"sim/worlds/{name}/__init__.py registers nothing. {cure}")
    return found


def test_every_file_of_a_world_registers_it():
    assert world_files_that_register_nothing(SOURCES / "sim" / "worlds") == []


def test_a_world_in_a_single_file_and_a_folder_without_a_world_are_named(tmp_path):
    for name, text in (("press.py", "register_world(Press())\n"), ("helper.py", ""), ("push/__init__.py", "")):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text, encoding="utf-8")
    single, folder = world_files_that_register_nothing(tmp_path)
    assert single.startswith("sim/worlds/press.py registers nothing. Make it a folder")
    assert folder.startswith("sim/worlds/push/__init__.py registers nothing. Call register_world with the world 'push'")


def test_tasks_are_chosen_by_name_or_number_in_the_order_of_the_suite():
    names = ("push-left", "push-right", "push-0", "0")
    for asked, chosen in (
        ((), names),
        (("push-right", "push-left", "push-right"), names[:2]),
        (("2", "push-left", "1"), names[:3]),
        (("0",), ("0",)),  # a name takes precedence
    ):
        assert PlanRequest("push", asked).chosen(names) == chosen
    for unknown in ("4", "-1", "01", "push"):
        with pytest.raises(UnknownNameError, match=f"Unknown task '{unknown}'.*push-right"):
            PlanRequest("push", ("push-left", unknown)).chosen(iter(names))


def test_our_world_has_the_control_rate_of_our_scenes():
    """The world names no module of the simulator, which a list of suites would import."""
    assert OWN_WORLD.control_rate_hz == CONTROL_RATE_HZ


def test_what_a_world_says_about_itself_exists():
    for world in all_worlds():
        assert world.facts.suites
        assert world.action_spaces == tuple(action_space(name).name for name in world.action_spaces)
        assert world.dialect in PLAYED_IN
        assert "default" in world.observations
        for preset in world.observations.values():
            observation_spec(preset)
        assert world.options is None or is_dataclass(world.options)
        assert world.conventions("panda")["units"]
        assert world.installation is None or world.installation.lock_path.is_file()


def test_each_suite_and_each_task_belongs_to_one_world():
    for world in all_worlds():
        assert known_facts()[world.name] is world.facts
        for suite in world.facts.suites.values():
            assert facts_of_suite(suite.name) is world.facts
            assert world_of_suite(suite.name) is world
    assert facts_of_task("libero_object-03").name == "libero"
    assert facts_of_task("fast_food") is OURS
    with pytest.raises(UnknownNameError, match="libero_object"):
        world_of_suite("libero_objekt")


def test_a_world_is_pickled_by_its_name_and_keeps_what_the_run_adds():
    for world in all_worlds():
        assert copy.deepcopy(world) == world
        added = {f.name: getattr(world, f.name) for f in fields(world)}
        assert type(world)(**added) == world


def test_the_name_of_a_world_and_of_a_suite_is_taken_once():
    with pytest.raises(InvalidInputError, match="this name is already registered"):
        register_world(OWN_WORLD)
    other = type(OURS)(name="other", title="Other", suites={"better60": OURS.suites["better60"]})
    with pytest.raises(InvalidInputError, match="betterbench also has a suite 'better60'"):
        register_facts(other)


def test_a_plan_of_any_world_says_in_which_one_its_trials_are_run(fake_command):
    ours = make_plan("noop", tasks=("fast_food",), trials=1)
    assert ours.world is OWN_WORLD
    assert "world" not in ours.to_json()
    assert facts_of_plan(ours.to_json(), where="here") is OURS
    same = make_world_plan("noop", suite="better60", tasks=("fast_food",), trials=1)
    assert same.trials == ours.trials
    theirs = make_world_plan("noop", suite="libero_object", command=fake_command, tasks=["3"], trials=1)
    assert facts_of_plan(theirs.to_json(), where="here") is world_named("libero").facts
    assert isinstance(theirs.world, World)
    with pytest.raises(UnknownNameError, match="LIBERO option"):
        make_world_plan("noop", suite="libero_object", command=fake_command, axes=("camera",))


def test_each_kind_of_scene_has_all_that_an_episode_asks_for(fake_command):
    members = {name for name in vars(TrialScene) if not name.startswith("_")}
    plan = make_world_plan("noop", suite="libero_object", command=fake_command, tasks=["3"], trials=1)
    theirs = plan.world.open_scene(
        WorldProcesses(()), task="libero_object-03", condition="base", seed=0, action_space=action_space("ee_delta"),
        images=False,
    )  # fmt: skip
    ours = OWN_WORLD.open_scene(
        WorldProcesses(()), task="fast_food", condition="train1", seed=0, action_space=action_space("ee_delta"),
        images=False, options=SceneOptions("fast", "panda", "unseen"),
    )  # fmt: skip
    assert (ours.quality.name, ours.looks, ours.compiled.robot.name) == ("fast", "unseen", "panda")
    for scene in (theirs, ours):
        known = set(dir(scene)) | {name for name in members if hasattr(type(scene), name)}
        assert members <= known
    of_bare = set(dir(BareScene)) | set(re.findall(r"self\.(\w+)(?:,| =|:)", inspect.getsource(BareScene.__init__)))
    assert members <= of_bare
    assert isinstance(theirs, ProcessScene)


def test_nobody_asks_which_world_it_is():
    """Callers ask the world: neither its class, nor whether there is one, nor its name outside of its own folders."""
    classes = re.compile(r"isinstance\([^)]*\b(?:ForeignScene|ProcessScene|BareScene|ProcessWorld|OwnWorld|World)\b")
    absent = re.compile(r"\bworld is (?:not )?None\b")
    names = re.compile(rf"world(?:\.name)? (?:==|!=) \"(?:{'|'.join(world_names())})\"")
    for path in sorted(SOURCES.rglob("*.py")):
        where = path.relative_to(SOURCES).as_posix()
        text = path.read_text(encoding="utf-8")
        assert not classes.search(text), where
        assert not absent.search(text), where
        if not where.startswith(("sim/worlds/", "policies/conventions/", "cli/verbs/premise.py")):
            assert not names.search(text), where
