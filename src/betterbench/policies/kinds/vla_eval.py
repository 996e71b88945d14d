"""Policy kind ``vla-eval``: model servers of vla-evaluation-harness."""

from __future__ import annotations

from typing import TYPE_CHECKING

from betterbench.policies.address import Option, PolicyAddress
from betterbench.policies.kinds.remote import register_server

if TYPE_CHECKING:
    from betterbench.interface import Policy


def _connect(address: PolicyAddress, seed: int) -> Policy:
    from betterbench.policies.clients.vla_eval import VlaEvalClient

    return VlaEvalClient(address, seed=seed)


VLA_EVAL = register_server(
    "vla-eval",
    summary="A model server of vla-evaluation-harness.",
    transport="websocket",
    port=8000,
    connect=_connect,
    usual="vla_eval",
    options=(Option("images", "the encoding of images in messages"),),
)
