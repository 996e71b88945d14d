"""``better train``: train a small policy on demonstrations, as described in a recipe file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from betterbench.cli.console import OUT, print_json, print_table, progress_bar, say
from betterbench.quoting import shell_word

if TYPE_CHECKING:
    from betterbench.learning.training.data import TrainingSet
    from betterbench.learning.training.loop import TrainingResult
    from betterbench.policies.learned import TrainingRecipe


def train_command(
    recipe: Annotated[Path, tyro.conf.Positional],
    *,
    out: Path,
    data: tuple[str, ...] = (),
    tasks: tuple[str, ...] = (),
    seed: int | None = None,
    steps: int | None = None,
    device: str = "cpu",
    frames: Path | None = None,
    workers: int = 1,
    json: bool = False,
) -> None:
    """Train a small learner on demonstrations; evaluate it afterwards with the policy address learned:OUT.

    The folder OUT contains checkpoint.safetensors (with the recipe in its metadata), and tables and curves of the loss,
    validation errors and rollouts. Running the command again resumes an interrupted training and gives the same
    weights. Start the command with torchrun to train on several devices.

    Example: better train recipe.yaml --out learners/coffee

    Args:
        recipe: YAML file with the recipe.
        out: Folder of the training.
        data: Folders of demonstrations; overrides the recipe.
        tasks: Tasks to train on; overrides the recipe.
        seed: Random seed; overrides the recipe.
        steps: Number of training steps; overrides the recipe.
        device: Torch device: cpu, cuda or cuda:N.
        frames: Folder with the rendered frames for a learner that uses images; default: NAME.frames next to each data
            folder.
        workers: Number of processes that render the frames.
        json: Print one JSON document instead of a table.
    """
    from betterbench.policies.learned.loading import require_torch

    chosen = _recipe(recipe, {"data": data or None, "tasks": tasks or None, "seed": seed, "steps": steps})
    require_torch("better train")
    from betterbench.learning.training.data import epochs_of
    from betterbench.learning.training.loop import TrainingProgress, require_place, train
    from betterbench.learning.training.processes import TrainingProcesses

    require_place(out, device)
    found = _training_set(chosen, frames, workers)
    first = TrainingProcesses.here().rank == 0
    if first:
        say(_about(found, epochs_of(found, chosen)))
    with progress_bar("training", chosen.steps) as (bar, row):

        def on_progress(progress: TrainingProgress) -> None:
            note = f"loss {progress.loss:.4f}, {progress.samples_per_s:,.0f} samples/s"
            bar.update(row, completed=progress.step, note=note)

        result = train(chosen, found, out, device=device, on_progress=on_progress)
    if first:
        _print(result, chosen, out, sorted({t.task for t in found.trials}), json=json)


def _recipe(path: Path, changes: dict[str, object]) -> TrainingRecipe:
    from betterbench.cli.yaml_file import read_yaml
    from betterbench.policies.learned.recipe import CURE, read_training_recipe

    return read_training_recipe(read_yaml(path, cure=CURE), where=str(path), changes=changes)


def _training_set(recipe: TrainingRecipe, frames: Path | None, workers: int) -> TrainingSet:
    """Read the demonstrations. If the learner uses images, render the frames that are missing."""
    from betterbench.learning.training.data import read_training_set

    with progress_bar("reading demonstrations", 0, stays=False) as (bar, row):

        def on_drawn(done: int, of: int) -> None:
            bar.update(row, completed=done, total=of, description="drawing frames")

        return read_training_set(
            recipe,
            on_read=lambda done, of: bar.update(row, completed=done, total=of),
            frames=frames,
            workers=workers,
            on_drawn=on_drawn,
        )


def _about(data: TrainingSet, epochs: float) -> str:
    held_out, frames = int(data.held_out.sum()), len(data.frames(held_out=False))
    store = "" if data.frames_of is None else f"; {data.frames_of.bytes / 1e6:,.0f} MB of rendered frames"
    asked = "" if data.questions is None else f"; {len(data.asked(held_out=False)):,} questions about these frames"
    return (
        f"{len(data.trials) - held_out} demonstrations with {frames:,} frames, {held_out} held out; "
        f"{epochs:.1f} passes over them{store}{asked}"
    )


def _print(result: TrainingResult, recipe: TrainingRecipe, out: Path, tasks: Sequence[str], *, json: bool) -> None:
    """Print the result of the last validation, and the command that evaluates the learner."""
    from betterbench.tasks.user_files import loading_options

    log = result.log
    errors = [row for row in log.errors if row.step == log.losses[-1].step]
    rollouts = [row for row in log.rollouts if row.step == log.losses[-1].step]
    answers = [row for row in log.answers if row.step == log.losses[-1].step]
    if json:
        print_json(
            {
                "checkpoint": str(result.checkpoint),
                "parameters": result.parameters,
                "loss": log.losses[-1].loss,
                "samples_per_s": round(result.samples_per_s, 1),
                "validation": [asdict(row) for row in errors],
                "rollouts": [asdict(row) for row in rollouts],
                "answers": [asdict(row) for row in answers],
            }
        )
        return
    print_table(
        ["phase", "frames", "position error [mm/step]", "turned by [deg/step]", "gripper wrong"],
        [
            [e.phase, str(e.frames), f"{e.translation_mm:.2f}", f"{e.rotation_deg:.2f}", f"{e.gripper_wrong:.1%}"]
            for e in errors
        ],
    )
    if answers:
        OUT.print()
        print_table(
            ["questions about", "right", "asked"],
            [[a.type, f"{a.right / a.asked:.0%}", str(a.asked)] for a in answers],
        )
    solved = sum(row.success for row in rollouts)
    OUT.print(
        f"\nloss {log.losses[-1].loss:.4f}; {solved} of {len(rollouts)} rollouts solved; "
        f"{result.parameters:,} parameters; {result.samples_per_s:,.0f} samples/s",
        markup=False,
    )
    OUT.print(f"checkpoint  {result.checkpoint}", markup=False, soft_wrap=True)
    files = "" if recipe.built_in else loading_options()
    evaluation = evaluation_of(out, tasks, files)
    OUT.print(f"evaluate    {evaluation}", markup=False, soft_wrap=True)


def evaluation_of(out: Path, tasks: Sequence[str], options: str = "") -> str:
    """Return the command that evaluates a learner on the tasks and in the action space for which it was trained.

    Args:
        out: Folder of the learner.
        tasks: Names of the tasks.
        options: Command-line options, with a leading space, for loading the file in which the learner's family is
            defined.
    """
    from betterbench.cli.robot_option import USUAL_OPTION
    from betterbench.interface.actions import EE_DELTA
    from betterbench.policies.kinds.learned import learned_address
    from betterbench.sim.robots import robot_space

    chosen = " ".join(map(shell_word, tasks))
    # All learners act in EE_DELTA.
    usual = robot_space(USUAL_OPTION.of(tasks)) == EE_DELTA.name
    space = "" if usual else f" --action-space {EE_DELTA.name}"
    return f"better eval --policy {shell_word(learned_address(out))}{options} --tasks {chosen}{space} --trials 3"
