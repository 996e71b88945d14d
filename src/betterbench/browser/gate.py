"""Access control for viser pages, which rejects requests without the secret token and requests from other web sites.

The token is the first part of the URL path. The websocket connection of the page uses the same path, so it also
contains the token. The token is not stored in a cookie, because servers on other ports of the same host could read the
cookie.
"""

from __future__ import annotations

import dataclasses
import functools
import hmac
import importlib
import secrets
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from http import HTTPStatus
from typing import Any

from betterbench.browser.incoming import MAX_MESSAGE_BYTES, IncomingMessages
from betterbench.policies.serving.callers import is_own_host, is_own_origin

OPEN_TIMEOUT_S = 5.0
"""Maximum time until a new connection has sent its request [s]."""
_HEADERS = {
    "Referrer-Policy": "no-referrer",
    "X-Frame-Options": "DENY",
    "Cache-Control": "no-store",
    "X-Content-Type-Options": "nosniff",
}
_REFUSED = "Access denied: open the address printed by {verb}, with its token.\n"

_UNREADABLE = "This request cannot be read.\n"


def _asked(inner: Callable[[Any, Any], Any] | None, connection: Any, request: Any) -> Any:  # noqa: ANN401
    """Return the response of viser's HTTP handler, or a response with status 400 if the handler raises an error.

    Without this function, malformed requests, such as a request with a duplicate header or invalid bytes in the path,
    would print a traceback.
    """
    try:
        return None if inner is None else inner(connection, request)
    except Exception:  # noqa: BLE001 - any error of viser for an unexpected request
        return connection.respond(HTTPStatus.BAD_REQUEST, _UNREADABLE)


class Gate:
    """Access control for a page: accepts only requests that contain the token and do not come from other web sites.

    Attributes:
        token: Secret token, with which the path of every request must begin.
        is_closed: Whether a server has been started under this access control. If it is False after the server has been
            started, the server is not protected.
    """

    def __init__(self, host: str, incoming: IncomingMessages, *, verb: str) -> None:
        """Create a random token.

        ``host`` is the interface of the server, ``incoming`` validates the messages of the page, and ``verb`` is the
        command that shows the page, such as "better teleop".
        """
        self._host, self.token, self.is_closed = host, secrets.token_urlsafe(24), False
        self._refused = _REFUSED.format(verb=verb)
        self._incoming = incoming

    def path_inside(self, path: str) -> str | None:
        """Return the part of a request path after the token, or None if the token is missing or wrong."""
        plain, mark, query = path.partition("?")
        given, _, rest = plain.removeprefix("/").partition("/")
        if not hmac.compare_digest(given.encode("utf-8", "replace"), self.token.encode()):
            return None
        return f"/{rest}{mark}{query}"

    def admits(self, request: Any) -> str | None:  # noqa: ANN401 - of websockets
        """Check a request. Return the part of its path after the token, or None if the request must be rejected."""
        hosts = request.headers.get_all("Host")
        if not is_own_host(hosts, self._host) or not is_own_origin(request.headers.get_all("Origin"), hosts):
            return None
        return self.path_inside(request.path)

    @contextmanager
    def before_servers(self) -> Iterator[None]:
        """Context manager that protects all websocket servers that are started in its body.

        viser has no access control, so the function that starts its websocket server is replaced temporarily.
        """
        module = importlib.import_module("websockets.asyncio.server")
        serve = module.serve

        @functools.wraps(serve)
        def gated(handler: Any, *arguments: Any, **options: Any) -> Any:  # noqa: ANN401
            options["process_request"] = self._process(options.get("process_request"))
            options["open_timeout"], options["max_size"] = OPEN_TIMEOUT_S, MAX_MESSAGE_BYTES
            self.is_closed = True
            return serve(self._incoming.before(handler), *arguments, **options)

        module.serve = gated  # type: ignore[attr-defined]
        try:
            yield
        finally:
            module.serve = serve  # type: ignore[attr-defined]

    def _process(self, inner: Callable[[Any, Any], Any] | None) -> Callable[[Any, Any], Any]:
        def process(connection: Any, request: Any) -> Any:  # noqa: ANN401
            path = self.admits(request)
            if path is None:
                response = connection.respond(HTTPStatus.FORBIDDEN, self._refused)
            else:
                response = _asked(inner, connection, dataclasses.replace(request, path=path))
            if response is not None:
                for name, value in _HEADERS.items():
                    response.headers[name] = value
            return response

        return process
