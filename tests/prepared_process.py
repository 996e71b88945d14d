"""Commands of Python in copies of a process that has imported modules, because imports take most of their time."""

from __future__ import annotations

import atexit
import functools
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path

COMMAND_LINE = tuple(
    f"betterbench.{name}"
    for name in (
        "cli.output.diagnosis", "cli.output.page", "cli.output.standing", "cli.verbs.certify",
        "cli.verbs.compare", "cli.verbs.diagnose", "cli.verbs.evaluate", "cli.verbs.listing", "cli.verbs.replay",
        "cli.verbs.report", "evaluation.running.runner",
    )
)  # fmt: skip
"""Modules of the usual subcommands of ``better``. Importing them registers no task."""

OTHERS = (
    "jinja2", "mujoco", "numpy", "PIL.Image", "pyarrow.parquet", "pydantic", "pytest", "rich.progress", "tyro",
    "unittest.mock",
)  # fmt: skip
"""Modules of other packages, for commands that import another copy of ours; no plug-ins of pytest."""

SERVER = """
import importlib, json, os, runpy, sys, traceback

for name in sys.argv[1:]:
    importlib.import_module(name)

def carry_out(kind, what, *rest):
    sys.argv[:] = [kind, *rest]
    if kind == "-m":
        runpy.run_module(what, run_name="__main__", alter_sys=True)
    else:
        exec(compile(what, "<string>", "exec"), {"__name__": "__main__"})

for line in sys.stdin:
    command, folder, environment, printed = json.loads(line)
    child = os.fork()
    if not child:
        files = (os.devnull, os.O_RDONLY), *((f"{printed}/{name}", os.O_WRONLY | os.O_CREAT) for name in ("out", "err"))
        for number, (file, mode) in enumerate(files):
            os.dup2(os.open(file, mode), number)
        os.chdir(folder)
        os.environ.clear()
        os.environ.update(environment)
        sys.path[1:1] = filter(None, environment.get("PYTHONPATH", "").split(os.pathsep))
        sys.dont_write_bytecode = bool(environment.get("PYTHONDONTWRITEBYTECODE"))
        importlib.invalidate_caches()
        status = 1
        try:
            carry_out(*command)
            status = 0
        except SystemExit as stop:
            status = stop.code or 0
        except BaseException:
            traceback.print_exc()
        finally:
            sys.stdout.flush()
            sys.stderr.flush()
            os._exit(status)
    print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), flush=True)
"""


class PreparedProcess:
    """A process that has imported modules, and carries out each command in a copy of itself.

    What a command registers or imports is in its copy alone.
    """

    def __init__(self, *modules: str) -> None:
        """Start the process, which imports the modules while the caller goes on."""
        # Task files that a test has loaded into this process are named in such variables, and modules would load them.
        environment = {name: value for name, value in os.environ.items() if not name.startswith("BETTERBENCH")}
        command = [sys.executable, "-c", SERVER, *modules]
        self._server = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=environment
        )

    def run(
        self, *command: str, cwd: Path | None = None, env: Mapping[str, str] | None = None
    ) -> subprocess.CompletedProcess[str]:
        """Return a command of Python that has ended.

        Args:
            command: Its words after the name of the interpreter, which are those of ``-m`` or ``-c``.
            cwd: Its folder.
            env: Its environment: that of this process unless given. Of the variables that Python reads when it starts,
                PYTHONPATH and PYTHONDONTWRITEBYTECODE count.
        """
        assert self._server.stdin is not None
        assert self._server.stdout is not None
        with tempfile.TemporaryDirectory() as printed:
            asked = [command, str(cwd or Path.cwd()), dict(os.environ if env is None else env), printed]
            self._server.stdin.write(json.dumps(asked) + "\n")
            self._server.stdin.flush()
            status = int(self._server.stdout.readline())
            out, err = ((Path(printed) / name).read_text(encoding="utf-8") for name in ("out", "err"))
        return subprocess.CompletedProcess(command, status, out, err)

    def close(self) -> None:
        """End the process."""
        with self._server:
            assert self._server.stdin is not None
            self._server.stdin.close()


@functools.cache
def prepared(*modules: str) -> PreparedProcess:
    """Return the process of this session that has imported the modules."""
    process = PreparedProcess(*modules)
    atexit.register(process.close)
    return process
