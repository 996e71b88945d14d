"""Recipe for training Being-H0.5 with its own trainer.

The recipe consists of a data configuration and of settings for sequence packing. These settings determine the batch
size.

The fields are taken from BeingBeyond/Being-H@594219ea: ``BeingH/train/train.py`` (arguments),
``scripts/train/train_libero_example.sh`` (values), ``configs/data_config.py`` and ``configs/dataset_info.py``
(registries).
"""

from __future__ import annotations

import json
import math
from typing import Any

from betterbench.demonstrations.export.layout import layout_of
from betterbench.demonstrations.recipes.recipe import Setting, given_or
from betterbench.demonstrations.recipes.trainer import (
    TrainerSetup,
    Training,
    evaluation_lines,
    export_line,
    exposure,
    filled,
    flag_lines,
    own_file,
)
from betterbench.errors import InvalidInputError
from betterbench.quoting import shell_line

UPSTREAM = "BeingBeyond/Being-H@594219eaa16097b86d460b3e1040cca0fc4e4b98"
PRESET, VERSION = "being_h_libero", "v2.1"
_LIBERO, _CODE = "train_libero_example.sh", "default of train.py"
_COPY_BRIDGE = (
    'cp "$(python -c "import betterbench.policies.clients as p; print(p.__path__[0])")'
    '/bridges/being_h_bridge.py" "$HERE"\n'
)
_BRIDGE = (
    'BEING_H_PROMPT=... \\\n  PYTHONPATH="$PWD:$HERE" python "$HERE/being_h_bridge.py" better_being_h:make --port 8000'
)
_COLUMNS = (
    "The data need LIBERO's columns: observation.images.image and .wrist_image, observation.state (8: position, "
    "rotation vector, fingers) and action (7)."
)
_TOKENS = "appendix A.4: the batch by sequence packing; tokens of a sample are an estimate"


def being_h_setup(training: Training) -> TrainerSetup:
    """Return the files and commands for training Being-H.

    Raises InvalidInputError if Being-H cannot follow the recipe.
    """
    recipe = training.recipe
    if recipe.form.proprioception is False:
        raise InvalidInputError(
            "proprioception",
            "Being-H cannot be trained without a state: with a state dropout of 1.0, the state would be missing in "
            "training but present in evaluation",
            "Write a constant state into the data and use the same constant in evaluation, or leave the field out",
        )
    settings = _settings(training)
    values = {s.name: s.value for s in settings}
    group, ours = f"{recipe.name}_posttrain", bool(training.data[0].preset)
    files = {f"{recipe.name}.yaml": _yaml(training, group), "better_being_h.py": _module(training, group, ours=ours)}
    start = f'torchrun --nproc_per_node={training.gpus} "$HERE/better_being_h.py"'
    commands = []
    if ours:
        commands += [("Export the demonstrations", export_line(d, "lerobot-v2.1")) for d in training.data]
    flags = [(s.name, shell_line([s.value])) for s in settings if s.name.startswith("--")]
    commands += [
        ("From Being-H's folder (the folder that contains BeingH and configs): train", flag_lines(start, flags)),
        (
            "Serve the last checkpoint behind the bridge of betterbench",
            _COPY_BRIDGE + f'BEING_H_CHECKPOINT="$(ls -d {values["--output_dir"]}/*{recipe.steps})" ' + _BRIDGE,
        ),
    ]
    per_gpu = math.ceil(recipe.batch / training.gpus)
    checks = [
        exposure(training),
        (
            f"A GPU fills its sequence up to {values['--expected_num_tokens']} tokens: {per_gpu} samples of "
            f"{training.sample_tokens}, which is an estimate. Every 100 steps, the log shows num_gen (samples per "
            f"step on all GPUs). If it is not about {recipe.batch}, give --sample-tokens "
            f"{values['--expected_num_tokens']} * "
            f"{training.gpus} / num_gen and start again."
        ),
        _kept(values["--save_steps"], values["--save_steps_start"], recipe.steps),
        *(() if ours else (_COLUMNS,)),
        "The weight of the data is given explicitly, because the default of 0 would stop the run.",
        "freeze_llm would freeze the action expert too; use freeze_mllm to freeze the backbone.",
        "A resumed training starts again at the beginning of the data.",
        "BEING_H_PROMPT is the prompt template of Being-H's own evaluation script, which betterbench does not copy.",
    ]
    if training.gpus * per_gpu != recipe.batch:
        checks.append(f"{training.gpus} GPUs of {per_gpu} samples are {training.gpus * per_gpu}, not {recipe.batch}.")
    return TrainerSetup("Being-H0.5", UPSTREAM, files, settings, tuple(commands), _evaluation(training), tuple(checks))


def _settings(training: Training) -> tuple[Setting, ...]:
    recipe, form = training.recipe, training.recipe.form
    tokens = math.ceil(recipe.batch / training.gpus) * training.sample_tokens
    begun = 25_000 if form.save_every is None and recipe.steps > 25_000 else 0
    rows: list[tuple[str, Any, Any, str]] = [
        ("--mllm_path", "InternVL3_5-2B", "upstream", _LIBERO),
        ("--expert_path", "Qwen3-0.6B", "upstream", _LIBERO),
        ("--resume_from", training.weights or "Being-H05-2B", "ours" if training.weights else "upstream", _LIBERO),
        ("--resume_model_only", True, "upstream", _LIBERO),
        ("--layer_module", "Qwen3MoTDecoderLayer", "upstream", _LIBERO),
        ("--dataset_config_file", own_file(f"{recipe.name}.yaml"), "ours", ""),
        ("--expected_num_tokens", tokens, *_batch_source(training), _TOKENS),
        ("--max_num_tokens", tokens + training.sample_tokens, "ours", "one sample more"),
        (
            "--max_num_tokens_per_sample",
            tokens + training.sample_tokens,
            "ours",
            "as max_num_tokens, like upstream",
        ),
        ("--prefer_buffer_before", tokens // 2, "ours", "half of it, like upstream"),
        ("--max_buffer_size", 4, "upstream", _LIBERO),
        ("--attn_mode", "causal", "upstream", _LIBERO),
        ("--force_image_size", 224, "upstream", _LIBERO),
        ("--max_view_num", -1, "upstream", _LIBERO),
        ("--use_fixed_view", False, "upstream", _CODE),
        ("--down_sample_ratio", 0.5, "upstream", _LIBERO),
        ("--use_flow_matching", True, "upstream", f"{_LIBERO}; {_CODE} is False"),
        ("--use_mpg", True, "upstream", _LIBERO),
        ("--mpg_lambda", 0.1, "upstream", _LIBERO),
        ("--prompt_template", "long", "upstream", _LIBERO),
        ("--conv_style", "being_h0", "upstream", _LIBERO),
        ("--gradient_accumulation_steps", 1, "upstream", _LIBERO),
        ("--weight_decay", 1e-5, "upstream", _LIBERO),
        ("--warmup_ratio", 0.05, "upstream", f"{_LIBERO}; at most 2,000 steps"),
        ("--lr_scheduler", "cosine", "upstream", f"{_LIBERO}; to 1e-7"),
        ("--min_lr", 1e-7, "upstream", _CODE),
        ("--state_dropout_prob", 0.0, "upstream", _CODE),
        ("--save_merged_metadata", True, "upstream", "needed to serve the checkpoint"),
        ("--num_workers", 12, "upstream", _LIBERO),
        ("--logging_steps", 10, "upstream", _LIBERO),
    ]
    return (
        *(Setting(*row[:2], row[2], row[3]) for row in rows),
        recipe.setting("--max_steps", "steps"),
        given_or("--action_chunk_length", form.chunk, 16, "upstream", _LIBERO),
        given_or("--learning_rate", form.learning_rate, 1e-4, "upstream", _LIBERO),
        given_or("--seed", form.seed, 42, "upstream", "default of the Hugging Face trainer"),
        *_freezing(training),
        given_or("--save_steps", form.save_every, recipe.saved_every(10_000), "upstream", _LIBERO),
        Setting("--save_steps_start", begun, "upstream" if begun else "ours", "no checkpoint before"),
        Setting("--output_dir", f"outputs/{recipe.name}", "ours", ""),
        Setting("--logging_dir", f"outputs/{recipe.name}/tensorboard", "ours", ""),
    )


def _kept(every: int, start: int, steps: int) -> str:
    kept = [f"{step:,}" for step in range(every, steps + 1, every) if step > start]
    return (
        f"Checkpoints are kept at the steps {', '.join(kept)}." if len(kept) < 9 else f"Every {every:,} steps are kept."
    )


def _batch_source(training: Training) -> tuple[Any]:
    return (training.recipe.setting("batch", "batch").origin,)


def _freezing(training: Training) -> tuple[Setting, ...]:
    parts, origin, where = training.recipe.frozen_parts("being-h")
    frozen = set(parts or ())
    if frozen == {"language"}:
        raise InvalidInputError(
            "frozen: being-h",
            "the language model cannot be frozen separately: freeze_llm also freezes the action expert",
            "Freeze both vision and language, only vision, or nothing",
        )
    whole = frozen == {"vision", "language"}
    return (
        Setting("--freeze_mllm", whole, origin, where),
        Setting("--freeze_llm", False, "ours", "it would freeze the action expert too"),
        Setting("--freeze_vit", frozen == {"vision"}, origin, where),
        Setting(
            "--freeze_vit_mlp", whole, origin, f"{where}; connector between vision and language".removeprefix("; ")
        ),
    )


def _yaml(training: Training, group: str) -> str:
    ours = bool(training.data[0].preset)
    config, tag = ("better", "new_embodiment") if ours else ("libero_nonorm", "libero_franka_gripper")
    n = len(training.data)

    def block(name: str, values: list[object]) -> str:
        return f"  {name}:\n" + "".join(f"  - {value}\n" for value in values)

    return (
        f"# The data of {group}, for {UPSTREAM}\n{group}:\n"
        + block("dataset_names", [json.dumps(data.name) for data in training.data])
        + block("data_config_names", [config] * n)
        + block("embodiment_tags", [tag] * n)
        + "  sampling_strategy: step\n  video_backend: torchvision_av\n  stats_level: auto\n"
        + "  vit_transform_args:\n    type: beingh\n    normalize_type: imagenet\n    use_color_jitter: true\n"
        + block("frame_step_size", [1] * n)
        + "  weight: 1.0\n"
    )


def _module(training: Training, group: str, *, ours: bool) -> str:
    columns = {column.key[-1]: column.name for column in layout_of(PRESET).images}
    sources = "\n".join(f"            {key!r}: {name!r}," for key, name in columns.items())
    places = {data.name: {"dataset_path": data.place} for data in training.data}
    if len(places) < len(training.data):
        raise InvalidInputError("--data", "two data sets are in folders of the same name", "Rename one of the folders")
    own = (
        f'''
    class BetterDataConfig(data_config.LiberoNoNormDataConfig):
        """Our columns: those of LIBERO without normalization, but for the names of the images."""

        VIDEO_KEYS = {list(columns)!r}
        VIDEO_SOURCE_COLUMNS = {{
{sources}
        }}

    data_config.DATA_CONFIG_MAP["better"] = BetterDataConfig
'''
        if ours
        else ""
    )
    config, tag = ("better", "new_embodiment") if ours else ("libero_nonorm", "libero_franka_gripper")
    texts = {"places": places, "group": group, "config": config, "tag": tag}
    return filled(
        "being_h.txt", {"upstream": UPSTREAM} | {name: repr(value) for name, value in texts.items()} | {"own": own}
    )


def _evaluation(training: Training) -> str:
    return evaluation_lines(
        training.recipe,
        training.data[0],
        address=f"openpi://localhost:8000?preset={PRESET}",
        on_libero="# on LIBERO itself: BeingH/benchmark/libero of Being-H",
        libero_address="openpi://localhost:8000?preset=being_h_libero_spatial",
    )
