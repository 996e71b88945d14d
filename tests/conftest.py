"""What every test shares: the GL back end, reproducible examples, and golden files."""

from __future__ import annotations

import ctypes
import difflib
import gc
import os
import signal
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from hypothesis import settings

settings.register_profile("betterbench", deadline=None, derandomize=True, print_blob=True)
settings.load_profile("betterbench")


def _gl_backend() -> str:
    """Names the off-screen GL back end whose library can be loaded here."""
    try:
        ctypes.CDLL("libEGL.so.1")
    except OSError:
        return "osmesa"
    return "egl"


# A shell lets its background jobs, and all that they start, ignore Ctrl-C; some tests press it.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

# Before anything imports mujoco; `make test` has chosen already, a bare `pytest` has not.
os.environ.setdefault("MUJOCO_GL", _gl_backend())
os.environ.setdefault("LP_NUM_THREADS", "0")
os.environ.setdefault("OMP_NUM_THREADS", "1")


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--regenerate-golden", action="store_true", help="rewrite golden files and print what changed")


def pytest_collection() -> None:
    gc.disable()  # a quarter of the time of importing the tests; nothing of them becomes garbage


def pytest_collection_finish() -> None:
    gc.freeze()
    gc.enable()


@pytest.fixture
def golden(request: pytest.FixtureRequest, capsys: pytest.CaptureFixture[str]) -> Callable[[str, str], None]:
    """Compares a text with the file ``golden/NAME`` beside the test; `make golden` rewrites the file."""

    def compare(name: str, text: str) -> None:
        file = Path(request.path).parent / "golden" / name
        stored = file.read_text(encoding="utf-8") if file.exists() else ""
        changes = "\n".join(difflib.unified_diff(stored.splitlines(), text.splitlines(), "stored", "now", lineterm=""))
        if request.config.getoption("--regenerate-golden"):
            file.parent.mkdir(exist_ok=True)
            file.write_text(text, encoding="utf-8")
            with capsys.disabled():
                request.config.get_terminal_writer().line(f"\n{file.name}: {changes or 'unchanged'}")
            return
        assert file.exists(), f"{file} does not exist: write it with `make golden`"
        assert stored == text, f"{file.name} differs (`make golden` rewrites it):\n{changes}"

    return compare


@pytest.fixture(autouse=True)
def _scenes_are_freed(request: pytest.FixtureRequest) -> Iterator[None]:
    """Frees the scenes of a long test: an expert and its scene refer to each other, and each holds some 25 MB."""
    yield
    if request.node.get_closest_marker("slow") is not None:
        gc.collect()
