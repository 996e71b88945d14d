"""Handshake between a client and a policy server. The conventions of both sides are compared before the run starts."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, replace
from typing import Annotated, Any, TypeVar

from pydantic import BaseModel, Strict, TypeAdapter, ValidationError

from betterbench.errors import BetterError, HandshakeError, InvalidInputError, one_line
from betterbench.interface import Execution
from betterbench.interface.actions import JOINT_SPACES, OPENING_SPACES, ActionSpace, action_space
from betterbench.json_form import first_problem
from betterbench.policies.conventions.adapter import Adapter
from betterbench.policies.conventions.image_rule import EVERY_CAMERA
from betterbench.policies.protocols.wire import MAX_DECLARED_BYTES, MAX_DECLARED_DEPTH, require_depth

FrameT = TypeVar("FrameT", bytes, bytes | str)
DeclaredT = TypeVar("DeclaredT")

PROTOCOL = 1
"""Version of the declaration format that betterbench servers use."""

_MOST_SHOWN = 12
"""Maximum number of differences listed in one message."""


@dataclass(frozen=True, slots=True)
class Declaration:
    """Conventions declared by the client or the server.

    A field is compared only if both sides declare it.

    Attributes:
        who: Name of the client or server for error messages.
        preset: Name of the adapter.
        action_space: Name of the action space.
        action_dim: Number of values in an action.
        action_low: Minimum of each value in an action.
        action_high: Maximum of each value in an action.
        action_scale: Size of one action unit in physical units, for each value in an action.
        action_convention: Text that describes the reference frame and the gripper convention of actions.
        position: Format of translations or positions ("delta_xyz").
        rotation: Format of rotations ("axis_angle").
        gripper: Gripper convention ("close_positive").
        state: Format of the robot's state.
        language: Whether the instruction is sent or required ("instruction").
        rate_hz: Control rate [Hz].
        cameras: Size (width, height) [pixel] of each image, by key, or None if any size is allowed. The client must
            provide all images that the server declares, and may provide more.
    """

    who: str
    preset: str | None = None
    action_space: str | None = None
    action_dim: int | None = None
    action_low: tuple[float, ...] | None = None
    action_high: tuple[float, ...] | None = None
    action_scale: tuple[float, ...] | None = None
    action_convention: str | None = None
    position: str | None = None
    rotation: str | None = None
    gripper: str | None = None
    state: str | None = None
    language: str | None = None
    rate_hz: float | None = None
    cameras: Mapping[str, tuple[int, int] | None] | None = None

    def rows(self) -> dict[str, str]:
        """Return the declared values as text for a table, by name."""
        shown = {}
        for entry in fields(self):
            value = getattr(self, entry.name)
            if entry.name not in ("who", "cameras") and value is not None:
                shown[entry.name.replace("_", " ")] = one_line(value) if isinstance(value, str) else _text(value)
        for key, size in (self.cameras or {}).items():
            shown[_camera(key)] = _size(size)
        return shown


class _ServerForm(BaseModel, strict=True, allow_inf_nan=False):
    """JSON form of a betterbench server's declaration. Unknown fields, which newer servers may send, are ignored."""

    preset: str
    action_space: dict[str, Any]
    control_rate_hz: float | None = None
    cameras: dict[str, Annotated[tuple[int, int], Strict(False)] | None] | None = None


_SERVER = TypeAdapter(_ServerForm)


def declare_space(who: str, space: ActionSpace) -> Declaration:
    """Return a declaration that contains only an action space."""
    return Declaration(
        who,
        action_space=space.name,
        action_dim=space.dim,
        action_low=space.low,
        action_high=space.high,
        action_scale=space.scale,
        action_convention=space.convention,
    )


def declare_adapter(who: str, adapter: Adapter, *, rate_hz: float | None = None) -> Declaration:
    """Return the declaration of an adapter's inputs and outputs.

    If ``rate_hz`` is None, the declaration contains the control rate of the adapter.
    """
    answer = adapter.answer
    space = action_space(answer.space)
    absolute = answer.space == "ee_pose"
    return Declaration(
        who,
        preset=adapter.name,
        action_space=space.name,
        action_dim=sum(answer.columns.values()),
        action_low=space.low if answer.as_is else None,
        action_high=space.high if answer.as_is else None,
        action_scale=space.scale if answer.as_is else None,
        action_convention=space.convention if answer.as_is else None,
        position=None if space.name in JOINT_SPACES else "absolute_xyz" if absolute else "delta_xyz",
        rotation=None if space.name in JOINT_SPACES else answer.rotation,
        gripper=None if space.name in OPENING_SPACES else answer.gripper,
        state=", ".join(part for rule in adapter.states for part in rule.parts) or None,
        language="instruction",
        rate_hz=adapter.control_rate_hz if rate_hz is None else rate_hz,
        cameras={
            "/".join(rule.key): None if rule.width is None or rule.height is None else (rule.width, rule.height)
            for rule in adapter.views
        },
    )


def read_server(who: str, form: object) -> Declaration:
    """Parse the declaration of a betterbench server.

    Raises HandshakeError if the declaration is malformed or has an unsupported version.
    """
    version = form.get("protocol") if isinstance(form, Mapping) else None
    if not isinstance(version, int) or version != PROTOCOL:
        raise HandshakeError(
            f"{who} uses version {one_line(version, most=20)} of the declaration format, but this client uses "
            f"version {PROTOCOL}. Install the same release on both sides."
        )
    try:
        told = _SERVER.validate_python(form)
        declared = ActionSpace.from_json(told.action_space)
    except (BetterError, ValidationError) as error:
        problem = ": ".join(first_problem(error)) if isinstance(error, ValidationError) else one_line(error)
        raise HandshakeError(
            f"{who}: the declared conventions cannot be read ({problem}). Update the server."
        ) from error
    return replace(declare_space(who, declared), preset=told.preset, rate_hz=told.control_rate_hz, cameras=told.cameras)


def read_execution(who: str, form: object) -> Execution | None:
    """Parse the settings for executing action chunks that a betterbench server declares.

    Return None if the server does not declare them. Raises HandshakeError if they are malformed.
    """
    told = form.get("execution") if isinstance(form, Mapping) else None
    if told is None:
        return None
    kinds: dict[str, tuple[type, ...]] = {"horizon": (int,), "ahead": (int,), "ensemble": (int, float)}
    given = {k: v for k, v in told.items() if v is not None} if isinstance(told, Mapping) else {"": told}
    if not all(k in kinds and isinstance(v, kinds[k]) and not isinstance(v, bool) for k, v in given.items()):
        raise HandshakeError(
            f"{who}: the declared settings for executing chunks are malformed. Install the same release on both sides."
        )
    try:
        return Execution(**given)
    except InvalidInputError as error:
        raise HandshakeError(f"{who} declares invalid settings for executing chunks ({error})") from error


def read_declared(who: str, frame: FrameT, decode: Callable[[FrameT], DeclaredT]) -> DeclaredT:
    """Decode the declaration of a server with ``decode``, and check its size.

    Raises HandshakeError if the declaration is too large or too deeply nested. Errors of ``decode`` are passed on.
    """
    if len(frame) > MAX_DECLARED_BYTES:
        raise HandshakeError(
            f"{who} sends a declaration of {len(frame)} bytes, but the limit is {MAX_DECLARED_BYTES} bytes. "
            "The server should declare only names, sizes and conventions."
        )
    value = decode(frame)
    try:
        require_depth(value, MAX_DECLARED_DEPTH)
    except ValueError as error:
        raise HandshakeError(
            f"{who}: the declaration cannot be read: {error}. The server should declare maps that are not "
            "deeply nested."
        ) from error
    return value


def space_cure(space: str) -> str:
    """Return advice for a user whose policy has a different action space than the run.

    In LIBERO and CALVIN, the advice is to use another policy or preset, because their action space is fixed.
    """
    return (
        f"Use --action-space {space} in a suite of betterbench. In LIBERO and CALVIN, choose another policy or preset"
    )


def compare_declarations(ours: Declaration, theirs: Declaration) -> None:
    """Raise HandshakeError if two declarations differ. The message quotes both values of each difference."""
    found = []
    for entry in fields(Declaration):
        if entry.name in ("who", "cameras"):
            continue
        mine, other = getattr(ours, entry.name), getattr(theirs, entry.name)
        if mine is not None and other is not None and mine != other:
            name = entry.name.replace("_", " ")
            found.append(f"{name}: {ours.who} declares {_text(mine)}, {theirs.who} declares {_text(other)}")
    given = ours.cameras or {}
    if ours.cameras is not None and not any("{camera}" in key or key == EVERY_CAMERA for key in given):
        for key, wanted in (theirs.cameras or {}).items():
            if key not in given:
                there = ", ".join(given) or "no images"
                found.append(f"{_camera(key)}: {theirs.who} needs this image, but {ours.who} provides {there}")
            elif wanted is not None and given[key] not in (None, wanted):
                found.append(
                    f"{_camera(key)}: {ours.who} declares {_size(given[key])}, {theirs.who} declares {_size(wanted)}"
                )
    if found:
        more = [f"{len(found) - _MOST_SHOWN} more"] if len(found) > _MOST_SHOWN else []
        raise HandshakeError(
            f"The two sides declare different conventions: {'; '.join(found[:_MOST_SHOWN] + more)}. "
            "Choose another preset, or correct the adapter, the run or the server."
        )


def _camera(key: str) -> str:
    return f"camera {one_line(key, most=60)}"


def _text(value: object) -> str:
    if isinstance(value, tuple):
        return f"({', '.join(_text(v) for v in value)})"
    if isinstance(value, str):
        return repr(one_line(value))
    return f"{value:g}" if isinstance(value, float) else one_line(value)


def _size(size: tuple[int, int] | None) -> str:
    return "any size" if size is None else f"{size[0]} x {size[1]}"
