"""Names and types of the fields of trainers that no package index holds, as facts of the commits that recipes name.

A configuration that names another field, or gives a value of another type, fails in the parser built from them.
"""

from __future__ import annotations

import argparse
import dataclasses
import sys
import types
from enum import Enum
from pathlib import Path
from typing import Any, Literal

import pytest

REQUIRED = dataclasses.MISSING

# Physical-Intelligence/openpi@15a9616a: src/openpi/training/config.py, models/pi0_config.py, training/optimizer.py
OPENPI: dict[str, tuple[str, ...]] = {
    "TrainConfig": (
        *("name", "project_name", "exp_name", "model", "weight_loader", "pytorch_weight_path"),
        *("pytorch_training_precision", "lr_schedule", "optimizer", "ema_decay", "freeze_filter", "data"),
        *("assets_base_dir", "checkpoint_base_dir", "seed", "batch_size", "num_workers", "num_train_steps"),
        *("log_interval", "save_interval", "keep_period", "overwrite", "resume", "wandb_enabled", "policy_metadata"),
        "fsdp_devices",
    ),
    "DataConfig": (
        *("repo_id", "asset_id", "norm_stats", "repack_transforms", "data_transforms", "model_transforms"),
        *("use_quantile_norm", "action_sequence_keys", "prompt_from_task", "rlds_data_dir", "action_space", "datasets"),
    ),
    "SimpleDataConfig": ("repo_id", "assets", "base_config", "data_transforms", "model_transforms"),
    "LeRobotLiberoDataConfig": ("repo_id", "assets", "base_config", "extra_delta_transform"),
    "Pi0Config": (
        *("dtype", "paligemma_variant", "action_expert_variant", "action_dim", "action_horizon", "max_token_len"),
        *("pi05", "discrete_state_input"),
    ),
    "CosineDecaySchedule": ("warmup_steps", "peak_lr", "decay_steps", "decay_lr"),
    "AdamW": ("b1", "b2", "eps", "weight_decay", "clip_gradient_norm"),
    "CheckpointWeightLoader": ("params_path",),
}


class EmbodimentTag(Enum):
    """NVIDIA/Isaac-GR00T@15ce93d2: gr00t/data/embodiment_tags.py, as far as recipes name it."""

    LIBERO_PANDA = "libero_panda"
    NEW_EMBODIMENT = "new_embodiment"


# gr00t/configs/finetune_config.py of the same commit
GR00T: tuple[tuple[str, Any, Any], ...] = (
    ("base_model_path", str, REQUIRED),
    ("dataset_path", str, REQUIRED),
    ("embodiment_tag", EmbodimentTag, REQUIRED),
    ("modality_config_path", str | None, None),
    ("tune_llm", bool, False),
    ("tune_visual", bool, False),
    ("tune_projector", bool, True),
    ("tune_diffusion_model", bool, True),
    ("state_dropout_prob", float, 0.0),
    ("random_rotation_angle", int | None, None),
    ("color_jitter_params", dict[str, float] | None, None),
    ("global_batch_size", int, 64),
    ("dataloader_num_workers", int, 2),
    ("learning_rate", float, 1e-4),
    ("gradient_accumulation_steps", int, 1),
    ("output_dir", str, "./outputs"),
    ("save_steps", int, 1000),
    ("save_total_limit", int, 5),
    ("num_gpus", int, 1),
    ("use_wandb", bool, False),
    ("max_steps", int, 10000),
    ("weight_decay", float, 1e-5),
    ("warmup_ratio", float, 0.05),
    ("shard_size", int, 1024),
    ("episode_sampling_rate", float, 0.1),
    ("num_shards_per_epoch", int, 100000),
)

# BeingBeyond/Being-H@594219ea: BeingH/train/train.py, and what it takes from the Hugging Face TrainingArguments
_WORDS = (
    "mllm_path",
    "expert_path",
    "layer_module",
    "attn_mode",
    "dataset_config_file",
    "prompt_template",
    "conv_style",
)
_WORDS += ("lr_scheduler", "resume_from", "output_dir", "logging_dir", "vit_path", "llm_path", "connector_arch")
_COUNTS = ("action_chunk_length", "max_view_num", "force_image_size", "prefetch_factor", "num_workers", "max_steps")
_COUNTS += ("expected_num_tokens", "max_num_tokens_per_sample", "max_num_tokens", "prefer_buffer_before", "save_steps")
_COUNTS += (
    "max_buffer_size",
    "gradient_accumulation_steps",
    "warmup_steps",
    "save_steps_start",
    "logging_steps",
    "seed",
)
_NUMBERS = ("down_sample_ratio", "vit_dropout_prob", "state_dropout_prob", "mpg_lambda", "min_lr", "learning_rate")
_NUMBERS += ("weight_decay", "warmup_ratio", "max_grad_norm")
_FLAGS = ("use_flow_matching", "use_fixed_view", "use_mpg", "freeze_mllm", "freeze_llm", "freeze_vit", "freeze_vit_mlp")
_FLAGS += ("resume_model_only", "auto_resume", "save_model_only", "save_merged_metadata")


def _truth(text: str) -> bool:
    return {"True": True, "False": False}[text]


def being_h_parser() -> argparse.ArgumentParser:
    """Returns a parser of its flags, as HfArgumentParser makes it of the three dataclasses."""
    parser = argparse.ArgumentParser(exit_on_error=False, allow_abbrev=False)
    for names, kind in ((_WORDS, str), (_COUNTS, int), (_NUMBERS, float), (_FLAGS, _truth)):
        for name in names:
            parser.add_argument(f"--{name}", type=kind)
    return parser


def gr00t_config() -> type:
    """Returns a dataclass with the fields of FinetuneConfig."""
    fields = [
        (name, kind) if default is REQUIRED else (name, kind, dataclasses.field(default=default))
        for name, kind, default in GR00T
    ]
    return dataclasses.make_dataclass("FinetuneConfig", fields)


def install(monkeypatch: pytest.MonkeyPatch, **modules: dict[str, Any]) -> None:
    """Puts modules with some names in the place of packages; ``__`` stands for a dot."""
    for name, content in modules.items():
        path = name.replace("__", ".").split(".")
        for depth in range(1, len(path) + 1):
            part = ".".join(path[:depth])
            if part not in sys.modules:
                monkeypatch.setitem(sys.modules, part, types.ModuleType(part))
            if depth > 1:
                setattr(sys.modules[".".join(path[: depth - 1])], path[depth - 1], sys.modules[part])
        vars(sys.modules[".".join(path)]).update(content)


def run_file(path: Path, name: str = "generated") -> dict[str, Any]:
    """Runs a generated file as a module and returns its names."""
    found: dict[str, Any] = {"__name__": name, "__file__": str(path)}
    exec(compile(path.read_text(), str(path), "exec"), found)  # noqa: S102 - what recipes write
    return found


def recorder(name: str) -> Any:
    """Returns a class that takes only the fields of an openpi class and keeps what it is given."""
    fields = OPENPI[name]

    def make(*given: Any, **named: Any) -> dict[str, Any]:
        unknown = set(named) - set(fields)
        assert not unknown, f"{name} has no field {unknown}"
        return {**dict(zip(fields, given, strict=False)), **named, "class": name}

    return make


Frozen = Literal["vision", "language"]
