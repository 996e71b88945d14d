"""Policy kind ``gr00t``: inference servers of Isaac GR00T."""

from __future__ import annotations

from typing import TYPE_CHECKING

from betterbench.policies.address import Option, PolicyAddress
from betterbench.policies.kinds.remote import register_server

if TYPE_CHECKING:
    from betterbench.interface import Policy


def _connect(address: PolicyAddress, seed: int) -> Policy:
    from betterbench.policies.clients.gr00t import connect_gr00t

    return connect_gr00t(address, seed=seed)


GR00T = register_server(
    "gr00t",
    summary="An inference server of Isaac GR00T.",
    transport="zeromq",
    port=5555,
    connect=_connect,
    usual="gr00t_new_embodiment",
    options=(
        Option("layout", "the format of a request"),
        Option("api_token_env", "the environment variable with the token"),
        Option("rtc_overlap_steps", "the number of actions of two chunks that overlap", "whole"),
        Option("rtc_frozen_steps", "the number of actions of the overlap that are kept unchanged", "whole"),
        Option("rtc_ramp_rate", "the rate at which the constraint on the rest of the overlap decays", "number"),
    ),
    constants=False,
)
