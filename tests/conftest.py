"""What every test shares: the GL back end, reproducible examples, and golden files."""

from __future__ import annotations

import argparse
import ctypes
import difflib
import gc
import os
import signal
import sys
import time
import zlib
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path

import pytest
from hypothesis import settings
from tests.daily import TODAY  # stores the day before worker processes start

settings.register_profile("betterbench", deadline=None, derandomize=True, print_blob=True)
settings.load_profile("betterbench")

THIRDS = (1, 2, 3)
"""Thirds of the slow tests: each day of continuous integration runs one of them."""
BEGAN = time.monotonic()


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
# Pydantic looks for plugins in all installed packages: 36 ms of CPU in each of the hundreds of processes of the tests.
os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")


def third(text: str) -> int:
    """Return the number of a third of the slow tests; "today" stands for another third each day."""
    if text == "today":
        return THIRDS[TODAY % len(THIRDS)]
    if text not in map(str, THIRDS):
        raise argparse.ArgumentTypeError(f"{text!r} is not 1, 2, 3 or today")
    return int(text)


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--regenerate-golden", action="store_true", help="rewrite golden files and print what changed")
    parser.addoption(
        "--slow-third", type=third, metavar="N", help="of the slow tests, run this third only: 1, 2, 3, or today"
    )
    parser.addoption("--slow-minutes", type=float, help="skip the slow tests that have not begun after so long")


def pytest_collection() -> None:
    gc.disable()  # a quarter of the time of importing the tests; nothing of them becomes garbage


def thirds_of(tests: Sequence[str]) -> list[int]:
    """Return the third of each slow test, in the order of collection, by its node id.

    The tests of a file are dealt out in turn, so that the parameters of one test, which take equally long, are spread
    over the thirds. The name of the file decides which third is first: a test that is added moves no test of another
    file.
    """
    dealt: Counter[str] = Counter()
    thirds = []
    for test in tests:
        file = test.partition("::")[0]
        thirds.append(THIRDS[(zlib.crc32(file.encode()) + dealt[file]) % len(THIRDS)])
        dealt[file] += 1
    return thirds


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Deselect the slow tests of the other thirds.

    With ``--last-failed``, pytest has not collected the tests that passed, so that the thirds would differ. The failed
    tests are those of the third that ran.
    """
    wanted = config.getoption("--slow-third")
    if wanted is None or config.getoption("lf", default=False):
        return
    slow = [item for item in items if item.get_closest_marker("slow") is not None]
    others = {item for item, third in zip(slow, thirds_of([i.nodeid for i in slow]), strict=True) if third != wanted}
    if others:
        config.hook.pytest_deselected(items=list(others))
        items[:] = [item for item in items if item not in others]


def pytest_collection_finish() -> None:
    """Put the folders of helper modules, each once, behind the installed packages, because processes inherit the path.

    The test files have put some sixty folders in front, which makes the start of a policy's process 20 % slower.
    """
    tests = Path(__file__).parent
    helpers = (str(tests), str(tests.parent / "tools"))
    sys.path[:] = sorted(dict.fromkeys(sys.path), key=lambda folder: folder.startswith(helpers))
    gc.freeze()
    gc.enable()


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item: pytest.Item) -> None:
    """Skip a slow test for which no time is left; continuous integration lists these."""
    minutes = item.config.getoption("--slow-minutes")
    if minutes is not None and item.get_closest_marker("slow") is not None and time.monotonic() > BEGAN + 60 * minutes:
        pytest.skip(f"not begun within --slow-minutes {minutes:g}")


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


@pytest.hookimpl(trylast=True)
def pytest_runtest_teardown(item: pytest.Item) -> None:
    """Free the scenes of a long test: an expert and its scene refer to each other, and each holds some 25 MB.

    This is no fixture, because each of the thousands of tests would set it up.
    """
    if item.get_closest_marker("slow") is not None:
        gc.collect()
