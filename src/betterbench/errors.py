"""Exceptions with messages for users. Each message states the problem and a remedy.

Every deliberate error of betterbench derives from :class:`BetterError`. The command line prints its message as one line
and exits with status 2. Any other exception is a bug and is shown with its traceback.
"""

from __future__ import annotations

import difflib
import errno
import importlib
import inspect
import os
import pkgutil
import re
import sys
import sysconfig
import traceback
from collections.abc import Callable, Container, Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from types import CodeType
from typing import NamedTuple, Protocol, TextIO, TypeVar

LONGEST_SHOWN = 500
"""Maximum number of characters that a message quotes from an external text by default."""

UNPRINTABLE = re.compile(
    r"[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u180e\u200b-\u200f\u2028-\u202e\u2060-\u206f\ufeff\ufff9-\ufffb\ud800-\udfff"
    r"\U000e0000-\U000e007f]"
)
"""Characters that control a terminal, hide or reorder letters, or cannot be encoded.

Tab and line feed are not included.
"""


def printable(text: str, *, most: int, omitted: int = 0) -> str:
    """Shorten external text if it is too long, and replace characters that could control a terminal.

    Text after the first ``most`` characters is replaced by a note with the number of omitted characters. ``omitted`` is
    the number of characters that the caller has already removed from the end. Characters in :data:`UNPRINTABLE` are
    replaced by U+FFFD. Line breaks are kept.
    """
    cut = max(0, len(text) - most) + omitted
    if cut > 0:
        text = f"{text[:most]}… ({cut} more characters)"
    return UNPRINTABLE.sub("\N{REPLACEMENT CHARACTER}", text)


def one_line(text: object, *, most: int = LONGEST_SHOWN) -> str:
    """Return external text as a single line that is safe to show in a message (see :func:`printable`)."""
    # Cut a long text before it is split. The factor leaves room for white space that is removed.
    whole, longest = str(text), 4 * most + 1
    line = " ".join(whole[:longest].split())
    return printable(line, most=most, omitted=max(0, len(whole) - longest))


def last_line(text: str, *, most: int = LONGEST_SHOWN) -> str:
    """Return the last non-empty line of an external error message or traceback, cleaned by :func:`one_line`."""
    return next((one_line(line, most=most) for line in reversed(text.splitlines()) if line.strip()), "")


def encodable(text: str) -> str:
    """Escape characters that cannot be encoded, such as lone surrogates."""
    return text.encode("utf-8", "backslashreplace").decode("utf-8")


def line_start(stream: TextIO) -> str:
    """Return the prefix for a message that is written to a stream.

    On a terminal, the prefix erases the progress bar.
    """
    return "\r\x1b[2K" if stream.isatty() and os.environ.get("TERM", "dumb") != "dumb" else ""


class BetterError(Exception):
    """Base class of all deliberate errors. The text of such an error is one line that a user can understand."""


_INSTALLED = {sysconfig.get_paths()[name] for name in ("stdlib", "platstdlib", "purelib", "platlib")}
_OURS = str(Path(__file__).resolve().parent)


def raised_at(problem: BaseException) -> str:
    """Return the location in user code at which an exception was raised, such as "my_policy.py, line 12, in act".

    Return an empty string if the traceback contains no user code.

    The location is the innermost frame outside betterbench, the standard library and installed packages. Only the name
    of the file is given, so that records do not depend on where the code is stored.
    """
    frames = [(f.filename, f.lineno, f.name) for f in traceback.extract_tb(problem.__traceback__)]
    if isinstance(problem, SyntaxError) and problem.filename:
        frames.append((problem.filename, problem.lineno, ""))
    for name, line, function in reversed(frames):
        if name.startswith("<") or any(Path(name).is_relative_to(folder) for folder in (_OURS, *_INSTALLED)):
            continue
        inside = f", in {function}" if function and not function.startswith("<") else ""
        return f"{Path(name).name}, line {line}{inside}"
    return ""


def place_of(owner: object, method: str) -> str:
    """Return a method of an extension with its file, such as "PointScene.views (point.py, line 12)".

    The line is left out if the class of ``owner`` inherits the method from betterbench.
    """
    kind = type(owner)
    own = getattr(getattr(owner, method, None), "__code__", None)
    for code in (own, *(getattr(member, "__code__", None) for member in vars(kind).values())):
        if isinstance(code, CodeType) and not Path(code.co_filename).is_relative_to(_OURS):
            line = f", line {code.co_firstlineno}" if code == own else ""
            return f"{kind.__name__}.{method} ({Path(code.co_filename).name}{line})"
    return f"{kind.__name__}.{method}"


def described(problem: BaseException) -> str:
    """Describe an exception from user code in one line: its type, its message and its location."""
    place = raised_at(problem)
    said = problem.msg if isinstance(problem, SyntaxError) and place else problem
    text = " ".join(f"{type(problem).__name__}: {said}".split()).removesuffix(":")
    return f"{text} ({place})" if place else text


class UnknownNameError(BetterError):
    """A requested name does not exist.

    Args:
        kind: Kind of the object, in the singular ("task", "policy").
        name: The requested name.
        known: The names that exist.
    """

    kind: str
    name: str
    known: tuple[str, ...]

    def __init__(self, kind: str | UnknownNameError, name: str = "", known: Iterable[str] = ()) -> None:
        """Build the message, which suggests the most similar names first.

        The first argument may be another UnknownNameError, which is then copied. Gymnasium's vector environments need
        this: to re-raise a worker's exception, they call the exception class with the original exception as its
        argument.
        """
        if isinstance(kind, UnknownNameError):
            same = kind
            kind, name, known = same.kind, same.name, same.known
        names = sorted(known)
        alike = [other for other in names if other.casefold() == name.strip().casefold()]
        # Truncate the name: matching takes quadratic time in its length, and it may come from an untrusted file.
        close = difflib.get_close_matches(name[:LONGEST_SHOWN], names, n=3, cutoff=0.5)
        close = [*alike, *(other for other in close if other not in alike)][:3]
        hint = f"Did you mean {' or '.join(repr(c) for c in close)}? " if close else ""
        listed = ", ".join(names) if names else "none"
        super().__init__(f"Unknown {kind} {printable(name, most=LONGEST_SHOWN)!r}. {hint}Known: {listed}.")
        self.kind, self.name, self.known, self.closest = kind, name, tuple(names), tuple(close)

    def __reduce__(self) -> tuple[type[UnknownNameError], tuple[str, str, tuple[str, ...]]]:
        """Make the error picklable, for worker processes."""
        return type(self), (self.kind, self.name, self.known)


class Named(Protocol):
    """Object that has a name."""

    @property
    def name(self) -> str:
        """Name of the object."""


NamedThing = TypeVar("NamedThing", bound=Named)


def find_named(kind: str, name: str, things: Iterable[NamedThing]) -> NamedThing:
    """Return the object with the given name.

    Args:
        kind: Kind of the object, in the singular.
        name: Name to look for.
        things: Objects to search.

    Raises:
        UnknownNameError: If no object has this name.
    """
    known = tuple(things)
    for thing in known:
        if thing.name == name:
            return thing
    raise UnknownNameError(kind, name, (t.name for t in known))


class InvalidInputError(BetterError):
    """A value, field or file that the user has given cannot be used.

    Args:
        where: Name of the field or file.
        problem: Description of the problem, which follows the name in the message.
        cure: Remedy, as an imperative without a period.
    """

    where: str
    problem: str
    cure: str

    def __init__(self, where: str | InvalidInputError, problem: str = "", cure: str = "") -> None:
        """Build the message.

        The first argument may be another InvalidInputError, which is then copied, as for :class:`UnknownNameError`.
        """
        if isinstance(where, InvalidInputError):
            same = where
            where, problem, cure = same.where, same.problem, same.cure
        super().__init__(f"{where}: {problem}. {cure.rstrip('.')}.")
        self.where, self.problem, self.cure = where, problem, cure

    def __reduce__(self) -> tuple[type[InvalidInputError], tuple[str, str, str]]:
        """Make the error picklable, for worker processes."""
        return type(self), (self.where, self.problem, self.cure)


def require_between(where: str, value: float, least: float, most: float) -> None:
    """Raise InvalidInputError unless the number in a field is finite and within the bounds."""
    if not least <= value <= most:
        try:
            given = one_line(value, most=40)
        except ValueError:  # Python does not print integers of more than 4,300 digits
            given = "the number"
        cure = f"Use a number ≥ {least}" if value < least else f"Use a number from {least} to {most}"
        raise InvalidInputError(where, f"{given} is out of range", cure)


class InvalidActionError(BetterError):
    """An action of a policy cannot be executed: it has a wrong shape or type, or is not finite."""


class PolicyError(BetterError):
    """A policy has crashed, answered too late or violated the policy protocol.

    The trial ends with the termination ``policy_error``.
    """


class PolicyUnavailableError(PolicyError):
    """A policy server cannot be reached, even after several attempts. The affected trials are repeated later."""


class PolicyProcessError(PolicyError):
    """A policy cannot be loaded, for example because memory ran out. Loading fewer instances of the policy may help."""


class PolicyKilledError(PolicyError):
    """The process of a policy was killed, for example by the operating system. The current trial is repeated."""


class ModelError(BetterError):
    """A language model cannot be reached, rejects a request, or gives an answer that cannot be read."""


class HandshakeError(BetterError):
    """A policy and the benchmark declare different conventions in their handshake. The message names both."""


class PremiseError(BetterError):
    """After the reset, the scene violates an assumption of the task about its initial state. The run must stop."""


class RunConflictError(BetterError):
    """A folder contains a run other than the requested one, or files that do not belong to a run."""


class RecordError(BetterError):
    """A record or a file of a run cannot be read, or was written with a different schema version."""


class StorageError(BetterError):
    """Files can no longer be written, because the disk is full or read-only. The run stops and can be resumed."""


class WorkerError(BetterError):
    """Worker processes keep dying. The run stops and can be resumed."""


class TrainingError(BetterError):
    """Training cannot continue because the loss is not finite. Training states that were already saved are kept."""


class MissingDependencyError(BetterError):
    """A system library or an optional extra is not installed. The message says how to install it."""


class GraphicsError(MissingDependencyError):
    """An environment variable names an OpenGL back end or device that does not exist on this machine.

    The message states which value to set.
    """


def system_error_text(problem: OSError) -> str:
    """Describe an error of the operating system in one line, with the path and a remedy."""
    where = "" if problem.filename is None else f"{problem.filename}: "
    other = "" if problem.filename2 is None else f" (to {problem.filename2})"
    reason = problem.strerror or str(problem) or type(problem).__name__
    line = " ".join(f"{where}{reason}{other}".split())
    shown = line if len(line) <= _MAX_LINE else f"{line[: _MAX_LINE // 2]} ... {line[-_MAX_LINE // 4 :]}"
    cure = STORAGE_CURES.get(problem.errno or 0, _PATH_CURE)
    return f"{shown}. {cure[:1].upper()}{cure[1:]}."


_MAX_LINE = 400
_PATH_CURE = "check the path and its permissions, then run the same command again"
_ROOM_CURE = "free disk space, then run the same command again"

STORAGE_CURES: Mapping[int, str] = {
    errno.ENOSPC: _ROOM_CURE,
    errno.EDQUOT: _ROOM_CURE,
    errno.EFBIG: _ROOM_CURE,
    errno.EROFS: "choose a writable folder",
    errno.EIO: "check the disk, then run the same command again",
}
"""Remedies for disk errors that affect all further writes, by errno."""


class PlanningError(BetterError):
    """The privileged expert found no collision-free motion for a skill."""


def require_parameters(where: str, name: str, function: Callable[..., object], parameters: str) -> None:
    """Check that a function of an extension can be called with the given positional parameters.

    Args:
        where: Location of the function, for the error message.
        name: Name of the function.
        function: The function.
        parameters: Names of the parameters, separated by commas ("state, object, target").

    Raises:
        InvalidInputError: If the function has other parameters.
    """
    try:
        inspect.signature(function).bind(*parameters.split(", "))
    except ValueError:  # some built-in functions have no signature
        return
    except TypeError as error:
        problem = f"{name} must be callable as {name}({parameters}) ({error})"
        raise InvalidInputError(where, problem, "Correct its parameters") from None


class Place(NamedTuple):
    """Place in a file at which an extension registers a name."""

    file: str
    line: int

    def __str__(self) -> str:
        """Return the place as errors show it."""
        return f"{self.file}, line {self.line}"


def registering_place() -> Place:
    """Return the place at which an extension calls the register function that calls this function."""
    frame = sys._getframe(2)
    return Place(frame.f_code.co_filename, frame.f_lineno)


def name_taken(what: str, before: Place, here: Place) -> InvalidInputError:
    """Create the error for a name that is registered twice.

    It names both places, because the file that is read last is not always the new one.

    Args:
        what: Kind and name, such as "relation 'inside'".
        before: Place that registered the name first (see :func:`registering_place`).
        here: Place that registers the name again.
    """
    cure = "Change the name at one of the two places"
    return InvalidInputError(f"{before}, and {here}", f"both register the {what}", cure)


@contextmanager
def errors_explained(path: str, *, keep: tuple[type[Exception], ...] = ()) -> Iterator[None]:
    """Context manager that adds the file and the line to an error raised in a user's file.

    Args:
        path: Path of the file.
        keep: Types of errors that are raised unchanged.

    Raises:
        InvalidInputError: If the file raises an error.
    """
    try:
        yield
    except Exception as error:
        if isinstance(error, keep) or (isinstance(error, InvalidInputError) and path in error.where):
            raise
        lines = [frame.lineno for frame in traceback.extract_tb(error.__traceback__) if frame.filename == path]
        line = error.lineno if isinstance(error, SyntaxError) and error.filename == path else (lines or [None])[-1]
        text = " ".join(str(error.msg if isinstance(error, SyntaxError) else error).split()).rstrip(".")
        problem = text if isinstance(error, BetterError) else f"{type(error).__name__}: {text}"
        where = path if line is None else f"{path}, line {line}"
        raise InvalidInputError(where, problem, "Correct the file") from error


def import_registering(
    package: str, folder: str, registering: Callable[[], Iterable[Place]], cure: str, *, shared: Container[str] = ()
) -> None:
    """Import the files of a folder of the package, and require that each of them registers something.

    Args:
        package: Name of the package whose files are imported.
        folder: Folder of the package.
        registering: Function that returns the places at which names have been registered.
        cure: Remedy for a file that registers nothing.
        shared: Names of modules that contain only shared code.

    Raises:
        InvalidInputError: If a file raises an error or registers nothing.
    """
    for module in pkgutil.iter_modules([folder]):
        path = Path(folder) / module.name
        file = str(path / "__init__.py" if module.ispkg else path.with_suffix(".py"))
        with errors_explained(file):
            importlib.import_module(f"{package}.{module.name}")
        if module.name not in shared and file not in {place.file for place in registering()}:
            raise InvalidInputError(file, "it registers nothing", cure)
