"""betterbench: a diagnostic benchmark that tells why a Vision-Language-Action policy fails.

Every task is known to Gymnasium once both are imported, in either order:
``gymnasium.make("BeTTER/FastFood-v0", variation="T1")``.
"""

import importlib.machinery
import importlib.util
import sys
from collections.abc import Sequence
from types import ModuleType

__version__ = "0.1.0"


def register_environments() -> None:
    """Register every task with Gymnasium that is not registered yet: call it after loading a task file."""
    import gymnasium  # noqa: PLC0415 - takes 0.3 s, which reading a record or printing a list does not need

    from betterbench.tasks import environment_id, task_names  # noqa: PLC0415 - the package has to exist first

    for task in task_names():
        name = environment_id(task)
        if name not in gymnasium.registry:
            gymnasium.register(name, entry_point="betterbench.episodes.gymnasium_env:TaskEnv", kwargs={"task": task})


class _AfterGymnasium:
    """Registers the tasks right after Gymnasium has been imported; Gymnasium itself loads no entry points."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> importlib.machinery.ModuleSpec | None:
        """Leave every import as it is, and let that of Gymnasium end with the registration."""
        del path, target
        if fullname != "gymnasium":
            return None
        sys.meta_path.remove(self)
        spec = importlib.util.find_spec(fullname)
        if spec is not None and isinstance(spec.loader, importlib.machinery.SourceFileLoader):
            spec.loader = _Registering(spec.loader.name, spec.loader.path)
        return spec


class _Registering(importlib.machinery.SourceFileLoader):
    """Loads a module, then registers the tasks."""

    def exec_module(self, module: ModuleType) -> None:
        """Execute the module and register."""
        super().exec_module(module)
        register_environments()


if "gymnasium" in sys.modules:
    register_environments()
else:
    sys.meta_path.insert(0, _AfterGymnasium())
