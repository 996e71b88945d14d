"""Client for servers with ``POST /act`` (``http://host:port/act``), such as OpenVLA, OpenVLA-OFT, X-VLA and Dexbotic.

Each request uses a new connection, and there is no handshake. Most of these servers do not declare their inputs and
outputs, so the policy address must name a preset or an adapter. Only Dexbotic's server
(:mod:`betterbench.policies.clients.dexbotic`) declares its images and action size. The client compares them with the
adapter. Source: OpenVLA and OpenVLA-OFT, ``vla-scripts/deploy.py``; X-VLA, ``models/modeling_xvla.py``.
"""

from __future__ import annotations

import contextlib
import http.client
import io
import socket
import ssl
import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, cast, get_args

import numpy as np

from betterbench.errors import HandshakeError, PolicyError, one_line
from betterbench.interface import EpisodeStart, Observation
from betterbench.policies.address import PolicyAddress
from betterbench.policies.clients.connection import ServerNotReadyError, errors_of
from betterbench.policies.clients.dexbotic import FORM_PATH, Route, compare_capabilities, encode_form, read_form_answer
from betterbench.policies.clients.remote import ServerClient, describe_remote_policy
from betterbench.policies.conventions.adapter import set_entry
from betterbench.policies.conventions.answers import get_entry, number_array
from betterbench.policies.conventions.handshake import read_declared
from betterbench.policies.conventions.in_calvin import X_VLA_CALVIN
from betterbench.policies.conventions.presets import X_VLA, adapter_of
from betterbench.policies.protocols.json_wire import MAX_BODY_BYTES, ArrayCoding, decode_body, encode_body

JSON = "application/json"
_REFUSED = (401, 403)
_ABSENT = (404, 405)
_LATE = (408, 504)
_NOT_READY = (425, 429, 502, 503)
_KNOCK_S = 2.0
_CLOSING_S = 0.25  # time in which a tunnel to a server that is down closes a connection
_LONGEST_BODY_SHOWN = 2000


@dataclass(frozen=True, slots=True)
class HttpAnswer:
    """Status code and body of an HTTP response, and the address to which it redirects the client."""

    status: int
    body: bytes
    location: str = ""


class HttpServer:
    """Client side of an HTTP server: its host and port, and the headers for requests.

    Each request opens a new connection, as the original clients of these servers do.
    """

    def __init__(self, address: PolicyAddress, key: str | None, *, timeout_s: float) -> None:
        """Store the settings and check that the server accepts and keeps a connection. Raises OSError if it does not.

        A tunnel or a container's port accepts a connection and closes it again if the server behind it is down.
        """
        self._host, self._port = address.server()
        encrypted = address.scheme == "https" or address.choice("tls", ("true", "false"), "false") == "true"
        self._tls = ssl.create_default_context() if encrypted else None
        name = f"[{self._host}]" if ":" in self._host else self._host
        self._name = f"Host: {name}:{self._port}"
        self._asked = ["Accept: application/json", "Accept-Encoding: identity", "Connection: close"]
        self._asked += [] if key is None else [f"Authorization: Bearer {key}"]
        self._path = address.path
        with socket.create_connection((self._host, self._port), min(timeout_s, _KNOCK_S)) as knock:
            knock.settimeout(_CLOSING_S)
            with contextlib.suppress(TimeoutError):
                if not knock.recv(1):
                    raise ConnectionError("connections are closed without an answer")

    def post(self, body: bytes, timeout_s: float, *, kind: str = JSON, path: str | None = None) -> HttpAnswer:
        """Send a POST request, by default to the path in the policy address. Return the answer (see :meth:`ask`)."""
        return self.ask("POST", path or self._path, body, timeout_s, kind=kind)

    def ask(self, method: str, path: str, body: bytes, timeout_s: float, *, kind: str = JSON) -> HttpAnswer:
        """Send a request and return the complete answer, which must arrive within ``timeout_s`` [s].

        Raises OSError if the answer does not arrive or the connection breaks, and PolicyError if the answer is too
        large.
        """
        end = time.monotonic() + timeout_s
        typed, sized = ([f"Content-Type: {kind}"], [f"Content-Length: {len(body)}"]) if method == "POST" else ([], [])
        lines = [f"{method} {path} HTTP/1.1", self._name, *typed, *self._asked, *sized]
        head = "\r\n".join((*lines, "", "")).encode("ascii")
        with contextlib.ExitStack() as stack:
            connected = stack.enter_context(socket.create_connection((self._host, self._port), max(0.001, timeout_s)))
            if self._tls is not None:
                connected = stack.enter_context(self._tls.wrap_socket(connected, server_hostname=self._host))
            connected.settimeout(max(0.001, end - time.monotonic()))
            connected.sendall(head + body)
            source = _Source(connected, end)
            answer = stack.enter_context(http.client.HTTPResponse(cast("socket.socket", source), method=method))
            try:
                answer.begin()
                read = answer.read(MAX_BODY_BYTES + 1)
            except (http.client.RemoteDisconnected, http.client.IncompleteRead) as error:
                raise ConnectionError("the connection was dropped") from error
            except http.client.HTTPException as error:
                problem = one_line(error, most=100) or type(error).__name__
                raise ConnectionError(f"the server does not use HTTP ({problem})") from error
        if len(read) <= MAX_BODY_BYTES and answer.length:
            raise ConnectionError(f"the answer is cut off: {answer.length} bytes are missing")
        if len(read) > MAX_BODY_BYTES:
            raise PolicyError(f"the server answered with more than {MAX_BODY_BYTES} bytes.")
        return HttpAnswer(answer.status, read, answer.headers.get("Location", ""))

    def close(self) -> None:
        """Do nothing, because no connection is open between requests."""


class _Source(io.RawIOBase):
    """Adapter that lets Python's HTTP parser read from a socket, with one deadline for all reads."""

    def __init__(self, connected: socket.socket, end: float) -> None:
        self._socket, self._end = connected, end

    def makefile(self, _mode: str) -> io.BufferedReader:
        return io.BufferedReader(self)

    def readable(self) -> bool:
        return True

    def readinto(self, buffer: Any) -> int:  # noqa: ANN401 - whatever holds bytes
        left = self._end - time.monotonic()
        if left <= 0.0:
            raise TimeoutError("no answer in time")
        self._socket.settimeout(left)
        return self._socket.recv_into(buffer)


class HttpActClient(ServerClient[HttpServer]):
    """Client for a policy served at ``POST /act``. Each environment needs its own client."""

    feeds_back = True

    def __init__(self, address: PolicyAddress, *, seed: int = 0) -> None:
        super().__init__(address, adapter_of(address), seed=seed)
        self._route = Route.of(address.path)
        usual: ArrayCoding = "map" if self._route is None else "png"
        if self.adapter.name in (X_VLA.name, X_VLA_CALVIN.name):
            usual = "text"
        self._arrays = address.choice("arrays", get_args(ArrayCoding), usual)
        self._encoded = address.choice("encoded", ("true", "false"), "false") == "true"
        self._capabilities: Mapping[str, Any] = {}
        self._first = True
        self._last: tuple[int, np.ndarray] | None = None  # step and actions of the last answer
        self._connection.open()
        self.info = describe_remote_policy(address, self.adapter, self._capabilities, says_actions=False)

    def reset(self, start: EpisodeStart) -> None:
        """Begin an episode. If the server has a reset endpoint, call it."""
        super().reset(start)
        self._first = True
        route = self._route
        if route is not None and route.reset:
            # Errors are ignored, because most models have nothing to reset and some servers lack this endpoint.
            self._connection.request(
                lambda server, timeout_s: server.post(b"{}", timeout_s, path=route.reset), replies=False
            )

    def act(self, observation: Observation) -> np.ndarray:
        """Return the next action chunk as an array (horizon, dim) float64."""
        request = self._fed_back(self.adapter.request(observation), observation.step)
        kind, form = JSON, self._route is not None and self._route.form
        if form:
            kind, body = encode_form(request, first=self._first)
        else:
            body = encode_body(request, arrays=self._arrays, encoded=self._encoded)
        answer = self._connection.request(lambda server, timeout_s: self._post(server, body, timeout_s, kind))
        self._first = False
        with errors_of(self._where):
            reply = read_form_answer(decode_body(answer.body)) if form else decode_body(answer.body)
        if isinstance(reply, str):
            raise PolicyError(
                f"{self._where} replies {one_line(reply)!r}, which servers of this kind return for any "
                "failure. See the server's log, and compare the keys that the server reads with those of the "
                "adapter."
            )
        if isinstance(reply, Mapping) and "error" in reply:
            raise PolicyError(f"{self._where} reports an error: {_told(reply)}")
        # OpenVLA returns one array, whereas OpenVLA-OFT returns a list of arrays.
        reply = self.adapter.named(_stacked(reply), self._where)
        actions = self._actions(reply, observation)
        if self.adapter.feedback is not None:
            rows = np.atleast_2d(np.asarray(get_entry(reply, self.adapter.feedback.answer_key), np.float64))
            self._last = (observation.step, rows.reshape(-1, rows.shape[-1])[:, : self.adapter.feedback.size])
        return actions

    def _fed_back(self, request: dict[str, Any], step: int) -> dict[str, Any]:
        """Replace the first values of the state in a request with the last executed action.

        The request remains unchanged if the adapter does not define ``feedback``, or if no action has been executed in
        this episode.
        """
        feedback, last = self.adapter.feedback, self._last
        if feedback is None or last is None or step <= last[0]:
            return request
        played = last[1][min(step - last[0], len(last[1])) - 1]
        state = get_entry(request, feedback.state_key)
        set_entry(request, feedback.state_key, np.concatenate([played, np.asarray(state)[feedback.size :]]))
        return request

    def _post(self, server: HttpServer, body: bytes, timeout_s: float, kind: str) -> HttpAnswer:
        """Send a POST request and return the answer if its status is 200 (OK).

        Raises HandshakeError if the server rejects or redirects the request, or if the path does not exist. Raises
        ServerNotReadyError or another ConnectionError for temporary errors, after which the request may be repeated,
        and PolicyError otherwise.
        """
        with errors_of(self._where):
            answer = server.post(body, timeout_s, kind=kind)
        status, path = answer.status, self._address.path
        if status == http.client.OK:
            return answer
        if status in _REFUSED:
            raise HandshakeError(
                f"{self._where} rejects this client (HTTP {status}). "
                "Add api_key_env=NAME to the address, where NAME is the environment variable with the key."
            )
        if 300 <= status < 400:
            elsewhere = one_line(answer.location, most=200) or "no address"
            raise HandshakeError(
                f"{self._where} redirects requests to another address (HTTP {status}, {elsewhere}). Use that address."
            )
        if status in _ABSENT:
            older = "" if self._route is None or self._route.form else f" Older releases of Dexbotic have {FORM_PATH}."
            raise HandshakeError(
                f"{self._where} has no POST {path} (HTTP {status}). Correct the path in the address.{older}"
            )
        if status in _NOT_READY:
            raise ServerNotReadyError(f"the server answered HTTP {status}")
        if status in _LATE:
            raise ConnectionError(f"the server answered HTTP {status}")
        try:
            told = _told(decode_body(answer.body))
        except PolicyError:
            told = one_line(answer.body[:_LONGEST_BODY_SHOWN].decode("utf-8", "replace")) or "no message"
        raise PolicyError(f"{self._where} answers HTTP {status}: {told}")

    def _dial(self, timeout_s: float) -> HttpServer:
        """Check that the server accepts connections.

        If the server describes its model, compare the description with the adapter.
        """
        end = time.monotonic() + timeout_s
        server = HttpServer(self._address, self._key, timeout_s=timeout_s)
        if self._route is not None and self._route.capabilities:
            answer = server.ask("GET", self._route.capabilities, b"", end - time.monotonic())
            if answer.status == http.client.OK:
                self._capabilities = compare_capabilities(
                    read_declared(self._where, answer.body, decode_body), self.adapter, self._where
                )
                self._require_same(self._capabilities)
            elif answer.status in (*_LATE, *_NOT_READY):
                raise ConnectionError(f"the server answered HTTP {answer.status}")
        return server


def _stacked(reply: object) -> object:
    """Stack a list of arrays into one array. Return any other value unchanged."""
    if isinstance(reply, list) and any(isinstance(row, np.ndarray) for row in reply):
        try:
            return np.stack([number_array(row) for row in reply])
        except ValueError:
            return reply
    return reply


def _told(reply: object) -> str:
    """Return the error message that an answer contains, as one line of text."""
    if isinstance(reply, Mapping):
        reply = reply.get("error", reply.get("detail", reply))
    return one_line(reply) or "no message"
