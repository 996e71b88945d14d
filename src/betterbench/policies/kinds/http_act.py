"""Policy kinds ``http`` and ``https``: servers with ``POST /act``, such as OpenVLA, OpenVLA-OFT, X-VLA and Dexbotic."""

from __future__ import annotations

from typing import TYPE_CHECKING

from betterbench.policies.address import Option, PolicyAddress
from betterbench.policies.kinds.remote import register_server

if TYPE_CHECKING:
    from betterbench.interface import Policy

_OPTIONS = (
    Option("arrays", "the encoding of arrays in requests"),
    Option("encoded", "whether the request is wrapped in a JSON string: true or false"),
)


def _connect(address: PolicyAddress, seed: int) -> Policy:
    from betterbench.policies.clients.http_act import HttpActClient

    return HttpActClient(address, seed=seed)


HTTP = register_server(
    "http",
    summary="A server of OpenVLA, OpenVLA-OFT or X-VLA (POST /act).",
    transport="http",
    port=8000,
    connect=_connect,
    options=_OPTIONS,
    shown="http://HOST:PORT/act",
)
HTTPS = register_server(
    "https",
    summary="A server of OpenVLA, OpenVLA-OFT or X-VLA over HTTPS.",
    transport="http",
    port=443,
    connect=_connect,
    options=_OPTIONS,
    shown="https://HOST/act",
)
