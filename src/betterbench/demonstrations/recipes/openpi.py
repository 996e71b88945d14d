"""Recipe for training pi0.5 with openpi: one Python file that registers a ``TrainConfig`` and starts openpi's scripts.

The fields are taken from Physical-Intelligence/openpi@15a9616a: ``src/openpi/training/config.py`` (``TrainConfig``,
``pi05_libero``) and ``src/openpi/models/pi0_config.py`` (``get_freeze_filter``). The fields for a real arm are taken
from ``SimpleDataConfig``, ``pi05_aloha_pen_uncap``, and ``DeltaActions`` in ``src/openpi/transforms.py``.
"""

from __future__ import annotations

from betterbench.demonstrations.recipes.recipe import Setting, given_or
from betterbench.demonstrations.recipes.trainer import (
    REAL_CAMERAS,
    REAL_PRESET,
    SO101_COLUMNS,
    TrainerSetup,
    Training,
    TrainingData,
    evaluation_lines,
    export_line,
    exposure,
    filled,
    own_file,
    real_checks,
    real_evaluation,
    record_lines,
)
from betterbench.quoting import shell_line, shell_word

UPSTREAM = "Physical-Intelligence/openpi@15a9616a00943ada6c20a0f158e3adb39df2ccac"
PRESET, VERSION = "openpi_libero", "v2.1"
LIBERO_DATA = "physical-intelligence/libero"
_OWN = "pi05_libero"

_STATELESS = (
    "The policy does not get the robot's state: pi0.5 only reads it from the prompt, and discrete_state_input is "
    "False as in pi05_libero (openpi issue 687). With proprioception: true in the recipe, the state is added to the "
    "prompt."
)
_COLUMNS = "The data need the columns image, wrist_image, state (8) and actions (7: deltas and the gripper)."
_STATE = "The prompt contains the robot's state in 256 bins; in pi05_libero it does not."

_FREEZE = {
    (): "nnx.Nothing()",
    ("vision",): 'nnx_utils.PathRegex(".*PaliGemma/img.*")',
    ("language",): 'nnx.All(nnx_utils.PathRegex(".*llm.*"), nnx.Not(nnx_utils.PathRegex(".*llm.*_1.*")))',
}
_FREEZE["vision", "language"] = f"nnx.Any({_FREEZE['vision',]}, {_FREEZE['language',]})"


def openpi_setup(training: Training) -> TrainerSetup:
    """Return the files and commands for training with openpi.

    Raises InvalidInputError if openpi cannot follow the recipe.
    """
    recipe, data = training.recipe, training.only_data
    _ = training.batch_of_gpu
    if recipe.benchmark == "real":
        return _real_setup(training)
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
        "A resumed training starts again at the beginning of the data.",
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


def _real_setup(training: Training) -> TrainerSetup:
    """Return the files and commands for training on data that LeRobot recorded with an SO-101.

    These data contain absolute joint positions and the images of two cameras.
    """
    recipe, data = training.recipe, training.only_data
    name = f"{recipe.name}_pi05"
    file, repo_id = f"{name}.py", f"local/{data.name}_v21"
    older = f'"$HF_LEROBOT_HOME"/{shell_word(repo_id)}'  # absolute, because the commands run in different folders
    settings = _real_settings(training, repo_id)
    run = shell_line(["uv", "run", own_file(file)])
    commands = []
    if data.frames is None:
        commands.append(("Record the demonstrations, in the environment of LeRobot", record_lines(data.place)))
    copied = f'mkdir -p "$HF_LEROBOT_HOME/local" && cp -r {shell_word(data.place)} {older}'
    convert = ["python", "ds_version_convert/v30_to_v21/convert_dataset_v30_to_v21.py", f"--repo-id={repo_id}"]
    last = recipe.steps - 1
    commands += [
        ("Copy the data set to openpi's folder: the converter replaces the copy", copied),
        (
            f"From the folder of any4lerobot, with LeRobot and datasets<4: {_CONVERTER}",
            f"{shell_line(convert)} --root={older}",
        ),
        ("From openpi's folder: statistics for normalization", f"{run} norm-stats"),
        ("Train", f"XLA_PYTHON_CLIENT_MEM_FRACTION=0.9 {run} train --exp-name {recipe.name}"),
        ("Serve the last checkpoint", f"{run} serve --dir checkpoints/{name}/{recipe.name}/{last}"),
    ]
    return TrainerSetup(
        "openpi",
        UPSTREAM,
        _real_files(name, settings),
        settings,
        tuple(commands),
        real_evaluation("pi05", f"openpi://localhost:8000?preset={REAL_PRESET}", data),
        (
            exposure(training),
            f"Steps count from 0: the last checkpoint is the folder {last}.",
            "openpi only reads LeRobot v2.1, because it pins lerobot 0cf86487. LeRobot records v3.0.",
            "All weights are trained, which needs more than 70 GB of GPU memory according to openpi's README.",
            *real_checks(data),
        ),
    )


_CONVERTER = "Tavish9/any4lerobot@69373154"
_ALOHA = "pi05_aloha_pen_uncap"


def _real_settings(training: Training, repo_id: str) -> tuple[Setting, ...]:
    recipe, form = training.recipe, training.recipe.form
    parts, origin, where = recipe.frozen_parts("openpi")
    rate = form.learning_rate
    weights = training.weights or "gs://openpi-assets/checkpoints/pi05_base/params"
    decay = 2.5e-6 if rate is None else 0.1 * rate
    return (
        Setting("model.pi05", True, "paper", "real-world experiments: pi0.5"),
        given_or("model.action_horizon", form.chunk, 50, "upstream", "default"),
        given_or("model.discrete_state_input", form.proprioception, True, "upstream", "default of pi0.5"),
        Setting("data.repo_id", repo_id, "ours", "folder of the data set, as LeRobot v2.1"),
        Setting("data.cameras", list(REAL_CAMERAS), "ours", "base and left wrist of pi0.5; the right wrist is masked"),
        Setting("data.base_config.prompt_from_task", True, "upstream", "pi05_libero"),
        Setting("data.base_config.action_sequence_keys", ["action"], "ours", "LeRobot's name"),
        Setting(
            "data.delta_joints", len(SO101_COLUMNS) - 1, "upstream", f"{_ALOHA}: joints relative, gripper absolute"
        ),
        recipe.setting("batch_size", "batch"),
        recipe.setting("num_train_steps", "steps"),
        Setting("lr_schedule.warmup_steps", 1_000, "upstream", "default"),
        given_or("lr_schedule.peak_lr", rate, 2.5e-5, "upstream", "default"),
        Setting("lr_schedule.decay_steps", 30_000, "upstream", "default"),
        given_or("lr_schedule.decay_lr", None if rate is None else decay, decay, "upstream", "default: a tenth"),
        Setting("optimizer.clip_gradient_norm", 1.0, "upstream", "default"),
        Setting("ema_decay", 0.99, "upstream", "default"),
        Setting("weight_loader.params_path", weights, "ours" if training.weights else "upstream", _ALOHA),
        Setting("freeze_filter", _FREEZE[_ordered(parts or ())], origin, where or _ALOHA),
        given_or("seed", form.seed, 42, "upstream", "default"),
        given_or("save_interval", form.save_every, recipe.save_every, "ours", "every checkpoint is kept"),
        given_or("keep_period", form.save_every, recipe.save_every, "ours", "every checkpoint is kept"),
    )


def _real_files(name: str, settings: tuple[Setting, ...]) -> dict[str, str]:
    """Return the contents of two files by name: the launcher, and the module that data-loader processes import."""
    values = {setting.name: setting.value for setting in settings}
    texts = {field.replace(".", "_"): repr(value) for field, value in values.items()}
    imports = "    import openpi.shared.nnx_utils as nnx_utils\n" if "nnx_utils" in values["freeze_filter"] else ""
    told = {"freeze_filter": values["freeze_filter"], "name": name, "imports": imports, "upstream": UPSTREAM}
    return {
        f"{name}.py": filled("openpi_so101.txt", texts | told),
        "better_so101.py": filled("better_so101.txt", texts | {"motors": str(len(SO101_COLUMNS))}),
    }


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
        Setting("data.extra_delta_transform", False, "upstream", f"{_OWN}; betterbench's actions are already deltas"),
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
