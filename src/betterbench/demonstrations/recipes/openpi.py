"""Recipe for openpi (pi0.5): one Python file that registers a ``TrainConfig`` and starts openpi's own scripts.

Fields: Physical-Intelligence/openpi@15a9616a, ``src/openpi/training/config.py`` (``TrainConfig``, ``pi05_libero``) and
``src/openpi/models/pi0_config.py`` (``get_freeze_filter``).
"""

from __future__ import annotations

from betterbench.demonstrations.recipes.recipe import Setting, given_or
from betterbench.demonstrations.recipes.trainer import (
    TrainerSetup,
    Training,
    TrainingData,
    evaluation_lines,
    export_line,
    exposure,
    filled,
    own_file,
)
from betterbench.quoting import shell_line, shell_word

UPSTREAM = "Physical-Intelligence/openpi@15a9616a00943ada6c20a0f158e3adb39df2ccac"
PRESET, VERSION = "openpi_libero", "v2.1"
LIBERO_DATA = "physical-intelligence/libero"
_OWN = "pi05_libero"

_STATELESS = (
    "The policy gets no state of the robot: pi0.5 reads it only from the prompt, and discrete_state_input is False as "
    "in pi05_libero (openpi issue 687). proprioception: true in the recipe writes it into the prompt."
)
_COLUMNS = "The data need the columns image, wrist_image, state (8) and actions (7: deltas and the gripper)."
_STATE = "The state of the robot is in the prompt, as 256 bins; pi05_libero itself has none."

_FREEZE = {
    (): "nnx.Nothing()",
    ("vision",): 'nnx_utils.PathRegex(".*PaliGemma/img.*")',
    ("language",): 'nnx.All(nnx_utils.PathRegex(".*llm.*"), nnx.Not(nnx_utils.PathRegex(".*llm.*_1.*")))',
}
_FREEZE["vision", "language"] = f"nnx.Any({_FREEZE['vision',]}, {_FREEZE['language',]})"


def openpi_setup(training: Training) -> TrainerSetup:
    """Return the setup of openpi; raise InvalidInputError if it cannot follow the recipe."""
    recipe, data = training.recipe, training.only_data
    _ = training.batch_of_gpu
    name = f"{recipe.name}_pi05"
    repo_id = data.place if _on_hub(data) else f"local/{data.name}"
    settings = _settings(training, repo_id)
    values = {setting.name: setting.value for setting in settings}
    file = f"{name}.py"
    run = shell_line(["uv", "run", own_file(file)])
    commands = []
    if data.preset:
        commands.append(("Export the demonstrations", export_line(data, "lerobot-v2.1", images="png")))
    if not _on_hub(data):
        linked = 'mkdir -p "$HF_LEROBOT_HOME/local" && ln -sfn '
        linked += f'"$(realpath -- {shell_word(data.place)})" "$HF_LEROBOT_HOME"/{shell_word(repo_id)}'
        commands.append(("Link the data set into openpi's folder", linked))
    last = recipe.steps - 1
    commands += [
        ("From openpi's folder: statistics for normalization", f"{run} norm-stats"),
        ("Train", f"XLA_PYTHON_CLIENT_MEM_FRACTION=0.9 {run} train --exp-name {recipe.name}"),
        ("Serve the last checkpoint", f"{run} serve --dir checkpoints/{name}/{recipe.name}/{last}"),
    ]
    checks = [
        exposure(training),
        f"Steps count from 0: the last checkpoint is the folder {last}.",
        "A training that is resumed begins the data anew.",
        _STATELESS if not values["model.discrete_state_input"] else _STATE,
    ]
    checks += [_COLUMNS] * (not data.preset and not _on_hub(data))
    checks += [f"{number} is nearly constant: normalization by quantiles amplifies it." for number in data.still]
    return TrainerSetup(
        "openpi",
        UPSTREAM,
        {file: _file(name, settings)},
        settings,
        tuple(commands),
        _evaluation(training),
        tuple(checks),
    )


def _on_hub(data: TrainingData) -> bool:
    return not data.preset and data.place == LIBERO_DATA


def _settings(training: Training, repo_id: str) -> tuple[Setting, ...]:
    recipe, form = training.recipe, training.recipe.form
    parts, origin, where = recipe.frozen_parts("openpi")
    rate = form.learning_rate
    weights = training.weights or "gs://openpi-assets/checkpoints/pi05_base/params"
    return (
        Setting("model.pi05", True, "paper", "section 4: pi0.5"),
        given_or("model.action_horizon", form.chunk, 10, "upstream", _OWN),
        given_or("model.discrete_state_input", form.proprioception, False, "upstream", _OWN),
        Setting("data", "LeRobotLiberoDataConfig", "upstream", "its columns are those of the preset openpi_libero"),
        Setting("data.repo_id", repo_id, "ours", "folder of the data set"),
        Setting("data.base_config.prompt_from_task", True, "upstream", _OWN),
        Setting("data.extra_delta_transform", False, "upstream", f"{_OWN}; our actions are deltas already"),
        recipe.setting("batch_size", "batch"),
        recipe.setting("num_train_steps", "steps"),
        Setting("lr_schedule.warmup_steps", 10_000, "upstream", _OWN),
        given_or("lr_schedule.peak_lr", rate, 5e-5, "upstream", _OWN),
        Setting("lr_schedule.decay_steps", 1_000_000, "upstream", _OWN),
        given_or("lr_schedule.decay_lr", rate, 5e-5, "upstream", f"{_OWN}: constant after the warm-up"),
        Setting("optimizer.clip_gradient_norm", 1.0, "upstream", _OWN),
        Setting("ema_decay", 0.999, "upstream", _OWN),
        Setting("weight_loader.params_path", weights, "ours" if training.weights else "upstream", _OWN),
        Setting("freeze_filter", _FREEZE[_ordered(parts or ())], origin, where),
        given_or("seed", form.seed, 42, "upstream", "default"),
        given_or("save_interval", form.save_every, recipe.save_every, "ours", "every checkpoint is kept"),
        given_or("keep_period", form.save_every, recipe.save_every, "ours", "every checkpoint is kept"),
    )


def _ordered(parts: tuple[str, ...]) -> tuple[str, ...]:
    return tuple(part for part in ("vision", "language") if part in parts)


def _file(name: str, settings: tuple[Setting, ...]) -> str:
    values = {setting.name: setting.value for setting in settings}
    texts = {field.replace(".", "_"): repr(value) for field, value in values.items()}
    uses_regex = "nnx_utils" in values["freeze_filter"]
    imports = "    import openpi.shared.nnx_utils as nnx_utils\n" if uses_regex else ""
    return filled(
        "openpi.txt",
        {"upstream": UPSTREAM} | texts | {"freeze_filter": values["freeze_filter"], "name": name, "imports": imports},
    )


def _evaluation(training: Training) -> str:
    return evaluation_lines(
        training.recipe,
        training.only_data,
        address=f"openpi://localhost:8000?preset={PRESET}",
        on_libero="# on LIBERO itself, from openpi's folder, for each suite:\n"
        "python examples/libero/main.py --args.task-suite-name libero_spatial",
        libero_address="openpi://localhost:8000?preset=openpi_libero_spatial",
    )
