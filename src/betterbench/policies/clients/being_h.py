"""Client for Being-H's inference server: ``being-h://host:port``.

The server uses ZeroMQ REQ/REP. As with GR00T N1.5, a request contains an endpoint, data and a token, but messages are
serialized with ``torch.save``. The server unpickles the requests. The client never unpickles replies, because this
could run arbitrary code; it reads them with :mod:`betterbench.policies.protocols.torch_payload`. The client does not
call ``get_modality_config``, because the reply contains Python objects that can only be read by unpickling them.
Source: BeingBeyond/Being-H, ``BeingH/inference/service.py``.

Alternatively, serve the policy with :mod:`betterbench.policies.clients.bridges.being_h_bridge`. The client then does
not need torch.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from betterbench.errors import PolicyError
from betterbench.interface import EpisodeStart, Observation
from betterbench.policies.address import PolicyAddress
from betterbench.policies.clients.connection import errors_of
from betterbench.policies.clients.endpoint_server import EndpointServer
from betterbench.policies.clients.previous_chunk import moved_up, rows_left
from betterbench.policies.clients.remote import ServerClient, describe_remote_policy
from betterbench.policies.conventions.presets import BEING_H_LIBERO, adapter_of
from betterbench.policies.protocols.torch_payload import import_torch, read_torch, write_torch

_UNIFIED = "action_unified"


class BeingHServer(EndpointServer):
    """Connection to a Being-H server. Messages are serialized in the format of ``torch.save``."""

    def _encode(self, question: Mapping[str, Any]) -> bytes:
        return write_torch(question)

    def _decode(self, answer: bytes, endpoint: str) -> Mapping[str, Any]:
        with errors_of(self._where):
            reply = read_torch(answer)
        if not isinstance(reply, Mapping):
            raise PolicyError(f"{self._where}: expected a map in reply to {endpoint}, got {type(reply).__name__}.")
        return reply


class BeingHClient(ServerClient[BeingHServer]):
    """Client for a Being-H policy. Each environment needs its own client.

    For real-time chunking, the server also returns the complete chunk in its unified action space. If ``ahead`` or
    ``delay`` is set, the next request contains the unexecuted actions of this chunk and the number of control steps
    that pass during inference. The server uses them to continue the old chunk.
    """

    def __init__(self, address: PolicyAddress, *, seed: int = 0) -> None:
        import_torch()
        super().__init__(address, adapter_of(address, BEING_H_LIBERO), seed=seed)
        self._last: tuple[int, np.ndarray] | None = None  # step and complete chunk of the last request
        self.info = describe_remote_policy(address, self.adapter, {}, says_actions=False)
        self._delay = address.whole("delay", self.info.execution.ahead)
        self._connection.open()

    def _dial(self, timeout_s: float) -> BeingHServer:
        return BeingHServer(self._address, self._key, timeout_s=timeout_s)

    def reset(self, start: EpisodeStart) -> None:
        """Begin an episode. Raises HandshakeError if the episode uses a different action space than the policy."""
        super().reset(start)
        self._last = None

    def act(self, observation: Observation) -> np.ndarray:
        """Return the next action chunk as an array (horizon, dim) float64."""
        data = self.adapter.request(observation)
        if self._last is not None:
            data |= continue_previous_chunk(*self._last, step=observation.step, delay=self._delay)
        reply = self._connection.request(lambda server, timeout_s: server.call("get_action", data, timeout_s))
        actions = self._actions(reply, observation)
        chunk = reply.get(_UNIFIED)
        self._last = None if chunk is None else (observation.step, _numbers(chunk, self._where))
        return actions


def continue_previous_chunk(asked_at: int, chunk: np.ndarray, *, step: int, delay: int) -> dict[str, Any]:
    """Return the request entries for real-time chunking.

    ``chunk`` is the old chunk, (..., horizon, dim) in the policy's own action space, which was requested at step
    ``asked_at``. The server copies the first ``delay`` rows of the chunk that it receives to its new chunk. If fewer
    than ``delay`` unexecuted rows remain at control step ``step``, the result is an empty dict.
    """
    if not delay or rows_left(asked_at, chunk, step=step) < delay:
        return {}
    return {"prev_chunk": moved_up(asked_at, chunk, step=step), "inference_delay": delay}


def _numbers(chunk: object, where: str) -> np.ndarray:
    """Convert a complete action chunk to an array.

    The server returns the chunk as nested lists, but accepts only arrays in requests.
    """
    try:
        array: np.ndarray = np.asarray(chunk, dtype=np.float32)
    except (TypeError, ValueError):
        array = np.zeros(0, dtype=np.float32)
    if array.ndim not in (2, 3) or not array.size:
        raise PolicyError(f"{where}: expected {_UNIFIED} as numbers of shape (horizon, dim).")
    return array
