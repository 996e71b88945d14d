"""Runs where the real LeRobot is installed: its TrainPipelineConfig reads the files that are named, and agrees."""

from __future__ import annotations

import contextlib
import json
import os
import sys
from pathlib import Path

os.environ |= {"HF_HUB_OFFLINE": "1", "HF_DATASETS_OFFLINE": "1"}

with contextlib.suppress(ImportError):
    import torchvision_for_processors  # noqa: F401 - see torch_environment.py

import lerobot
import lerobot.policies  # the types of policies
from lerobot.configs.train import TrainPipelineConfig


def compare(found: object, wanted: object, path: str) -> None:
    if isinstance(wanted, dict):
        for name, value in wanted.items():
            compare(found[name] if isinstance(found, dict) else getattr(found, name), value, f"{path}.{name}")
    else:
        assert found == wanted or str(found) == str(wanted), f"{path}: {found!r} is not {wanted!r}"


for file in map(Path, sys.argv[1:]):
    sys.argv = ["lerobot-train", f"--config_path={file}"]
    config = TrainPipelineConfig.from_pretrained(file, cli_args=[])
    config.validate()
    compare(config, json.loads(file.read_text()), file.parent.name)
    assert config.optimizer.lr == config.policy.optimizer_lr
    sys.stdout.write(f"lerobot {lerobot.__version__}: {file.parent.name} {config.policy.type}\n")
