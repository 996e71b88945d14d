"""``better place``: adapt tasks to another robot."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from betterbench.cli.console import print_json, print_listing, print_table, progress_bar, say
from betterbench.cli.robot_option import USUAL_OPTION, ChosenRobot
from betterbench.errors import InvalidInputError, require_between

if TYPE_CHECKING:
    from betterbench.certification.placing import Feasibility, Placed


def place_command(
    *,
    out: Path,
    tasks: tuple[str, ...] = (),
    suite: str = "better60",
    arm: ChosenRobot = USUAL_OPTION,
    trials: int = 2,
    measure: bool = True,
    overwrite: bool = False,
    json: bool = False,
) -> None:
    """Adapt tasks to another robot, and measure how many grasps can be planned and how many trials are solved.

    The robot's base is moved to the position from which it can reach the most slots. Each task is written as a separate
    task file, TASK_ROBOT.json. The table shows the base position relative to the base of the task's original robot, the
    slots out of reach, how many grasps can be planned per object, and how many trials of training conditions the expert
    solves.

    Example: better place --robot so101 --tasks cheeseburger --out placed

    Args:
        out: Folder to write.
        tasks: Tasks to adapt; default: all tasks in the suite.
        suite: Suite that contains the tasks.
        arm: Option that selects the robot.
        trials: Trials per training condition.
        measure: Measure the grasps and the solved trials; with --no-measure, only the task files are written.
        overwrite: Write even to a folder that `better place` did not make, and replace files of the same names there.
        json: Print the measurements as one JSON document.
    """
    from betterbench.certification.placing import measure_feasibility, place_task
    from betterbench.cli.verbs.evaluate import prepare_robot
    from betterbench.jobs import write_durably
    from betterbench.jobs.outputs import OutputFolder
    from betterbench.json_form import dump_json
    from betterbench.sim.robots import robot
    from betterbench.tasks import get_task, suite_tasks, task_to_json
    from betterbench.wording import plural

    of_suite = suite_tasks(suite)
    if arm.robot is None:
        raise InvalidInputError("--robot", "no robot was given", "Choose the robot to which to adapt the tasks")
    require_between("--trials", trials, 1, 1000)
    seeds = trials if measure else 0
    spec = robot(arm.robot)
    placed = [place_task(get_task(name), spec) for name in tasks or of_suite]
    prepare_robot(spec.name)
    rows: list[tuple[Placed, Feasibility]] = []
    planned = sum(seeds * len(p.task.training) for p in placed)
    with OutputFolder(out, "place", overwrite=overwrite), progress_bar("place", planned) as (bar, row):
        for one in placed:
            write_durably(out / f"{one.task.id}.json", dump_json(task_to_json(one.task)) + b"\n")
            bar.update(row, note=one.task.id)
            rows.append((one, measure_feasibility(one.task, seeds=seeds, on_trial=lambda: bar.advance(row))))
    if json:
        print_json({"robot": spec.name, "tasks": [_form(*one) for one in rows]})
        return
    print_table(["task", "base at (x, y)", "slots out of reach", "grasps planned", "solved"], [_row(*r) for r in rows])
    reasons = [reason for one in rows for reason in _reasons(*one)]
    if reasons:
        print_listing(["task", "object", "trials", "most frequent reason"], reasons)
    say(
        f"wrote {plural(len(rows), 'task file')} to {out}; every command takes a task file with --task-file", whole=True
    )


def _form(placed: Placed, found: Feasibility) -> dict[str, Any]:
    """Return a task's measurements as a JSON-serializable dict."""
    return {"task": placed.task.id, "base_m": list(placed.base_m), "outside": list(placed.outside), **asdict(found)}


def _row(placed: Placed, found: Feasibility) -> list[str]:
    x, y = placed.base_m
    grasps = f"{sum(g.planned for g in found.grasps)} of {sum(g.trials for g in found.grasps)}"
    return [
        placed.task.id,
        f"({x:g}, {y:g}) m",
        ", ".join(placed.outside) or "none",
        grasps if found.trials else "not measured",
        f"{found.solved} of {found.trials}" if found.trials else "not measured",
    ]


def _reasons(placed: Placed, found: Feasibility) -> list[list[str]]:
    """Return table rows with the reasons of failures.

    There is a row for each object whose grasp could not be planned in some trials, and one for the unsolved trials.
    """
    rows = [
        [placed.task.id, grasp.name, f"{grasp.trials - grasp.planned} of {grasp.trials}", f"no grasp: {grasp.reason}"]
        for grasp in found.grasps
        if grasp.reason
    ]
    if found.problem:
        rows.append([placed.task.id, "", f"{found.trials - found.solved} of {found.trials}", found.problem])
    return rows
