"""Client for openpi's websocket protocol: ``openpi://host:port``, or ``openpi://host:port/path``.

After a connection is opened, the server sends a metadata map. It then answers each observation with an action chunk.
All of these messages are binary frames. A text frame reports an error and ends the connection. The protocol has no
reset message, because the server treats each request independently. Source: openpi's ``packages/openpi-client``.

The client also supports two variants of this protocol. Some servers encode arrays in the msgpack-numpy format. The
client uses this format for its requests if the server's metadata uses it, or if the option ``arrays=nd`` is set.
vLLM-Omni (``vllm_omni/entrypoints/openpi``, ``connection.py`` and ``serving.py``) listens at a URL path, answers with a
plain array of actions, and reports an error as a map with ``type`` "error". It distinguishes episodes by a
``session_id``, which the client sends if the metadata contains ``needs_session_id``.

openpi itself does not support real-time chunking. The fork kai0 (OpenDriveLab/kai0, ``src/openpi/policies/policy.py``)
and similar servers do. They accept the unexecuted actions of the previous chunk as ``prev_action_chunk``, together with
``inference_delay`` and ``execute_horizon``. These actions have the same units as the actions that the server returns.
The client sends these fields if the option ``delay=N`` is set.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any, get_args
from uuid import uuid4

import numpy as np

from betterbench.errors import PolicyError, last_line, one_line, printable
from betterbench.interface import EpisodeStart, Observation
from betterbench.policies.address import EXECUTION, PolicyAddress
from betterbench.policies.clients.connection import errors_of
from betterbench.policies.clients.previous_chunk import moved_up, rows_left
from betterbench.policies.clients.remote import ServerClient, describe_remote_policy
from betterbench.policies.conventions.adapter import Adapter
from betterbench.policies.conventions.answers import get_entry
from betterbench.policies.conventions.handshake import (
    Declaration,
    compare_declarations,
    declare_adapter,
    read_declared,
    read_execution,
    read_server,
)
from betterbench.policies.conventions.presets import NATIVE, PRESETS, adapter_of
from betterbench.policies.protocols.websocket import WebSocket
from betterbench.policies.protocols.wire import (
    MAX_FRAME_BYTES,
    OpenpiArrays,
    decode_openpi,
    encode_openpi,
    marks_arrays_as_nd,
)

if TYPE_CHECKING:  # policy processes must not import the tasks, which take long to load
    from betterbench.tasks import TrialId

_LONGEST_REASON = 20_000
_SESSION = "session_id"


class OpenpiClient(ServerClient[WebSocket]):
    """Client for a policy served with openpi's protocol. Each environment needs its own client."""

    def __init__(self, address: PolicyAddress, *, seed: int = 0, max_bytes: int = MAX_FRAME_BYTES) -> None:
        # Errors in the address are reported before a server is contacted.
        super().__init__(address, adapter_of(address, NATIVE), seed=seed)
        self._max_bytes = max_bytes
        self._arrays: OpenpiArrays = address.choice("arrays", get_args(OpenpiArrays), "openpi")
        self._session = _new_session()
        self._delay = address.whole("delay")
        if self._delay and len(self.adapter.answer.columns) > 1:
            raise address.error(
                f"delay needs a single action array, but adapter {self.adapter.name} reads several", "Omit delay"
            )
        self._last: tuple[int, np.ndarray] | None = None  # step of the last request, and the complete chunk
        self._start: EpisodeStart | None = None
        self._trial: TrialId | None = None
        self._serves_expert = False
        self._server_s = 0.0
        self._chosen: Adapter | None = None  # set by the first handshake
        self.last_reply: dict[str, Any] = {}
        self._metadata: Mapping[str, Any] = {}
        self._connection.open()
        ours = self._metadata.get("betterbench")
        ours = ours if isinstance(ours, Mapping) else {}
        wants, looks_at = ours.get("needs_images"), ours.get("looks_at")
        info = describe_remote_policy(
            address,
            self.adapter,
            self._metadata,
            needs_images=wants if isinstance(wants, bool) else None,
            cameras=looks_at if isinstance(looks_at, list) else None,
        )
        # Precedence of the settings for chunk execution: policy address, then server, then preset.
        told = read_execution(self._where, ours)
        if told is not None and not address.given(EXECUTION):
            info = replace(info, execution=told)
        self.info = info

    @property
    def figures(self) -> dict[str, float]:
        """Numbers of requests, retries and reconnects in this episode, and the server's total inference time [s]."""
        return {**self._connection.figures, "policy_server_s": round(self._server_s, 6)}

    def reset(self, start: EpisodeStart) -> None:
        """Begin an episode with a new ``session_id``."""
        super().reset(start)
        self._start, self._server_s, self._session, self._last = start, 0.0, _new_session(), None

    def name_trial(self, trial: TrialId) -> None:
        """Set the trial of the next episode.

        The client sends the trial only to servers of an expert policy, which need it to simulate the same scene.
        """
        self._trial = trial

    def act(self, observation: Observation) -> np.ndarray:
        """Return the next action chunk as an array (horizon, dim) float64."""
        trial = self._trial if self._serves_expert else None
        request = self.adapter.request(observation, self._start, trial)
        if self._metadata.get("needs_session_id") is True:
            request.setdefault(_SESSION, self._session)
        frame = encode_openpi(request | self._continuation(observation.step), arrays=self._arrays)

        def exchange(connection: WebSocket, timeout_s: float) -> object:
            end = time.monotonic() + timeout_s
            # Messages have no sequence number, so an unread answer would be mistaken for the answer to this request.
            connection.refuse_unasked()
            connection.send(frame, timeout_s)
            answer = connection.receive(end - time.monotonic())
            connection.mark_end_of_answer()
            return self._read(answer, (Mapping, np.ndarray))

        reply = self.adapter.named(self._connection.request(exchange), self._where)
        actions = self._actions(reply, observation)
        if self._delay:
            self._last = (observation.step, _whole_chunk(get_entry(reply, next(iter(self.adapter.answer.columns)))))
        taken = {key[0] for key in self.adapter.answer.columns}
        self.last_reply = {str(k): v for k, v in reply.items() if k not in taken}
        timing = reply.get("server_timing")
        spent = timing.get("infer_ms") if isinstance(timing, Mapping) else None
        if isinstance(spent, (int, float)) and 0.0 <= spent < 1e9:
            self._server_s += 0.001 * float(spent)
        return actions

    def _continuation(self, step: int) -> dict[str, Any]:
        """Return the request entries for real-time chunking.

        The dict is empty if fewer than ``delay`` unexecuted actions of the previous chunk remain.
        """
        if self._last is None or rows_left(*self._last, step=step) < self._delay:
            return {}
        horizon = self._address.execution(self.adapter.horizon).horizon
        executed = {} if horizon is None else {"execute_horizon": horizon}
        return {"prev_action_chunk": moved_up(*self._last, step=step), "inference_delay": self._delay, **executed}

    def _dial(self, timeout_s: float) -> WebSocket:
        """Connect, read the server's metadata and compare conventions.

        Called for the first connection and for each reconnection.
        """
        end = time.monotonic() + timeout_s
        connection = WebSocket(self._address, timeout_s=timeout_s, key=self._key, max_bytes=self._max_bytes)
        with connection.greeting("it accepted the connection but sent no metadata and may not be an openpi server"):
            frame = connection.receive(end - time.monotonic())
            self._agree(read_declared(self._where, frame, lambda given: self._read(given, (Mapping,))))
            if "arrays" not in self._address.options:
                self._arrays = "nd" if isinstance(frame, bytes) and marks_arrays_as_nd(frame) else "openpi"
        return connection

    def _agree(self, metadata: Mapping[Any, Any]) -> None:
        """Compare the client's conventions with the server's. At the first handshake, also choose the adapter."""
        declared = metadata.get("betterbench")
        theirs = Declaration(self._where) if declared is None else read_server(self._where, declared)
        read_execution(self._where, declared)  # raise an error if the server declares invalid execution settings
        self._within = isinstance(declared, Mapping) and declared.get("within") is True
        self._serves_expert = isinstance(declared, Mapping) and declared.get("expert") is True
        adapter = self._chosen
        if adapter is None:
            adapter = adapter_of(self._address, PRESETS.get(theirs.preset or ""))
            if theirs.action_space is not None and adapter.answer.as_is and "action_space" not in self._address.options:
                adapter = adapter.in_space(theirs.action_space)
        layouts = declared.get("layouts") if isinstance(declared, Mapping) else None
        if isinstance(layouts, list) and adapter.name in [name for name in layouts if isinstance(name, str)]:
            # The server accepts requests in the adapter's layout, so compare with this layout instead of its default.
            columns = theirs.action_dim if adapter.answer.as_is else None
            theirs = replace(theirs, preset=adapter.name, action_dim=columns)
        compare_declarations(declare_adapter("this side", adapter), theirs)
        self._require_same(metadata)
        self._chosen = self.adapter = adapter
        self.server = theirs
        self._metadata = {str(k): v for k, v in metadata.items()}

    def _read(self, frame: bytes | str, kinds: tuple[type, ...]) -> Any:  # noqa: ANN401 - one of the kinds
        """Decode a frame.

        Raises PolicyError if the server reports an error or the value does not have one of the given types.
        """
        if isinstance(frame, str):
            if self._within:
                raise PolicyError(printable(frame, most=_LONGEST_REASON))
            raise PolicyError(f"{self._where} reports an error: {last_line(frame) or 'no message'}")
        with errors_of(self._where):
            value = decode_openpi(frame)
        if not isinstance(value, kinds):
            raise PolicyError(f"{self._where}: expected a map, got {type(value).__name__}.")
        if isinstance(value, Mapping) and isinstance(value.get("type"), str) and value["type"] == "error":
            raise PolicyError(f"{self._where} reports an error: {one_line(value.get('message', 'no message'))}")
        return value


def _whole_chunk(given: object) -> np.ndarray:
    """Return the chunk in a decoded answer as an array (horizon, dim) float32."""
    array = np.asarray(given, dtype=np.float32)
    while array.ndim > 2:
        array = array[0]
    return np.atleast_2d(array)


def _new_session() -> str:
    """Return a session name that has not been used before."""
    return f"betterbench-{uuid4().hex}"
