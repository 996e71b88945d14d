"""Runs where the real LeRobot is installed: reads our data sets with its reader, and trains on one.

``read FOLDER SET``: the items of ``FOLDER/SET`` are what ``FOLDER/SET.npz`` says. ``train FOLDER SET``: ACT for 20
steps, and the adapter that follows from its checkpoint is the preset of the data set. ``version``: of LeRobot.
"""

from __future__ import annotations

import contextlib
import os
import sys
from pathlib import Path

os.environ |= {"HF_HUB_OFFLINE": "1", "HF_DATASETS_OFFLINE": "1", "WANDB_MODE": "disabled", "TQDM_DISABLE": "1"}

with contextlib.suppress(ImportError):
    import torchvision_for_processors  # noqa: F401 - see torch_environment.py

import numpy as np

STEPS = 20


def read(folder: Path, name: str) -> None:
    import lerobot
    from lerobot.datasets.lerobot_dataset import LeRobotDataset

    os.environ["HF_DATASETS_CACHE"] = str(folder / "cache")
    dataset = LeRobotDataset(f"local/{name}", root=folder / name, video_backend="pyav")
    wanted = np.load(folder / f"{name}.npz")
    assert len(dataset) == len(wanted["action"])
    assert set(dataset.meta.stats) >= {"observation.state", "action", "observation.images.front"}
    worst = 0.0
    for i in wanted["rows"].tolist():
        item = dataset[i]
        np.testing.assert_array_equal(item["observation.state"].numpy(), wanted["observation.state"][i])
        np.testing.assert_array_equal(item["action"].numpy(), wanted["action"][i])
        assert item["task"] == str(wanted["task"][i])
        for camera in ("front", "wrist"):
            key = f"observation.images.{camera}"
            image = np.round(item[key].numpy().transpose(1, 2, 0) * 255.0).astype(int)
            worst = max(worst, float(np.abs(image - wanted[key][i]).mean()))
        if "subtask" in item:
            assert item["subtask"] == str(wanted["subgoal"][i])
        if "language_persistent" in item:
            assert item["language_persistent"][0]["content"] == str(wanted["subgoal"][0])
    assert worst <= float(wanted["most_error"]), worst
    chunk = LeRobotDataset(
        f"local/{name}", root=folder / name, video_backend="pyav", delta_timestamps={"action": [0.0, 0.05, 0.1]}
    )[0]
    np.testing.assert_array_equal(chunk["action"].numpy(), wanted["action"][:3])
    sys.stdout.write(f"lerobot {lerobot.__version__}: {len(dataset)} frames, largest mean error {worst:.2f}\n")


def train(folder: Path, name: str) -> None:
    from lerobot.scripts.lerobot_train import main

    sys.argv = [
        "lerobot-train",
        f"--dataset.repo_id=local/{name}",
        f"--dataset.root={folder / name}",
        "--dataset.video_backend=pyav",
        "--policy.type=act",
        "--policy.device=cpu",
        "--policy.push_to_hub=false",
        "--policy.pretrained_backbone_weights=null",
        "--policy.chunk_size=8",
        "--policy.n_action_steps=8",
        "--policy.dim_model=64",
        "--policy.dim_feedforward=128",
        "--policy.n_heads=4",
        "--policy.n_encoder_layers=1",
        f"--output_dir={folder / 'act'}",
        f"--steps={STEPS}",
        "--save_freq=20",
        "--log_freq=5",
        "--batch_size=2",
        "--num_workers=0",
        "--eval_freq=0",
        "--wandb.enable=false",
        "--seed=1",
    ]
    main()
    from betterbench.policies.clients.lerobot import load_lerobot
    from betterbench.policies.conventions.presets import preset
    from betterbench.policies.kinds import read_address

    policy = load_lerobot(read_address(f"lerobot:{folder / 'act/checkpoints/last'}?device=cpu"))
    derived, wanted = policy.adapter, preset("lerobot")
    assert (derived.views, derived.states, derived.answer) == (wanted.views, wanted.states, wanted.answer)
    sys.stdout.write(f"trained {STEPS} steps; the checkpoint's adapter is the preset lerobot\n")


def version(_folder: Path, _name: str) -> None:
    from importlib.metadata import version as version_of

    sys.stdout.write(version_of("lerobot") + "\n")


if __name__ == "__main__":
    {"read": read, "train": train, "version": version}[sys.argv[1]](Path(sys.argv[2]), sys.argv[3])
