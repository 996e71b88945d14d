"""Installation of a simulator in its own Python environment, and the program that its process runs."""

from __future__ import annotations

import contextlib
import fcntl
import hashlib
import os
import pkgutil
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import platformdirs

from betterbench.errors import InvalidInputError, MissingDependencyError, last_line
from betterbench.jobs.places import open_in_place
from betterbench.sim.worlds.environment import python_environment

INSTALL_LIMIT_S = 3600.0
"""Maximum duration of one installation step [s]. LIBERO's packages are 360 MB."""

_COMPLETE = "complete"
_PACKAGE = Path(__file__).resolve().parent
_START = (
    "import sys, types\n"
    "for name, path in {packages!r}:\n"
    "    stand_in = types.ModuleType(name); stand_in.__path__ = [path]; sys.modules[name] = stand_in\n"
    "from {module} import main\n"
    "main()\n"
)
"""Program that runs a module of betterbench in an environment in which betterbench is not installed.

The packages of betterbench are replaced by empty modules that only have a search path.
"""
_STAND_INS = (
    "betterbench",
    "betterbench.jobs",
    "betterbench.sim",
    "betterbench.sim.worlds",
    *(f"betterbench.sim.worlds.{found.name}" for found in pkgutil.iter_modules([str(_PACKAGE)]) if found.ispkg),
    "betterbench.tasks",
    "betterbench.tasks.worlds",
)
"""Packages that contain the modules imported by a simulator. Their ``__init__`` modules are not executed."""


@dataclass(frozen=True, slots=True)
class Installation:
    """Python environment with the simulator of a world.

    Attributes:
        name: World name on the command line.
        lock: Name of the locked requirements file.
        module: Module that the simulator's process runs.
        size: Size of the packages for messages, such as "270 MB (0.9 GB unpacked)".
        summary: Description in a few words.
        beside: Installation of another world, if that world's Python runs this simulator. None if this simulator has a
            Python of its own. If another Python is used, this simulator's packages are only read and never imported, so
            their dependencies are not installed.
    """

    name: str
    lock: str
    module: str
    size: str
    summary: str
    beside: Installation | None = None

    @property
    def lock_path(self) -> Path:
        """Path of the locked requirements.

        The file is next to this module in an installed package, and in the folder ``requirements`` in a checkout.
        """
        packaged = _PACKAGE / "locks" / self.lock
        return packaged if packaged.exists() else _PACKAGE.parents[3] / "requirements" / self.lock

    @property
    def folder(self) -> Path:
        """Folder of the environment. Its name contains a hash of the lock file.

        `make bench` also uses the folder of the LIBERO environment.
        """
        digest = hashlib.sha256(self.lock_path.read_bytes()).hexdigest()[:16]
        return platformdirs.user_cache_path("betterbench") / "peers" / f"{self.name}-{digest}"

    @property
    def is_installed(self) -> bool:
        """Whether this environment is complete.

        If another world's Python is used, the environment of that world must be complete too.
        """
        return (self.folder / _COMPLETE).exists() and (self.beside is None or self.beside.is_installed)

    def command(self) -> tuple[str, ...]:
        """Return the command that starts the simulator process. The caller appends the socket's file descriptor.

        If another world's Python runs the simulator, the first argument is the folder of this installation.

        Raises:
            MissingDependencyError: If the world was not installed with ``better worlds install``.
        """
        if not self.is_installed:
            raise MissingDependencyError(
                f"the world {self.name} is not installed. Run `better worlds install {self.name}` once."
            )
        python = (self.beside or self).folder / "bin" / "python"
        return (str(python), "-c", start_code(self.module), *([] if self.beside is None else [str(self.folder)]))

    def install(self, *, waits: Callable[[], None] = lambda: None) -> Path:
        """Create the environment unless it is already complete, and return its folder.

        The environment is marked as complete at the very end. After an interruption, the installation starts again from
        the beginning. If another process is installing the same world, ``waits`` is called once, and the method returns
        when that process has finished.

        Raises:
            MissingDependencyError: If a step fails. The message contains the last output of the step.
        """
        if self.is_installed:
            return self.folder
        if self.beside is not None:
            self.beside.install(waits=waits)
        with self._alone(waits) as lock:
            if not self.is_installed:
                self._make(lock)
        return self.folder

    @contextlib.contextmanager
    def _alone(self, waits: Callable[[], None]) -> Iterator[int]:
        """Hold the lock of the folder until all processes that inherited it have ended.

        Yields the lock's file descriptor.
        """
        path = self.folder.with_name(f".{self.folder.name}.lock")
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            handle = open_in_place(path)
        except (OSError, InvalidInputError) as error:
            raise MissingDependencyError(f"the world {self.name} cannot be installed: {error}") from error
        try:
            try:
                fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                waits()
                fcntl.flock(handle, fcntl.LOCK_EX)
            yield handle
        finally:
            os.close(handle)

    def _make(self, lock: int) -> None:
        target = self.folder
        shutil.rmtree(target, ignore_errors=True)
        python = (self.beside or self).folder / "bin" / "python"
        install = ["install", "--quiet", "--require-hashes", "--no-deps", "--requirement", str(self.lock_path)]
        if self.beside is not None:
            install += ["--target", str(target)]
        uv = shutil.which("uv")
        if self.beside is None:
            venv = [sys.executable, "-m", "venv"] if uv is None else [uv, "venv", "--quiet", "--python", sys.executable]
            self._run([*venv, str(target)], lock)
        if uv is not None:
            self._run([uv, "pip", *install, "--python", str(python)], lock)
        else:
            self._run([str(python), "-m", "pip", *install], lock)
        (target / _COMPLETE).touch()

    def _run(self, command: list[str], lock: int) -> None:
        """Run one step of the installation.

        If the calling process is killed, the step continues and still holds the lock.
        """
        try:
            done = subprocess.run(  # noqa: S603 - uv or pip with our own lock
                command,
                capture_output=True,
                text=True,
                timeout=INSTALL_LIMIT_S,
                check=False,
                env=python_environment(os.environ),
                pass_fds=(lock,),
            )
        except (OSError, subprocess.TimeoutExpired) as error:
            raise MissingDependencyError(f"the world {self.name} cannot be installed: {error}") from error
        if done.returncode:
            said = last_line(done.stderr) or last_line(done.stdout) or "no output"
            raise MissingDependencyError(
                f"the world {self.name} cannot be installed: {Path(command[0]).name} reported: {said}. "
                "Its packages come from the package index. Check the connection, and run the same command again."
            )


def start_code(module: str) -> str:
    """Return the Python program that runs the ``main`` function of the given module in a simulator's environment."""
    source = _PACKAGE.parents[2]
    packages = tuple((name, str(source.joinpath(*name.split(".")))) for name in _STAND_INS)
    return _START.format(packages=packages, module=module)
