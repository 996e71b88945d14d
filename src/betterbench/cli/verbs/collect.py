"""``better collect``: collect expert demonstrations in varied motion styles."""

from __future__ import annotations

import os
from pathlib import Path

from betterbench.cli.console import progress_bar
from betterbench.cli.robot_option import USUAL_OPTION, ChosenRobot


def collect_command(
    *,
    out: Path,
    tasks: tuple[str, ...] = (),
    suite: str = "better60",
    demos: int = 10,
    seed: int | None = None,
    attempts: int = 4,
    arm: ChosenRobot = USUAL_OPTION,
    workers: int | None = None,
    films: bool = True,
    json: bool = False,
) -> None:
    """Collect expert demonstrations for each training condition, and save them as a run.

    The seed determines the motion style of each demonstration: speed, side and height of the approach, pauses, detours,
    and grasps that miss and are corrected. The initial states cover the training distribution evenly, and test seeds
    are never used. Ctrl-C keeps finished demonstrations. Running the command again resumes the job where it stopped; a
    larger --demos adds more.

    Example: better collect --tasks fast_food --demos 10 --out runs/demonstrations

    Args:
        out: Run folder.
        tasks: Tasks to demonstrate; default: all tasks in the suite.
        suite: Suite that contains the tasks.
        demos: Demonstrations per training condition.
        seed: First seed, 1000000 or above; 1000000 if not given.
        attempts: Maximum attempts per initial state, each in a different motion style.
        arm: Option that selects the robot.
        workers: Number of worker processes; default: one per CPU core.
        films: Render a video of the first failed attempt of each kind, and a picture of the paths per task.
        json: Print the outcome of the attempts as one JSON document.
    """
    from betterbench.cli.output.demonstrations import bar_note, tell_acceptance
    from betterbench.cli.verbs.evaluate import prepare_robot
    from betterbench.demonstrations.making.production import SetProgress, collect
    from betterbench.tasks import suite_tasks
    from betterbench.tasks.randomness import FIRST_DEMONSTRATION_SEED

    of_suite = suite_tasks(suite)
    robot = arm.of(tasks or of_suite)
    prepare_robot(robot)
    with progress_bar("collect", 0) as (bar, shown):

        def told(progress: SetProgress) -> None:
            bar.update(shown, total=progress.planned, completed=progress.done, note=bar_note(progress))

        run = collect(
            tasks or of_suite,
            out,
            demos=demos,
            first_seed=FIRST_DEMONSTRATION_SEED if seed is None else seed,
            attempts=attempts,
            robot=robot,
            workers=workers or os.cpu_count() or 1,
            on_progress=told,
        )
    tell_acceptance(run, films=films, json=json)
