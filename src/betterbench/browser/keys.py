"""Keyboard and gamepad input of a page: message format, and HTML element with the script that sends the messages."""

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
"""Prefix of the messages that contain keyboard and gamepad input."""
NO_PUSH = (0.0,) * 6
MOST_TAPS_AT_ONCE = 8

_Number = Annotated[float, Field(ge=-1.0, le=1.0)]
_Key = Annotated[str, Field(max_length=20)]


class PageKeys(BaseModel, extra="forbid", allow_inf_nan=False):
    """State of the keyboard and the gamepad, as sent by a page.

    Attributes:
        held: Codes of the keys that are held down.
        taps: Number of times that each action was triggered by a key or button since the page was opened.
        push: Deflection of the gamepad or SpaceMouse in [-1, 1]: 3 translations, then 3 rotations.
        slow: Whether the shift key is held down.
        n: Number of this message.
    """

    held: Annotated[list[_Key], Field(max_length=20)] = []
    taps: dict[_Key, Annotated[int, Field(ge=0)]] = {}
    push: Annotated[list[_Number], Field(max_length=6, min_length=6)] = list(NO_PUSH)
    slow: bool = False
    n: int = 0


_KEYS = TypeAdapter(PageKeys)


def read_keys(text: str) -> PageKeys:
    """Parse a message from the script of a page. Raises InvalidInputError if the message is malformed."""
    data = text.removeprefix(MARK).encode(errors="replace")
    return read_form(_KEYS, data, where="page", cure="Reload the page")


def new_taps(sent: PageKeys, known: dict[str, int], names: Sequence[str]) -> list[str]:
    """Return the actions triggered since the previous message of a page.

    Args:
        sent: Message of the page.
        known: Counts from the previous message, by action. They are updated.
        names: Actions to consider. If an action was triggered several times, it occurs several times in the result.
    """
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
    """Return an HTML element that runs the script ``page.js`` when it is displayed.

    viser does not run script tags in its HTML elements, so the element is an image with the script as its error
    handler.

    Args:
        taps: Actions that are triggered once per key press, by key code.
        held: Codes of the keys that have an effect as long as they are held down.
        gamepad: Actions by button number of a standard gamepad, or None to ignore gamepads.
    """
    source = resources.files("betterbench.browser").joinpath("page.js").read_text()
    for name, value in (("PUSH_KEYS", list(held)), ("TAP_KEYS", dict(taps)), ("BUTTONS", gamepad), ("MARK", MARK)):
        source = source.replace(f"__{name}__", json.dumps(value))
    return f'<img src="data:," alt="" style="display:none" onerror="{html.escape(source, quote=True)}">'


def key_table(rows: Sequence[tuple[str, str]]) -> str:
    """Return an HTML table of keys and their descriptions."""
    cells = "".join(
        f'<tr><td style="padding:1px 12px 1px 0;white-space:nowrap"><b>{markup_text(k)}</b></td>'
        f"<td>{markup_text(t)}</td></tr>"
        for k, t in rows
    )
    return f'<table style="margin:0 10px;font-size:12px">{cells}</table>'
