"""Access control for local servers. Programs and the server's own pages may connect, but pages of other sites may not.

This is necessary because a browser lets any page connect to this machine. With each request, the browser sends the site
of the page (``Origin``) and the host name of the server (``Host``). If a foreign name resolves to this machine, the
host name differs from the names of this machine.
"""

from __future__ import annotations

import ipaddress
import socket
from collections.abc import Sequence

LOOPBACK_NAMES = frozenset({"127.0.0.1", "localhost", "::1"})
_ANY = frozenset({"0.0.0.0", "::", ""})  # noqa: S104 - compared, not bound


def is_own_host(values: Sequence[str], bound: str) -> bool:
    """Return whether the ``Host`` headers of a request are allowed for a server that listens on an interface.

    On the loopback interface, the loopback names and the interface's name are allowed. If the server listens on all
    interfaces, this machine's name and every IP address are allowed too, because a DNS rebinding attack needs a name.
    """
    if len(values) != 1:
        return False
    name = _name_in(values[0])
    if name in LOOPBACK_NAMES or (bound not in _ANY and name == bound.lower()):
        return True
    return bound in _ANY and (_is_number(name) or name in {socket.gethostname().lower(), socket.getfqdn().lower()})


def is_own_origin(values: Sequence[str], hosts: Sequence[str]) -> bool:
    """Return whether a request's ``Origin`` headers, if any, match the address in its ``Host`` header."""
    return not values or (len(hosts) == 1 and list(values) == [f"http://{hosts[0]}"])


def _name_in(host: str) -> str:
    """Return the name in a ``Host`` header without its port."""
    if host.startswith("["):
        return host[1:].partition("]")[0].lower()
    return host.rpartition(":")[0].lower() if ":" in host else host.lower()


def _is_number(name: str) -> bool:
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True
