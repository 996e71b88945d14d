"""Checkpoints that the real LeRobot makes and saves, loaded and evaluated by us.

Run by ``test_with_torch.py`` in an environment that has LeRobot; pytest does not collect this file by itself.
"""

from __future__ import annotations

import contextlib
import dataclasses
import json
import os
import shutil
import sys
import threading
import warnings

import numpy as np
import pytest

os.environ["HF_HUB_OFFLINE"] = "1"  # read when the package of the hub is imported

with contextlib.suppress(ImportError), warnings.catch_warnings():
    warnings.simplefilter("ignore")
    import torchvision_for_processors  # noqa: F401 - of the environment made by torch_environment.py

import torch
from lerobot.configs.policies import PreTrainedConfig
from lerobot.configs.types import FeatureType, NormalizationMode, PolicyFeature
from lerobot.envs.utils import preprocess_observation
from lerobot.policies.act.configuration_act import ACTConfig
from lerobot.policies.diffusion.configuration_diffusion import DiffusionConfig
from lerobot.policies.factory import get_policy_class, make_pre_post_processors
from lerobot.policies.smolvla.configuration_smolvla import SmolVLAConfig
from lerobot.policies.tdmpc.configuration_tdmpc import TDMPCConfig
from lerobot.policies.vqbet.configuration_vqbet import VQBeTConfig
from lerobot.policies.xvla.configuration_xvla import XVLAConfig
from safetensors.torch import load_file, save_file
from tokenizers import Tokenizer
from tokenizers.models import WordLevel
from tokenizers.pre_tokenizers import Whitespace
from transformers import (
    PreTrainedTokenizerFast,
    SmolVLMConfig,
    SmolVLMImageProcessor,
    SmolVLMProcessor,
    SmolVLMVideoProcessor,
)

from betterbench.errors import (
    BetterError,
    HandshakeError,
    InvalidInputError,
    MissingDependencyError,
    UnknownNameError,
)
from betterbench.evaluation import evaluate, make_plan
from betterbench.interface import BatchPolicy, EpisodeStart, Execution, Observation, observation_spec
from betterbench.policies.clients import checkpoint as checkpoint_module
from betterbench.policies.clients import lerobot as lerobot_module
from betterbench.policies.clients import lerobot_types
from betterbench.policies.factory import check_policy
from betterbench.policies.kinds import make_policy
from betterbench.policies.process import policy_process

START = EpisodeStart("pack the apple", 3, "ee_delta")
SIDE = 96
pytestmark = pytest.mark.filterwarnings("ignore")


def features(*, cameras=("front",), state=8, action=7, extra=None):
    inputs = {
        f"observation.images.{name}": PolicyFeature(type=FeatureType.VISUAL, shape=(3, SIDE, SIDE)) for name in cameras
    }
    inputs["observation.state"] = PolicyFeature(type=FeatureType.STATE, shape=(state,))
    outputs = {"action": PolicyFeature(type=FeatureType.ACTION, shape=(action,))}
    return {"input_features": {**inputs, **(extra or {})}, "output_features": outputs}


def statistics(config):
    """Return statistics that nobody would take for the identity."""
    draw = np.random.default_rng(5)
    found = {}
    for key, feature in {**config.input_features, **config.output_features}.items():
        shape = (3, 1, 1) if feature.type is FeatureType.VISUAL else feature.shape
        mean, std = draw.normal(0.3, 0.2, shape), draw.uniform(0.5, 2.0, shape)
        found[key] = {"mean": mean, "std": std, "min": mean - 2.0 * std, "max": mean + 2.0 * std}
        found[key] = {k: torch.as_tensor(v, dtype=torch.float32) for k, v in found[key].items()}
    return found


def save(config, folder):
    """Make a policy with random weights and save it as LeRobot's training does."""
    torch.manual_seed(11)
    policy = get_policy_class(config.type)(config)
    policy.save_pretrained(folder)
    for processor in make_pre_post_processors(config, dataset_stats=statistics(config)):
        processor.save_pretrained(folder)
    return folder


def act_config(**changes):
    small = {
        "chunk_size": 8,
        "n_action_steps": 6,
        "dim_model": 32,
        "n_heads": 2,
        "dim_feedforward": 32,
        "n_encoder_layers": 1,
        "n_vae_encoder_layers": 1,
        "latent_dim": 4,
        "pretrained_backbone_weights": None,
        "device": "cpu",
    }
    return ACTConfig(**{**small, **features(), **changes})


@pytest.fixture(scope="module")
def act(tmp_path_factory):
    return save(act_config(), tmp_path_factory.mktemp("act") / "pretrained_model")


@pytest.fixture(scope="module")
def diffusion(tmp_path_factory):
    config = DiffusionConfig(
        **features(),
        n_obs_steps=2,
        horizon=8,
        n_action_steps=4,
        down_dims=(16, 32),
        kernel_size=3,
        n_groups=4,
        diffusion_step_embed_dim=8,
        num_train_timesteps=4,
        num_inference_steps=2,
        spatial_softmax_num_keypoints=4,
        crop_shape=(84, 84),
        pretrained_backbone_weights=None,
        device="cpu",
        normalization_mapping=dict.fromkeys(("VISUAL", "STATE", "ACTION"), NormalizationMode.MIN_MAX),
    )
    return save(config, tmp_path_factory.mktemp("diffusion") / "pretrained_model")


def seen(step=0, seed=0, **changes):
    draw = np.random.default_rng(seed)
    given = {
        "instruction": "pack the apple",
        "step": step,
        "images": {name: draw.integers(0, 256, (SIDE, SIDE, 3), np.uint8) for name in ("front", "wrist")},
        "joint_positions": np.linspace(0.0, 0.6, 7),
        "joint_velocities": np.zeros(7),
        "ee_position": np.array([0.4, 0.1 * seed, 0.3]),
        "ee_quaternion": np.array([0.0, 1.0, 0.0, 0.0]),
        "gripper_width": 0.05,
        "depth": {},
        "masks": {},
    }
    return Observation(**{**given, **changes})


def as_lerobot_answers(folder, observation):
    """Return the chunk by LeRobot's own functions, in the order of its own evaluation."""
    config = PreTrainedConfig.from_pretrained(folder)
    policy = get_policy_class("act").from_pretrained(folder)
    before, after = make_pre_post_processors(config, pretrained_path=str(folder))
    state = [*observation.ee_position, np.pi, 0.0, 0.0, 0.025, -0.025]
    batch = preprocess_observation(
        {"pixels": {"front": observation.images["front"]}, "agent_pos": np.array(state, np.float32)}
    )
    batch["task"] = [observation.instruction]
    chunk = policy.predict_action_chunk(before(batch))
    return np.stack([after(chunk[:, i]).numpy()[0] for i in range(chunk.shape[1])])


def test_a_chunk_is_what_lerobot_itself_answers(act, capsys):
    policy = make_policy(f"lerobot:{act}")
    assert capsys.readouterr().out == ""
    for seed in range(3):
        ours = policy.act(seen(seed=seed))
        assert ours.shape == (8, 7)
        assert ours.dtype == np.float64
        assert np.allclose(ours, as_lerobot_answers(act, seen(seed=seed)), atol=1e-5)


def test_what_the_policy_says_about_itself(act):
    info = make_policy(f"lerobot:{act}").info
    assert info.heavy
    assert info.action_space == "ee_delta"
    assert info.execution == Execution(horizon=6)
    assert info.metadata["policy type"] == "act"
    assert info.metadata["device"] in ("cpu", "cuda", "mps")
    assert info.metadata["lerobot version"].startswith("0.")
    assert len(info.metadata["checkpoint"]) == len("sha256 ") + 64
    adapter = json.loads(info.metadata["adapter"])
    assert adapter["views"][0]["key"] == "observation.images.front"
    assert make_policy(f"lerobot:{act}?horizon=3").info.execution == Execution(horizon=3)
    assert make_policy(f"lerobot:{act.parent}").info.execution == info.execution


def test_an_answer_does_not_depend_on_who_is_asked_beside(act):
    policy = make_policy(f"lerobot:{act}")
    assert isinstance(policy, BatchPolicy)
    policy.reset(START)
    alone = [policy.act(seen(seed=seed)) for seed in range(4)]
    together = policy.act_batch([seen(seed=seed) for seed in range(4)])
    assert np.allclose(alone, together, atol=1e-5)
    assert not np.allclose(alone[0], alone[1], atol=1e-3)


def test_noise_is_drawn_for_each_observation_alone(act, monkeypatch):
    """The flow policies need gigabytes, so a policy that answers its noise stands in for them."""

    class Noisy:
        def predict_action_chunk(self, batch, noise):
            assert len(noise) == len(batch["observation.state"])
            return noise[:, :, :7]

    policy = make_policy(f"lerobot:{act}")
    for module in (checkpoint_module, lerobot_module):
        monkeypatch.setattr(module, "NOISE_TYPES", ("act",))
    monkeypatch.setattr(policy._checkpoint, "policy", Noisy())
    monkeypatch.setattr(policy._checkpoint.config, "max_action_dim", 32, raising=False)
    alone = [policy.act(seen(seed=seed)) for seed in range(3)]
    assert np.array_equal(alone, policy.act_batch([seen(seed=seed) for seed in range(3)]))
    assert not np.array_equal(alone[0], alone[1])
    assert not np.array_equal(alone[0], policy.act(seen(step=1)))


@pytest.fixture
def in_its_own_process(monkeypatch):
    """Lets the process of a policy import torchvision as this one did."""
    if "torchvision_for_processors" in sys.modules:
        start = policy_process._START.replace("import sys;", "import sys, torchvision_for_processors;")
        monkeypatch.setattr(policy_process, "_START", start)


@pytest.mark.usefixtures("in_its_own_process")
def test_one_short_trial_is_evaluated(act, tmp_path):
    address = f"lerobot:{act}"
    check_policy(address, action_space="ee_delta")
    plan = make_plan(address, tasks=["morning_coffee"], variations=["T1"], trials=1, quality="fast")
    plan = dataclasses.replace(plan, trials=tuple(t for t in plan.trials if t.variation == "T1"))
    run = evaluate(plan, tmp_path / "run")
    (entry,) = run.entries()
    assert (entry.status, entry.message) == ("done", None)
    record = run.read_record("morning_coffee", "T1", plan.trials[0].seed)
    assert record.outcome.termination in ("success", "failure", "step_limit")
    assert len(record.applied) > 20
    assert np.ptp(record.applied[1:], axis=0).max() > 0.0


def test_ensembling_of_the_checkpoint_becomes_ours(tmp_path):
    folder = save(act_config(temporal_ensemble_coeff=0.01, n_action_steps=1), tmp_path / "ensemble")
    policy = make_policy(f"lerobot:{folder}")
    assert policy.info.execution == Execution(ensemble=0.01)
    assert policy.act(seen()).shape == (8, 7)


@pytest.mark.parametrize("space", ["joint_position", "joint_delta", "ee_pose"])
def test_eight_numbers_mean_what_the_address_says(tmp_path, space):
    folder = save(act_config(**features(action=8)), tmp_path / "eight")
    with pytest.raises(InvalidInputError, match="the meaning of the"):
        make_policy(f"lerobot:{folder}")
    policy = make_policy(f"lerobot:{folder}?action_space={space}&state=joints")
    assert policy.info.action_space == space
    assert policy.act(seen()).shape == (8, 8)
    with pytest.raises(HandshakeError, match=space):
        policy.reset(START)


# ------------------------------------------------------------------------------------------------ policies with memory


def test_a_policy_with_memory_is_asked_at_every_step_and_shares_its_weights(diffusion):
    one, two = make_policy(f"lerobot:{diffusion}"), make_policy(f"lerobot:{diffusion}")
    assert not isinstance(one, BatchPolicy)
    assert one.info.heavy
    assert one.info.execution == Execution()

    def episode(policies):
        for policy in policies:
            policy.reset(START)
        return [[policy.act(seen(step, seed=100 * i + step)) for i, policy in enumerate(policies)] for step in range(9)]

    together, alone = episode([one, two]), episode([one])
    assert np.asarray(together).shape == (9, 2, 1, 7)
    assert np.allclose([a[0] for a in together], [a[0] for a in alone], atol=1e-5)
    assert not np.allclose([a[0] for a in together], [a[1] for a in together], atol=1e-3)
    shared = [set(map(id, p._policy.parameters())) for p in (one, two)]
    assert shared[0] == shared[1]


def test_a_new_episode_begins_without_the_last_one(diffusion):
    policy = make_policy(f"lerobot:{diffusion}")
    policy.reset(START)
    first = [policy.act(seen(step, seed=step)) for step in range(6)]
    policy.act(seen(6, seed=77))
    policy.reset(START)
    again = [policy.act(seen(step, seed=step)) for step in range(6)]
    assert np.array_equal(first, again)


def test_threads_do_not_disturb_each_other(diffusion):
    policies = [make_policy(f"lerobot:{diffusion}") for _ in range(3)]
    answers = [[] for _ in policies]

    def run(i):
        policies[i].reset(START)
        answers[i] = [policies[i].act(seen(step, seed=step)) for step in range(6)]

    threads = [threading.Thread(target=run, args=(i,)) for i in range(3)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert np.allclose(answers[0], answers[1], atol=1e-6)
    assert np.allclose(answers[0], answers[2], atol=1e-6)


def test_its_chunks_are_its_own_business(diffusion):
    with pytest.raises(InvalidInputError, match="Omit horizon"):
        make_policy(f"lerobot:{diffusion}?horizon=4")


# ------------------------------------------------------------------------------------------- what does not fit is named


def changed(act, tmp_path, change):
    folder = tmp_path / "changed"
    shutil.copytree(act, folder)
    change(folder)
    return folder


@pytest.mark.parametrize(
    ("options", "text"),
    [
        ("device=gpu", "device=gpu cannot be used"),
        ("device=cuda:99", "device=cuda:99 cannot be used"),
        ("preset=openpi_libero", "observation/image: the checkpoint declares nothing, the adapter an image of 224"),
        ("preset=openpi_libero", "observation.state: the checkpoint declares 8 numbers, the adapter nothing"),
        ("size=64", "the checkpoint declares an image of 96 x 96, the adapter an image of 64 x 64"),
        ("action_space=joint_delta", "action: the checkpoint declares 7 numbers, the adapter 8 numbers"),
        ("state=eef", "Did you mean 'ee'"),
        ("camera.observation.images.top=front", "camera.observation.images.top|observation.images.top"),
    ],
)
def test_options_that_do_not_fit_are_named(act, options, text):
    with pytest.raises(BetterError, match=text) as caught:
        make_policy(f"lerobot:{act}?{options}")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("given", "text"),
    [
        (features(state=14), "its observation.state has 14 numbers"),
        (features(cameras=("top",)), r"the camera for observation.images.top is unknown.*camera.observation"),
        (features(cameras=("wrist", "hand")), "the camera wrist would be used for several inputs"),
        (
            features(extra={"observation.environment_state": PolicyFeature(type=FeatureType.ENV, shape=(4,))}),
            "environment_state' has the type ENV",
        ),
    ],
)
def test_what_a_checkpoint_leaves_open_is_named(tmp_path, given, text):
    folder = save(act_config(**given), tmp_path / "open")
    with pytest.raises(InvalidInputError, match=text) as caught:
        make_policy(f"lerobot:{folder}")
    assert "\n" not in str(caught.value)


def test_an_unknown_image_is_named_by_the_address(tmp_path):
    folder = save(act_config(**features(cameras=("top", "wrist_cam"))), tmp_path / "top")
    policy = make_policy(f"lerobot:{folder}?camera.observation.images.top=front")
    assert policy.adapter.cameras == ("front", "wrist")
    with pytest.raises(HandshakeError, match="wrist"):
        policy.check(space="ee_delta", observation=observation_spec("state_only"), rate_hz=20.0)


def planted(folder):
    """Let a step of a processor be a call of any function, as LeRobot would make it."""
    file = folder / "policy_postprocessor.json"
    form = json.loads(file.read_text())
    form["steps"].insert(0, {"class": "os.system", "config": {"command": f"touch {folder}/was_run"}})
    file.write_text(json.dumps(form))


def test_code_that_a_checkpoint_names_is_run_only_if_it_is_trusted(act, tmp_path):
    folder = changed(act, tmp_path, planted)
    with pytest.raises(
        InvalidInputError, match=r"loading it would run code chosen by the checkpoint's author.*trust=true"
    ):
        make_policy(f"lerobot:{folder}")
    assert not (folder / "was_run").exists()
    with pytest.raises(InvalidInputError, match="LeRobot cannot load the checkpoint"):  # os.system makes no step
        make_policy(f"lerobot:{folder}?trust=true")
    assert (folder / "was_run").exists()


def claims(**fields):
    """Return a change of config.json to values that the weights do not have."""

    def change(folder):
        file = folder / "config.json"
        file.write_text(json.dumps({**json.loads(file.read_text()), **fields}))

    return change


@pytest.mark.parametrize(
    ("change", "text"),
    [
        (lambda f: (f / "policy_preprocessor.json").unlink(), "the normalization is unknown"),
        (lambda f: (f / "config.json").write_text("{"), "config.json cannot be read"),
        (lambda f: (f / "config.json").write_text("[]"), "has no policy type"),
        (
            lambda f: (f / "config.json").write_text('{"type": "no_such_type"}'),
            "type 'no_such_type' is not known to LeRobot",
        ),
        (lambda f: (f / "config.json").unlink(), "contains no config.json"),
        (lambda f: (f / "model.safetensors").write_bytes(b"\x00" * 64), "LeRobot cannot load the checkpoint"),
        (lambda f: (f / "model.safetensors").unlink(), "LeRobot cannot load the checkpoint"),
        (planted, "step 0 of policy_postprocessor.json names the class 'os.system'"),
        (claims(dim_model=20_000), r"a network with more than [\d,]+ parameters, but the weights file has only"),
        (claims(dim_feedforward=10**12), "LeRobot cannot load the checkpoint"),
        (claims(n_encoder_layers=10**9), r"a network with more than [\d,]+ parameters"),
        (
            claims(dim_model=2, dim_feedforward=1, n_encoder_layers=10**9),
            "a network with more than 100,000 weight tensors",
        ),
        (claims(chunk_size=10**9), "chunk_size in config.json is 1000000000, but at most 4096 is supported"),
    ],
)
def test_a_broken_checkpoint_is_one_clear_line(act, tmp_path, change, text):
    folder = changed(act, tmp_path, change)
    with pytest.raises(InvalidInputError, match=text) as caught:
        make_policy(f"lerobot:{folder}")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("target", ["/no/such/folder", "./nothing", "one_word"])
def test_a_checkpoint_that_is_not_there_is_named(target):
    with pytest.raises(InvalidInputError, match="does not exist"):
        make_policy(f"lerobot:{target}")


def test_a_checkpoint_that_cannot_be_fetched_is_one_clear_line():
    with pytest.raises(InvalidInputError, match="LeRobot cannot load the checkpoint") as caught:
        make_policy("lerobot:betterbench/no-such-checkpoint")
    assert "\n" not in str(caught.value)


def test_an_unknown_option_is_answered_with_the_closest(act):
    with pytest.raises(UnknownNameError, match="Did you mean 'device'"):
        make_policy(f"lerobot:{act}?devise=cpu")


# ------------------------------------------------------------------------------------------------ the types of policies


def vqbet_config():
    return VQBeTConfig(
        **features(),
        n_obs_steps=2,
        n_action_pred_token=2,
        action_chunk_size=3,
        crop_shape=(84, 84),
        pretrained_backbone_weights=None,
        spatial_softmax_num_keypoints=4,
        gpt_input_dim=32,
        gpt_output_dim=32,
        gpt_hidden_dim=32,
        gpt_n_layer=1,
        gpt_n_head=2,
        vqvae_n_embed=4,
        vqvae_embedding_dim=16,
        vqvae_enc_hidden_dim=16,
        device="cpu",
    )


def tdmpc_config():
    # LeRobot 0.4.4 itself plays a TD-MPC only if its image has this name.
    given = features()
    inputs = given["input_features"]
    given["input_features"] = {"observation.image": inputs.pop("observation.images.front"), **inputs}
    return TDMPCConfig(
        **given,
        horizon=2,
        n_action_steps=1,
        image_encoder_hidden_dim=8,
        state_encoder_hidden_dim=16,
        latent_dim=8,
        mlp_dim=16,
        n_gaussian_samples=8,
        n_pi_samples=2,
        n_elites=4,
        cem_iterations=1,
        device="cpu",
    )


def tokenizer_in(folder):
    """Write a tokenizer with a handful of words, in place of one that would be fetched."""
    special = {
        "fake_image_token": "<fake>",
        "image_token": "<image>",
        "global_image_token": "<global>",
        "end_of_utterance_token": "<end>",
    }
    words = ["<pad>", "<s>", "</s>", "<unk>", *special.values(), "pack", "the", "apple"]
    named = {"pad_token": "<pad>", "bos_token": "<s>", "eos_token": "</s>", "unk_token": "<unk>"}
    made = Tokenizer(WordLevel({word: i for i, word in enumerate(words)}, named["unk_token"]))
    made.pre_tokenizer = Whitespace()
    tokenizer = PreTrainedTokenizerFast(tokenizer_object=made, **named, extra_special_tokens=special)
    tokenizer.save_pretrained(folder)
    return tokenizer


def smolvla_config(folder):
    text = {"vocab_size": 64, "hidden_size": 32, "intermediate_size": 64, "num_hidden_layers": 2, "head_dim": 16}
    text |= {"model_type": "llama", "num_attention_heads": 2, "num_key_value_heads": 2, "pad_token_id": 0}
    vision = {"hidden_size": 32, "intermediate_size": 64, "num_hidden_layers": 1, "num_attention_heads": 2}
    vision |= {"image_size": 64, "patch_size": 16}
    SmolVLMConfig(text_config=text, vision_config=vision, image_token_id=5, scale_factor=2).save_pretrained(folder)
    parts = {"image_processor": SmolVLMImageProcessor(), "video_processor": SmolVLMVideoProcessor()}
    SmolVLMProcessor(tokenizer=tokenizer_in(folder), image_seq_len=4, **parts).save_pretrained(folder)
    return SmolVLAConfig(
        **features(),
        vlm_model_name=str(folder),
        num_vlm_layers=2,
        load_vlm_weights=False,
        chunk_size=8,
        n_action_steps=4,
        num_steps=2,
        resize_imgs_with_padding=(64, 64),
        device="cpu",
    )


def xvla_config(folder):
    tokenizer_in(folder)
    text = {"vocab_size": 64, "d_model": 32, "encoder_layers": 1, "decoder_layers": 1, "max_position_embeddings": 128}
    text |= {
        f"{side}_{name}": n for side in ("encoder", "decoder") for name, n in (("attention_heads", 2), ("ffn_dim", 32))
    }
    vision = {
        "model_type": "davit",
        "dim_embed": [16, 16, 16, 32],
        "num_heads": [1, 1, 1, 2],
        "num_groups": [1, 1, 1, 2],
    }
    vision |= {"depths": [1, 1, 1, 1], "patch_size": [7, 3, 3, 3], "patch_stride": [4, 2, 2, 2], "window_size": 12}
    vision |= {"patch_padding": [3, 1, 1, 1], "patch_prenorm": [False, True, True, True], "projection_dim": 32}
    vision |= {"visual_temporal_embedding": {"type": "COSINE", "max_temporal_embeddings": 100}}
    vision |= {"image_pos_embed": {"type": "learned_abs_2d", "max_pos_embeddings": 50}}
    vision |= {"image_feature_source": ["spatial_avg_pool", "temporal_avg_pool"]}
    return XVLAConfig(
        **features(),
        florence_config={"text_config": text, "vision_config": vision, "projection_dim": 32, "vocab_size": 64},
        tokenizer_name=str(folder),
        tokenizer_max_length=16,
        resize_imgs_with_padding=(224, 224),
        hidden_size=32,
        depth=1,
        num_heads=2,
        len_soft_prompts=2,
        num_denoising_steps=2,
        action_mode="auto",
        chunk_size=8,
        n_action_steps=4,
        device="cpu",
    )


def with_every_weight(folder):
    """Draw the weights that a model of this make leaves as the memory was (X-VLA's image projection)."""
    file = folder / "model.safetensors"
    weights = load_file(file)
    torch.manual_seed(3)
    for name in ("model.vlm.image_projection",):
        weights[name] = 0.02 * torch.randn_like(weights[name])
    save_file(weights, file, metadata={"format": "pt"})
    return folder


@pytest.mark.parametrize("make", [vqbet_config, tdmpc_config])
def test_types_with_a_memory_are_asked_at_every_step(tmp_path, make):
    folder = save(make(), tmp_path / "pretrained_model")
    answers = []
    for _ in range(2):
        policy = make_policy(f"lerobot:{folder}")
        policy.reset(START)
        answers.append([policy.act(seen(step=step, seed=step)) for step in range(3)])
    assert np.shape(answers) == (2, 3, 1, 7)
    assert np.isfinite(answers).all()
    assert np.allclose(*answers)
    assert policy.info.metadata["policy type"] == make().type


def test_a_small_smolvla_answers_chunks_to_many_at_once(tmp_path):
    folder = save(smolvla_config(tmp_path / "backbone"), tmp_path / "pretrained_model")
    policy = make_policy(f"lerobot:{folder}")
    assert isinstance(policy, BatchPolicy)
    policy.reset(START)
    alone = [policy.act(seen(seed=seed)) for seed in range(3)]
    together = policy.act_batch([seen(seed=seed) for seed in range(3)])
    assert np.shape(alone) == (3, 8, 7)
    assert np.allclose(alone, together, atol=1e-4)
    assert not np.allclose(alone[0], alone[1], atol=1e-3)


def test_a_small_x_vla_is_asked_at_every_step(tmp_path):
    folder = with_every_weight(save(xvla_config(tmp_path / "tokenizer"), tmp_path / "pretrained_model"))
    answers = []
    for _ in range(2):
        policy = make_policy(f"lerobot:{folder}")
        policy.reset(START)
        answers.append([policy.act(seen(step=step)) for step in range(2)])
    assert np.shape(answers) == (2, 2, 1, 7)
    assert np.isfinite(answers).all()
    assert np.allclose(*answers)


@pytest.mark.parametrize(
    ("kind", "text"),
    [
        ("wall_x", r"type wall_x, which needs .*qwen_vl_utils\. Run: .*pip install .*'lerobot\[wallx\]'"),
        ("groot", r"type groot, which needs peft, timm\. Run: .*pip install .*'lerobot\[groot\]'"),
    ],
)
def test_a_type_whose_packages_are_missing_names_its_extra(act, tmp_path, kind, text):
    folder = changed(act, tmp_path, lambda f: (f / "config.json").write_text(json.dumps({"type": kind})))
    with pytest.raises(MissingDependencyError, match=text):
        make_policy(f"lerobot:{folder}")


def test_an_extra_that_this_release_lacks_is_not_advised(act, tmp_path, monkeypatch):
    monkeypatch.setitem(lerobot_types.POLICY_TYPES, "pi0", lerobot_types.Needs("pi", ("no_such_module",)))
    folder = changed(act, tmp_path, lambda f: (f / "config.json").write_text('{"type": "pi0"}'))
    with pytest.raises(
        MissingDependencyError,
        match=r"LeRobot 0\.4\.4 has no extra for this policy type\. Install lerobot\[pi\] of LeRobot 0\.6",
    ):
        make_policy(f"lerobot:{folder}")


@pytest.mark.parametrize("kind", ["sarm", "reward_classifier"])
def test_a_reward_model_is_not_a_policy(act, tmp_path, kind):
    folder = changed(act, tmp_path, lambda f: (f / "config.json").write_text(json.dumps({"type": kind})))
    with pytest.raises(InvalidInputError, match=f"{kind} is a reward model, which does not return actions"):
        make_policy(f"lerobot:{folder}")


def test_every_type_of_this_release_is_described():
    known = set(PreTrainedConfig.get_known_choices()) - set(lerobot_types.REWARD_MODELS)
    assert known - {"sac"} <= set(lerobot_types.POLICY_TYPES)
