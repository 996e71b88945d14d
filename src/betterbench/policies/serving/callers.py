"""Protection of local servers against requests from foreign web pages.

A browser lets any web page send requests to servers on this machine. These functions distinguish such requests from
requests of local programs and of the server's own pages. The browser sends the site of the page (``Origin``) and the
host name of the server (``Host``) with each request. In a DNS rebinding attack, a foreign host name resolves to this
machine. ``Host`` then contains the foreign name instead of a name of this machine.
"""

from __future__ import annotations

import ipaddress
import socket
from collections.abc import Sequence

LOOPBACK_NAMES = frozenset({"127.0.0.1", "localhost", "::1"})
_ANY = frozenset({"0.0.0.0", "::", ""})  # noqa: S104 - compared, not bound


def is_own_host(values: Sequence[str], bound: str) -> bool:
    """Return whether the ``Host`` header of a request names this machine.

    Loopback names and the name of the interface ``bound``, on which the server listens, are always allowed. If the
    server listens on all interfaces, the name of this machine and all IP addresses are also allowed. IP addresses are
    safe, because a DNS rebinding attack needs a host name. ``values`` are all ``Host`` headers of the request; a
    request with several of them is rejected.
    """
    if len(values) != 1:
        return False
    name = _name_in(values[0])
    if name in LOOPBACK_NAMES or (bound not in _ANY and name == bound.lower()):
        return True
    return bound in _ANY and (_is_number(name) or name in {socket.gethostname().lower(), socket.getfqdn().lower()})


def is_own_origin(values: Sequence[str], hosts: Sequence[str]) -> bool:
    """Return whether the ``Origin`` header of a request matches its ``Host`` header.

    If they match, the request comes from a page of this server. A request without ``Origin`` is also allowed, because
    it does not come from a web page.
    """
    return not values or (len(hosts) == 1 and list(values) == [f"http://{hosts[0]}"])


def _name_in(host: str) -> str:
    """Return the host name in a ``Host`` header, without the port."""
    if host.startswith("["):
        return host[1:].partition("]")[0].lower()
    return host.rpartition(":")[0].lower() if ":" in host else host.lower()


def _is_number(name: str) -> bool:
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True
