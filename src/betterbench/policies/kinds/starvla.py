"""Policy kind ``starvla``: websocket servers of starVLA."""

from __future__ import annotations

from typing import TYPE_CHECKING

from betterbench.policies.address import Option, PolicyAddress
from betterbench.policies.kinds.remote import register_server

if TYPE_CHECKING:
    from betterbench.interface import Policy


def _connect(address: PolicyAddress, seed: int) -> Policy:
    from betterbench.policies.clients.starvla import StarVlaClient

    return StarVlaClient(address, seed=seed)


STARVLA = register_server(
    "starvla",
    summary="A websocket server of starVLA.",
    transport="websocket",
    port=10093,
    connect=_connect,
    usual="starvla",
    options=(Option("layout", "the format of a request"),),
)
