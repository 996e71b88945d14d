"""Layout of a task for a different robot: the slots are moved and, if necessary, brought closer together."""

from betterbench.tasks.authoring.task import Task
from betterbench.tasks.authoring.task_form import task_from_json, task_to_json


def laid_out(
    task: Task, name: str, *, robot: str, robot_title: str, base_m: tuple[float, float], scale: float = 1.0
) -> Task:
    """Return a copy of a task with its slots moved for a different robot.

    The conditions and variations stay the same, and the slots in the operations of the variations are moved as well.
    Slots keep their headings and their jitter. The new task has version 1 and no listed regimes.

    Args:
        task: The task to lay out.
        name: Name of the new task.
        robot: Name of the robot.
        robot_title: Title of the robot, which is added to the title of the task.
        base_m: Position of the robot's base, in the base frame of the robot of the original task [m].
        scale: Distances between slots, as a fraction of the original distances.
    """
    form = task_to_json(task)  # also lists the slots in the operations
    x, y = base_m
    form["slots"] = [
        {**slot, "x": round(scale * (slot["x"] - x), 4), "y": round(scale * (slot["y"] - y), 4)}
        for slot in form["slots"]
    ]
    form |= {"id": name, "title": f"{task.title} ({robot_title})", "version": 1, "robot": robot}
    form.pop("regimes", None)
    return task_from_json(form, where=name)
