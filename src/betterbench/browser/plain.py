"""HTTP server for pages that do not use viser. It serves files, images and JSON.

As in :mod:`betterbench.browser.gate`, a secret token is the first part of every path, and requests from other web sites
are rejected. A content security policy prevents the page from loading anything from another server.
"""

from __future__ import annotations

import contextlib
import functools
import hmac
import http.server
import json
import re
import secrets
import threading
from collections.abc import Callable, Mapping
from http import HTTPStatus
from importlib import resources
from typing import Any

from betterbench.browser.address import origin_of
from betterbench.browser.server import free_port
from betterbench.errors import BetterError
from betterbench.json_form import parse_json
from betterbench.policies.serving.callers import LOOPBACK_NAMES, is_own_host, is_own_origin

MOST_BYTES = 1 << 16
"""Maximum size of a request body [bytes]."""
TIMEOUT_S = 10.0
"""Time after which an idle connection is closed [s]."""
_RANGE = re.compile("bytes=([0-9]{0,15})-([0-9]{0,15})")
"""Pattern of a ``Range`` header with a single range (RFC 9110, section 14).

For any other ``Range`` header, the server sends the complete content.
"""

_HEADERS = {
    "Referrer-Policy": "no-referrer",
    "X-Frame-Options": "DENY",
    "Cache-Control": "no-store",
    "X-Content-Type-Options": "nosniff",
    "Content-Security-Policy": (
        "default-src 'none'; img-src 'self' data: blob:; media-src 'self'; style-src 'self'; script-src 'self'; "
        "connect-src 'self'; form-action 'none'; base-uri 'none'"
    ),
}

Answer = tuple[str, bytes]
"""Media type and content of an answer."""


@functools.cache
def file_of_package(package: str, name: str, kind: str) -> Answer:
    """Return a text file of a package as an answer. ``kind`` is its media type, such as "text/html"."""
    return f"{kind}; charset=utf-8", resources.files(package).joinpath(name).read_bytes()


class PlainServer:
    """HTTP server for a single page. It runs until it is closed."""

    def __init__(
        self,
        get: Mapping[str, Callable[[], Answer | None]],
        post: Callable[[dict[str, Any]], object],
        *,
        host: str,
        port: int,
        verb: str,
    ) -> None:
        """Start listening.

        Args:
            get: Functions that answer GET requests, by the part of the path after the token, such as "" or "state". A
                function returns a response, or None for status 404. Several threads may call it at the same time.
            post: Function that executes a command of the page. It is called with the JSON object that the page sent to
                the path "do", and returns a JSON value. If it raises a BetterError, the page receives its message.
            host: Interface to listen on.
            port: Port to listen on. 0 selects any free port.
            verb: Command that shows the page, such as "better teleop". It is named in the response to a rejected
                request.

        Raises:
            InvalidInputError: If the port is not available.
        """
        self._host, self._token = host, secrets.token_urlsafe(24)
        handler = functools.partial(_Handler, host=host, token=self._token, get=get, post=post, verb=verb)
        self._server = http.server.ThreadingHTTPServer((host, free_port(host, port)), handler)
        self._server.daemon_threads = True
        self.port = int(self._server.server_address[1])
        self._thread = threading.Thread(target=self._server.serve_forever, args=(0.1,), name="page", daemon=True)
        self._thread.start()

    @property
    def url(self) -> str:
        """Address of the page, including the token."""
        return f"{origin_of(self._host, self.port)}/{self._token}/"

    @property
    def is_local(self) -> bool:
        """Whether the server listens only on this machine."""
        return self._host in LOOPBACK_NAMES

    def close(self) -> None:
        """Stop the server. Further calls have no effect."""
        if self._thread.is_alive():
            self._server.shutdown()
            self._thread.join()
            self._server.server_close()


class _Handler(http.server.BaseHTTPRequestHandler):
    """Handler of the requests to a :class:`PlainServer`."""

    protocol_version = "HTTP/1.1"
    timeout = TIMEOUT_S

    def __init__(
        self,
        *arguments: Any,  # noqa: ANN401 - of the server
        host: str,
        token: str,
        get: Mapping[str, Callable[[], Answer | None]],
        post: Callable[[dict[str, Any]], object],
        verb: str,
    ) -> None:
        self._host, self._token, self._get, self._post, self._verb = host, token, get, post, verb
        super().__init__(*arguments)

    def handle(self) -> None:
        """Answer requests until the connection is closed. A browser resets its connections when a tab is closed."""
        with contextlib.suppress(ConnectionError):
            super().handle()

    def do_GET(self) -> None:
        """Send a page, an image or a state."""
        inside = self._inside()
        if inside is None:
            return
        make = self._get.get(inside)
        try:
            answer = None if make is None else make()
        except (BetterError, OSError) as problem:  # for example, if a video file has been deleted
            self._send(HTTPStatus.INTERNAL_SERVER_ERROR, "text/plain; charset=utf-8", f"{problem}\n".encode())
            return
        if answer is None:
            self._send(HTTPStatus.NOT_FOUND, "text/plain; charset=utf-8", b"not found\n")
        else:
            self._send_part(*answer)

    def do_POST(self) -> None:
        """Execute a command."""
        inside = self._inside()
        if inside is None:
            return
        length = self.headers.get("Content-Length", "")
        if inside != "do" or not re.fullmatch("[0-9]{1,9}", length) or int(length) > MOST_BYTES:
            self.close_connection = True  # the body has not been read and would be parsed as the next request
            self._send(HTTPStatus.BAD_REQUEST, "text/plain; charset=utf-8", b"This request cannot be read.\n")
            return
        try:
            form = parse_json(self.rfile.read(int(length)), unique=True)
            answer = self._post(form) if isinstance(form, dict) else {"error": "Expected a JSON object."}
        except (BetterError, OSError, ValueError) as problem:
            answer = {"error": str(problem)}
        self._send(HTTPStatus.OK, "application/json", json.dumps(answer).encode())

    def _inside(self) -> str | None:
        """Check the request, and return the part of its path after the token.

        If the check fails, send an error response and return None.
        """
        hosts = self.headers.get_all("Host") or []
        given, _, rest = self.path.partition("?")[0].removeprefix("/").partition("/")
        if (
            hmac.compare_digest(given.encode("utf-8", "replace"), self._token.encode())
            and is_own_host(hosts, self._host)
            and is_own_origin(self.headers.get_all("Origin") or [], hosts)
        ):
            return rest
        text = f"Access denied: open the address printed by {self._verb}, with its token.\n"
        self.close_connection = True  # the body has not been read and would be parsed as the next request
        self._send(HTTPStatus.FORBIDDEN, "text/plain; charset=utf-8", text.encode())
        return None

    def _send_part(self, kind: str, data: bytes) -> None:
        """Send the content, or the byte range that the browser requests when the user seeks in a video."""
        found = _RANGE.fullmatch(self.headers.get("Range", ""))
        first, last = ("", "") if found is None else found.groups()
        if not (first or last) or (first and last and int(last) < int(first)):
            self._send(HTTPStatus.OK, kind, data, {"Accept-Ranges": "bytes"})
            return
        size = len(data)
        begin = int(first) if first else max(0, size - int(last))
        end = min(size, int(last) + 1) if first and last else size
        if begin >= end:
            told = {"Content-Range": f"bytes */{size}"}
            self._send(HTTPStatus.REQUESTED_RANGE_NOT_SATISFIABLE, "text/plain; charset=utf-8", b"", told)
            return
        told = {"Accept-Ranges": "bytes", "Content-Range": f"bytes {begin}-{end - 1}/{size}"}
        self._send(HTTPStatus.PARTIAL_CONTENT, kind, data[begin:end], told)

    def _send(self, status: HTTPStatus, kind: str, data: bytes, headers: Mapping[str, str] | None = None) -> None:
        try:
            self.send_response(status)
            for name, value in {**_HEADERS, **(headers or {})}.items():
                self.send_header(name, value)
            self.send_header("Content-Type", kind)
            self.send_header("Content-Length", str(len(data)))
            self.end_headers()
            self.wfile.write(data)
        except OSError:  # the page was closed
            self.close_connection = True

    def log_message(self, format: str, *args: object) -> None:  # noqa: A002 - the name in http.server
        """Do nothing. Requests are not logged, because their paths contain the secret token."""
