"""Loading a text as a user's file with a learner, and forgetting it after the test."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from betterbench.policies.learned import families
from betterbench.tasks import user_files
from betterbench.tasks.user_files import load_task_files

REGISTRIES = [(families, "_FAMILIES"), *((user_files, name) for name in ("_files", "_origins", "_makers"))]


def loader(folder: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., Path]:
    """Returns what loads a text from a file; each text beside the others, or in place of them with ``anew``."""
    before = [(module, name, dict(getattr(module, name))) for module, name in REGISTRIES]
    monkeypatch.setenv(user_files.VARIABLE, "")

    def forget() -> None:
        for module, held, values in before:
            monkeypatch.setattr(module, held, dict(values))

    def load(text: str, name: str = "mine.py", *, anew: bool = False) -> Path:
        if anew:
            forget()
        (folder / name).write_text(text, encoding="utf-8")
        load_task_files([folder / name])
        return folder / name

    forget()
    return load
