"""Policy kind ``openpi``: openpi servers, and servers started by ``better serve``."""

from __future__ import annotations

from typing import TYPE_CHECKING

from betterbench.policies.address import Option, PolicyAddress
from betterbench.policies.kinds.remote import register_server

if TYPE_CHECKING:
    from betterbench.interface import Policy


def _connect(address: PolicyAddress, seed: int) -> Policy:
    from betterbench.policies.clients.openpi import OpenpiClient

    return OpenpiClient(address, seed=seed)


OPENPI = register_server(
    "openpi",
    summary="A server of openpi, or of better serve.",
    transport="websocket",
    port=8000,
    connect=_connect,
    usual="native",
    options=(
        Option("arrays", "the encoding of arrays in messages"),
        Option("delay", "the number of actions that are executed while the server computes", "whole"),
    ),
)
