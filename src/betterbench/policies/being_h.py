"""Client of Being-H's inference server: ``being-h://host:port``.

ZeroMQ REQ/REP with the questions of GR00T N1.5 (an endpoint, its data, a token), but written by torch. What the server
answers is read without unpickling (:mod:`betterbench.policies.torch_payload`); the server unpickles what we send, which
is its risk and not ours. ``get_modality_config`` is not asked for: it answers with objects of the server's own classes,
which is just what must not be unpickled. Facts: BeingBeyond/Being-H, ``BeingH/inference/service.py``.

The bridge (:mod:`betterbench.policies.bridges.being_h_bridge`) needs torch on the server's side only.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Any

import numpy as np

from betterbench.errors import HandshakeError, PolicyError
from betterbench.interface import EpisodeStart, Observation, PolicyInfo
from betterbench.policies.address import PolicyAddress
from betterbench.policies.connection import PolicyConnection, Terms, api_key
from betterbench.policies.handshake import Declaration
from betterbench.policies.presets import BEING_H_LIBERO, adapter_of
from betterbench.policies.remote import Adapted, check_start, describe_policy
from betterbench.policies.request_client import RequestClient
from betterbench.policies.torch_payload import import_torch, read_torch, write_torch

_ERROR = b"ERROR"
_LONGEST_ERROR = 500
_UNIFIED = "action_unified"


class BeingHServer:
    """One connection: a socket over which the server has answered a ping."""

    def __init__(self, address: PolicyAddress, token: str | None, *, timeout_s: float) -> None:
        """Connect and ask whether the server is alive.

        Args:
            address: Address of the server.
            token: Token to show, or None.
            timeout_s: Longest time that this may take [s].

        Raises:
            OSError: If the server is not there, or not ready.
            HandshakeError: If it refuses the token or speaks another protocol.
        """
        end = time.monotonic() + timeout_s
        self._where, self._token = f"policy server {address.scheme}://{address.target}", token
        self._requester = RequestClient(*address.server(), timeout_s=timeout_s)
        try:
            self.call("ping", None, end - time.monotonic())
        except PolicyError as error:
            self.close()
            hint = "" if "nauthorized" not in str(error) else " Give api_key_env=NAME with the variable of its token."
            raise HandshakeError(f"{error}{hint}") from error
        except BaseException:
            self.close()
            raise

    def call(self, endpoint: str, data: Mapping[str, Any] | None, timeout_s: float) -> Mapping[str, Any]:
        """Ask something.

        Args:
            endpoint: What is asked for.
            data: What goes with it, or None.
            timeout_s: Longest time until the answer is there [s].

        Returns:
            The answer: texts, numbers, lists and arrays by name.

        Raises:
            OSError: If no answer came.
            PolicyError: If it is an error of the server's, or cannot be read.
        """
        question: dict[str, Any] = {"endpoint": endpoint}
        if data is not None:
            question["data"] = data
        if self._token is not None:
            question["api_token"] = self._token
        answer = self._requester.ask(write_torch(question), max(0.0, timeout_s))
        if answer == _ERROR:
            raise PolicyError(f"{self._where} answers {endpoint} with an error and no text. Its own output tells more.")
        reply = read_torch(answer)
        if not isinstance(reply, Mapping):
            raise PolicyError(f"{self._where} answers {endpoint} with a {type(reply).__name__} in place of a map.")
        if "error" in reply:
            lines = [line.strip() for line in str(reply["error"]).splitlines() if line.strip()]
            raise PolicyError(f"{self._where} reports an error: {lines[-1][:_LONGEST_ERROR] if lines else 'no text'}")
        return reply

    def close(self) -> None:
        """End the connection."""
        self._requester.close()


class BeingHClient(Adapted):
    """A Being-H policy; each environment has a client of its own.

    With real-time chunking the server answers also with its whole chunk in its unified action space. With ``ahead`` or
    ``delay``, what is left of that is sent back with the next question, and the number of control steps that pass while
    the server computes, so that the new chunk continues the old one.

    Attributes:
        adapter: What the policy is shown and how its answers are read.
        server: What the server declares: nothing.
        info: What the policy says about itself.
    """

    def __init__(self, address: PolicyAddress, *, seed: int = 0) -> None:
        """Connect.

        Args:
            address: Address of the server.
            seed: Seed of the jitter between attempts.

        Raises:
            MissingDependencyError: If torch is not installed.
            PolicyUnavailableError: If the server cannot be reached.
            HandshakeError: If it refuses this client.
            InvalidInputError: If an option of the address is malformed.
            UnknownNameError: If a name in the address does not exist.
        """
        import_torch()
        self.adapter = adapter_of(address, BEING_H_LIBERO)
        self._where = f"policy server {address.scheme}://{address.target}"
        self.server = Declaration(self._where)
        token = api_key(address)
        self._delay = address.whole("delay", address.execution().ahead)
        self._last: tuple[int, np.ndarray] | None = None  # step of the last question, and the whole chunk it brought
        self.info: PolicyInfo = describe_policy(address, self.adapter, {}, says_actions=False)
        self._link = PolicyConnection(
            self._where,
            lambda timeout_s: BeingHServer(address, token, timeout_s=timeout_s),
            Terms.of(address, seed=seed),
        )
        self._link.open()

    @property
    def figures(self) -> dict[str, float]:
        """Wall-clock figures of the episode so far, by name."""
        return self._link.figures

    def reset(self, start: EpisodeStart) -> None:
        """Begin an episode.

        Raises:
            HandshakeError: If it wants actions of another kind.
        """
        check_start(self.adapter, start, self._where)
        self._last = None
        self._link.count_anew()

    def act(self, observation: Observation) -> np.ndarray:
        """Return the next actions, (horizon, dim) float64.

        Raises:
            PolicyError: If the reply cannot be used, or none came.
            PolicyUnavailableError: If the server cannot be reached.
        """
        data = self.adapter.request(observation)
        if self._last is not None:
            data |= continuation(*self._last, step=observation.step, delay=self._delay)
        reply = self._link.request(lambda server, timeout_s: server.call("get_action", data, timeout_s))
        actions = self.adapter.actions(reply, observation)
        chunk = reply.get(_UNIFIED)
        self._last = None if chunk is None else (observation.step, _numbers(chunk, self._where))
        return actions

    def close(self) -> None:
        """End the connection."""
        self._link.close()


def continuation(asked_at: int, chunk: np.ndarray, *, step: int, delay: int) -> dict[str, Any]:
    """Return what is added to a question so that the new chunk continues the old one; empty if nothing is left of it.

    The server keeps the first ``delay`` rows of what it is sent as the first of its new chunk. They have to be those of
    the control steps that begin now, so the old chunk is moved up by the steps that have passed, and filled up with its
    last row, which the server does not look at.

    Args:
        asked_at: Control step of the question that brought the old chunk.
        chunk: The old chunk, (..., horizon, dim) in the policy's own action space.
        step: Control step of this question.
        delay: Control steps that pass while the policy computes.
    """
    passed = step - asked_at
    if not delay or passed < 0 or chunk.shape[-2] - passed < delay:
        return {}
    moved = np.concatenate([chunk[..., passed:, :], np.repeat(chunk[..., -1:, :], passed, axis=-2)], axis=-2)
    return {"prev_chunk": moved, "inference_delay": delay}


def _numbers(chunk: object, where: str) -> np.ndarray:
    """Return the whole chunk as an array; the server takes no lists, in which it sends them.

    Raises:
        PolicyError: If it is no chunk of numbers.
    """
    try:
        array: np.ndarray = np.asarray(chunk, dtype=np.float32)
    except (TypeError, ValueError):
        array = np.zeros(0, dtype=np.float32)
    if array.ndim not in (2, 3) or not array.size:
        raise PolicyError(f"{where}: {_UNIFIED} is no chunk of numbers, (horizon, dim).")
    return array
