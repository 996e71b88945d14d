"""Help texts of the subcommands, each printed once for all tests of a process."""

from __future__ import annotations

import contextlib
import functools
import io

import pytest

from betterbench.cli.main import main


@functools.cache
def help_of(command: str, columns: int = 80) -> str:
    """Return the help of a command, such as "assets import", on a terminal with the given number of columns."""
    with pytest.MonkeyPatch.context() as patch, contextlib.redirect_stdout(io.StringIO()) as printed:
        patch.setenv("COLUMNS", str(columns))
        with pytest.raises(SystemExit) as stop:
            main([*command.split(), "--help"])
    assert not stop.value.code
    return printed.getvalue()
