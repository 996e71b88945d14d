"""Our tasks in vla-evaluation-harness: the real command plays them, and its runs are diagnosed like ours."""

from __future__ import annotations

import importlib
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import yaml
from tests.evaluation.conftest import in_few_steps
from vla_eval.api import serve_background
from vla_eval.model_servers.predict import PredictModelServer
from vla_eval.recording import RecordingError
from vla_eval.specs import (
    GRIPPER_CLOSE_NEG,
    GRIPPER_CLOSE_POS,
    IMAGE_RGB,
    LANGUAGE,
    POSITION_DELTA,
    ROTATION_AA,
    STATE_EEF_POS_AA_GRIP,
    check_specs,
)

from betterbench.diagnosis import Label, diagnose_run
from betterbench.episodes import Observer
from betterbench.errors import InvalidInputError, MissingDependencyError, UnknownNameError
from betterbench.evaluation import evaluate, make_plan
from betterbench.evaluation.integrations.vla_eval_benchmark import BetterBench
from betterbench.interface import observation_spec
from betterbench.interface.actions import EE_DELTA
from betterbench.policies.conventions.presets import VLA_EVAL
from betterbench.records import RunFolder, record_bytes
from betterbench.sim.scenes import Scene
from betterbench.sim.scenes.stage import quality_preset
from betterbench.tasks import get_task, suite_tasks
from betterbench.tasks.trial import Trial

pytestmark = pytest.mark.physics

ROOT = Path(__file__).parents[2]
STILL = {"actions": np.array([0.0] * 6 + [-1.0])}
WAVE = """
import numpy as np
from betterbench.interface import PolicyInfo
class Wave:
    info = PolicyInfo("wave", needs_images=False)
    def reset(self, start):
        pass
    def act(self, seen):
        return np.append(0.6 * np.sin(0.1 * seen.step + np.arange(6)), 1.0 if seen.step % 40 > 20 else -1.0)
"""


def wave(step: int) -> np.ndarray:
    return np.append(0.6 * np.sin(0.1 * step + np.arange(6)), 1.0 if step % 40 > 20 else -1.0)


@pytest.fixture
def bench(tmp_path):
    made = []

    def build(name: str = "run", **arguments: object) -> BetterBench:
        arguments = {"observation": "state_only", "quality": "fast", "trials": 1, "policy": "scripted", **arguments}
        made.append(BetterBench(str(tmp_path / name), **arguments))
        return made[-1]

    yield build
    for one in made:
        one.cleanup()


def task_of(bench: BetterBench, name: str, episode: int = 0) -> dict:
    return {**next(t for t in bench.get_tasks() if t["name"] == name), "episode_idx": episode}


def play(bench: BetterBench, task: dict, answers) -> dict:
    """One episode as the harness plays it; answers maps the number of a step to a reply."""
    seen = bench.reset(task)
    for step in range(bench.get_metadata()["max_steps"]):
        bench.make_obs(seen, task)
        result = bench.step(answers(step))
        if bench.check_done(result):
            break
        seen = result.obs
    return {"steps": step + 1, **bench.get_step_result(result)}


class Scripted(PredictModelServer):
    """A model that never moves and remembers what it was shown."""

    def __init__(self) -> None:
        super().__init__(chunk_size=1)
        self.shown: list[dict] = []

    def predict(self, obs, ctx):  # noqa: ARG002
        self.shown.append(obs)
        return STILL

    def get_action_spec(self):
        return {"position": POSITION_DELTA, "rotation": ROTATION_AA, "gripper": GRIPPER_CLOSE_POS}

    def get_observation_spec(self):
        return {"language": LANGUAGE, "state": STATE_EEF_POS_AA_GRIP}

    def get_observation_params(self):
        return {"send_state": True, "quat_no_antipodal": True}


def test_the_command_plays_two_tasks_and_the_run_is_diagnosed(tmp_path):
    config = yaml.safe_load((ROOT / "docs" / "vla-eval.yaml").read_text())
    (entry,) = config["benchmarks"]
    entry["episodes_per_task"] = 1
    entry["params"] |= {
        "run": str(tmp_path / "run"),
        "conditions": ["morning_coffee/T1", "dinner_plates/train1"],
        "trials": 1,
        "observation": "state_only",
        "quality": "fast",
    }
    (tmp_path / "config.yaml").write_text(yaml.safe_dump(config))
    model = Scripted()
    command = [
        sys.executable,
        "-m",
        "vla_eval.cli.main",
        "run",
        "--no-docker",
        "--config",
        str(tmp_path / "config.yaml"),
    ]
    with serve_background(model) as server:
        command += ["--server-url", server.url, "--output-dir", str(tmp_path / "results")]
        done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "better60: 50.0%" in done.stdout
    assert "Spec mismatch" not in done.stderr
    assert "cannot be forwarded" not in done.stderr
    assert model.shown[0]["states"].shape == (8,)
    assert (
        model.shown[0]["task_description"]
        == "Put the red mug inside the ring of the coffee machine, its handle not facing the machine."
    )

    diagnosis = diagnose_run(tmp_path / "run")
    labels = {(t.task, t.variation): t.label for t in diagnosis.trials}
    assert labels == {("morning_coffee", "T1"): Label.CORRECT_FREEZE, ("dinner_plates", None): Label.EARLY_HALT}
    assert diagnosis.policy == "vla-eval:my-policy"
    (theirs,) = [json.loads(f.read_text()) for f in (tmp_path / "results").glob("better60*.json")]
    assert {t["task"]: t["mean_success"] for t in theirs["tasks"]} == {
        "morning_coffee/T1": 1.0,
        "dinner_plates/train1": 0.0,
    }


def test_the_page_shows_the_configuration_that_is_shipped():
    page = (ROOT / "docs" / "own-loop.md").read_text()
    assert f"```yaml\n{(ROOT / 'docs' / 'vla-eval.yaml').read_text()}```" in page


def test_its_records_are_those_of_better_eval_under_the_same_actions(bench, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(Trial, "resolve", in_few_steps(80))
    Path("wave.py").write_text(WAVE)
    plan = make_plan(
        "python:wave.py:Wave",
        tasks=["morning_coffee"],
        variations=["morning_coffee/L1"],
        trials=1,
        seed=3,
        observation="state_only",
        quality="fast",
    )
    ours = evaluate(plan, tmp_path / "ours")
    guest = bench("theirs", conditions="morning_coffee/L1", seed=3)
    play(guest, task_of(guest, "morning_coffee/L1"), lambda step: {"actions": wave(step)})
    folder = RunFolder.open(tmp_path / "theirs")
    assert [e.status for e in folder.entries()] == ["done"]
    mine, theirs = (r.read_record("morning_coffee", "L1", 3) for r in (ours, folder))
    assert len(mine.time) == 81
    assert theirs.metadata.policy == "vla-eval:scripted"
    object.__setattr__(theirs.metadata, "policy", mine.metadata.policy)
    assert record_bytes(theirs) == record_bytes(mine)
    assert folder.load_scene(theirs.metadata.scene_hash) == ours.load_scene(mine.metadata.scene_hash)


@pytest.mark.render
def test_the_model_is_shown_what_better_eval_shows(bench):
    guest = bench(conditions="fast_food/T1", observation="default", seed=5, send_state=True, send_wrist_image=True)
    task = task_of(guest, "fast_food/T1")
    seen = guest.reset(task)
    trial = guest.plan.trials[0]
    found = trial.resolve()
    scene = Scene(found.task, found.condition, seed=5, action_space=EE_DELTA, quality=quality_preset("fast"))
    scene.reset()
    observer = Observer(observation_spec("default"))
    for step in range(3):
        shown = observer.observe(scene, scene.state())
        message = guest.make_obs(seen, task)
        assert set(message) == {"images", "states", "task_description"}
        assert message["task_description"] == found.condition.instruction.text
        assert list(message["images"]) == ["agentview", "wrist"]
        assert np.array_equal(message["images"]["agentview"], shown.images["front"])
        assert np.array_equal(message["images"]["wrist"], shown.images["wrist"])
        assert np.array_equal(message["states"], VLA_EVAL.request(shown)["states"])
        assert np.array_equal(guest.render(), shown.images["front"])
        seen = guest.step({"actions": wave(step)[None]}).obs
        scene.step(wave(step))
    observer.close()


def test_what_is_not_asked_for_is_not_sent(bench):
    assert set(bench(observation="default").get_observation_spec()) == {"agentview", "language"}
    full = bench(observation="default", send_state=True, send_wrist_image=True)
    assert full.get_observation_spec() == {
        "agentview": IMAGE_RGB,
        "wrist": IMAGE_RGB,
        "language": LANGUAGE,
        "state": STATE_EEF_POS_AA_GRIP,
    }
    server = {"position": POSITION_DELTA, "rotation": ROTATION_AA, "gripper": GRIPPER_CLOSE_POS}
    assert check_specs(server, full.get_action_spec(), {}, full.get_observation_spec()) == []
    (told,) = check_specs({**server, "gripper": GRIPPER_CLOSE_NEG}, full.get_action_spec(), {}, {})
    assert "gripper" in told


def test_every_condition_of_the_suite_is_a_task(bench):
    whole = bench(conditions=None)
    tasks = whole.get_tasks()
    wanted = [
        f"{name}/{c.name}"
        for name in suite_tasks("better60")
        for c in (*get_task(name).training, *get_task(name).variations)
    ]
    assert sorted(t["name"] for t in tasks) == sorted(wanted)
    assert {t["suite"] for t in tasks} == set(suite_tasks("better60"))
    assert whole.get_metadata()["max_steps"] >= 550
    some = bench(conditions="fast_food, morning_coffee/T1")
    assert {t["suite"] for t in some.get_tasks()} == {"fast_food", "morning_coffee"}
    assert [t["name"] for t in some.get_tasks() if t["suite"] == "morning_coffee"] == ["morning_coffee/T1"]


def test_an_episode_cut_short_is_run_again_and_one_that_is_done_is_only_told(bench, tmp_path):
    def entries():
        return [(e.condition, e.status) for e in RunFolder.open(tmp_path / "run").entries()]

    first = bench(conditions="morning_coffee/T1")
    task = task_of(first, "morning_coffee/T1")
    first.reset(task)
    result = first.step(STILL)
    assert first.get_step_result(result) == {"success": False, "policy_error": False, "cut_short": True}
    first.cleanup()
    assert entries() == [("T1", "error")]
    (trial,) = diagnose_run(tmp_path / "run").trials
    assert trial.label is Label.POLICY_ERROR
    assert "ended the episode at step 1" in str(trial.evidence)

    second = bench(conditions="morning_coffee/T1")
    assert play(second, task, lambda _: STILL) == {
        "steps": 200,
        "success": True,
        "policy_error": False,
        "cut_short": False,
    }
    assert play(second, task, lambda _: STILL)["steps"] == 1
    third = bench(conditions="morning_coffee/T1")
    assert play(third, task, lambda _: STILL) == {
        "steps": 1,
        "success": True,
        "policy_error": False,
        "cut_short": False,
    }
    assert entries() == [("T1", "done")]


@pytest.mark.parametrize(
    ("reply", "reason"),
    [
        ({"actions": np.full(7, np.nan)}, "nan"),
        ({"actions": np.zeros(8)}, "shape (8,)"),
        ({"action": np.zeros(7)}, "no 'actions'"),
        ({"actions": np.zeros((0, 7))}, "empty chunk"),
        ({"actions": "left"}, "not an array of real numbers"),
    ],
)
def test_a_broken_reply_ends_the_trial_with_its_reason(bench, tmp_path, reply, reason):
    guest = bench(conditions="morning_coffee/T1")
    told = play(guest, task_of(guest, "morning_coffee/T1"), lambda step: STILL if step < 2 else reply)
    assert told == {"steps": 3, "success": False, "policy_error": True, "cut_short": False}
    record = RunFolder.open(tmp_path / "run").read_record("morning_coffee", "T1", 0)
    assert record.outcome.termination == "policy_error"
    assert reason in record.outcome.error
    assert len(record.time) == 3


def test_shards_share_a_run(bench, tmp_path):
    one, two = (bench(conditions="morning_coffee/T1", trials=4) for _ in range(2))
    for episode in range(4):
        play(
            (one, two)[episode % 2],
            task_of(one, "morning_coffee/T1", episode),
            lambda _: {"actions": np.full(7, np.nan)},
        )
    assert sorted(e.seed for e in RunFolder.open(tmp_path / "run").entries()) == [0, 1, 2, 3]


def test_other_settings_in_the_same_folder_stop_the_evaluation(bench):
    first = bench(conditions="morning_coffee/T1")
    first.reset(task_of(first, "morning_coffee/T1"))
    for other in ({"policy": "another"}, {"seed": 1}, {"send_state": True}):
        second = bench(**{"conditions": "morning_coffee/T1", **other})
        with pytest.raises(RecordingError, match=r"a different run: plan\.|is not the policy of this run"):
            second.reset(task_of(second, "morning_coffee/T1"))


def test_bad_settings_are_named(bench):
    guest = bench(conditions="morning_coffee/T1", trials=2)
    with pytest.raises(InvalidInputError, match=r"to the same number, which must be at least 3"):
        guest.reset(task_of(guest, "morning_coffee/T1", 2))
    with pytest.raises(InvalidInputError, match="Call reset first"):
        guest.step(STILL)
    with pytest.raises(UnknownNameError, match="Did you mean 'T1'"):
        bench(conditions="morning_coffee/T11")
    with pytest.raises(UnknownNameError, match="observation preset"):
        bench(observation="defualt")
    with pytest.raises(InvalidInputError, match=r"there_is_no_such_file\.json"):
        bench(adapter="there_is_no_such_file.json")
    with pytest.raises(InvalidInputError, match="answers with absolute poses, but adapter vla_eval reads ee_delta"):
        bench(absolute_action=True)


def test_holding_still_is_known(bench):
    assert bench().get_hold_action(None)["actions"].tolist() == [0.0] * 7


def test_a_missing_harness_says_how_to_install_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "vla_eval.benchmarks.base", None)
    monkeypatch.delitem(sys.modules, "betterbench.evaluation.integrations.vla_eval_benchmark")
    with pytest.raises(MissingDependencyError, match="EXTRAS=vla-eval"):
        importlib.import_module("betterbench.evaluation.integrations.vla_eval_benchmark")
