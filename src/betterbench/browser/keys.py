"""Keyboard and gamepad input of a page: the script that sends it, and the format of its messages."""

from __future__ import annotations

import html
import json
from collections.abc import Mapping, Sequence
from importlib import resources
from typing import Annotated

from pydantic import BaseModel, Field, TypeAdapter

from betterbench.json_form import read_form
from betterbench.quoting import markup_text

MARK = "better-page:"
"""Prefix of messages about keys."""
NO_PUSH = (0.0,) * 6
MOST_TAPS_AT_ONCE = 8

_Number = Annotated[float, Field(ge=-1.0, le=1.0)]
_Key = Annotated[str, Field(max_length=20)]


class PageKeys(BaseModel, extra="forbid", allow_inf_nan=False):
    """State of the keyboard and the gamepad as reported by a web page.

    The state consists of the keys that are held down, the number of times that each key has been pressed since the page
    was opened, and the positions of the gamepad's axes in [-1, 1].
    """

    held: Annotated[list[_Key], Field(max_length=20)] = []
    taps: dict[_Key, Annotated[int, Field(ge=0)]] = {}
    push: Annotated[list[_Number], Field(max_length=6, min_length=6)] = list(NO_PUSH)
    slow: bool = False
    n: int = 0


_KEYS = TypeAdapter(PageKeys)


def read_keys(text: str) -> PageKeys:
    """Parse a message from the page's script. Raises InvalidInputError if it is malformed."""
    data = text.removeprefix(MARK).encode(errors="replace")
    return read_form(_KEYS, data, where="page", cure="Reload the page")


def new_taps(sent: PageKeys, known: dict[str, int], names: Sequence[str]) -> list[str]:
    """Return the keys pressed since the previous message from a page, and update the page's counts in ``known``."""
    made = [
        name
        for name in names
        for _ in range(min(MOST_TAPS_AT_ONCE, max(0, sent.taps.get(name, 0) - known.get(name, 0))))
    ]
    known.update(sent.taps)
    return made


def script_element(
    *, taps: Mapping[str, str], held: Sequence[str] = (), gamepad: Mapping[int, str] | None = None
) -> str:
    """Return an HTML element that runs the page's script as soon as it is shown.

    viser does not run script tags in its HTML elements. The element is therefore an image whose error handler contains
    the script.

    Args:
        taps: Action for each key that triggers a single action, by key code.
        held: Codes of the keys that have an effect for as long as they are held down.
        gamepad: Action for each button of a standard gamepad, or None to ignore gamepads.
    """
    source = resources.files("betterbench.browser").joinpath("page.js").read_text()
    for name, value in (("PUSH_KEYS", list(held)), ("TAP_KEYS", dict(taps)), ("BUTTONS", gamepad), ("MARK", MARK)):
        source = source.replace(f"__{name}__", json.dumps(value))
    return f'<img src="data:," alt="" style="display:none" onerror="{html.escape(source, quote=True)}">'


def key_table(rows: Sequence[tuple[str, str]]) -> str:
    """Return an HTML table of keys and what they do."""
    cells = "".join(
        f'<tr><td style="padding:1px 12px 1px 0;white-space:nowrap"><b>{markup_text(k)}</b></td>'
        f"<td>{markup_text(t)}</td></tr>"
        for k, t in rows
    )
    return f'<table style="margin:0 10px;font-size:12px">{cells}</table>'
