"""Write a recipe folder: files for the framework, commands, and a page that states the source of each field."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from types import ModuleType

from betterbench.demonstrations.recipes import being_h, gr00t, lerobot, openpi
from betterbench.demonstrations.recipes.recipe import Framework, Recipe, Setting
from betterbench.demonstrations.recipes.trainer import TrainerSetup, Training, data_of
from betterbench.errors import InvalidInputError, RunConflictError
from betterbench.jobs import write_durably
from betterbench.jobs.outputs import OutputFolder
from betterbench.json_form import read_object
from betterbench.ordinary_file import read_ordinary
from betterbench.quoting import json_text, markdown_code, markdown_table, markdown_text

_MOST_BYTES = 16 << 20
_ORIGINS = {
    "paper": "the paper",
    "upstream": "the framework",
    "recipe": "your recipe",
    "ours": "betterbench",
}


@dataclass(frozen=True, slots=True)
class _Trainer:
    module: ModuleType
    setup: Callable[[Training], TrainerSetup]


_TRAINERS: Mapping[Framework, _Trainer] = {
    "openpi": _Trainer(openpi, openpi.openpi_setup),
    "gr00t": _Trainer(gr00t, gr00t.gr00t_setup),
    "being-h": _Trainer(being_h, being_h.being_h_setup),
    "lerobot": _Trainer(lerobot, lerobot.lerobot_setup),
}


def trainer_setup(
    framework: Framework,
    recipe: Recipe,
    data: Sequence[str] = (),
    *,
    gpus: int | None = None,
    weights: str | None = None,
    policy: str = "pi05",
    sample_tokens: int = 220,
) -> TrainerSetup:
    """Return the setup for training with a framework according to a recipe: files, settings, commands and checks.

    Args:
        framework: The framework.
        recipe: The recipe.
        data: Paths of the data sets. For LIBERO, the default is the data set that the framework publishes, if there is
            one.
        gpus: Number of GPUs. The default is 4, or 1 for the real arm.
        weights: Initial weights; None for the weights that the framework publishes.
        policy: Policy type, for LeRobot.
        sample_tokens: Number of tokens in one sample, for the sequence packing of Being-H.

    Raises:
        InvalidInputError: If the data sets or the recipe do not fit the framework.
        UnknownNameError: If LeRobot does not have the policy type.
    """
    trainer = _TRAINERS[framework]
    is_real = recipe.benchmark == "real"
    if is_real and framework not in ("openpi", "lerobot"):
        problem = f"{framework} has no recipe for data of a real SO-101"
        raise InvalidInputError("--recipe", problem, "Use openpi or lerobot, or choose another recipe")
    recipe = recipe.of_policy(policy if framework == "lerobot" else "pi05")
    published = getattr(trainer.module, "LIBERO_DATA", None) if recipe.benchmark == "libero" else None
    places = tuple(data) or ((published,) if published else ())
    if not places:
        raise InvalidInputError(
            "--data",
            "no data set is given",
            "Pass the folder of the data set, on this machine or on the training machine",
        )
    preset, version = trainer.module.PRESET, trainer.module.VERSION
    found = tuple(data_of(place, preset=preset, version=version, benchmark=recipe.benchmark) for place in places)
    training = Training(
        recipe,
        found,
        gpus=(1 if is_real else 4) if gpus is None else gpus,
        weights=weights,
        policy=policy,
        sample_tokens=sample_tokens,
    )
    setup = trainer.setup(training)
    apart = tuple(
        f"{place} does not exist here: paths are relative to the folder in which a command is run."
        for place in places
        if place != published and not Path(place).is_absolute() and not Path(place).exists()
    )
    return replace(setup, checks=setup.checks + apart)


def setup_files(setup: TrainerSetup, recipe: Recipe) -> dict[str, str]:
    """Return the content of each file in a recipe folder, by file name."""
    fields = [asdict(setting) for setting in setup.settings]
    told = {"framework": setup.framework, "upstream": setup.upstream, "recipe": recipe.name, "fields": fields}
    return {
        **setup.files,
        "commands.sh": _commands(setup),
        "fields.json": json_text(told, indent=1) + "\n",
        "README.md": _page(setup, recipe),
    }


def write_setup(files: Mapping[str, str], out: Path, *, overwrite: bool = False) -> None:
    """Write the files of a recipe into a folder. Files that already have the same content are not written again.

    Raises:
        RunConflictError: If the folder contains another recipe or other files, and ``overwrite`` is False.
        OSError: If the folder cannot be written.
    """
    wanted = {name: text.encode() for name, text in files.items()}
    with OutputFolder(out, "recipe", overwrite=overwrite, is_ours=lambda: _is_recipe(out)):
        others = [name for name, data in wanted.items() if (out / name).exists() and read_ordinary(out / name) != data]
        if others and not overwrite:
            raise RunConflictError(
                f"{out}: it contains a different {others[0]}. Choose another folder, or pass --overwrite to replace "
                "the file."
            )
        for name, data in wanted.items():
            write_durably(out / name, data)


def _is_recipe(out: Path) -> bool:
    try:
        form = read_object(out / "fields.json", max_bytes=_MOST_BYTES, cure="")
    except InvalidInputError:
        return False
    return {"framework", "upstream", "recipe", "fields"} == form.keys()


def _commands(setup: TrainerSetup) -> str:
    lines = [
        "#!/usr/bin/env bash",
        f"# {setup.framework} ({setup.upstream}). Look at README.md first.",
        "# Each step runs in the environment in its title, so run the steps one by one instead of this file.",
        "set -euo pipefail",
        'HERE="$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)"',
    ]
    for title, command in setup.commands:
        lines += ["", f"# {title}", command]
    lines += ["", "# Evaluate, in the environment of betterbench", setup.evaluation]
    return "\n".join(lines) + "\n"


def _page(setup: TrainerSetup, recipe: Recipe) -> str:
    given = "the steps of pi0.5" if recipe.benchmark == "real" else "steps, batch and frozen parts"
    lines = [
        f"# {recipe.name}: fine-tuning with {setup.framework}",
        "",
        f"Written by betterbench for {setup.upstream}. `commands.sh` has the steps in order.",
        "",
        "## Check",
        "",
        *(f"- {markdown_text(text)}" for text in setup.checks),
        "",
        "## Fields",
        "",
        *markdown_table(("field", "value", "decided by", "where"), map(_row, setup.settings)),
        "",
        f"The paper gives {given}. All other values are taken from the framework's own recipe",
        "and may differ from those used in the paper.",
        "",
    ]
    return "\n".join(lines)


def _row(setting: Setting) -> tuple[str, ...]:
    value = setting.value if isinstance(setting.value, str) else json.dumps(setting.value)
    return markdown_code(setting.name), markdown_code(value), _ORIGINS[setting.origin], markdown_text(setting.where)
