"""Registry of assets that is the same after a test that loads imported assets."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from betterbench.sim.assets.authoring import registry
from betterbench.tasks import user_files


@contextmanager
def kept_registry() -> Iterator[None]:
    """Restore the registered assets, the loaded files and the environment variable that passes them on."""
    before = dict(registry._REGISTER)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(user_files.VARIABLE, "")
        patch.setattr(user_files, "_files", dict(user_files._files))
        patch.setattr(registry, "_folders_read", set())
        try:
            yield
        finally:
            registry._REGISTER.clear()
            registry._REGISTER.update(before)
