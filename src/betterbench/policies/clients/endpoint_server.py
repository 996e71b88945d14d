"""Connection to a ZeroMQ server with named endpoints. GR00T and Being-H use it with different message encodings."""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Any

from betterbench.errors import HandshakeError, PolicyError, last_line
from betterbench.policies.address import PolicyAddress
from betterbench.policies.clients.request_client import RequestClient
from betterbench.policies.conventions.handshake import read_declared

ERROR_REPLY = b"ERROR"
"""Reply with which these servers report a failed request without giving a reason."""


class EndpointServer:
    """Connection to a ZeroMQ server. It is created when the server has answered a ping.

    Raises:
        OSError: If the server cannot be reached or is not ready.
        HandshakeError: If the server rejects the token, uses another protocol, or declares conventions that differ from
            the client's.
    """

    def __init__(self, address: PolicyAddress, token: str | None, *, timeout_s: float) -> None:
        end = time.monotonic() + timeout_s
        self._where, self._token = address.server_name, token
        self._client = RequestClient(*address.server(), timeout_s=timeout_s)
        try:
            self._greet(end)
        except BaseException:
            self.close()
            raise

    def _greet(self, end: float) -> None:
        """Check that the server is alive and that its conventions are the expected ones.

        The check must be finished at the time ``end`` [s], as measured by ``time.monotonic``.
        """
        self._first("ping", end)

    def _first(self, endpoint: str, end: float) -> Any:  # noqa: ANN401 - as decoded
        """Send a request that belongs to the handshake. Raises HandshakeError if the request fails."""
        try:
            return self.call(endpoint, None, end - time.monotonic(), declares=True)
        except PolicyError as error:
            hint = (
                ""
                if "nauthorized" not in str(error)
                else (" Add api_key_env=NAME to the address, where NAME is the environment variable with the token.")
            )
            raise HandshakeError(f"{error}{hint}") from error

    def _encode(self, question: Mapping[str, Any]) -> bytes:
        """Encode a request as the bytes of one message."""
        raise NotImplementedError

    def _check_frame(self, answer: bytes, endpoint: str) -> None:
        """Raise PolicyError if a message must not be decoded."""

    def _decode(self, answer: bytes, endpoint: str) -> Any:  # noqa: ANN401 - as decoded
        """Decode the bytes of a message. Raises PolicyError if the message cannot be read."""
        raise NotImplementedError

    def call(self, endpoint: str, data: Mapping[str, Any] | None, timeout_s: float, *, declares: bool = False) -> Any:  # noqa: ANN401 - as decoded
        """Send a request to an endpoint and return the decoded answer, which must arrive within ``timeout_s`` [s].

        If the server is asked to describe its model, set ``declares`` to True, which limits the length of the answer.
        Raises OSError if no answer arrived, and PolicyError if the server reports an error or the answer cannot be
        read.
        """
        question: dict[str, Any] = {"endpoint": endpoint}
        if data is not None:
            question["data"] = data
        if self._token is not None:
            question["api_token"] = self._token
        answer = self._client.ask(self._encode(question), max(0.0, timeout_s))
        self._check_frame(answer, endpoint)
        if answer == ERROR_REPLY:
            raise PolicyError(f"{self._where} reports an error for {endpoint} without a message. See the server's log.")
        reply = (
            read_declared(self._where, answer, lambda given: self._decode(given, endpoint))
            if declares
            else self._decode(answer, endpoint)
        )
        if isinstance(reply, Mapping) and "error" in reply:
            raise PolicyError(f"{self._where} reports an error: {last_line(str(reply['error'])) or 'no message'}")
        return reply

    def close(self) -> None:
        """End the connection."""
        self._client.close()
