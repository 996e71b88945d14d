"""In the environment of the real LeRobot: its TrainPipelineConfig, and the scripts that need PyTorch."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from betterbench.demonstrations.recipes import recipe_of, setup_files, trainer_setup

sys.path.insert(0, str(Path(__file__).parents[2] / "policies"))
from torch_environment import NoTorchError, run_in_torch

pytestmark = pytest.mark.slow

FORMS = {
    "plain": "better",
    "libero": "libero",
    "real": "real_arm",
    "whole": {"chunk": 16, "learning_rate": 1e-4, "frozen": {"lerobot": []}, "save_every": 1000, "seed": 3},
}
POLICIES = ("act", "diffusion", "smolvla", "pi0", "pi05")


MAKE = """
import sys, torch
from pathlib import Path
from safetensors.torch import save_file
here = Path(sys.argv[1])
old = {"model.llm.layer.w": torch.ones(3), "head.out.w": torch.ones(2), "gone.a.w": torch.ones(1)}
new = {"model.llm.layer.w": torch.ones(3).bfloat16(), "head.out.w": torch.zeros(2)}
for name, tensors in (("before", old), ("after", new)):
    (here / name).mkdir()
    save_file(tensors, here / name / "model.safetensors")
"""


def test_what_training_changed_is_found(tmp_path):
    script = tmp_path / "check_frozen.py"
    script.write_text(trainer_setup("gr00t", recipe_of(), ("sets/demos",)).files["check_frozen.py"])
    try:
        made = run_in_torch("-c", MAKE, str(tmp_path), timeout_s=1800.0)
        assert made.returncode == 0, made.stderr
        done = run_in_torch(str(script), str(tmp_path / "before"), str(tmp_path / "after"), timeout_s=1800.0)
    except NoTorchError as error:
        pytest.skip(str(error))
    assert [line.split() for line in done.stdout.splitlines()] == [
        *(
            ["1", "of", "1", "tensors", "changed", "head.out.w"],
            ["0", "of", "1", "tensors", "changed", "model.llm.layer"],
        ),
        ["1", "tensors", "are", "in", "one", "checkpoint", "only"],
    ]


def test_lerobot_reads_every_recipe(tmp_path):
    files = []
    for name, form in FORMS.items():
        for policy in POLICIES:
            setup = trainer_setup("lerobot", recipe_of(form), ("sets/demos",), policy=policy)
            file = tmp_path / f"{name}_{policy}" / "train_config.json"
            file.parent.mkdir()
            file.write_text(setup_files(setup, recipe_of(form))["train_config.json"])
            files.append(str(file))
    frozen = recipe_of({"frozen": {"lerobot": ["vision", "language"]}})
    (tmp_path / "frozen").mkdir()
    file = tmp_path / "frozen/train_config.json"
    file.write_text(trainer_setup("lerobot", frozen, ("sets/demos",)).files["train_config.json"])
    try:
        done = run_in_torch(str(Path(__file__).parent / "lerobot_parse.py"), *files, str(file), timeout_s=1800.0)
    except NoTorchError as error:
        pytest.skip(str(error))
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-4000:]
    assert done.stdout.count("lerobot ") == len(files) + 1
