"""betterbench: a diagnostic benchmark that tells why a Vision-Language-Action policy fails.

Importing it makes every task known to Gymnasium: ``gymnasium.make("BeTTER/FastFood-v0", variation="T1")``.
"""

import gymnasium

__version__ = "0.1.0"


def _register_environments() -> None:
    """Register every task with Gymnasium. Gymnasium loads no entry points, so importing this package has to do it."""
    from betterbench.tasks import environment_id, task_names  # noqa: PLC0415 - the package has to exist first

    for task in task_names():
        name = environment_id(task)
        if name not in gymnasium.registry:
            gymnasium.register(name, entry_point="betterbench.episodes.gymnasium_env:TaskEnv", kwargs={"task": task})


_register_environments()
