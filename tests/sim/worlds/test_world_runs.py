"""Runs in a world with a simulator of its own, a stand-in: journal, records, and what a failing simulator costs."""

import math
import time
from dataclasses import replace

import numpy as np
import pytest
from tests.daily import others_slow
from tests.sim.worlds.clients import CLIENTS, differences

from betterbench.episodes import Observer
from betterbench.errors import InvalidInputError, PremiseError, UnknownNameError, one_line
from betterbench.evaluation import evaluate
from betterbench.evaluation.planning.world_plan import make_world_plan
from betterbench.interface import observation_spec
from betterbench.interface.actions import EE_DELTA
from betterbench.policies.conventions.in_libero import in_libero
from betterbench.policies.conventions.presets import PRESETS
from betterbench.sim.worlds import ProcessScene, WorldProcesses, process
from betterbench.sim.worlds.scene import quat2axisangle
from betterbench.tasks.worlds.libero import PROTOCOLS, SUITES

POLICY = """
import numpy as np
from betterbench.interface import PolicyInfo

class Shove:
    info = PolicyInfo("shove")
    def reset(self, start):
        pass
    def act(self, seen):
        assert seen.images["front"].shape == (256, 256, 3)
        return np.array([[0.5, 0.1 * seen.images["front"][0, 0, 0] / 255.0, 0, 0, 0, 0, 1.0]] * 4)
"""


@pytest.fixture(scope="module")
def plan_of(fake_command, tmp_path_factory):
    file = tmp_path_factory.mktemp("policies") / "shove.py"
    file.write_text(POLICY)
    made = {}

    def plan(policy=f"python:{file}:Shove", suite="libero_object", **options):
        # Each plan starts a simulator; a plan that is the same is made once.
        key = repr((policy, suite, sorted(options.items())))
        if key not in made:
            options = {"tasks": ["3"], "trials": 2, **options}
            made[key] = make_world_plan(policy, suite=suite, command=fake_command, **options)
        return made[key]

    return plan


def _bytes(run):
    return {p.relative_to(run.path): p.read_bytes() for p in sorted(run.path.glob("records/**/*.parquet"))}


def test_a_run_ends_with_the_success_of_the_world(plan_of, tmp_path):
    run = evaluate(plan_of(), tmp_path / "run")
    records = list(run.records())
    assert [(r.metadata.task, r.metadata.condition, r.metadata.seed) for r in records] == [
        ("libero_object-03", "base", 0),
        ("libero_object-03", "base", 1),
    ]
    for record in records:
        assert record.outcome.success
        assert record.object_positions[-1, 0, 0] > 0.2 >= record.object_positions[-2, 0, 0]
        assert record.metadata.instruction == "pick up the cube and place it on the plate"
        assert record.predicates[-1].tolist() == [True, True]
        assert record.metadata.engine["mujoco"] == "3.3.7"
        assert run.load_scene(record.metadata.scene_hash)["task.bddl"] == b"(define (problem cube))"


@pytest.mark.parametrize("workers", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_results_do_not_depend_on_workers_environments_or_the_trials_before(plan_of, policies_here, tmp_path, workers):
    plan = plan_of(trials=3)
    together = _bytes(evaluate(plan, tmp_path / "together", workers=1, envs=1))
    assert together == _bytes(evaluate(plan, tmp_path / "side by side", workers=workers, envs=2))
    alone = _bytes(evaluate(replace(plan, trials=plan.trials[2:]), tmp_path / "alone"))
    assert len(alone) == 1
    assert alone.items() <= together.items()


def short(plan):
    return replace(plan, world=replace(plan.world, protocol=replace(PROTOCOLS["openpi"], steps={"libero_object": 12})))


@pytest.fixture(scope="module")
def three_trials(fake_command):
    """Plan of three short trials, which needs no simulator any more."""
    return short(make_world_plan("noop", suite="libero_object", command=fake_command, tasks=["3"], trials=3))


@pytest.fixture(scope="module")
def undisturbed(three_trials, tmp_path_factory):
    return _bytes(evaluate(three_trials, tmp_path_factory.mktemp("undisturbed") / "run"))


@pytest.fixture(scope="module")
def many_trials(fake_command):
    """Plan in which each of the four trials of an odd seed may fail, between two that do not."""
    return short(make_world_plan("noop", suite="libero_object", command=fake_command, tasks=["3"], trials=9))


@pytest.fixture(scope="module")
def many_undisturbed(many_trials, tmp_path_factory):
    return _bytes(evaluate(many_trials, tmp_path_factory.mktemp("undisturbed") / "run"))


def at_odd_seeds(faults, folder, monkeypatch):
    """Let each of the faults happen once, in a trial of its own, and return the faults by seed."""
    at = {2 * i + 1: fault for i, fault in enumerate(faults)}
    lines = [f"{fault}:{seed}:{folder / f'it happened {seed}'}" for seed, fault in at.items()]
    monkeypatch.setenv("FAKE_FAULT", "\n".join(lines))
    return at


FAULTS = ["dies", "hangs", "raises", "nan", "garbage"]
FAULTS += [
    "short row",
    "unknown pair",
    "pair from the end",
    "pair without force",
    "endless force",
    "few truths",
    "no row",
    "truths that are numbers",
    "contacts in a table",
    "done in words",
    "done is missing",
    "no rotation",
    "row of floats",
    "two rows",
    "prints much",
    "raises in lines",
    "slowly",
    "half",
    "half and waits",
    "late",
    "of another request",
    "huge",
]


@pytest.mark.parametrize("faults", others_slow([FAULTS[part::7] for part in range(7)], 7))
def test_a_failing_simulator_costs_one_trial_and_the_same_command_resumes(
    many_trials, tmp_path, monkeypatch, many_undisturbed, faults
):
    monkeypatch.setattr(process, "STEP_LIMIT_S", 1.0)
    at = at_odd_seeds(faults, tmp_path, monkeypatch)
    began = time.monotonic()
    run = evaluate(many_trials, tmp_path / "run", envs=2)
    assert time.monotonic() - began < 60.0 * len(faults)
    broken = {e.seed: e.message for e in run.entries() if e.status == "error"}
    assert {seed: at.get(seed) for seed in broken} == at
    for message in broken.values():
        assert "simulator" in message
        assert one_line(message, most=600) == message
    assert _bytes(evaluate(many_trials, tmp_path / "run", envs=1)) == many_undisturbed


def test_an_answer_that_is_sent_twice_is_read_once(three_trials, tmp_path, monkeypatch, undisturbed):
    monkeypatch.setenv("FAKE_FAULT", f"twice:1:{tmp_path / 'it happened'}")
    run = evaluate(three_trials, tmp_path / "run")
    assert (tmp_path / "it happened").exists()
    assert not [e for e in run.entries() if e.status == "error"]
    assert _bytes(run) == undisturbed


STARTS = [
    "pairs",
    "pairs=[1]",
    'pairs=["abc"]',
    "row",
    'row=[["qpos", [3]]]',
    'row=[["qpos", [-3]]]',
    "objects",
    "objects=7",
    'objects=[{"name": "cube_1"}, {}]',
    "relations",
    "goal=[7]",
    "premises=[[]]",
    "places=[[1]]",
    'objects=[{"name": "cube_1", "kind": "cube", "fixed": "no", "mass": 0.1, "size": [1, 1, 1], "regions": []}]',
    "arena",
    "arena=7",
    "base=[0, 0]",
    "bddl=7",
    "engine",
    "engine=7",
    'engine={"mujoco": 3}',
]


@pytest.mark.parametrize("faults", others_slow([STARTS[part::7] for part in range(7)], 7))
def test_a_start_that_cannot_be_read_costs_one_trial(many_trials, tmp_path, monkeypatch, many_undisturbed, faults):
    monkeypatch.setenv("FAKE_START", "1")
    at = at_odd_seeds(faults, tmp_path, monkeypatch)
    run = evaluate(many_trials, tmp_path / "run", envs=1)
    broken = {e.seed: e.message for e in run.entries() if e.status == "error"}
    assert {seed: at.get(seed) for seed in broken} == at
    assert all("simulator" in message for message in broken.values())
    assert _bytes(evaluate(many_trials, tmp_path / "run", envs=1)) == many_undisturbed


def test_an_image_of_another_type_is_no_image(plan_of, policies_here, tmp_path, monkeypatch):
    monkeypatch.setenv("FAKE_FAULT", f"image of numbers:1:{tmp_path / 'it happened'}")
    (tmp_path / "each.py").write_text(POLICY.replace("]] * 4", "]]"))
    run = evaluate(short(plan_of(policy=f"python:{tmp_path / 'each.py'}:Shove")), tmp_path / "run")
    broken = [e for e in run.entries() if e.status == "error"]
    assert [e.seed for e in broken] == [1]
    assert "sent image_front as float64 (256, 256, 3), expected uint8 (256, 256, 3)" in broken[0].message


def test_a_scene_that_does_not_show_its_premise_stops_the_run(plan_of, policies_here, tmp_path):
    with pytest.raises(PremiseError, match=r"on\(cube_1, tray_1\) is false after settling"):
        evaluate(plan_of(seed=40, trials=1), tmp_path / "refused")
    run = evaluate(plan_of(seed=40, trials=1, broken_premises="run"), tmp_path / "run")
    assert next(run.records()).metadata.engine["scene_broken_premises"] == "on(cube_1, tray_1)"


def test_the_plan_says_how_it_is_run(plan_of):
    form = plan_of(suite="libero_object_lan", protocol="gr00t", trials=None).to_json()
    assert len(form["trials"]) == 20
    assert form["trials"][0]["condition"] == "lan"
    assert form["trials"][0]["base_condition"] == "base"
    assert form["world"]["protocol"]["steps"]["libero_object"] == 720
    assert form["world"]["tasks"]["libero_object-03/lan"]["instruction"] == "shove the cube"
    assert "/" not in str(form["world"]["versions"])


@pytest.mark.parametrize(
    ("options", "error"),
    [
        ({"policy": "zoo:halt"}, InvalidInputError),
        ({"policy": "learned:checkpoint"}, InvalidInputError),
        ({"policy": "openpi://localhost:8000?preset=openpi_libero_object"}, InvalidInputError),
        ({"suite": "libero_objects"}, UnknownNameError),
        ({"protocol": "ours"}, UnknownNameError),
        ({"tasks": ["10"]}, UnknownNameError),
        ({"trials": 51}, InvalidInputError),
        ({"trials": 2, "seed": 49}, InvalidInputError),
        ({"observation": "droid"}, UnknownNameError),
    ],
)
def test_a_wrong_setting_is_refused(plan_of, options, error):
    with pytest.raises(error):
        plan_of(**options)


def test_every_protocol_has_steps_for_every_suite():
    assert all(suite.base in p.steps for suite in SUITES.values() for p in PROTOCOLS.values())
    assert len(SUITES) == 21


@pytest.fixture(scope="module")
def first_seen(plan_of, fake_command):
    """The instruction and the first observation of a trial."""
    processes = WorldProcesses(fake_command)
    scene = ProcessScene(
        plan_of().world,
        processes,
        task="libero_object-03",
        condition="base",
        seed=1,
        action_space=EE_DELTA,
        images=True,
    )
    seen = Observer(observation_spec("default")).observe(scene, scene.reset())
    scene.close(well=True)
    processes.close()
    return scene.task.instruction, seen


@pytest.mark.parametrize("preset", sorted(CLIENTS))
def test_an_observation_is_what_the_clients_of_the_field_make_of_it(first_seen, preset):
    instruction, seen = first_seen
    quaternion = np.array([0.99930133, -0.00474019, -0.03628211, -0.0076154])
    obs = {
        "agentview_image": seen.images["front"][::-1, ::-1],
        "robot0_eye_in_hand_image": seen.images["wrist"][::-1, ::-1],
        "robot0_eef_pos": np.array([0.01, 0.0, 0.0]),
        "robot0_eef_quat": quaternion,
        "robot0_gripper_qpos": np.array([0.0262, -0.0261]),
        "controller_pos": np.array([0.01, 0.0, 0.0]),
        "controller_mat": np.eye(3),
    }
    adapter = in_libero(PRESETS[preset])
    assert list(differences(adapter.request(seen), CLIENTS[preset](obs, instruction))) == []
    assert np.linalg.norm(quat2axisangle(quaternion)) > math.pi, "the vector is not the shorter way round"
    obs["agentview_image"] = seen.images["front"][::-1]
    assert list(differences(adapter.request(seen), CLIENTS[preset](obs, instruction))) != []


def test_images_are_drawn_only_where_the_policy_is_asked(plan_of, policies_here, tmp_path, monkeypatch):
    asked = []
    step = process.WorldProcess.step

    def counted(self, action, *, look):
        asked.append(look)
        return step(self, action, look=look)

    monkeypatch.setattr(process.WorldProcess, "step", counted)
    run = evaluate(plan_of(trials=1), tmp_path / "run", workers=1, envs=1)
    assert sum(asked) == (len(asked) - 1) // 4 + (len(asked) % 4 == 0)
    assert next(run.records()).n_steps == len(asked)
