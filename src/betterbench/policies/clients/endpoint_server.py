"""Connection to a ZeroMQ server with named endpoints, as used by GR00T and Being-H with different message encodings."""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Any

from betterbench.errors import HandshakeError, PolicyError, last_line
from betterbench.policies.address import PolicyAddress
from betterbench.policies.clients.connection import errors_of
from betterbench.policies.clients.request_client import RequestClient
from betterbench.policies.conventions.handshake import read_declared

ERROR_REPLY = b"ERROR"
"""Reply that the server sends if a request fails. It contains no reason."""


class EndpointServer:
    """Connection to a ZeroMQ server with named endpoints. The constructor connects and does the handshake.

    Raises:
        OSError: If the server cannot be reached or is not ready.
        HandshakeError: If the server rejects the token, uses another protocol, or declares different conventions.
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
        """Do the handshake. Here, it consists of a ping; subclasses also compare conventions.

        ``end`` is the deadline for the handshake [s], as measured by ``time.monotonic``.
        """
        self._first("ping", end)

    def _first(self, endpoint: str, end: float) -> Any:  # noqa: ANN401 - as decoded
        """Send a request of the handshake. Raises HandshakeError if the server reports an error."""
        try:
            return self.call(endpoint, None, end - time.monotonic(), declares=True)
        except PolicyError as error:
            text = str(error)
            if "nauthorized" in text:
                text = (
                    f"{text.removesuffix('.')}. "
                    "Add api_key_env=NAME to the address, where NAME is the environment variable with the token."
                )
            raise HandshakeError(text) from error

    def _encode(self, question: Mapping[str, Any]) -> bytes:
        """Encode a request as the bytes of one message."""
        raise NotImplementedError

    def _check_frame(self, answer: bytes, endpoint: str) -> None:
        """Raise PolicyError if a message must not be decoded. Subclasses may override this check."""

    def _decode(self, answer: bytes, endpoint: str) -> Any:  # noqa: ANN401 - as decoded
        """Decode the bytes of a message. Raises PolicyError if the message cannot be read."""
        raise NotImplementedError

    def call(self, endpoint: str, data: Mapping[str, Any] | None, timeout_s: float, *, declares: bool = False) -> Any:  # noqa: ANN401 - as decoded
        """Send a request to an endpoint and return the decoded answer, which must arrive within ``timeout_s`` [s].

        Set ``declares`` to True if the answer describes the model. Such answers have stricter limits on size and
        nesting. Raises OSError if no answer arrives, and PolicyError if the server reports an error or the answer
        cannot be read.
        """
        question: dict[str, Any] = {"endpoint": endpoint}
        if data is not None:
            question["data"] = data
        if self._token is not None:
            question["api_token"] = self._token
        with errors_of(self._where):
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
        """Close the connection."""
        self._client.close()
