"""``better show``: draw a training scene next to a test scene."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import tyro

from betterbench.cli.console import say
from betterbench.cli.robot_option import USUAL_OPTION, ChosenRobot


def show_command(
    what: Annotated[str, tyro.conf.Positional],
    *,
    out: Path = Path("scene.png"),
    seed: int = 0,
    size: int = 512,
    arm: ChosenRobot = USUAL_OPTION,
    overwrite: bool = False,
) -> None:
    """Draw a training scene next to the test scene with the same seed, and outline the changes.

    Example: better show fast_food/T1 --out t1.png

    Args:
        what: TASK draws the training conditions of a task; TASK/VARIATION draws a test scene next to its training
            scene.
        out: PNG or JPEG file to write.
        seed: Seed of both scenes.
        size: Side length of each image in pixels.
        arm: Option that selects the robot.
        overwrite: Replace a file that `better show` did not write.
    """
    from betterbench.cli.output.picture_file import picture_file
    from betterbench.evaluation import show_comparison, show_training
    from betterbench.evaluation.figures.show import shown_credits

    task, _, name = what.partition("/")
    with picture_file(out, "show", overwrite=overwrite) as write:
        options: dict[str, Any] = {"seed": seed, "size": size, "robot": arm.of([task])}
        image = show_comparison(task, name, **options) if name else show_training(task, **options)
        lines = shown_credits(task, name or None)
        write(image, lines)
    for line in lines:
        say(f"assets: {line}")
