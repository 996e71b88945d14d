"""Registration of all tasks with Gymnasium."""

import gymnasium

from betterbench.tasks import environment_id, task_names


def register_environments() -> None:
    """Register all tasks with Gymnasium under IDs such as "BeTTER/FastFood-v0", if they are not registered yet.

    If Gymnasium has been imported before betterbench, as in ``gymnasium.make("betterbench:BeTTER/FastFood-v0")``,
    importing betterbench registers the tasks. Otherwise, call this function.
    """
    for task in task_names():
        name = environment_id(task)
        if name not in gymnasium.registry:
            gymnasium.register(name, entry_point="betterbench.episodes.gymnasium_env:TaskEnv", kwargs={"task": task})
