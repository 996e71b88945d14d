"""``better show``: a training scene beside a test scene."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import tyro

from betterbench.cli.console import say


def show_command(
    what: Annotated[str, tyro.conf.Positional], *, out: Path = Path("scene.png"), seed: int = 0, size: int = 512
) -> None:
    """Draw a training scene beside the test scene of the same seed, with what changed outlined.

    Example: better show fast_food/T1 --out t1.png

    Args:
        what: TASK for its training conditions, or TASK/VARIATION.
        out: PNG file to write.
        seed: Seed of both scenes.
        size: Side of each image in pixels.
    """
    from betterbench.evaluation import show_comparison, show_training

    task, _, name = what.partition("/")
    image = show_comparison(task, name, seed=seed, size=size) if name else show_training(task, seed=seed, size=size)
    out.parent.mkdir(parents=True, exist_ok=True)
    image.save(out)
    say(f"wrote {out}", whole=True)
