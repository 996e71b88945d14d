"""User files and plugins that register tasks, assets and other items.

Files are passed with the option ``--task-file`` or in the environment variable ``BETTERBENCH_TASK_FILES``. Worker
processes inherit this variable. A folder of imported assets (``--asset-dir``) is also treated as a user file: its
manifest is read, and nothing is executed. An installed package is a plugin if it names a module in the entry point
group ``betterbench.plugins``. A file in the folder of a run is never executed automatically, because it may be
untrusted.
"""

from __future__ import annotations

import functools
import hashlib
import importlib.abc
import importlib.metadata
import importlib.util
import os
import re
import sys
import threading
import types
from collections.abc import Callable, Container, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

from betterbench.errors import InvalidInputError, RecordError, errors_explained
from betterbench.installation import extra_with, missing_extra
from betterbench.json_form import read_bounded
from betterbench.quoting import shell_word
from betterbench.tasks.renamed import with_present_names
from betterbench.tasks.suite_folder import is_suite_folder, read_suite_folder

VARIABLE = "BETTERBENCH_TASK_FILES"
"""Environment variable with the paths of task files, which are separated as in PATH."""

GROUP = "betterbench.plugins"
"""Group of entry points. Each entry point names a module that registers tasks or assets when it is imported."""

COMPANION_SUFFIX = ".demonstrations.json"
"""Suffix of the file with the measured demonstrations of a task file. It replaces ".py" or ".json".

The file is in the same folder as the task file.
"""

COPIES = "task_files"
"""Folder of a run in which a copy of each task file is kept."""

ASSET_MANIFEST = "asset-manifest.json"
"""File that lists the assets in a folder of imported assets."""

_MAX_SOURCE_BYTES = 64 << 20

P = ParamSpec("P")
T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class TaskFile:
    """User file that has been read: a task file, or the manifest of an asset folder.

    Worker processes get the text that was read, even if the file changes in the meantime.

    Attributes:
        path: Absolute path on the machine that read the file first.
        source: Text of the file.
        demonstrations: Text of the file with the measured demonstrations, or None if there is no such file.
        suite: Suite folder that the file was loaded with, or None.
    """

    path: str
    source: str
    demonstrations: str | None = None
    suite: str | None = None

    @classmethod
    def read(cls, path: Path | str) -> TaskFile:
        """Read a task file.

        Raises:
            InvalidInputError: If the file does not exist, or is not UTF-8 text.
        """
        cure = "Pass the path of a task file"
        try:
            found = Path(os.path.realpath(path))
            text = read_bounded(found, max_bytes=_MAX_SOURCE_BYTES, cure=cure).decode("utf-8")
            return cls(str(found), text, _companion_text(found))
        except (InvalidInputError, ValueError) as error:
            problem = error.problem if isinstance(error, InvalidInputError) else "it is not UTF-8 text"
            raise InvalidInputError(f"--task-file {path}", problem, cure) from None

    @classmethod
    def read_folder(cls, folder: Path | str) -> TaskFile:
        """Read the manifest of an asset folder.

        Raises:
            InvalidInputError: If the folder does not exist, or contains no imported assets.
        """
        cure = "Pass a folder written by `better assets import`"
        found = Path(os.path.realpath(folder))
        where = f"--asset-dir {folder}"
        if not found.is_dir():
            raise InvalidInputError(where, "the folder does not exist", cure)
        if not (found / ASSET_MANIFEST).is_file():
            raise InvalidInputError(where, f"it has no {ASSET_MANIFEST}", cure)
        return cls.read(found / ASSET_MANIFEST)

    @property
    def is_asset_folder(self) -> bool:
        """Whether the file is the manifest of an asset folder."""
        return Path(self.path).name == ASSET_MANIFEST

    @property
    def option(self) -> str:
        """Command-line option that loads the file, for use in messages.

        If the file belongs to a suite, the option loads the suite folder.
        """
        if self.is_asset_folder:
            return f"--asset-dir {shell_word(str(Path(self.path).parent))}"
        return f"--task-file {shell_word(self.suite or self.path)}"

    @property
    def option_by_name(self) -> tuple[str, str]:
        """Command-line option that loads the file, given by its name without the folder.

        It is meant for people who received the file from others, because they may have it in a different folder.
        """
        if self.is_asset_folder:
            return "--asset-dir", Path(self.path).parent.name
        return "--task-file", Path(self.suite or self.path).name

    @property
    def sha256(self) -> str:
        """SHA-256 of the text."""
        return hashlib.sha256(self.source.encode()).hexdigest()

    @property
    def copy_name(self) -> str:
        """File name of the copy that is stored in the folder of a run."""
        return _copy_name(Path(self.path).name, self.sha256)


@dataclass(frozen=True, slots=True)
class Companion:
    """File with the measured demonstrations of a user's task.

    Attributes:
        path: Path of the file.
        text: Content of the file, or None if the file is missing.
    """

    path: Path
    text: str | None


@dataclass(frozen=True, slots=True)
class _Origin:
    """Origin of a registered name.

    Attributes:
        text: Description for messages.
        path: Path of the task file, or of the plugin's module.
        package: Name and version of the plugin's package, or None for a task file.
    """

    text: str
    path: str
    package: tuple[str, str] | None = None


class _Loader(importlib.abc.ExecutionLoader):
    """Import loader that executes the text of a task file as a module."""

    def __init__(self, file: TaskFile) -> None:
        self._file = file

    def get_filename(self, fullname: str) -> str:  # noqa: ARG002
        return self._file.path

    def get_source(self, fullname: str) -> str:  # noqa: ARG002
        return self._file.source

    @staticmethod
    def source_to_code(data: str | bytes, path: str = "<string>") -> types.CodeType:  # type: ignore[override]
        return compile(with_present_names(data, path), path, "exec", dont_inherit=True)


READERS: dict[str, Callable[[TaskFile], None]] = {}
"""Functions that register the content of files that are not Python files, by suffix (".json")."""

_files: dict[str, TaskFile] = {}
_origins: dict[tuple[str, str], _Origin] = {}
_makers: dict[tuple[str, str], Callable[..., Any]] = {}
_loading: list[_Origin] = []
_plugins_loaded: list[str] = []
_lock = threading.RLock()


def loading_folder() -> Path | None:
    """Return the folder of the user file that is being loaded.

    The result is None if nothing is being loaded, or if a plugin is being loaded.
    """
    return Path(_loading[-1].path).parent if _loading and _loading[-1].package is None else None


def registered(kind: str, name: str, make: Callable[P, T], known: Container[str]) -> Callable[P, T]:
    """Record which user file registers a name. Every registry that users may extend calls this function.

    Args:
        kind: Kind of the registered item in the singular ("task", "asset").
        name: Name of the item.
        make: Function that makes the item.
        known: Names that are already taken.

    Returns:
        The function ``make``. If it comes from a user's file, errors that it raises name this file and the line.

    Raises:
        InvalidInputError: If a user's file uses a name that belongs to betterbench or to another file.
    """
    if not _loading or make.__module__.startswith("betterbench."):
        return make  # a user's file may be the first to import a module of betterbench
    here, before = _loading[-1], _origins.get((kind, name))
    if name in known and (before is None or before.path != here.path):
        owner = "betterbench itself" if before is None else before.text
        raise InvalidInputError(
            f"{kind} {name!r}",
            f"it is defined in both {here.text} and {owner}",
            "Change the name in one of the two files",
        )

    @functools.wraps(make)
    def explained(*args: P.args, **kwargs: P.kwargs) -> T:
        with errors_explained(here.path):
            return make(*args, **kwargs)

    _origins[kind, name], _makers[kind, name] = here, explained
    return explained


def load_task_files(paths: Iterable[Path | str]) -> None:
    """Load user files, each once, and pass their paths on to child processes.

    Args:
        paths: Task files, and suite folders whose tasks are loaded.

    Raises:
        InvalidInputError: If a file is missing, raises an error, or registers a name that is already taken.
    """
    files: list[TaskFile] = []
    for path in paths:
        if is_suite_folder(path):
            folder = str(Path(path).absolute())
            files += [replace(TaskFile.read(file), suite=folder) for file in read_suite_folder(path).files]
        else:
            files.append(TaskFile.read(path))
    _load_read(files)


def load_asset_folders(folders: Iterable[Path | str]) -> None:
    """Load folders of imported assets, each once, and pass their paths on to child processes.

    Raises:
        InvalidInputError: If a folder is missing or contains no imported assets.
    """
    _load_read([TaskFile.read_folder(folder) for folder in folders])


def _load_read(files: Iterable[TaskFile]) -> None:
    with _lock:
        load_declared()
        load_sources(files)
        if _files:
            os.environ[VARIABLE] = os.pathsep.join(_files)


def load_sources(files: Iterable[TaskFile]) -> None:
    """Load files that have already been read, for example in a worker. A text that is already loaded is skipped.

    Raises:
        InvalidInputError: If a file raises an error, or registers a name that is already taken.
    """
    with _lock:
        for file in files:
            if file.path in _files or file.sha256 in {f.sha256 for f in _files.values()}:
                continue
            if file.is_asset_folder:  # the asset registry reads the manifest when an asset is first looked up
                _files[file.path] = file
                continue
            with _registering(_Origin(file.path, file.path)):
                READERS.get(Path(file.path).suffix.lower(), _execute)(file)
            _files[file.path] = file


def _execute(file: TaskFile) -> None:
    """Execute the text of a Python file as a module."""
    stem = re.sub(r"\W", "_", Path(file.path).stem)
    name = f"betterbench_task_file_{stem}_{file.sha256[:8]}"
    spec = importlib.util.spec_from_loader(name, _Loader(file), origin=file.path)
    if spec is None or spec.loader is None:
        raise AssertionError("the import system returned no module specification for the file")
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module  # dataclasses look up the module of their class in sys.modules
    spec.loader.exec_module(module)


def load_declared() -> None:
    """Load the installed plugins and the files in the environment variable, once. The registries call this function.

    Raises:
        InvalidInputError: If a file cannot be loaded, raises an error, or registers a name that is already taken.
    """
    if _loading:
        return  # a user's file is using a registry while it is being loaded
    with _lock:
        if not _plugins_loaded:
            for entry in importlib.metadata.entry_points(group=GROUP):
                found = importlib.util.find_spec(entry.module)
                package = (entry.dist.name, entry.dist.version) if entry.dist else (entry.name, "unknown")
                with _registering(_Origin(f"plugin {package[0]}", (found and found.origin) or entry.module, package)):
                    entry.load()
            _plugins_loaded.append(GROUP)
        declared = [path for path in os.environ.get(VARIABLE, "").split(os.pathsep) if path and path not in _files]
        if declared:
            load_sources([TaskFile.read(path) for path in declared])


def loaded_files() -> tuple[TaskFile, ...]:
    """Return the user files that are loaded in this process."""
    return tuple(_files.values())


def origins_of(tasks: Iterable[str], *, worlds: Iterable[str] = ()) -> dict[str, list[dict[str, str]]]:
    """Return the files and plugins that the given tasks and worlds need, for the plan of a run.

    The keys of the result are "task_files" (with name and sha256) and "plugins" (with name and version). If there are
    no entries for a key, the key is left out.
    """
    names = [*(("task", task) for task in tasks), *(("world", world) for world in worlds)]
    found = [origin for origin in map(_origins.get, names) if origin is not None]
    packages = sorted({origin.package for origin in found if origin.package})
    files = [{"name": Path(f.path).name, "sha256": f.sha256} for f in _files.values()] if found else []
    plugins = [{"name": name, "version": version} for name, version in packages]
    return {name: listed for name, listed in (("task_files", files), ("plugins", plugins)) if listed}


def code_of(kind: str, name: str) -> str | None:
    """Return where a registered name comes from.

    This is "sha256 ..." for a user's file, the name and version of the package for a plugin, and None for a built-in
    name. ``kind`` has the same meaning as in :func:`registered`.
    """
    origin = _origins.get((kind, name))
    if origin is None:
        return None
    return " ".join(origin.package) if origin.package else f"sha256 {_files[origin.path].sha256}"


@contextmanager
def explaining(kind: str, name: str) -> Iterator[None]:
    """Context manager that adds the file and the line to errors raised by the user code that registered a name.

    Raises:
        InvalidInputError: If the code raises an error.
    """
    origin = _origins.get((kind, name))
    if origin is None:
        yield
        return
    with errors_explained(origin.path):
        yield


def suite_folder_of(tasks: Iterable[str]) -> Path | None:
    """Return the folder of the suite that defines all the given tasks, or None if no single folder defines them."""
    origins = {_origins.get(("task", task)) for task in tasks}
    files = {None if origin is None else _files.get(origin.path) for origin in origins}
    folders = {None if file is None else file.suite for file in files}
    folder = folders.pop() if len(folders) == 1 else None
    return None if folder is None else Path(folder)


def suite_file(tasks: Iterable[str], name: str) -> Path | None:
    """Return the path of a file in the folder of the suite that defines all the given tasks.

    The result is None if no single folder defines these tasks, or if the folder does not contain the file.
    """
    folder = suite_folder_of(tasks)
    path = None if folder is None else folder / name
    return path if path is not None and path.is_file() else None


def companion_of(task: str) -> Companion | None:
    """Return the file with the measured demonstrations of a user's task.

    Returns:
        The path and the text of the file, or None for a built-in task. On a machine to which the task file was sent,
        the text is the copy that was sent with it.
    """
    origin = _origins.get(("task", task))
    if origin is None:
        return None
    path = Path(origin.path)
    text = _companion_text(path)
    sent = _files.get(origin.path)
    if text is None and sent is not None and not path.exists():
        text = sent.demonstrations
    return Companion(path.with_suffix(COMPANION_SUFFIX), text)


def _companion_text(path: Path) -> str | None:
    companion = path.with_suffix(COMPANION_SUFFIX)
    try:
        return read_bounded(companion, max_bytes=_MAX_SOURCE_BYTES, cure="Measure them again").decode("utf-8")
    except InvalidInputError as error:
        if isinstance(error.__cause__, FileNotFoundError):
            return None
        raise


def options_for(tasks: Iterable[str], *, worlds: Iterable[str] = ()) -> str:
    """Return the command-line options that load the files of the given tasks and worlds, beginning with a space.

    The result is "" if all of them are built in.
    """
    return loading_options() if origins_of(tasks, worlds=worlds).get("task_files") else ""


def options_by_name(tasks: Iterable[str]) -> tuple[str, ...]:
    """Return the command-line options that load the files of the given tasks, as separate words.

    The options contain only the names of the files, without their folders.
    """
    hashes = {file["sha256"] for file in origins_of(tasks).get("task_files", ())}
    options = dict.fromkeys(file.option_by_name for file in _files.values() if file.sha256 in hashes)
    return tuple(word for option in options for word in option)


def loading_options() -> str:
    """Return the command-line options that load the same files as in this process, beginning with a space.

    A single suite is loaded with ``--suite``. Commands accept this option only once, so several suites are loaded with
    ``--task-file``.
    """
    suites = {file.suite for file in _files.values() if file.suite is not None}
    suite = f"--suite {shell_word(suites.pop())}" if len(suites) == 1 else None
    options = (suite if suite is not None and file.suite is not None else file.option for file in _files.values())
    return "".join(f" {option}" for option in dict.fromkeys(options))


def require_origins(plan: Mapping[str, Any], run: Path) -> None:
    """Check that the files and plugins of a run's tasks are loaded, as listed in the plan of the run.

    If the folder of the run contains copies of the files, the error names them, but they are never loaded from there.

    Raises:
        RecordError: If a file or plugin is not loaded, or if a file has a different text.
    """
    load_declared()
    hashes = {file.sha256 for file in _files.values()}
    for name, sha256 in _pairs(plan, "task_files", "sha256"):
        if sha256 not in hashes:
            copy = run / COPIES / _copy_name(name, sha256)
            if name == ASSET_MANIFEST:
                raise RecordError(
                    f"{run}: tasks of this run use an asset folder (manifest sha256 {_safe(sha256)[:12]}) that is not "
                    f"loaded or has changed. Pass the folder with --asset-dir. If it has changed, also choose a new "
                    f"folder with --out."
                )
            where = f"a copy is {copy}: read it before you pass it" if copy.is_file() else "pass the file"
            raise RecordError(
                f"{run}: tasks of this run are defined by {_safe(name)} (sha256 {_safe(sha256)[:12]}), which is not "
                "loaded, or is loaded with a different text. For another run, or if the text has changed, choose a new "
                "folder with --out. A file in the "
                f"folder of a run is not executed automatically: {where} with --task-file, or pass the folder of "
                "its suite with --suite."
            )
    packages = {origin.package[0] for origin in _origins.values() if origin.package}
    for name, version in _pairs(plan, "plugins", "version"):
        if name not in packages:
            raise RecordError(
                f"{run}: tasks of this run are defined by the package {_safe(name)} {_safe(version)}, which is not "
                "installed. Install this package."
            )


def _pairs(plan: Mapping[str, Any], key: str, second: str) -> Iterator[tuple[str, str]]:
    listed = plan.get(key, [])
    for entry in listed if isinstance(listed, list) else []:
        if isinstance(entry, dict):
            yield str(entry.get("name")), str(entry.get(second))


def _safe(text: str) -> str:
    """Return an untrusted string without the characters that could lead out of a folder or control a terminal."""
    return re.sub(r"[^\w.+-]", "_", text)[:100]


def _copy_name(name: str, sha256: str) -> str:
    return f"{_safe(sha256)[:12]}-{_safe(name)}"


@contextmanager
def _registering(origin: _Origin) -> Iterator[None]:
    """Context manager that records a file as the origin of everything that is registered inside it.

    At the end, the tasks of the file are built as a check.

    Raises:
        InvalidInputError: If the file raises an error.
        MissingDependencyError: If the file imports a module of an extra that is not installed.
    """
    _loading.append(origin)
    try:
        try:
            with errors_explained(origin.path):
                yield
        except InvalidInputError as error:
            cause = error.__cause__
            module = (cause.name or "").partition(".")[0] if isinstance(cause, ModuleNotFoundError) else ""
            extra = extra_with(module)
            if extra is None:
                raise
            raise missing_extra(f"{error.where}: it imports {module}, which is not installed", extra) from error
        for (kind, name), make in tuple(_makers.items()):
            if kind == "task" and _origins[kind, name] is origin:
                make()
    finally:
        _loading.pop()
