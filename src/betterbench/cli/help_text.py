"""Help texts, wrapped to the terminal width. Default values that a description already states are not repeated."""

from __future__ import annotations

import contextlib
import inspect
import os
import re
import shutil
import sys
import textwrap
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import fields, is_dataclass
from pathlib import Path
from types import NoneType
from typing import Annotated, Any, TextIO, get_args, get_origin, get_type_hints

import tyro

VALUES: dict[type, str] = {str: "TEXT", int: "INT", float: "FLOAT", Path: "PATH"}
"""Placeholder for the value of an option, by its type."""

WIDEST = 100
"""Maximum length of a line in a description [characters]."""

INDENT = "  "
"""Indentation of continuation lines, because tyro joins lines that begin with a letter."""


def description_of(function: object) -> str:
    """Return a function's description without its arguments, wrapped to the terminal width.

    An example command that is too long for one line is split with a backslash, so that it can be pasted into a shell.
    """
    text = inspect.getdoc(function) or ""
    width = min(shutil.get_terminal_size().columns, WIDEST)
    paragraphs = text.partition("\n\nArgs:")[0].split("\n\n")
    layout = textwrap.TextWrapper(width, subsequent_indent=INDENT, break_long_words=False, break_on_hyphens=False)
    narrower = textwrap.TextWrapper(width - 2, subsequent_indent=INDENT, break_long_words=False, break_on_hyphens=False)

    def wrapped(paragraph: str) -> str:
        if len(paragraph) > width and paragraph.startswith("Example: "):
            return " \\\n".join(narrower.wrap(paragraph))
        return layout.fill(paragraph)

    return "\n\n".join(map(wrapped, paragraphs))


def color_as_asked() -> None:
    """Disable colors in help and error boxes if NO_COLOR is set or standard error is not a terminal."""
    if os.environ.get("NO_COLOR") or not sys.stderr.isatty():
        tyro._experimental_options["ansi_codes"] = False


@contextlib.contextmanager
def brief_usage(verbs: Iterable[str]) -> Iterator[None]:
    """Shorten the usage line in the overview of all subcommands.

    If the list of subcommands does not fit the terminal, it is replaced by COMMAND.
    """
    listed = "{" + ",".join(verbs) + "}"

    class Brief:
        def __init__(self, stream: TextIO) -> None:
            self._stream = stream

        def write(self, text: str) -> int:
            return self._stream.write(text.replace(listed, "COMMAND"))

        def __getattr__(self, name: str) -> Any:  # noqa: ANN401 - whatever a stream has
            return getattr(self._stream, name)

    if len(f"usage: better [-h] {listed}") <= shutil.get_terminal_size().columns:
        yield
        return
    with contextlib.redirect_stdout(Brief(sys.stdout)):
        yield


def word_options(function: Callable[..., None]) -> None:
    """Set the texts, placeholders and default values that the help shows for a subcommand's options.

    Lines of a text are joined, because tyro would break the text again at the line breaks of the docstring.
    """
    text, args, options = inspect.cleandoc(function.__doc__ or "").partition("\n\nArgs:\n")
    function.__doc__ = text + args + re.sub(r"\n {8,}", " ", options)
    parameters = inspect.signature(function).parameters
    hints = function.__annotations__
    function.__annotations__ = hints | {
        name: _worded(name, hints[name], parameter.default) for name, parameter in parameters.items() if name in hints
    }


def _worded(name: str, hint: Any, default: object) -> Any:  # noqa: ANN401 - a type hint
    bare = get_args(hint)[0] if get_origin(hint) is Annotated else hint
    if not is_dataclass(bare):
        said = default in (
            None,
            False,
            (),
            "",
            inspect.Parameter.empty,
        )  # the description already states the default, or there is no value to show
        value = _value(name, bare, _marks(hint))
        if value and tyro.conf.Positional in _marks(hint) and default is not inspect.Parameter.empty:
            value = f"[{value}]"
        return Annotated[hint, tyro.conf.arg(metavar=value, help_behavior_hint="" if said else None)]
    hints = get_type_hints(bare, include_extras=True)  # each field of an option group is a separate option
    bare.__annotations__ = {field.name: _worded(field.name, hints[field.name], field.default) for field in fields(bare)}
    return hint


def _value(name: str, bare: Any, marks: Sequence[object]) -> str | None:  # noqa: ANN401 - a type hint
    """Return the placeholder for an option's value, or None to keep the placeholder that tyro chooses."""
    several = get_origin(bare) is tuple
    kinds = [kind for kind in get_args(bare) if kind not in (NoneType, Ellipsis)] or [bare]
    value = VALUES.get(kinds[0]) if len(kinds) == 1 else None
    if tyro.conf.Positional in marks and value:
        value = name.upper().removesuffix("S")
    if several and value and tyro.conf.UseAppendAction not in marks:
        value = f"{value} [{value} ...]"
    return value


def _marks(hint: Any) -> Sequence[object]:  # noqa: ANN401 - a type hint
    return hint.__metadata__ if get_origin(hint) is Annotated else ()
