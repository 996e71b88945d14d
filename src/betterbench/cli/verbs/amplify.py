"""``better amplify``: generate demonstrations for new initial states from a few source demonstrations."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated, Literal

import tyro

from betterbench.cli.console import progress_bar


def amplify_command(
    sources: Annotated[Path, tyro.conf.Positional],
    *,
    out: Path,
    tasks: tuple[str, ...] = (),
    demos: int = 50,
    seed: int | None = None,
    attempts: int = 6,
    select: Literal["random", "nearest_object", "nearest_robot"] = "nearest_object",
    noise: float = 0.02,
    workers: int | None = None,
    films: bool = True,
    json: bool = False,
) -> None:
    """Generate demonstrations for new initial states from a run's demonstrations, and save them as another run.

    Each skill in a source demonstration keeps its motion in the frame of the object or target that it manipulates. The
    motion between skills is kept too, but its height, side and speed vary with the seed. If it would collide, a planner
    finds another path. A failed attempt is repeated with another source demonstration. A demonstration is accepted if
    it succeeds, remains successful while the robot holds still, and stays inside the certified training distribution.
    The command prints how varied the demonstrations and their sources are. Running the command again resumes the job
    where it stopped; a larger --demos adds demonstrations.

    Example: better amplify runs/demonstrations --demos 50 --out runs/amplified

    Args:
        sources: Run folder with the source demonstrations.
        out: Output run folder.
        tasks: Tasks to amplify; default: all tasks that the sources demonstrate.
        demos: Demonstrations per training condition.
        seed: First seed, 1000000 or above; 1000000000 if not given.
        attempts: Maximum attempts per initial state, each with a different primary source demonstration.
        select: How to choose the source demonstration for each subgoal: at random, by the nearest position of the
            object, or by the nearest initial pose of the motion.
        noise: Standard deviation of the noise added to the executed actions, in action units; the recorded actions are
            free of this noise.
        workers: Number of worker processes; default: one per CPU core.
        films: Render a video of the first failed attempt of each kind, and a picture of the paths per task.
        json: Print the outcome of the attempts as one JSON document.
    """
    from betterbench.cli.output.demonstrations import bar_note, tell_acceptance
    from betterbench.cli.verbs.evaluate import prepare_robot
    from betterbench.demonstrations.making.amplifier import AmplifierSettings
    from betterbench.demonstrations.making.production import SetProgress, amplify
    from betterbench.demonstrations.making.starts import FIRST_AMPLIFIED_SEED
    from betterbench.interface.actions import USUAL_ROBOT
    from betterbench.records import RunFolder

    prepare_robot(str(RunFolder.open(sources).plan.get("robot", USUAL_ROBOT)))
    with progress_bar("amplify", 0) as (bar, shown):

        def told(progress: SetProgress) -> None:
            bar.update(shown, total=progress.planned, completed=progress.done, note=bar_note(progress))

        run = amplify(
            sources,
            out,
            tasks=tasks,
            demos=demos,
            first_seed=FIRST_AMPLIFIED_SEED if seed is None else seed,
            attempts=attempts,
            settings=AmplifierSettings(select, noise),
            workers=workers or os.cpu_count() or 1,
            on_progress=told,
        )
    tell_acceptance(run, films=films, json=json)
