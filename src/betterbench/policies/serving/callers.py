"""Access control for servers on this machine.

Programs on this machine and the server's own pages may connect, but other web pages may not. The check is necessary
because a browser lets any web page send requests to this machine. With each request, the browser sends the site of the
page (``Origin``) and the host name of the server (``Host``). If a foreign host name resolves to this machine (DNS
rebinding), ``Host`` contains that name and not a name of this machine.
"""

from __future__ import annotations

import ipaddress
import socket
from collections.abc import Sequence

LOOPBACK_NAMES = frozenset({"127.0.0.1", "localhost", "::1"})
_ANY = frozenset({"0.0.0.0", "::", ""})  # noqa: S104 - compared, not bound


def is_own_host(values: Sequence[str], bound: str) -> bool:
    """Return whether the ``Host`` headers of a request are allowed if the server listens on the interface ``bound``.

    On the loopback interface, the loopback names and the name of the interface are allowed. If the server listens on
    all interfaces, the name of this machine and all IP addresses are also allowed. IP addresses are safe, since a DNS
    rebinding attack needs a host name.
    """
    if len(values) != 1:
        return False
    name = _name_in(values[0])
    if name in LOOPBACK_NAMES or (bound not in _ANY and name == bound.lower()):
        return True
    return bound in _ANY and (_is_number(name) or name in {socket.gethostname().lower(), socket.getfqdn().lower()})


def is_own_origin(values: Sequence[str], hosts: Sequence[str]) -> bool:
    """Return whether the ``Origin`` header of a request matches its ``Host`` header.

    A request without ``Origin`` is allowed.
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
