"""Validation of the messages that a page sends to viser.

viser accepts messages that set any property of any element or call any registered function. An invalid value could end
the session or block pages that are opened later, and one type of message would publish the page on the internet.
Therefore, only messages that match the schemas in this module are passed on to viser.
"""

from __future__ import annotations

import importlib
from collections.abc import Awaitable, Callable
from typing import Annotated, Any, Literal, get_args

from pydantic import BaseModel, Field, TypeAdapter

MAX_MESSAGE_BYTES = 1 << 16
"""Maximum size of a message [bytes]. A connection that sends a larger message is closed."""
LARGEST = 1e6
"""Largest allowed absolute value of numbers in a message, such as lengths [m] and image sizes [pixel]."""
LEFT_OUT = "an unexpected message of the page was ignored; reload the page"

InputKind = Literal["button", "number", "text"]
"""Type of an element in the panel of the page, such as a button or a number field."""

_Number = Annotated[float, Field(ge=-LARGEST, le=LARGEST)]
_Vector = Annotated[list[_Number], Field(min_length=3, max_length=3)]
_Quaternion = Annotated[list[_Number], Field(min_length=4, max_length=4)]
_Name = Annotated[str, Field(max_length=64)]


class _Message(BaseModel, extra="forbid", strict=True, allow_inf_nan=False):
    """Message sent by the page."""


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
    """Validator for the messages that a page sends."""

    def __init__(self, complain: Callable[[str], None]) -> None:
        """Create a validator without registered panel elements.

        ``complain`` is a function that is called with an explanation for each rejected message.
        """
        self._complain = complain
        self._kinds: dict[str, InputKind] = {}

    def expect(self, uuid: str, kind: InputKind) -> None:
        """Register a panel element. Messages about elements that are not registered are rejected."""
        if kind not in get_args(InputKind):
            raise AssertionError(kind)
        self._kinds[uuid] = kind

    def admits(self, raw: object) -> bool:
        """Return whether a message is valid and may be passed on to viser."""
        if not isinstance(raw, bytes) or len(raw) > MAX_MESSAGE_BYTES:
            return False
        try:
            sent = _SENT.validate_python(importlib.import_module("msgspec.msgpack").decode(raw))
        except Exception:  # noqa: BLE001 - a message can cause any error
            return False
        if not isinstance(sent, _Update):
            return True
        kind, value = self._kinds.get(sent.uuid), sent.updates.value
        # bool is a subclass of int in Python, but a number field must not be set to a boolean.
        return kind is not None and isinstance(value, _TYPES[kind]) and isinstance(value, bool) == (kind == "button")

    def before(self, handler: Callable[[Any], Awaitable[None]]) -> Callable[[Any], Awaitable[None]]:
        """Wrap a connection handler so that it receives only valid messages."""

        async def handle(connection: Any) -> None:  # noqa: ANN401 - of websockets
            await handler(_Filtered(connection, self))

        return handle

    async def next_of(self, connection: Any) -> Any:  # noqa: ANN401
        """Wait for the next valid message on a connection, and return it."""
        while True:
            raw = await connection.recv()
            if self.admits(raw):
                return raw
            self._complain(LEFT_OUT)


class _Filtered:
    """Wrapper around a websocket connection whose ``recv`` returns only valid messages."""

    def __init__(self, connection: Any, incoming: IncomingMessages) -> None:  # noqa: ANN401
        self._connection, self._incoming = connection, incoming

    def __getattr__(self, name: str) -> Any:  # noqa: ANN401
        return getattr(self._connection, name)

    async def recv(self) -> Any:  # noqa: ANN401
        """Wait for the next valid message on the wrapped connection, and return it."""
        return await self._incoming.next_of(self._connection)
