"""What goes wrong in the process of a stand-in of a simulator, once.

The environment variable ``FAKE_FAULT`` holds "KIND:WHERE:FILE": what goes wrong, in which trial, and the file that says
that it has. ``FAKE_RUN`` is the process of the run.
"""

import os
import signal
import sys
import time
from pathlib import Path


def fault_due(here):
    """Return what goes wrong now in a trial for which ``here`` is true of the place that the fault names, or None."""
    kind, where, file = (os.environ.get("FAKE_FAULT") or "none:0:none").rsplit(":", 2)
    if kind == "none" or Path(file).exists() or not here(where):
        return None
    Path(file).touch()
    return kind


def fail(kind):
    """Let it go wrong, unless it is a number that is none."""
    if kind == "dies":
        os._exit(9)
    if kind == "hangs":
        time.sleep(1000.0)
    if kind == "raises":
        raise RuntimeError("the cube is gone")
    if kind == "garbage":
        os.write(int(sys.argv[-1]), b"mujoco says hello, and more than that\n" * 10)
    if kind == "kill the simulator":
        os.kill(os.getpid(), signal.SIGKILL)
    if kind == "kill the worker":
        os.kill(os.getppid(), signal.SIGKILL)
    if kind == "kill the run":
        os.kill(int(os.environ["FAKE_RUN"]), signal.SIGKILL)
