"""Registration of every task with Gymnasium."""

import gymnasium

from betterbench.tasks import environment_id, task_names


def register_environments() -> None:
    """Register all tasks with Gymnasium that are not registered yet ("BeTTER/FastFood-v0").

    Importing betterbench does this automatically if Gymnasium was imported first, as in
    ``gymnasium.make("betterbench:BeTTER/FastFood-v0")``. Call this function if betterbench was imported first.
    """
    for task in task_names():
        name = environment_id(task)
        if name not in gymnasium.registry:
            gymnasium.register(name, entry_point="betterbench.episodes.gymnasium_env:TaskEnv", kwargs={"task": task})
