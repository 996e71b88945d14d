"""Recipe for training with LeRobot: a ``train_config.json`` for LeRobot's ``TrainPipelineConfig``.

The recipe supports several policy types. The fields are taken from huggingface/lerobot 0.4.4 and 0.6.1:
``configs/train.py``, ``configs/default.py`` and ``policies/*/configuration_*.py``. Only fields that exist in both
releases are written, except for policies that were added later.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from betterbench.demonstrations.recipes.recipe import Setting, given_or
from betterbench.demonstrations.recipes.trainer import (
    REAL_PRESET,
    TrainerSetup,
    Training,
    evaluation_lines,
    export_line,
    exposure,
    real_checks,
    real_evaluation,
    record_lines,
)
from betterbench.errors import InvalidInputError, UnknownNameError
from betterbench.quoting import shell_line

UPSTREAM = "huggingface/lerobot 0.6.1 (and 0.4.4)"
PRESET, VERSION = "lerobot", "v3.0"
LIBERO_DATA = "HuggingFaceVLA/libero"

_POLICIES: Mapping[str, Mapping[str, Any]] = {
    "act": {"chunk": ("chunk_size", 100), "executed": ("n_action_steps", 100), "lr": 1e-5},
    "diffusion": {"chunk": ("horizon", 64), "executed": ("n_action_steps", 32), "lr": 1e-4},
    "multi_task_dit": {"chunk": ("horizon", 32), "executed": ("n_action_steps", 24), "lr": 2e-5},
    "smolvla": {"chunk": ("chunk_size", 50), "executed": ("n_action_steps", 50), "lr": 1e-4},
    "pi0": {"chunk": ("chunk_size", 50), "executed": ("n_action_steps", 50), "lr": 2.5e-5},
    "pi05": {"chunk": ("chunk_size", 50), "executed": ("n_action_steps", 50), "lr": 2.5e-5},
}
_WEIGHTS = {"smolvla": "lerobot/smolvla_base", "pi0": "lerobot/pi0_base", "pi05": "lerobot/pi05_base"}
_DOWNSAMPLED = 8
"""Factor by which the diffusion policy downsamples its horizon, so the horizon must be a multiple of it.

It is 2 to the power of the number of ``down_dims`` (configuration_diffusion.py).
"""
_WITHOUT_LANGUAGE = ("act", "diffusion")


def lerobot_setup(training: Training) -> TrainerSetup:
    """Return the files and commands for training with LeRobot.

    Raises:
        UnknownNameError: If the policy type does not exist.
        InvalidInputError: If the recipe does not fit the policy type.
    """
    recipe, data, policy = training.recipe, training.only_data, training.policy
    if policy not in _POLICIES:
        raise UnknownNameError("LeRobot policy", policy, _POLICIES)
    if recipe.form.proprioception is False:
        raise InvalidInputError(
            "proprioception",
            "no known policy of LeRobot can be trained without observation.state",
            "Leave out the field proprioception, or use openpi",
        )
    settings = _settings(training)
    name = f"{recipe.name}_{policy}"
    start = "lerobot-train"
    if training.gpus > 1:
        start = f'accelerate launch --multi_gpu --num_processes={training.gpus} "$(which lerobot-train)"'
    is_real = recipe.benchmark == "real"
    commands = [("Export the demonstrations", export_line(data, "lerobot"))] if data.preset else []
    if is_real and data.frames is None:
        commands.append(("Record the demonstrations, in the environment of LeRobot", record_lines(data.place)))
    commands.append(("Train", f'{start} --config_path="$HERE/train_config.json"'))
    checks = [
        exposure(training),
        "LeRobot cannot mix several data sets; merge them into one first.",
    ]
    if training.gpus > 1:
        each = f"The batch is {training.batch_of_gpu} on each of {training.gpus} GPUs"
        checks.insert(1, f"{each}: batch_size applies to one process.")
    if is_real:
        checks += real_checks(data)
    if policy in _WITHOUT_LANGUAGE and is_real:
        checks.append(
            f"{policy} does not use the instruction: it can only distinguish the two tasks by the tablecloth."
        )
    elif policy in _WITHOUT_LANGUAGE:
        checks.append(f"{policy} does not use the instruction: export and train it per task (`better export --tasks`).")
    else:
        checks.append(f"{policy} loads a tokenizer or a backbone from the Hugging Face hub.")
    if policy == "multi_task_dit":
        checks.append("multi_task_dit requires LeRobot 0.5.1 or newer.")
    if policy in ("pi0", "pi05"):
        checks += [f"{number} is nearly constant: normalization amplifies it." for number in data.still]
    return TrainerSetup(
        "LeRobot",
        UPSTREAM,
        {"train_config.json": json.dumps(_nested(settings), indent=2) + "\n"},
        settings,
        tuple(commands),
        _evaluation(training, f"outputs/{name}/checkpoints/last"),
        tuple(checks),
    )


def _settings(training: Training) -> tuple[Setting, ...]:
    recipe, form, policy = training.recipe, training.recipe.form, training.policy
    known, data = _POLICIES[policy], training.only_data
    here = Setting("dataset.root", data.place, "ours", "folder of the data set")
    hub = not data.preset and data.place == LIBERO_DATA
    chunk, default = known["chunk"]
    executed, steps = known["executed"]
    # A policy with a horizon (diffusion) observes two steps, so the first action of its horizon is in the past.
    longest = (form.chunk or default) - (chunk == "horizon")
    if policy == "diffusion" and (form.chunk or default) % _DOWNSAMPLED:
        problem = f"diffusion halves its horizon three times, but {form.chunk} is not a multiple of {_DOWNSAMPLED}"
        raise InvalidInputError("chunk", problem, "Use a multiple of 8, or leave out the field")
    if longest < 1:
        raise InvalidInputError(
            "chunk", f"{policy} needs at least two steps", "Use a larger number, or leave out the field"
        )
    batch = recipe.setting("batch", "batch")
    rows = [
        Setting(
            "dataset.repo_id", data.place if hub else f"local/{data.name}", "ours", "a name; nothing is downloaded"
        ),
        *(() if hub else (here,)),
        Setting("policy.type", policy, "ours", "--policy"),
        Setting("policy.push_to_hub", False, "ours", "nothing is sent"),
        given_or(f"policy.{chunk}", form.chunk, default, "upstream", f"default of {policy}"),
        Setting(
            f"policy.{executed}",
            min(steps, longest),
            "upstream" if longest >= steps else "recipe",
            f"default of {policy}" if longest >= steps else "no more than the chunk",
        ),
        given_or("policy.optimizer_lr", form.learning_rate, known["lr"], "upstream", f"default of {policy}"),
        *_freezing(training),
    ]
    weights = training.weights or _WEIGHTS.get(policy)
    if weights is not None:
        told = "ours" if training.weights else "upstream"
        rows.append(Setting("policy.pretrained_path", weights, told, "initial weights"))  # type: ignore[arg-type]
    rows += [
        Setting(
            "batch_size", training.batch_of_gpu, batch.origin, f"{batch.where}: {batch.value} over {training.gpus}"
        ),
        recipe.setting("steps", "steps"),
        given_or("save_freq", form.save_every, recipe.save_every, "ours", ""),
        given_or("seed", form.seed, 1000, "upstream", "default"),
        Setting("num_workers", 4, "upstream", "default"),
        Setting("wandb.enable", False, "ours", "nothing is sent"),
        Setting("output_dir", f"outputs/{recipe.name}_{policy}", "ours", ""),
    ]
    return tuple(rows)


def _freezing(training: Training) -> tuple[Setting, ...]:
    policy = training.policy
    parts, origin, where = training.recipe.frozen_parts("lerobot")
    if parts is None:
        return ()
    frozen = set(parts)
    if frozen and policy not in ("smolvla", "pi05"):
        raise InvalidInputError(
            "frozen: lerobot",
            f"{policy} has no option to freeze parts of the model",
            "Leave out the field frozen, or use the policy pi05 or smolvla",
        )
    if frozen == {"language"}:
        problem = f"the language model of {policy} cannot be frozen separately"
        raise InvalidInputError("frozen: lerobot", problem, "Freeze both vision and language, only vision, or nothing")
    if policy not in ("smolvla", "pi05"):
        return ()
    return (
        Setting("policy.freeze_vision_encoder", "vision" in frozen, origin, where),
        Setting("policy.train_expert_only", "language" in frozen, origin, where),
    )


def _nested(settings: tuple[Setting, ...]) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for setting in settings:
        *path, last = setting.name.split(".")
        place = found
        for name in path:
            place = place.setdefault(name, {})
        place[last] = setting.value
    return found


def _evaluation(training: Training, checkpoint: str) -> str:
    if training.recipe.benchmark == "real":
        return real_evaluation(training.policy, f"lerobot:{checkpoint}?preset={REAL_PRESET}", training.only_data)
    on_libero = shell_line(["lerobot-eval", f"--policy.path={checkpoint}/pretrained_model", "--env.type=libero"])
    return evaluation_lines(
        training.recipe,
        training.only_data,
        address=f"lerobot:{checkpoint}",
        on_libero=f"# on LIBERO itself:\n{on_libero} --env.task=libero_spatial",
    )
