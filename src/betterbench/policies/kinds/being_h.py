"""Policy kind ``being-h``: inference servers of Being-H."""

from __future__ import annotations

from typing import TYPE_CHECKING

from betterbench.policies.address import Option, PolicyAddress
from betterbench.policies.kinds.remote import register_server

if TYPE_CHECKING:
    from betterbench.interface import Policy


def _connect(address: PolicyAddress, seed: int) -> Policy:
    from betterbench.policies.clients.being_h import BeingHClient

    return BeingHClient(address, seed=seed)


BEING_H = register_server(
    "being-h",
    summary="An inference server of Being-H.",
    transport="zeromq",
    port=5555,
    connect=_connect,
    usual="being_h_libero",
    options=(Option("delay", "the number of actions that are executed while the server computes", "whole"),),
)
