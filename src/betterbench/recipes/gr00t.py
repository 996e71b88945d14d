"""GR00T N1.6: a modality configuration, a copy of the checkpoint that really freezes its backbone, and the launcher.

Fields: NVIDIA/Isaac-GR00T@15ce93d2 (N1.6), ``gr00t/configs/finetune_config.py`` and
``gr00t/experiment/launch_finetune.py``. The project's license there is for research and evaluation only.
"""

from __future__ import annotations

from typing import Any

from betterbench.errors import InvalidInputError
from betterbench.export.layout import layout_of
from betterbench.export.lerobot_v21 import modality
from betterbench.recipes.recipe import Setting, given_or
from betterbench.recipes.trainer import (
    TrainerSetup,
    Training,
    evaluation_command,
    export_command,
    exposure,
    flag_lines,
    shell,
)

UPSTREAM = "NVIDIA/Isaac-GR00T@15ce93d2530e6f31aa7fe1c999a25c5dff7045db"
PRESET, VERSION = "gr00t_new_embodiment", "v2.1"
_LIBERO = "examples/LIBERO"
_JITTER = {"brightness": 0.3, "contrast": 0.4, "saturation": 0.5, "hue": 0.08}


def gr00t_setup(training: Training) -> TrainerSetup:
    """Return what GR00T needs; raises InvalidInputError if the recipe does not fit it."""
    recipe, data = training.recipe, training.only_data
    _ = training.batch_of_gpu
    if recipe.form.proprioception is False:
        raise InvalidInputError(
            "proprioception",
            "GR00T cannot leave the state out: dropout of 1.0 would train without what is served",
            "Write a constant state into the data and serve the same constant, or leave the field out",
        )
    parts, origin, where = recipe.frozen_parts("gr00t")
    frozen = parts or ()
    settings = _settings(training, frozen, origin, where)
    files = {"prepare_checkpoint.py": _PREPARE, "check_frozen.py": _CHECK}
    if data.preset:
        files["better_modality.py"] = _modality_file(recipe.form.chunk or 16)
    values = {s.name: s.value for s in settings}
    top = values["config.json: tune_top_llm_layers"]
    out = values["--output-dir"]
    start = "python" if training.gpus == 1 else f"torchrun --nproc_per_node={training.gpus} --master_port=29500"
    commands = []
    if data.preset:
        commands.append(("Export the demonstrations", export_command(data, "lerobot-v2.1")))
    commands += [
        (
            "From Isaac-GR00T's folder: a copy of the checkpoint whose top layers are frozen too"
            if "language" in frozen
            else "From Isaac-GR00T's folder: a copy of the checkpoint",
            'python "$HERE/prepare_checkpoint.py" '
            + shell([training.weights or "GR00T-N1.6-3B", values["--base-model-path"], top]),
        ),
        ("Train", flag_lines(f"{start} gr00t/experiment/launch_finetune.py", _flags(settings))),
        (
            "What was trained, and what was frozen",
            'python "$HERE/check_frozen.py" '
            + shell([values["--base-model-path"], f"{out}/checkpoint-{recipe.steps}"]),
        ),
        (
            "Serve the last checkpoint",
            shell(["python", "gr00t/eval/run_gr00t_server.py", "--model-path", f"{out}/checkpoint-{recipe.steps}"])
            + f" --embodiment-tag {values['--embodiment-tag']} --port 5555",
        ),
    ]
    checks = (
        exposure(training),
        "Download the checkpoint first: huggingface-cli download nvidia/GR00T-N1.6-3B --local-dir GR00T-N1.6-3B",
        (
            "tune_llm False alone does not freeze the language model: its top 4 layers are trained as long as the "
            "checkpoint's config.json says tune_top_llm_layers 4, and the launcher has no flag for that. The copy says "
            f"{top}; check_frozen.py compares the weights afterwards."
        ),
        "Frozen vision also freezes what connects it with the language model.",
        "The published LIBERO recipes of NVIDIA differ: batch 640, 20,000 steps, and state dropout 0.8 for LIBERO-10.",
        *(f"{number} hardly moves: normalization by its range blows it up." for number in data.still),
    )
    return TrainerSetup("GR00T N1.6", UPSTREAM, files, settings, tuple(commands), _evaluation(training), checks)


def _settings(training: Training, frozen: tuple[str, ...], origin: Any, where: str) -> tuple[Setting, ...]:  # noqa: ANN401
    recipe, data, form = training.recipe, training.only_data, training.recipe.form
    ours = bool(data.preset)
    tag = "NEW_EMBODIMENT" if ours or recipe.benchmark == "calvin" else "LIBERO_PANDA"
    chunk = () if not ours else (given_or("delta_indices of the action", form.chunk, 16, "upstream", _LIBERO),)
    modality_path = () if not ours else (Setting("--modality-config-path", '"$HERE/better_modality.py"', "ours", ""),)
    top = 0 if "language" in frozen else 4
    told = "N1.6 trains the top 4 layers although tune_llm is False" if not top else "default of N1.6"
    return (
        Setting(
            "--base-model-path", f"checkpoints/GR00T-N1.6-3B-top{top}", "ours", "copy made by prepare_checkpoint.py"
        ),
        Setting("--dataset-path", data.place, "ours", "where the data set lies"),
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
        given_or("--save-steps", form.save_every, recipe.save_every, "ours", "the last five are kept"),
        Setting("--save-total-limit", 5, "upstream", "default"),
        Setting("--num-gpus", training.gpus, "ours", "--gpus"),
        Setting("--dataloader-num-workers", 4, "upstream", _LIBERO),
        Setting("--output-dir", f"outputs/{recipe.name}", "ours", ""),
    )


def _flags(settings: tuple[Setting, ...]) -> list[tuple[str, str]]:
    """Return the flags of the launcher, as tyro reads them."""
    found = []
    for setting in settings:
        if not setting.name.startswith("--"):
            continue
        if isinstance(setting.value, bool):
            found.append((setting.name if setting.value else setting.name.replace("--", "--no-", 1), ""))
        elif isinstance(setting.value, dict):
            found.append((setting.name, " ".join(f"{key} {value}" for key, value in setting.value.items())))
        else:
            found.append((setting.name, shell([setting.value])))
    return found


def _modality_file(chunk: int) -> str:
    found = modality(layout_of(PRESET))
    if found is None:
        raise InvalidInputError("preset", f"{PRESET} has columns that GR00T does not read", "Report this")
    (annotation,) = found["annotation"]
    actions = list(found["action"])
    return f'''"""The modalities of betterbench's export (preset {PRESET}).

For {UPSTREAM}.

Names are those of meta/modality.json. The actions are deltas of the tool's pose already, so they are ABSOLUTE here:
RELATIVE would subtract the state once more.
"""

from gr00t.configs.data.embodiment_configs import register_modality_config
from gr00t.data.embodiment_tags import EmbodimentTag
from gr00t.data.types import ActionConfig, ActionFormat, ActionRepresentation, ActionType, ModalityConfig

BETTER = {{
    "video": ModalityConfig(delta_indices=[0], modality_keys={_quoted(found["video"])}),
    "state": ModalityConfig(delta_indices=[0], modality_keys={_quoted(found["state"])}),
    "action": ModalityConfig(
        delta_indices=list(range({chunk})),
        modality_keys={_quoted(actions)},
        action_configs=[
            ActionConfig(
                rep=ActionRepresentation.ABSOLUTE, type=ActionType.NON_EEF, format=ActionFormat.DEFAULT
            )
            for _ in range({len(actions)})
        ],
    ),
    "language": ModalityConfig(delta_indices=[0], modality_keys=["annotation.{annotation}"]),
}}

register_modality_config(BETTER, embodiment_tag=EmbodimentTag.NEW_EMBODIMENT)
'''


def _quoted(names: Any) -> str:  # noqa: ANN401 - any collection of texts
    return "[" + ", ".join(f'"{name}"' for name in names) + "]"


_PREPARE = '''"""Copies a GR00T N1.6 checkpoint by links and sets how many top layers of its language model are trained.

python prepare_checkpoint.py CHECKPOINT COPY LAYERS
"""

import json
import os
import sys
from pathlib import Path


def main(source, copy, layers):
    source, copy = Path(source), Path(copy)
    config = json.loads((source / "config.json").read_text())
    copy.mkdir(parents=True, exist_ok=True)
    for path in sorted(p for p in source.rglob("*") if p.is_file() and p.name != "config.json"):
        place = copy / path.relative_to(source)
        place.parent.mkdir(parents=True, exist_ok=True)
        if not place.exists():
            os.symlink(path.resolve(), place)
    found = config.get("tune_top_llm_layers", "nothing")
    config["tune_top_llm_layers"] = int(layers)
    (copy / "config.json").write_text(json.dumps(config, indent=2) + "\\n")
    print(f"tune_top_llm_layers: {found} in {source}, {layers} in {copy}")


if __name__ == "__main__":
    main(*sys.argv[1:])
'''

_CHECK = '''"""Says which parts of a checkpoint training has changed: python check_frozen.py BEFORE AFTER

Tensors are compared as bfloat16, because a trainer may store the same weights with more digits.
"""

import sys
from collections import Counter
from pathlib import Path

import torch
from safetensors import safe_open


def tensors(folder):
    places = {}
    for path in sorted(Path(folder).glob("*.safetensors")):
        with safe_open(path, framework="pt") as file:
            places.update(dict.fromkeys(file.keys(), path))
    if not places:
        raise SystemExit(f"{folder}: no safetensors file")
    return places


def tensor(path, name):
    with safe_open(path, framework="pt") as file:
        return file.get_tensor(name).to(torch.bfloat16)


def main(before, after):
    old, new = tensors(before), tensors(after)
    changed, total = Counter(), Counter()
    for name in sorted(old.keys() & new.keys()):
        part = ".".join(name.split(".")[:3])
        total[part] += 1
        changed[part] += not torch.equal(tensor(old[name], name), tensor(new[name], name))
    for part in sorted(total):
        print(f"{changed[part]:5d} of {total[part]:5d} tensors changed  {part}")
    print(f"{len(old.keys() ^ new.keys())} tensors are in one checkpoint only")


if __name__ == "__main__":
    main(*sys.argv[1:])
'''


def _evaluation(training: Training) -> str:
    benchmark, data = training.recipe.benchmark, training.only_data
    if benchmark == "better":
        return evaluation_command(f"gr00t://localhost:5555?preset={PRESET}", training.recipe, data)
    if benchmark == "libero":
        return (
            "# on LIBERO itself: examples/LIBERO/README.md of Isaac-GR00T\n"
            "# on our suite, without training on it:\n"
            + evaluation_command("gr00t://localhost:5555?preset=gr00t_libero_panda_spatial", training.recipe, data)
        )
    return (
        "# CALVIN's own evaluation (calvin_models/calvin_agent/evaluation); betterbench has no preset for its actions"
    )
