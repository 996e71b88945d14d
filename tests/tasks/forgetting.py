"""Tasks of files that a test loads, and that no other test knows."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from betterbench.tasks import user_files
from betterbench.tasks.authoring import registry


@contextmanager
def forgotten_tasks() -> Iterator[None]:
    """Begins without loaded files and forgets those that are loaded inside, like a process of its own."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(user_files.VARIABLE, "")
        own = {kind_name for kind_name in user_files._origins if kind_name[0] == "task"}
        for module, name, kept in (
            (user_files, "_files", {}),
            (user_files, "_origins", {k: v for k, v in user_files._origins.items() if k not in own}),
            (user_files, "_makers", {k: v for k, v in user_files._makers.items() if k not in own}),
            (registry, "_BUILDERS", {k: v for k, v in registry._BUILDERS.items() if ("task", k) not in own}),
            (registry, "_REGISTERED_AT", dict(registry._REGISTERED_AT)),
        ):
            patch.setattr(module, name, kept)
        yield
