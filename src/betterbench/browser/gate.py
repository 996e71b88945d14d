"""Access control for a page: requests without the token, and requests from other web sites, are rejected.

The token is the first part of the path. The websocket connection of the page uses the same address, so it contains the
token too. The token is not stored in a cookie, because a server on another port could read the cookie.
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
"""Time within which a new connection must send its request [s]."""
_HEADERS = {
    "Referrer-Policy": "no-referrer",
    "X-Frame-Options": "DENY",
    "Cache-Control": "no-store",
    "X-Content-Type-Options": "nosniff",
}
_REFUSED = "Access denied: open the address printed by {verb}, with its token.\n"

_UNREADABLE = "This request cannot be read.\n"


def _asked(inner: Callable[[Any, Any], Any] | None, connection: Any, request: Any) -> Any:  # noqa: ANN401
    """Return the response of the wrapped HTTP handler, or a response with status 400 if the handler raises an error.

    Otherwise, the server would print a traceback for a request in which a header occurs twice or the path contains
    invalid bytes.
    """
    try:
        return None if inner is None else inner(connection, request)
    except Exception:  # noqa: BLE001 - any error of viser for an unexpected request
        return connection.respond(HTTPStatus.BAD_REQUEST, _UNREADABLE)


class Gate:
    """Filter that admits only requests that contain the token and come from the page itself.

    Attributes:
        token: Token with which every request path must begin.
        is_closed: Whether the filter already protects a server. A server must not be used before this is True.
    """

    def __init__(self, host: str, incoming: IncomingMessages, *, verb: str) -> None:
        """Draw a random token.

        ``verb`` is the subcommand that shows the page, and ``incoming`` filters messages from the page.
        """
        self._host, self.token, self.is_closed = host, secrets.token_urlsafe(24), False
        self._refused = _REFUSED.format(verb=verb)
        self._incoming = incoming

    def path_inside(self, path: str) -> str | None:
        """Return the part of a request path that follows the token, or None if the token is missing or wrong."""
        plain, mark, query = path.partition("?")
        given, _, rest = plain.removeprefix("/").partition("/")
        if not hmac.compare_digest(given.encode("utf-8", "replace"), self.token.encode()):
            return None
        return f"/{rest}{mark}{query}"

    def admits(self, request: Any) -> str | None:  # noqa: ANN401 - of websockets
        """Check a request, and return the part of its path that follows the token.

        Return None if it must be rejected.
        """
        hosts = request.headers.get_all("Host")
        if not is_own_host(hosts, self._host) or not is_own_origin(request.headers.get_all("Origin"), hosts):
            return None
        return self.path_inside(request.path)

    @contextmanager
    def before_servers(self) -> Iterator[None]:
        """Protect every websocket server that is started while this context is active.

        This is necessary because viser has no access control.
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
