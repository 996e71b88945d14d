"""Recipe for training GR00T N1.6.

The recipe consists of a modality configuration, the command that starts the training, and a copy of the checkpoint. The
complete backbone can be frozen in this copy.

The fields are taken from NVIDIA/Isaac-GR00T@15ce93d2 (N1.6): ``gr00t/configs/finetune_config.py`` and
``gr00t/experiment/launch_finetune.py``. The license of GR00T permits only research and evaluation.
"""

from __future__ import annotations

from typing import Any

from betterbench.demonstrations.export.layout import layout_of
from betterbench.demonstrations.export.lerobot_v21 import modality
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
from betterbench.quoting import ShellText, shell_line

UPSTREAM = "NVIDIA/Isaac-GR00T@15ce93d2530e6f31aa7fe1c999a25c5dff7045db"
PRESET, VERSION = "gr00t_new_embodiment", "v2.1"
_LIBERO = "examples/LIBERO"
_CALVIN = (
    "MODALITY_CONFIG is your Python file with the modalities of your conversion of CALVIN, registered for "
    "NEW_EMBODIMENT (better_modality.py of a recipe for BeTTER shows one)."
)
_OWN_FILE = ShellText('"$MODALITY_CONFIG"')
_JITTER = {"brightness": 0.3, "contrast": 0.4, "saturation": 0.5, "hue": 0.08}


def gr00t_setup(training: Training) -> TrainerSetup:
    """Return the files and commands for training GR00T. Raises InvalidInputError if GR00T cannot follow the recipe."""
    recipe, data = training.recipe, training.only_data
    _ = training.batch_of_gpu
    if recipe.form.proprioception is False:
        raise InvalidInputError(
            "proprioception",
            "GR00T cannot be trained without a state: with a state dropout of 1.0, the state would be missing in "
            "training but present in evaluation",
            "Write a constant state into the data and use the same constant in evaluation, or leave the field out",
        )
    parts, origin, where = recipe.frozen_parts("gr00t")
    frozen = parts or ()
    settings = _settings(training, frozen, origin, where)
    files = {"prepare_checkpoint.py": filled("prepare_checkpoint.txt"), "check_frozen.py": filled("check_frozen.txt")}
    if data.preset:
        files["better_modality.py"] = _modality_file(recipe.form.chunk or 16)
    values = {s.name: s.value for s in settings}
    top = values["config.json: tune_top_llm_layers"]
    out = values["--output-dir"]
    start = "python" if training.gpus == 1 else f"torchrun --nproc_per_node={training.gpus} --master_port=29500"
    commands = []
    if data.preset:
        commands.append(("Export the demonstrations", export_line(data, "lerobot-v2.1")))
    commands += [
        (
            "From Isaac-GR00T's folder: a copy of the checkpoint whose top layers are frozen too"
            if "language" in frozen
            else "From Isaac-GR00T's folder: a copy of the checkpoint",
            'python "$HERE/prepare_checkpoint.py" '
            + shell_line([training.weights or "GR00T-N1.6-3B", values["--base-model-path"], top]),
        ),
        ("Train", flag_lines(f"{start} gr00t/experiment/launch_finetune.py", _flags(settings))),
        (
            "What was trained, and what was frozen",
            'python "$HERE/check_frozen.py" '
            + shell_line([values["--base-model-path"], f"{out}/checkpoint-{recipe.steps}"]),
        ),
        (
            "Serve the last checkpoint",
            shell_line(["python", "gr00t/eval/run_gr00t_server.py", "--model-path", f"{out}/checkpoint-{recipe.steps}"])
            + f" --embodiment-tag {values['--embodiment-tag']} --port 5555",
        ),
    ]
    checks = (
        exposure(training),
        "Download the checkpoint first: huggingface-cli download nvidia/GR00T-N1.6-3B --local-dir GR00T-N1.6-3B",
        (
            "tune_llm False alone does not freeze the language model. Its top 4 layers are trained if the "
            "checkpoint's config.json contains tune_top_llm_layers 4, and the launcher has no flag to change this. "
            f"The copy says {top}; check_frozen.py compares the weights afterwards."
        ),
        *(() if data.preset or recipe.benchmark != "calvin" else (_CALVIN,)),
        "Freezing vision also freezes its connector to the language model.",
        "The published LIBERO recipes of NVIDIA differ: batch 640, 20,000 steps, and state dropout 0.8 for LIBERO-10.",
        *(f"{number} is nearly constant: normalization by its range amplifies it." for number in data.still),
    )
    return TrainerSetup("GR00T N1.6", UPSTREAM, files, settings, tuple(commands), _evaluation(training), checks)


def _settings(training: Training, frozen: tuple[str, ...], origin: Any, where: str) -> tuple[Setting, ...]:  # noqa: ANN401
    recipe, data, form = training.recipe, training.only_data, training.recipe.form
    ours = bool(data.preset)
    tag = "NEW_EMBODIMENT" if ours or recipe.benchmark == "calvin" else "LIBERO_PANDA"
    chunk = () if not ours else (given_or("delta_indices of the action", form.chunk, 16, "upstream", _LIBERO),)
    path, told = (own_file("better_modality.py"), "") if ours else (_OWN_FILE, "your file, see above")
    modality_path = () if tag != "NEW_EMBODIMENT" else (Setting("--modality-config-path", path, "ours", told),)
    top = 0 if "language" in frozen else 4
    told = "N1.6 trains the top 4 layers although tune_llm is False" if not top else "default of N1.6"
    return (
        Setting(
            "--base-model-path", f"checkpoints/GR00T-N1.6-3B-top{top}", "ours", "copy made by prepare_checkpoint.py"
        ),
        Setting("--dataset-path", data.place, "ours", "folder of the data set"),
        Setting("--embodiment-tag", tag, "upstream", "new robots" if tag == "NEW_EMBODIMENT" else _LIBERO),
        *modality_path,
        *chunk,
        Setting("--tune-visual", "vision" not in frozen, origin, where),
        Setting("--tune-llm", "language" not in frozen, origin, where),
        Setting("config.json: tune_top_llm_layers", top, origin, f"{where}; {told}" if where else told),
        Setting("--tune-projector", True, origin, where or "default"),
        Setting("--tune-diffusion-model", True, origin, where or "default"),
        Setting("--state-dropout-prob", 0.0, "upstream", "default"),
        recipe.setting("--global-batch-size", "batch"),
        recipe.setting("--max-steps", "steps"),
        given_or("--learning-rate", form.learning_rate, 1e-4, "upstream", "default"),
        Setting("--weight-decay", 1e-5, "upstream", "default"),
        Setting("--warmup-ratio", 0.05, "upstream", "default"),
        Setting("--color-jitter-params", _JITTER, "upstream", _LIBERO),
        given_or("--save-steps", form.save_every, recipe.save_every, "ours", "the last five checkpoints are kept"),
        Setting("--save-total-limit", 5, "upstream", "default"),
        Setting("--num-gpus", training.gpus, "ours", "--gpus"),
        Setting("--dataloader-num-workers", 4, "upstream", _LIBERO),
        Setting("--output-dir", f"outputs/{recipe.name}", "ours", ""),
    )


def _flags(settings: tuple[Setting, ...]) -> list[tuple[str, str]]:
    """Return the command-line flags for the settings, in the syntax of tyro, which the launcher uses to parse them."""
    found = []
    for setting in settings:
        if not setting.name.startswith("--"):
            continue
        if isinstance(setting.value, bool):
            found.append((setting.name if setting.value else setting.name.replace("--", "--no-", 1), ""))
        elif isinstance(setting.value, dict):
            found.append((setting.name, " ".join(f"{key} {value}" for key, value in setting.value.items())))
        else:
            found.append((setting.name, shell_line([setting.value])))
    return found


def _modality_file(chunk: int) -> str:
    found = modality(layout_of(PRESET))
    if found is None:
        raise InvalidInputError("preset", f"{PRESET} has columns that GR00T does not read", "Report this as a bug")
    (annotation,) = found["annotation"]
    actions = list(found["action"])
    texts = {"video": _quoted(found["video"]), "state": _quoted(found["state"]), "actions": _quoted(actions)}
    numbers = {"chunk": str(chunk), "count": str(len(actions))}
    return filled(
        "modality.txt", {"upstream": UPSTREAM} | texts | numbers | {"preset": PRESET, "annotation": annotation}
    )


def _quoted(names: Any) -> str:  # noqa: ANN401 - any collection of texts
    return "[" + ", ".join(f'"{name}"' for name in names) + "]"


def _evaluation(training: Training) -> str:
    return evaluation_lines(
        training.recipe,
        training.only_data,
        address=f"gr00t://localhost:5555?preset={PRESET}",
        on_libero="# on LIBERO itself: examples/LIBERO/README.md of Isaac-GR00T",
        libero_address="gr00t://localhost:5555?preset=gr00t_libero_panda_spatial",
    )
