"""Client for vla-evaluation-harness (``vla-eval://host:port``), which serves about twenty model families.

A message is a map with a type, a payload, a sequence number and a timestamp. Client and server first exchange hello
messages, which declare their conventions. The client sends a message at the start and at the end of each episode. The
server answers each observation with an action that has the same sequence number. Source: ``vla_eval/protocol`` and
``vla_eval/model_servers/serve.py`` of the package vla-eval.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal, get_args

import numpy as np

from betterbench.errors import HandshakeError, PolicyError, one_line
from betterbench.interface import EpisodeStart, Observation
from betterbench.interface.actions import (
    CALVIN_ABSOLUTE,
    CALVIN_ABSOLUTE_QUATERNION,
    CALVIN_DELTA,
    EE_DELTA,
    LIBERO_ABSOLUTE,
)
from betterbench.policies.address import PolicyAddress
from betterbench.policies.clients.connection import errors_of
from betterbench.policies.clients.remote import ServerClient, describe_remote_policy
from betterbench.policies.conventions.adapter import Adapter
from betterbench.policies.conventions.handshake import Declaration, compare_declarations, read_declared
from betterbench.policies.conventions.presets import VLA_EVAL, adapter_of
from betterbench.policies.conventions.proprioception import StatePart, StateRule
from betterbench.policies.protocols.websocket import WebSocket
from betterbench.policies.protocols.wire import MAX_FRAME_BYTES, ImageCoding, decode_vla_eval, encode_vla_eval
from betterbench.version import __version__

PROTOCOL_VERSION = 1
"""Version of the protocol that this client supports."""

_MOST_STRAYS = 64
_ROTATIONS = {
    "axis_angle": "axis_angle",
    "rpy": "euler_xyz",
    "quaternion_xyzw": "quaternion_xyzw",
    "rotation_6d_interleaved": "rot6d_interleaved",
}
_GRIPPERS = {
    "close_positive": ("binary_close_positive",),
    "open_positive": ("binary_close_negative",),
    "closed_fraction": ("binary_close_01", "continuous_01"),
    "closed_linear": ("binary_close_01", "continuous_01"),
    "open_fraction": ("continuous_01",),
    "open_linear": ("continuous_01",),
    "open_sign": ("continuous_01",),
    "closed_at_least": ("binary_close_01", "continuous_01"),
}
_SIGNED = ("binary_close_positive",)
"""Gripper formats in which only the sign of the value matters. The adapter reads them with the threshold 0."""
_STATES = {
    ("ee_position", "ee_axis_angle", "gripper_fingers"): "eef_pos3_axisangle3_gripper2",
    ("ee_position", "ee_axis_angle_short", "gripper_fingers"): "eef_pos3_axisangle3_gripper2",
    ("ee_position", "ee_rpy", "gripper_fingers"): "eef_pos3_euler3_gripper2",
    ("ee_position", "ee_rpy", "gripper_width", "gripper_command"): "eef_pos3_euler3_gripper2",
    ("ee_position", "ee_quaternion_xyzw", "gripper_width"): "eef_pos3_quat4_gripper1",
    ("joint_positions",): "joint_positions",
}
_JOINTS = {"joint_position": "joint_positions", "joint_delta": "joint_delta_pos"}
_RAW = "raw"
_ABSOLUTE = ("ee_pose", LIBERO_ABSOLUTE.name, CALVIN_ABSOLUTE.name, CALVIN_ABSOLUTE_QUATERNION.name)
_WRIST_KEYS = ("wrist", "rgb_gripper")

_MessageKind = Literal["hello", "observation", "action", "episode_start", "episode_end", "error"]


class VlaEvalClient(ServerClient[WebSocket]):
    """Client for a policy served with the protocol of vla-evaluation-harness. Each environment needs its own client."""

    def __init__(self, address: PolicyAddress, *, seed: int = 0, max_bytes: int = MAX_FRAME_BYTES) -> None:
        super().__init__(address, adapter_of(address, VLA_EVAL), seed=seed)
        self._max_bytes, self._wanted = max_bytes, self.adapter
        self._images: ImageCoding = address.choice("images", get_args(ImageCoding), "raw")
        self._hello: Mapping[Any, Any] = {}
        self._start: EpisodeStart | None = None
        self._sequence = 0
        self._asked = 0
        self._running_on: WebSocket | None = None
        self._connection.open()
        self.info = describe_remote_policy(
            address,
            self.adapter,
            {str(k): v for k, v in self._hello.items()},
            says_actions=bool(self._hello.get("action_spec")),
        )

    def reset(self, start: EpisodeStart) -> None:
        """End the last episode and begin a new one.

        The server receives only the instruction, not the trial.
        """
        super().reset(start)
        self._end_episode()
        self._start, self._asked = start, 0
        self._connection.request(self._begin_episode, replies=False)

    def act(self, observation: Observation) -> np.ndarray:
        """Return the next action chunk as an array (horizon, dim) float64."""
        payload = self.adapter.request(observation, self._start)

        def exchange(connection: WebSocket, timeout_s: float) -> Mapping[Any, Any]:
            end = time.monotonic() + timeout_s
            if self._running_on is not connection and self._start is not None:
                # The client has reconnected during the episode, so the server must be informed about the episode again.
                self._begin_episode(connection, timeout_s)
            sent = self._send(connection, "observation", payload, timeout_s)
            return self._reply(connection, sent, end)

        reply = self._connection.request(exchange)
        self._asked += 1
        return self._actions(reply, observation)

    @property
    def _compared(self) -> Declaration:
        """Empty declaration, because the conventions have already been compared in the handshake."""
        return Declaration(self._where)

    def close(self) -> None:
        """End the episode and close the connection."""
        self._end_episode()
        super().close()

    def _dial(self, timeout_s: float) -> WebSocket:
        """Connect, exchange hello messages and compare conventions.

        Called for the first connection and for each reconnection.
        """
        end = time.monotonic() + timeout_s
        connection = WebSocket(self._address, timeout_s=timeout_s, key=self._key, max_bytes=self._max_bytes)
        said = {
            "harness_version": f"betterbench {__version__}",
            "protocol_version": PROTOCOL_VERSION,
            "benchmark": "betterbench",
        }
        with connection.greeting(
            "it accepted the connection but did not answer the hello and may not be a vla-eval server"
        ):
            sent = self._send(connection, "hello", said, timeout_s)
            self._agree(self._reply(connection, sent, end, expected="hello"))
        return connection

    def _agree(self, hello: Mapping[Any, Any]) -> None:
        """Remove the inputs that the server does not request from the adapter, and compare conventions."""
        version = hello.get("protocol_version")
        if not isinstance(version, int) or version != PROTOCOL_VERSION:
            raise HandshakeError(
                f"{self._where} uses version {one_line(version, most=20)} of the protocol, "
                f"but betterbench uses version {PROTOCOL_VERSION}."
            )
        adapter = shaped_by(self._wanted, self._where, hello, chosen=self._address.names_adapter)
        theirs, ours = declare_specs(self._where, hello, adapter)
        compare_declarations(ours, theirs)
        self._require_same(hello)
        self.adapter, self.server, self.offered, self._hello = adapter, theirs, ours, hello

    def _begin_episode(self, connection: WebSocket, timeout_s: float) -> None:
        if self._start is None:
            raise AssertionError("an episode must begin before its first observation")
        self._send(connection, "episode_start", {"task": {"name": self._start.instruction}}, timeout_s)
        self._running_on = connection

    def _end_episode(self) -> None:
        """Notify a connected server that the episode has ended. The message does not contain the result."""
        connection, self._running_on = self._running_on, None
        if connection is None or not self._connection.holds(connection):
            return
        try:
            self._send(connection, "episode_end", {"steps": self._asked}, 1.0)
        except (OSError, PolicyError):
            self._connection.drop()

    def _send(self, connection: WebSocket, kind: _MessageKind, payload: Mapping[str, Any], timeout_s: float) -> int:
        """Send a message and return its sequence number."""
        self._sequence += 1
        message = {"type": kind, "payload": dict(payload), "seq": self._sequence, "timestamp": time.time()}
        connection.send(encode_vla_eval(message, images=self._images), timeout_s)
        return self._sequence

    def _reply(
        self, connection: WebSocket, sent: int, end: float, *, expected: _MessageKind = "action"
    ) -> Mapping[Any, Any]:
        """Return the payload of the answer to message number ``sent``. Late answers to earlier messages are skipped."""
        for _ in range(_MOST_STRAYS):
            frame = connection.receive(end - time.monotonic())
            message = self._decoded(frame, declares=expected == "hello") if isinstance(frame, bytes) else None
            if not isinstance(message, Mapping) or not isinstance(message.get("payload"), Mapping):
                raise PolicyError(
                    f"{self._where} sent a frame that is not a message with a type and a payload. "
                    "Check that the server uses vla-eval's protocol."
                )
            payload: Mapping[Any, Any] = message["payload"]
            kind, number = message.get("type"), message.get("seq")
            if not isinstance(kind, str) or not isinstance(number, int):
                raise PolicyError(f"{self._where} sent a message without a type or without a number.")
            if kind == "error":
                text = one_line(payload.get("error", "no message"))
                raise PolicyError(f"{self._where} reports an error: {text}")
            if kind == expected and number == sent:
                return payload
            if number >= sent:
                raise PolicyError(
                    f"{self._where} answered message {sent} with {one_line(kind, most=20)!r} number {number}. "
                    "An answer must have the number of its message."
                )
        raise PolicyError(f"{self._where} sent {_MOST_STRAYS} messages, none of which answers the request.")

    def _decoded(self, frame: bytes, *, declares: bool) -> object:
        with errors_of(self._where):
            return read_declared(self._where, frame, decode_vla_eval) if declares else decode_vla_eval(frame)


def shaped_by(adapter: Adapter, who: str, hello: Mapping[Any, Any], *, chosen: bool) -> Adapter:
    """Return the adapter without the inputs that the server does not request.

    The harness sends the image of the wrist camera and the robot state only to servers that request them, either with
    ``observation_params`` or with a component in ``observation_spec``. Some servers use every input that they receive,
    so this client sends only the requested inputs. If the policy address names the adapter (``chosen``), the client
    sends all inputs of the adapter except those that ``observation_params`` explicitly disables.

    Raises:
        HandshakeError: If the server's specs are malformed, or if the server returns absolute actions but the adapter
            reads deltas.
    """
    parameters = hello.get("observation_params")
    if not isinstance(parameters, Mapping):
        parameters = {}
    seen = _specs(who, hello, "observation_spec")
    if parameters.get("absolute_action") is True and adapter.answer.space not in _ABSOLUTE:
        cure = {
            CALVIN_DELTA.name: "Use preset=vla_eval_calvin_absolute",
            EE_DELTA.name: "In LIBERO, use preset=vla_eval_absolute. In betterbench's own scenes, use "
            "action_space=ee_pose with the rotation format of the model, and --action-space ee_pose",
        }.get(adapter.answer.space, "Use an adapter that reads absolute poses")
        raise HandshakeError(
            f"action: the server returns absolute poses, but adapter {adapter.name} reads {adapter.answer.space}. "
            f"{cure}."
        )
    if parameters.get("send_wrist_image", chosen or len(_images(seen)) > 1) is False:
        adapter = replace(adapter, views=tuple(v for v in adapter.views if v.key[-1] not in _WRIST_KEYS))
    if parameters.get("send_state", chosen or "state" in seen) is False:
        adapter = replace(adapter, states=())
    if parameters.get("quat_no_antipodal") is True:
        adapter = replace(adapter, states=tuple(map(_unshortened, adapter.states)))
    return adapter


def _unshortened(rule: StateRule) -> StateRule:
    """Return a state rule whose rotation vector may be longer than pi, as in robosuite.

    Servers that declare ``quat_no_antipodal`` expect this format.
    """
    parts: list[StatePart] = ["ee_axis_angle" if part == "ee_axis_angle_short" else part for part in rule.parts]
    return replace(rule, parts=tuple(parts))


def declare_specs(who: str, hello: Mapping[Any, Any], adapter: Adapter) -> tuple[Declaration, Declaration]:
    """Return the conventions of the server and of the adapter, with common names for the formats.

    As in the harness, a component with the format ``raw`` is not compared. Value ranges are not compared either,
    because the harness declares ±3.15 for rotation vectors, although the values are scaled to ±1. The number of
    images is compared, but not their names, because servers use the images in the order in which they are sent.

    Raises:
        HandshakeError: If the server's specs are malformed, or if the server returns joint positions but the adapter
            reads another action space.
    """
    action, seen = _specs(who, hello, "action_spec"), _specs(who, hello, "observation_spec")
    answer = adapter.answer
    joints = answer.space.startswith("joint")
    declared = _format(action, "joints")
    if declared not in (None, _JOINTS.get(answer.space)):
        raise HandshakeError(
            f"action: {who} returns joints as {declared!r}, but adapter {adapter.name} reads {answer.space}. "
            "Add adapter=FILE with an adapter that reads joints, and use --action-space with the same action space."
        )
    position = None if joints else "absolute_xyz" if answer.space in _ABSOLUTE else "delta_xyz"
    # If the adapter supports the server's format, declare it under the server's name, so that the comparison succeeds.
    # Otherwise, declare the adapter's own format.
    told = {name: _format(action, name) for name in ("position", "rotation", "gripper")}
    meant = {
        "position": () if position is None else (position,),
        "rotation": () if joints else (_ROTATIONS.get(answer.rotation, answer.rotation),),
        "gripper": _SIGNED if answer.gripper_threshold == 0.0 else _GRIPPERS[answer.gripper],
    }
    said = {
        name: None if (w := told[name]) is None else w if w in words else (*words, "joints")[0]
        for name, words in meant.items()
    }
    theirs = Declaration(who, position=told["position"], rotation=told["rotation"], gripper=told["gripper"])
    ours = Declaration("this side", position=said["position"], rotation=said["rotation"], gripper=said["gripper"])
    state = _format(seen, "state")
    if "state" in seen:
        parts = tuple(part for rule in adapter.states for part in rule.parts)
        sent = _STATES.get(parts, ", ".join(parts))
        if not parts:
            theirs, ours = replace(theirs, state=state or "any"), replace(ours, state="none")
        elif state is not None:
            fits = sent == state or sent in seen["state"].accepts
            theirs, ours = replace(theirs, state=state), replace(ours, state=state if fits else sent)
    images = _images(seen)
    given = ["/".join(view.key) for view in adapter.views]
    if len(images) > len(given):
        cameras: dict[str, tuple[int, int] | None] = dict.fromkeys(images[len(given) :])
        theirs, ours = replace(theirs, cameras=cameras), replace(ours, cameras=dict.fromkeys(given))
    return theirs, ours


@dataclass(frozen=True, slots=True)
class _Spec:
    """Declared format of one component of an observation or action, and the other formats that are accepted."""

    format: str | None
    accepts: tuple[str, ...]


def _specs(who: str, hello: Mapping[Any, Any], name: str) -> dict[str, _Spec]:
    given = hello.get(name)
    if given is None:
        return {}
    if not isinstance(given, Mapping) or not all(isinstance(spec, Mapping) for spec in given.values()):
        raise HandshakeError(f"{who}: expected a map of components as {name}.")
    found = {}
    for key, spec in given.items():
        told, accepts = spec.get("format"), spec.get("accepts")
        words = [word for word in accepts if isinstance(word, str)] if isinstance(accepts, list) else []
        found[str(key)] = _Spec(told if isinstance(told, str) else None, tuple(words))
    return found


def _images(specs: Mapping[str, _Spec]) -> list[str]:
    return [key for key, spec in specs.items() if spec.format == "rgb_hwc_uint8"]


def _format(specs: Mapping[str, _Spec], name: str) -> str | None:
    """Return the format that a component declares, or None if it declares no format."""
    told = specs[name].format if name in specs else None
    return None if told == _RAW else told
