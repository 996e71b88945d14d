"""Run pytest, and with ``--again`` run the tests that failed a second time.

Usage: ``python tools/run_tests.py [--again] [arguments of pytest]``. Tests with timeouts, and tests that kill
processes, may fail on a busy machine. When the other tests have ended, the machine is less busy.

The plug-in pytest-rerunfailures is not used: with several processes it asks a server about every test, and each
answer takes about 20 ms.
"""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Sequence

import pytest

AGAIN = "--again"
ONLY_FAILED = ("--last-failed", "--last-failed-no-failures", "none")


def run_tests(arguments: Sequence[str]) -> int:
    """Run pytest with the arguments and return its exit status.

    With ``--again``, the failed tests run once more, and the status is that of their second run. If the first run
    did not come to its end (an interruption, or an error in pytest), its status is returned.
    """
    for_pytest = [argument for argument in arguments if argument != AGAIN]
    status = _pytest(for_pytest)
    if AGAIN not in arguments or status != pytest.ExitCode.TESTS_FAILED:
        return status
    print("\n[test] The tests that failed, listed above, run once more.", flush=True)
    return _pytest([*for_pytest, *ONLY_FAILED])


def _pytest(arguments: Sequence[str]) -> int:
    return subprocess.run([sys.executable, "-m", "pytest", *arguments], check=False).returncode


if __name__ == "__main__":
    raise SystemExit(run_tests(sys.argv[1:]))
