"""A checkpoint that acts: the same records each time, and one line about what is wrong with an address."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest
import torch
from made_up import made_up
from small_recipes import PIXELS, tiny

from betterbench.cli.main import main
from betterbench.episodes import Observer
from betterbench.errors import InvalidInputError, UnknownNameError
from betterbench.evaluation import open_server
from betterbench.evaluation.preflight.check import run_preflight
from betterbench.evaluation.serving.shadow import ShadowSimulation
from betterbench.interface import CameraSpec, EpisodeStart, observation_spec
from betterbench.interface.actions import EE_DELTA
from betterbench.policies.factory import PolicyFactory
from betterbench.policies.kinds import make_policy, needs_of, read_address
from betterbench.policies.learned import is_seeing, learned_info, make_learned, make_seeing
from betterbench.policies.learned.checkpoint import Trained, write_checkpoint
from betterbench.policies.learned.network import ObjectsBatch, ObjectsNetwork, ShownBatch
from betterbench.policies.learned.networks import new_network
from betterbench.policies.learned.pixels import PicturesBatch
from betterbench.policies.learned.policy import Learner
from betterbench.records import RunFolder
from betterbench.sim.scenes import Scene
from betterbench.sim.scenes.stage import quality_preset
from betterbench.tasks import TrialId, get_task

TRIAL = TrialId("morning_coffee", "train1", 0)


@pytest.fixture(scope="module", params=["l1", "flow"])
def checkpoint(request, tmp_path_factory) -> Path:
    out = tmp_path_factory.mktemp("learner")
    recipe, known = tiny(loss=request.param, history=3, history_stride=2), made_up().vocabulary
    torch.manual_seed(0)
    network = ObjectsNetwork(recipe, known)
    write_checkpoint(out / "checkpoint.safetensors", network.state_dict(), Trained(recipe, known, 12, "none"))
    return out


def played(address: str, steps: int = 7) -> np.ndarray:
    task = get_task(TRIAL.task)
    scene = Scene(task, task.training[0], seed=0, action_space=EE_DELTA, quality=quality_preset("fast"))
    policy, state, actions = make_learned(read_address(address), scene.condition.instruction.text, 0), scene.reset(), []
    for _ in range(steps):
        actions.append(policy.act_on_state(state))
        assert np.array_equal(policy.act_on_state(state), actions[-1])
        scene.step(actions[-1])
        state = scene.state()
    return np.array(actions)


def test_the_same_checkpoint_acts_the_same(checkpoint):
    first = played(f"learned:{checkpoint}")
    assert np.array_equal(first, played(f"learned:{checkpoint}/checkpoint.safetensors"))
    assert np.abs(first).max() <= 1.0
    looking = played(f"learned:{checkpoint}?execute=1")
    assert np.array_equal(first[0], looking[0])
    assert not np.array_equal(first, looking)
    served = ShadowSimulation(f"learned:{checkpoint}", TRIAL)
    assert np.array_equal(first, served.actions(0, 7))


def test_what_is_made_of_words_alone_is_kept_and_changes_no_bit(checkpoint, seeing, monkeypatch):
    monkeypatch.setattr("betterbench.policies.learned.policy.KEPT_INSTRUCTIONS", 2)
    draw = np.random.default_rng(0)
    for path in (checkpoint, seeing):
        learner, fresh = (Learner.load(path / "checkpoint.safetensors") for _ in range(2))
        for word in (1, 2, 3, 1, 2, 1):  # the first is forgotten at the third
            shown = something(learner, draw, words=np.array([word, 2, 0]))
            kept, heard = learner.chunk(shown, 5), fresh.network.hear(shown.words)
            fresh._heard.clear()
            assert np.array_equal(kept, fresh.chunk(shown, 5))
            noise = learner.batch(np.zeros((learner.network.chunk, 7), np.float32))
            with torch.inference_mode():
                assert torch.equal(learner.network.answer(shown, noise), learner.network.answer(shown, noise, heard))
        assert len(learner._heard) == 2


def something(learner: Learner, draw: np.random.Generator, *, words: np.ndarray) -> ShownBatch:
    recipe, batch = learner.trained.recipe, learner.batch
    common = {"words": batch(words), "tools": batch(draw.random((recipe.history, 10), np.float32))}
    if recipe.family == "pixels":
        size = recipe.eyes.size
        pictures = draw.integers(0, 256, (len(recipe.eyes.windows), size, size, 3), dtype=np.uint8)
        return PicturesBatch(**common, pictures=batch(pictures))
    return ObjectsBatch(
        **common,
        poses=batch(draw.random((2, 9), np.float32)),
        sizes=batch(draw.random((2, 3), np.float32)),
        categories=batch(np.array([1, 2])),
        colors=batch(np.array([1, 1])),
    )


def test_the_fingerprint_is_told(checkpoint):
    info = learned_info(read_address(f"learned:{checkpoint}"))
    assert info.metadata["checkpoint"].startswith("sha256 ")
    assert not info.needs_images


@pytest.mark.parametrize(
    ("options", "error"),
    [("?execute=0", InvalidInputError), ("?execute=5", InvalidInputError), ("?speed=1", UnknownNameError)],
)
def test_a_wrong_option_is_refused(checkpoint, options, error):
    with pytest.raises(error):
        learned_info(read_address(f"learned:{checkpoint}{options}"))


def test_a_scale_that_is_not_finite_is_refused(tmp_path):
    recipe, known = tiny(), made_up().vocabulary
    weights = ObjectsNetwork(recipe, known).state_dict()
    weights["tool_mean"][0] = float("nan")
    write_checkpoint(tmp_path / "checkpoint.safetensors", weights, Trained(recipe, known, 12, "none"))
    with pytest.raises(InvalidInputError, match=r"not finite \(tool_mean\)"):
        learned_info(read_address(f"learned:{tmp_path}"))


@pytest.mark.parametrize("address", ["learned:", "learned:/nowhere/at/all"])
def test_a_checkpoint_that_is_not_there_is_one_line(address, capsys):
    assert main(["eval", "--policy", address, "--out", "/nowhere/run"]) == 2
    assert "Traceback" not in capsys.readouterr().err


@pytest.fixture(scope="module")
def seeing(tmp_path_factory) -> Path:
    """A checkpoint that looks at the wrist's camera alone."""
    out = tmp_path_factory.mktemp("seeing")
    recipe = tiny(**{**PIXELS, "eyes": {"views": ["wrist"], "size": 16}}, history=2, history_stride=4)
    known = made_up().vocabulary
    torch.manual_seed(0)
    network = new_network(recipe, known)
    write_checkpoint(out / "checkpoint.safetensors", network.state_dict(), Trained(recipe, known, 12, "none"))
    return out


def test_a_checkpoint_that_is_not_there_is_said_before_a_client_comes(tmp_path):
    with pytest.raises(InvalidInputError, match=r"checkpoint.safetensors: cannot be read"):
        open_server(f"learned:{tmp_path}", port=0)


def test_a_learner_of_pixels_sees_observations_of_its_cameras(seeing, checkpoint):
    address = f"learned:{seeing}"
    assert is_seeing(read_address(address))
    assert not needs_of(address).state
    assert needs_of(f"learned:{checkpoint}").state
    assert not is_seeing(read_address("learned:/nowhere"))
    info = learned_info(read_address(address))
    assert (info.needs_images, info.cameras, info.execution.horizon) == (True, ("wrist",), 2)
    assert observation_spec("default").only(info.cameras).cameras == (CameraSpec("wrist"),)


def test_a_learner_of_pixels_answers_the_same_to_the_same(seeing):
    task = get_task(TRIAL.task)
    scene = Scene(task, task.training[0], seed=0, action_space=EE_DELTA, quality=quality_preset("fast"))
    state, observer = scene.reset(), Observer(observation_spec("state_only"))
    draw = np.random.default_rng(0)
    pictures = {"wrist": draw.integers(0, 256, (256, 256, 3), dtype=np.uint8)}
    seen = dataclasses.replace(observer.observe(scene, state), images=pictures)
    answers = []
    for policy in (
        make_seeing(read_address(f"learned:{seeing}")),
        make_seeing(read_address(f"learned:{seeing}?execute=4")),
    ):
        policy.reset(EpisodeStart(scene.condition.instruction.text, 5, "ee_delta"))
        answers.append(policy.act(seen))
        policy.act(dataclasses.replace(seen, step=4))
        policy.reset(EpisodeStart(scene.condition.instruction.text, 5, "ee_delta"))
        assert np.array_equal(policy.act(seen), answers[-1])
    assert answers[0].shape == (4, 7)
    assert np.array_equal(*answers)


def test_a_served_learner_of_pixels_asks_for_its_cameras_and_answers_the_same(seeing):
    task = get_task(TRIAL.task)
    scene = Scene(task, task.training[0], seed=0, action_space=EE_DELTA, quality=quality_preset("fast"))
    state, observer = scene.reset(), Observer(observation_spec("state_only"))
    pictures = {"wrist": np.random.default_rng(0).integers(0, 256, (256, 256, 3), dtype=np.uint8)}
    seen = dataclasses.replace(observer.observe(scene, state), images=pictures)
    start = EpisodeStart(scene.condition.instruction.text, 5, "ee_delta")
    direct = make_seeing(read_address(f"learned:{seeing}"))
    direct.reset(start)
    with open_server(f"learned:{seeing}", port=0) as server:
        client = make_policy(f"openpi://127.0.0.1:{server.port}")
        try:
            assert (client.info.cameras, client.info.execution.horizon) == (("wrist",), 2)
            client.reset(start)
            assert np.array_equal(client.act(seen), direct.act(seen))
        finally:
            client.close()


def test_pictures_of_another_observation_are_refused(seeing):
    with pytest.raises(InvalidInputError, match="--observation default"), PolicyFactory(f"learned:{seeing}") as made:
        made.check("ee_delta", "official")
    with pytest.raises(InvalidInputError, match="history_stride"):
        make_seeing(read_address(f"learned:{seeing}?execute=3"))


@pytest.mark.slow
def test_the_doctor_shows_a_learner_of_pixels_what_it_asks_for(seeing):
    found = run_preflight(f"learned:{seeing}", TRIAL, quality="fast")
    assert [shown.key for shown in found.shown] == ["wrist"]
    assert found.actions.shape == (4, 7)


@pytest.mark.slow
def test_a_learner_of_pixels_is_evaluated_to_the_same_records(seeing, tmp_path):
    for name in ("one", "two"):
        words = ["--tasks", TRIAL.task, "--variations", "L1", "--trials", "1", "--quality", "fast"]
        assert main(["eval", "--policy", f"learned:{seeing}", *words, "--out", str(tmp_path / name)]) == 0
    files = [sorted(RunFolder.open(tmp_path / name).path.glob("records/*/*/*.parquet")) for name in ("one", "two")]
    assert files[0]
    assert [f.read_bytes() for f in files[0]] == [f.read_bytes() for f in files[1]]


@pytest.mark.slow
def test_it_is_evaluated_to_the_same_records(checkpoint, tmp_path):
    for name in ("one", "two"):
        words = ["--tasks", TRIAL.task, "--variations", "L1", "--trials", "1", "--out", str(tmp_path / name)]
        assert main(["eval", "--policy", f"learned:{checkpoint}", *words]) == 0
    files = [sorted(RunFolder.open(tmp_path / name).path.glob("records/*/*/*.parquet")) for name in ("one", "two")]
    assert files[0]
    assert [f.read_bytes() for f in files[0]] == [f.read_bytes() for f in files[1]]
