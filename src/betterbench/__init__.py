"""betterbench: a diagnostic benchmark that tells why a Vision-Language-Action policy fails.

Every task is a Gymnasium environment: ``gymnasium.make("betterbench:BeTTER/FastFood-v0", variation="T1")`` imports this
package, which registers them.
"""

import sys

from betterbench.version import __version__ as __version__


def register_environments() -> None:
    """Register every task with Gymnasium that is not registered yet.

    Importing betterbench does this if Gymnasium has been imported before. Call it where betterbench is imported first,
    and after loading a task file.
    """
    import gymnasium  # noqa: PLC0415 - takes 0.3 s, which reading a record or printing a list does not need

    from betterbench.tasks import environment_id, task_names  # noqa: PLC0415 - the package has to exist first

    for task in task_names():
        name = environment_id(task)
        if name not in gymnasium.registry:
            gymnasium.register(name, entry_point="betterbench.episodes.gymnasium_env:TaskEnv", kwargs={"task": task})


if "gymnasium" in sys.modules:
    register_environments()
