"""Chains of CALVIN by the runner of betterbench: its process with an environment that has no physics."""

import os
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from betterbench.comparison.across import read_suite_runs, world_table
from betterbench.errors import (
    InvalidActionError,
    InvalidInputError,
    MissingDependencyError,
    PremiseError,
    RunConflictError,
    UnknownNameError,
)
from betterbench.evaluation import evaluate
from betterbench.evaluation.planning.plan import make_plan
from betterbench.evaluation.planning.world_plan import make_world_plan
from betterbench.interface.actions import CALVIN_RELATIVE, EE_DELTA
from betterbench.records import RunFolder
from betterbench.sim.worlds import WorldProcesses, process
from betterbench.sim.worlds.calvin import calvin_command, checkout_root, from_euler
from betterbench.sim.worlds.installation import start_code
from betterbench.tasks.worlds.calvin import calvin_chains, resampled_start_of, start_of, subtasks
from betterbench.tasks.worlds.calvin.resampling import APART_M, TRAINING_RANGE
from betterbench.tasks.worlds.calvin.starts import BLOCKS

pytestmark = pytest.mark.usefixtures("policies_here")  # but not for the fixture ``undisturbed``

POLICY = """
import numpy as np
from betterbench.interface import PolicyInfo

class Reads:
    info = PolicyInfo("reads", action_space="calvin_relative")
    def reset(self, start):
        self.told, self.asked = start.instruction, 0
    def act(self, seen):
        assert seen.instruction == self.told
        assert seen.images["front"].shape == (200, 200, 3)
        assert seen.images["wrist"].shape == (84, 84, 3)
        assert seen.native["robot_obs"].shape == (15,)
        self.asked += 1
        number = NUMBERS[self.told] if self.told not in CANNOT else -1
        # A chunk of four actions, of which the second does what is asked.
        return np.array([[-1, 0, 0, 0, 0, 0, 1], [number / 100, 0, 0, 0, 0, 0, -1]] + [[-1, 0, 0, 0, 0, 0, 1]] * 2)
"""


def policy_text(cannot=()):
    """The file of a policy that does what it is told, but for some instructions; its process imports no tasks."""
    numbers = {s.instruction: i for i, s in enumerate(subtasks())}
    return f"CANNOT = {set(cannot) or 'set()'}\nNUMBERS = {numbers}\n{POLICY}"


FAR = """
import numpy as np
from betterbench.interface import PolicyInfo

class Far:
    info = PolicyInfo("far", action_space="calvin_relative")
    def reset(self, start):
        pass
    def act(self, seen):
        return np.array([-1.8, 0, 0, 0, 0, 0, 1.0])
"""


def _scene(world, processes, number):
    return world.open_scene(
        processes, task="calvin", condition="base", seed=number, action_space=CALVIN_RELATIVE, images=False
    )


@pytest.fixture(scope="module")
def command():
    folder = str(Path(__file__).parent)
    code = f"import sys; sys.path.append({folder!r})\n{start_code('fake_calvin')}"
    return (sys.executable, "-c", code, folder, "", "")


@pytest.fixture(scope="module")
def plan_of(command, tmp_path_factory):
    folder = tmp_path_factory.mktemp("policies")
    made = {}

    def plan(cannot=(), suite="calvin", **options):
        file = folder / f"reads{len(cannot)}.py"
        file.write_text(policy_text(cannot))
        options = {"policy": f"python:{file}:Reads", "suite": suite, "command": command, "trials": 3, **options}
        # A plan starts a simulator, which answers by these variables; a plan that is the same is made once.
        simulator = [(name, value) for name, value in os.environ.items() if name.startswith("FAKE_")]
        key = repr((sorted(options.items()), sorted(simulator)))
        if key not in made:
            made[key] = make_world_plan(**options)
        return made[key]

    return plan


@pytest.fixture(scope="module")
def undisturbed(plan_of, tmp_path_factory):
    """A run of three chains, one after the other."""
    return evaluate(plan_of(), tmp_path_factory.mktemp("undisturbed") / "run", workers=1, envs=1)


def _bytes(run):
    return {p.relative_to(run.path): p.read_bytes() for p in sorted(run.path.glob("records/**/*.parquet"))}


def test_a_chain_is_one_trial_whose_instruction_changes(undisturbed):
    for number, record in enumerate(undisturbed.records()):
        chain = calvin_chains()[number]
        assert (record.metadata.task, record.metadata.condition, record.metadata.seed) == ("calvin", "base", number)
        assert record.metadata.subgoal_names == chain.names
        assert record.metadata.instruction.split("; ") == [s.instruction for s in chain.subtasks]
        assert record.metadata.control_rate_hz == 30.0
        assert record.outcome.success
        # Two steps for each: chunks end where an instruction does.
        assert record.subgoals.sum(axis=1).tolist() == [0, 0, 1, 1, 2, 2, 3, 3, 4, 4, 5]
        assert record.qpos[0].tolist()[15:] == pytest.approx(start_of(chain.start).scene.tolist())
        assert record.action[2].tolist()[-1] == -1.0
        assert record.gripper_command.tolist()[:3] == [-1.0, -1.0, 1.0]


def test_a_chain_ends_with_the_first_subtask_that_takes_too_long(plan_of, tmp_path, monkeypatch):
    monkeypatch.setattr("betterbench.sim.worlds.calvin.world.STEPS_PER_SUBTASK", 7)
    third = calvin_chains()[0].subtasks[2].instruction
    record = next(evaluate(plan_of([third], trials=1), tmp_path / "run", workers=1, envs=1).records())
    assert not record.outcome.success
    assert record.outcome.termination == "step_limit"
    assert record.subgoals[-1].tolist() == [True, True, False, False, False]
    assert record.n_steps == 2 + 2 + 7


def test_results_do_not_depend_on_environments_order_or_the_trials_before(plan_of, tmp_path, undisturbed):
    """The stand-in keeps something of a chain until its process ends, as PyBullet does."""
    plan = plan_of()
    backwards = replace(plan, trials=plan.trials[::-1])
    assert _bytes(undisturbed) == _bytes(evaluate(backwards, tmp_path / "side by side", workers=1, envs=2))
    alone = _bytes(evaluate(replace(plan, trials=plan.trials[2:]), tmp_path / "alone", workers=1, envs=1))
    assert len(alone) == 1
    assert alone.items() <= _bytes(undisturbed).items()


def test_a_run_that_goes_on_later_has_the_records_of_one_that_was_not_interrupted(plan_of, tmp_path, undisturbed):
    evaluate(plan_of(trials=1), tmp_path / "run", workers=1, envs=1)
    assert _bytes(evaluate(plan_of(), tmp_path / "run", workers=1, envs=1)) == _bytes(undisturbed)


def test_a_chain_that_is_begun_again_is_in_a_new_process(plan_of):
    """As after the death of the policy: the runner resets the same scene."""
    world = plan_of(trials=1).world
    processes = WorldProcesses(world.command)
    scene = _scene(world, processes, 0)
    rows, ids = [], []
    for _ in range(2):
        scene.reset()
        ids.append(scene._process.pid)
        rows.append([scene.simulator_state()["qpos"]])
        for _ in range(3):
            scene.step(np.array([-1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]))
            rows[-1].append(scene.simulator_state()["qpos"])
    assert np.array_equal(rows[0], rows[1])
    assert ids[0] != ids[1]
    assert not Path(f"/proc/{ids[0]}").exists()
    scene.close(well=True)
    processes.close()
    assert not Path(f"/proc/{ids[1]}").exists()


def test_a_process_refuses_a_second_chain(plan_of):
    world = plan_of(trials=1).world
    processes = WorldProcesses(world.command)
    scene = _scene(world, processes, 0)
    scene.reset()
    start = scene.start()
    with pytest.raises(process.WorldError, match="each chain needs a new process"):
        scene._process.start({"robot": start.robot.tolist(), "scene": start.scene.tolist(), "images": False})
    scene.close(well=False)
    processes.close()


def test_a_checkout_that_changes_during_a_run_costs_the_chains_that_follow(plan_of, tmp_path, monkeypatch):
    plan = plan_of(trials=1)
    monkeypatch.setenv("FAKE_COMMIT", "1" * 40)
    (entry,) = evaluate(plan, tmp_path / "run", workers=1, envs=1).entries()
    assert entry.status == "error"
    assert f"calvin_env is {'1' * 40} in the simulator, but it was {'0' * 40} when the run began" in entry.message


def test_actions_are_applied_as_they_are_and_counted(plan_of, tmp_path):
    """CALVIN clips none: ten steps of 1.8 lead 1.8 times as far as ten of 1."""
    file = tmp_path / "far.py"
    file.write_text(FAR)
    plan = plan_of(policy=f"python:{file}:Far", trials=1)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("betterbench.sim.worlds.calvin.world.STEPS_PER_SUBTASK", 10)
        record = next(evaluate(plan, tmp_path / "run", workers=1, envs=1).records())
    assert record.action[1:, 0].tolist() == [-1.8] * 10
    assert record.outcome.clipped_actions == 10
    assert record.ctrl[-1, 0] - record.ctrl[0, 0] == pytest.approx(-10 * 0.02 * 1.8)


def test_the_action_space_of_calvin_checks_and_does_not_clip():
    far = np.array([1.8, -3.0, 0.5, 0.0, 0.0, 0.0, 2.0])
    assert CALVIN_RELATIVE.clip(far).tolist() == far.tolist()
    assert EE_DELTA.clip(far).tolist() == [1.0, -1.0, 0.5, 0.0, 0.0, 0.0, 1.0]
    assert CALVIN_RELATIVE.count_clipped(np.array([far, 0.1 * far])) == 1
    for wrong in (far[:6], np.full(7, np.nan), np.full(7, -np.inf)):
        with pytest.raises(InvalidActionError):
            CALVIN_RELATIVE.clip(wrong)


@pytest.mark.parametrize("fault", ["dies", "black"])
def test_egl_is_used_where_it_starts(plan_of, command, monkeypatch, caplog, fault):
    said = {"dies": "status -6", "black": "has only one color"}[fault]
    auto = (*command[:-1], "auto")
    world = plan_of(command=auto).world
    assert world.command == (*command[:-1], "egl")
    assert world.versions["renderer"] == "EGL"
    assert not caplog.records
    monkeypatch.setenv("FAKE_EGL", fault)
    world = plan_of(command=auto).world
    assert world.command == command
    assert world.versions["renderer"] == "TinyRenderer"
    assert said in caplog.text
    assert "rendered by TinyRenderer because EGL" in caplog.text
    with pytest.raises(process.WorldError, match=said):
        plan_of(command=(*command[:-1], "egl"))


def test_renderers_are_not_mixed(plan_of, command, tmp_path):
    egl, tiny = plan_of(trials=1, command=(*command[:-1], "egl")), plan_of(trials=1)
    run = evaluate(egl, tmp_path / "egl", workers=1, envs=1)
    assert next(run.records()).metadata.engine["renderer"] == "EGL"
    assert run.plan["world"]["versions"]["renderer"] == "EGL"
    with pytest.raises(RunConflictError, match='renderer is "EGL" in the folder but "TinyRenderer" in the request'):
        evaluate(tiny, tmp_path / "egl", workers=1, envs=1)
    evaluate(tiny, tmp_path / "tiny", workers=1, envs=1)
    with pytest.raises(RunConflictError, match="renderer"):
        world_table(read_suite_runs([RunFolder.open(tmp_path / r) for r in ("egl", "tiny")], names=["one", "other"]))


def test_a_missing_module_is_named_with_its_cure(plan_of, monkeypatch):
    """Hydra wraps the error in one that does not name its cause."""
    monkeypatch.setenv("FAKE_MISSING", "a_module_of_nobody")
    with pytest.raises(process.WorldError, match=r"No module named 'a_module_of_nobody'.*uv pip install --python"):
        plan_of()


@pytest.mark.slow
@pytest.mark.parametrize("suite", ["calvin", "calvin_resampled"])
def test_results_do_not_depend_on_workers_environments_or_the_trials_before(plan_of, tmp_path, suite):
    together = _bytes(evaluate(plan_of(suite=suite), tmp_path / "together", workers=1, envs=1))
    assert together == _bytes(evaluate(plan_of(suite=suite), tmp_path / "side by side", workers=2, envs=2))
    alone = _bytes(evaluate(plan_of(suite=suite, trials=1, seed=2), tmp_path / "alone"))
    assert alone.items() <= together.items()


@pytest.mark.parametrize(
    "fault", ["dies", *(pytest.param(kind, marks=pytest.mark.slow) for kind in ("hangs", "raises", "nan", "garbage"))]
)
def test_a_failing_simulator_costs_one_chain_and_the_same_command_resumes(
    plan_of, tmp_path, monkeypatch, undisturbed, fault
):
    monkeypatch.setattr(process, "STEP_LIMIT_S", 1.0)
    yaw = float(start_of(calvin_chains()[1].start).scene[11])
    monkeypatch.setenv("FAKE_FAULT", f"{fault}:{yaw!r}:{tmp_path / 'it happened'}")
    run = evaluate(plan_of(), tmp_path / "run", workers=1, envs=1)
    broken = [e for e in run.entries() if e.status == "error"]
    assert [e.seed for e in broken] == [1]
    assert "simulator" in broken[0].message
    assert _bytes(evaluate(plan_of(), tmp_path / "run", workers=1, envs=1)) == _bytes(undisturbed)


def test_blocks_are_placed_by_name_whatever_their_order(plan_of, tmp_path, monkeypatch, undisturbed):
    """calvin_env's own scene D lists pink, blue, red; ``scene_obs`` is red, blue, pink."""
    monkeypatch.setenv("FAKE_ORDER", "block_pink,block_blue,block_red")
    turned = _bytes(evaluate(plan_of(trials=1), tmp_path / "turned", workers=1, envs=1))
    assert len(turned) == 1
    assert turned.items() <= _bytes(undisturbed).items()
    monkeypatch.setenv("FAKE_ORDER", "block_pink,block_blue")
    with pytest.raises(Exception, match="the scene has the blocks block_pink, block_blue"):
        plan_of(trials=1)


def test_a_scene_that_is_elsewhere_stops_the_run(plan_of, tmp_path, monkeypatch):
    monkeypatch.setenv("FAKE_SHIFT", "0.04")
    with pytest.raises(PremiseError, match=r"chain 0: the red block is 40 mm from its place.*--calvin-config"):
        evaluate(plan_of(trials=1), tmp_path / "refused")
    run = evaluate(plan_of(trials=1, broken_premises="run"), tmp_path / "run")
    assert "red block is 40 mm" in next(run.records()).metadata.engine["scene_broken_premises"]


def test_images_are_drawn_only_where_the_policy_is_asked(plan_of, tmp_path, monkeypatch):
    looked = []
    step = process.WorldProcess.step

    def counted(self, action, *, look):
        looked.append(look)
        return step(self, action, look=look)

    monkeypatch.setattr(process.WorldProcess, "step", counted)
    evaluate(plan_of(trials=1), tmp_path / "run", workers=1, envs=1)
    # Every chunk is cut off by success; the images of the next instruction come with its beginning.
    assert looked == [False] * 10


def test_the_plan_names_neither_checkout_nor_machine(plan_of):
    form = plan_of(suite="calvin_resampled", trials=None).to_json()
    assert len(form["trials"]) == 1000
    assert form["trials"][7]["condition"] == form["trials"][7]["variation"] == "resampled"
    assert form["trials"][7]["base_condition"] == "base"
    assert form["action_space"] == CALVIN_RELATIVE.name
    assert form["control_rate_hz"] == 30.0
    assert form["observation"]["name"] == "calvin"
    assert str(Path(__file__).parent) not in str(form)


@pytest.mark.parametrize(
    ("options", "error"),
    [
        ({"policy": "expert"}, InvalidInputError),
        ({"suite": "calvin_d"}, UnknownNameError),
        ({"trials": 1001}, InvalidInputError),
        ({"trials": 2, "seed": 999}, InvalidInputError),
        ({"observation": "droid"}, UnknownNameError),
    ],
)
def test_a_wrong_setting_is_refused(plan_of, options, error):
    with pytest.raises(error):
        plan_of(**options)


def test_a_policy_of_another_world_is_refused(plan_of, tmp_path):
    with pytest.raises(InvalidInputError, match="calvin_relative"):
        evaluate(plan_of(policy="noop"), tmp_path / "run")
    with pytest.raises(UnknownNameError, match="calvin_relative"):
        make_plan("noop", action_space="calvin_relative")


def test_a_clone_of_calvin_is_a_checkout_too(tmp_path):
    clone = tmp_path / "calvin"
    (clone / "calvin_env").mkdir(parents=True)
    with pytest.raises(InvalidInputError, match="neither"):
        checkout_root(clone)
    (clone / ".gitmodules").write_text('[submodule "calvin_env"]\n\tpath = calvin_env\n')
    for named in (clone, clone / "calvin_env"):
        with pytest.raises(InvalidInputError, match=rf"`git -C {clone} submodule update --init --recursive`"):
            checkout_root(named)
    module = clone / "calvin_env" / "calvin_env" / "envs" / "play_table_env.py"
    module.parent.mkdir(parents=True)
    module.touch()
    assert checkout_root(clone) == checkout_root(clone / "calvin_env") == clone / "calvin_env"
    (clone / "calvin_models").mkdir()
    with pytest.raises(InvalidInputError, match=r"neither.*Pass the root"):
        checkout_root(clone / "calvin_models")
    with pytest.raises(InvalidInputError, match=rf"Pass --calvin-env {clone / 'calvin_env'}\W*$"):
        checkout_root(clone / "calvin_env" / "calvin_env")


def test_the_checkout_is_asked_for(tmp_path, monkeypatch):
    with pytest.raises(InvalidInputError, match=r"--calvin-env.*[Cc]lone"):
        calvin_command(None, None, egl=False)
    with pytest.raises(InvalidInputError, match=r"play_table_env\.py"):
        calvin_command(tmp_path, None, egl=False)
    module = tmp_path / "calvin_env" / "envs" / "play_table_env.py"
    module.parent.mkdir(parents=True)
    module.touch()
    with pytest.raises(InvalidInputError, match="--calvin-config"):
        calvin_command(tmp_path, tmp_path / "merged_config.yaml", egl=False)
    monkeypatch.setattr("platformdirs.user_cache_path", lambda _: tmp_path / "cache")
    with pytest.raises(MissingDependencyError, match="better worlds install calvin"):
        calvin_command(tmp_path, None, egl=False)


def test_resampled_starts_are_in_the_training_range_and_change_nothing_else():
    drawn = set()
    for chain in calvin_chains():
        official, start = start_of(chain.start), resampled_start_of(chain)
        assert np.array_equal(start.robot, official.robot)
        assert np.array_equal(start.scene[:6], official.scene[:6])
        places = start.scene[6:].reshape(3, 6)
        for block, (x, y, z, *turn) in zip(BLOCKS, places.tolist(), strict=True):
            (low_x, high_x), (low_y, high_y), height = TRAINING_RANGE[str(chain.start[block])]
            assert low_x <= x <= high_x
            assert low_y <= y <= high_y
            assert z == height
            assert turn[:2] == [0.0, 0.0]
        gaps = [np.hypot(*(a - b)) for i, a in enumerate(places[:, :2]) for b in places[:i, :2]]
        assert min(gaps) > APART_M
        drawn.add(places.tobytes())
    assert len(drawn) == 1000
    again = resampled_start_of(calvin_chains()[17]).scene
    assert np.array_equal(again, resampled_start_of(calvin_chains(18)[17]).scene)


def test_euler_angles_are_bullet_s():
    # pybullet.getQuaternionFromEuler([0.3, -0.5, 1.1]) of 3.2.7, its (x, y, z, w) put in our order.
    assert from_euler(np.array([0.3, -0.5, 1.1])) == pytest.approx(
        (0.7974216914293404, 0.25130194824168633, -0.13286838981801155, 0.5322705776530126), abs=1e-12
    )
    assert from_euler(np.zeros(3)) == (1.0, 0.0, 0.0, 0.0)


@pytest.mark.slow
def test_a_thousand_chains_run_to_the_numbers_that_are_known(plan_of, tmp_path, monkeypatch):
    monkeypatch.setattr("betterbench.sim.worlds.calvin.world.STEPS_PER_SUBTASK", 6)
    cannot = {"open_drawer", "lift_red_block_table", "stack_block"}
    sentences = [s.instruction for s in subtasks() if s.name in cannot]
    run = evaluate(plan_of(sentences, trials=None), tmp_path / "run", workers=1, envs=1)
    expected = [next((i for i, n in enumerate(c.names) if n in cannot), 5) for c in calvin_chains()]
    found = {r.metadata.seed: int(r.subgoals[-1].sum()) for r in run.records()}
    assert [found[i] for i in range(1000)] == expected
