"""Client for starVLA's websocket server: ``starvla://host:port``.

After a connection is opened, the server sends a metadata map. A request is a map with a type, an identifier and a
payload, and the answer has the same identifier. A text frame reports an error and ends the connection. The payload is a
list of examples, so one request can contain the observations of many environments. Arrays are encoded as in openpi's
variant of msgpack. Source: starVLA, ``deployment/model_server``.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, Literal, get_args

import numpy as np

from betterbench.errors import PolicyError, last_line, one_line
from betterbench.interface import EpisodeStart, Observation
from betterbench.policies.address import PolicyAddress
from betterbench.policies.clients.connection import errors_of
from betterbench.policies.clients.remote import ServerClient, check_start, describe_remote_policy
from betterbench.policies.conventions.adapter import set_entry
from betterbench.policies.conventions.answers import number_array
from betterbench.policies.conventions.handshake import read_declared
from betterbench.policies.conventions.presets import STARVLA, adapter_of
from betterbench.policies.protocols.websocket import WebSocket
from betterbench.policies.protocols.wire import decode_openpi, encode_openpi

ExampleLayout = Literal["payload", "flat"]
"""Layout of a request.

"payload": the examples are an entry of the payload. "flat": the examples are at the top level of the request, as the
first starVLA servers expect.
"""

_IMAGES = "image"
_MOST_STRAYS = 64


class StarVlaClient(ServerClient[WebSocket]):
    """Client for a policy served with starVLA's protocol. One client serves many environments."""

    def __init__(self, address: PolicyAddress, *, seed: int = 0) -> None:
        super().__init__(address, adapter_of(address, STARVLA), seed=seed)
        self._layout = address.choice("layout", get_args(ExampleLayout), "payload")
        self._metadata: Mapping[Any, Any] = {}
        self._lock = threading.Lock()
        self._sequence = 0
        self._answered: deque[str] = deque(maxlen=_MOST_STRAYS)
        self._connection.open()
        declared = {str(key): value for key, value in self._metadata.items()}
        self.info = describe_remote_policy(address, self.adapter, declared, says_actions=False)

    def reset(self, start: EpisodeStart) -> None:
        """Begin an episode in one of the environments. The client keeps no state between episodes."""
        check_start(self.adapter, start, self._where)

    def act(self, observation: Observation) -> np.ndarray:
        """Return the next action chunk as an array (horizon, dim) float64."""
        return self.act_batch([observation])[0]

    def act_batch(self, observations: Sequence[Observation]) -> list[np.ndarray]:
        """Return the next action chunk of each environment. A single request contains all observations."""
        payload: dict[str, Any] = {"examples": [self._example(observation) for observation in observations]}
        for constant in self.adapter.constants:
            set_entry(payload, constant.key, constant.value)
        with self._lock:
            data = self._connection.request(lambda connection, timeout_s: self._infer(connection, payload, timeout_s))
        return [
            self._actions(sample, observation)
            for sample, observation in zip(self._samples(data, len(observations)), observations, strict=True)
        ]

    def _example(self, observation: Observation) -> dict[str, Any]:
        """Return one example: a list of images in the order of the adapter, and each state as an array (1, size)."""
        message = replace(self.adapter, constants=()).request(observation)
        images = message.get(_IMAGES)
        if isinstance(images, Mapping):
            message[_IMAGES] = list(images.values())
        elif images is not None:
            message[_IMAGES] = [images]
        for rule in self.adapter.states:
            value = message.get(rule.key[0])
            if isinstance(value, np.ndarray) and value.ndim == 1:
                message[rule.key[0]] = value[None]
        return message

    def _infer(self, connection: WebSocket, payload: Mapping[str, Any], timeout_s: float) -> Mapping[Any, Any]:
        """Send one request and return the data in the answer. Late answers to earlier requests are skipped."""
        end = time.monotonic() + timeout_s
        self._sequence += 1
        identifier = f"betterbench-{self._sequence}"
        examples = {"payload": payload} if self._layout == "payload" else payload
        request = {"type": "infer", "request_id": identifier, **examples}
        connection.send(encode_openpi(request), timeout_s)
        for _ in range(_MOST_STRAYS):
            reply = self._read(connection.receive(end - time.monotonic()))
            number = reply.get("request_id")
            if isinstance(number, str) and number == identifier:
                self._answered.append(identifier)
                return self._data(reply)
            if not isinstance(number, str) or number not in self._answered:
                raise PolicyError(
                    f"{self._where} answered request {identifier} with {one_line(number, most=40)!r}. "
                    "An answer must have the request_id of its request."
                )
        raise PolicyError(f"{self._where} sent {_MOST_STRAYS} messages, none of which answers the request.")

    def _data(self, reply: Mapping[Any, Any]) -> Mapping[Any, Any]:
        """Return the data in an answer. Raises PolicyError if the server reports an error."""
        data, status = reply.get("data"), reply.get("status")
        if not isinstance(status, str) or status != "ok" or not isinstance(data, Mapping):
            error = reply.get("error", data.get("error") if isinstance(data, Mapping) else None)
            told = error.get("message") if isinstance(error, Mapping) else error
            text = ("" if told is None else one_line(told)) or "no message"
            hint = " Older servers need layout=flat." if "'examples'" in text and self._layout == "payload" else ""
            raise PolicyError(f"{self._where} reports an error: {text}{hint}")
        return data

    def _samples(self, data: Mapping[Any, Any], count: int) -> list[dict[str, Any]]:
        """Split the batched arrays of an answer. Return one dict of arrays (horizon, dim) per environment."""
        names = dict.fromkeys(key[0] for key in self.adapter.answer.columns)
        if "normalized_actions" in data and not all(name in data for name in names):
            raise PolicyError(
                f"{self._where} returns normalized actions, which need the statistics of the "
                "checkpoint. Update starVLA: newer servers unnormalize the actions themselves."
            )
        arrays = {}
        for name in names:
            if name not in data:
                there = ", ".join(sorted(one_line(key, most=40) for key in data)[:20]) or "nothing"
                raise PolicyError(f"{self._where}: the reply has no {name!r}. It has: {there}.")
            array = number_array(data[name])
            if array.ndim != 3 or len(array) != count:
                raise PolicyError(
                    f"{self._where}: {name!r} has shape {array.shape}. "
                    f"Send ({count}, chunk, action), one chunk for each example."
                )
            arrays[name] = array
        return [{name: array[i] for name, array in arrays.items()} for i in range(count)]

    def _dial(self, timeout_s: float) -> WebSocket:
        """Connect, and check that the server sends the same metadata as at the first connection."""
        end = time.monotonic() + timeout_s
        connection = WebSocket(self._address, timeout_s=timeout_s, key=self._key)
        with connection.greeting("it accepted the connection but sent no metadata and may not be a starVLA server"):
            metadata = read_declared(self._where, connection.receive(end - time.monotonic()), self._read)
            self._require_same(metadata)
            self._metadata = metadata
        return connection

    def _read(self, frame: bytes | str) -> Mapping[Any, Any]:
        """Return the map in a frame.

        Raises PolicyError if the server reports an error or the frame does not contain a map.
        """
        if isinstance(frame, str):
            raise PolicyError(f"{self._where} reports an error: {last_line(frame) or 'no message'}")
        with errors_of(self._where):
            value = decode_openpi(frame)
        if not isinstance(value, Mapping):
            raise PolicyError(f"{self._where}: expected a map, got {type(value).__name__}.")
        return value
