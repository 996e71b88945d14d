"""Filter of incoming messages: only those that the page sends reach viser, all others are left out.

viser takes any property of any element from a message, and calls whatever a message names: a wrong value would end the
session or keep every later page out, and one message shows the page to the whole internet. So each message is read
through the schema of what the page sends. What viser does with the rest needs no check of its own.
"""

from __future__ import annotations

import importlib
from collections.abc import Awaitable, Callable
from typing import Annotated, Any, Literal, get_args

from pydantic import BaseModel, Field, TypeAdapter

MAX_MESSAGE_BYTES = 1 << 16
"""Largest message of a page; a connection that sends a larger one is closed."""
LARGEST = 1e6
"""Largest number of a message: a length [m], a size [pixel] or a share."""
LEFT_OUT = "a message that this page does not send was left out; reload the page"

InputKind = Literal["button", "number", "text"]
"""Kind of the value of an element of the panel."""

_Number = Annotated[float, Field(ge=-LARGEST, le=LARGEST)]
_Vector = Annotated[list[_Number], Field(min_length=3, max_length=3)]
_Quaternion = Annotated[list[_Number], Field(min_length=4, max_length=4)]
_Name = Annotated[str, Field(max_length=64)]


class _Message(BaseModel, extra="forbid", strict=True, allow_inf_nan=False):
    """A message of the page."""


class _Camera(_Message):
    type: Literal["ViewerCameraMessage"]
    wxyz: _Quaternion
    position: _Vector
    fov: _Number
    near: _Number
    far: _Number
    image_height: _Number
    image_width: _Number
    look_at: _Vector
    up_direction: _Vector


class _Value(_Message):
    value: bool | _Number | Annotated[str, Field(max_length=4096)]


class _Update(_Message):
    type: Literal["GuiUpdateMessage"]
    uuid: _Name
    updates: _Value


class _Dragged(_Message):
    type: Literal["TransformControlsUpdateMessage"]
    name: _Name
    wxyz: _Quaternion
    position: _Vector
    owner: _Name = ""


class _DragEnds(_Message):
    type: Literal["TransformControlsDragStartMessage", "TransformControlsDragEndMessage"]
    name: _Name
    owner: _Name = ""


_Sent = Annotated[_Camera | _Update | _Dragged | _DragEnds, Field(discriminator="type")]
_SENT: TypeAdapter[_Camera | _Update | _Dragged | _DragEnds] = TypeAdapter(_Sent)
_TYPES: dict[InputKind, tuple[type, ...]] = {"button": (bool,), "number": (int, float), "text": (str,)}


class IncomingMessages:
    """Rules by which messages are let in. A server without them must not be used."""

    def __init__(self, complain: Callable[[str], None]) -> None:
        """Let nothing in for an element of the panel until it is named; ``complain`` is told what is left out."""
        self._complain = complain
        self._kinds: dict[str, InputKind] = {}

    def expect(self, uuid: str, kind: InputKind) -> None:
        """Let in the values of an element of the panel."""
        if kind not in get_args(InputKind):
            raise AssertionError(kind)
        self._kinds[uuid] = kind

    def admits(self, raw: object) -> bool:
        """Tell whether viser may read a message."""
        if not isinstance(raw, bytes) or len(raw) > MAX_MESSAGE_BYTES:
            return False
        try:
            sent = _SENT.validate_python(importlib.import_module("msgspec.msgpack").decode(raw))
        except Exception:  # noqa: BLE001 - whatever is in it
            return False
        if not isinstance(sent, _Update):
            return True
        kind, value = self._kinds.get(sent.uuid), sent.updates.value
        # A boolean is a number to Python, and not to the slider.
        return kind is not None and isinstance(value, _TYPES[kind]) and isinstance(value, bool) == (kind == "button")

    def before(self, handler: Callable[[Any], Awaitable[None]]) -> Callable[[Any], Awaitable[None]]:
        """Return a handler of connections that sees those messages alone."""

        async def handle(connection: Any) -> None:  # noqa: ANN401 - of websockets
            await handler(_Filtered(connection, self))

        return handle

    async def next_of(self, connection: Any) -> Any:  # noqa: ANN401
        """Return the next message of a connection that may come in."""
        while True:
            raw = await connection.recv()
            if self.admits(raw):
                return raw
            self._complain(LEFT_OUT)


class _Filtered:
    """Wrapper of a connection without the messages that are left out."""

    def __init__(self, connection: Any, incoming: IncomingMessages) -> None:  # noqa: ANN401
        self._connection, self._incoming = connection, incoming

    def __getattr__(self, name: str) -> Any:  # noqa: ANN401
        return getattr(self._connection, name)

    async def recv(self) -> Any:  # noqa: ANN401
        """Return the next message that may come in."""
        return await self._incoming.next_of(self._connection)
