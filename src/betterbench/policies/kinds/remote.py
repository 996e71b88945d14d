"""Code shared by the policy kinds that connect to a server or load a checkpoint. These kinds use presets."""

from __future__ import annotations

import itertools
import os
from collections.abc import Callable
from typing import TYPE_CHECKING

from betterbench.errors import InvalidInputError, registering_place
from betterbench.policies.address import (
    ADAPTER,
    CAMERA,
    CONNECTION,
    CONSTANT,
    EXECUTION,
    AddressForm,
    Option,
    PolicyAddress,
    Transport,
)
from betterbench.policies.kinds.kind import SERVER, PolicyKind, register

if TYPE_CHECKING:
    from betterbench.interface import Policy

COMMON = (*EXECUTION, *CONNECTION, *ADAPTER)
"""Options that addresses of all policy servers and of local LeRobot checkpoints accept."""

_COUNT = itertools.count()


def register_server(
    scheme: str,
    *,
    summary: str,
    transport: Transport,
    port: int,
    connect: Callable[[PolicyAddress, int], Policy],
    usual: str = "",
    options: tuple[Option, ...] = (),
    constants: bool = True,
    shown: str = "",
) -> PolicyKind:
    """Register a kind of policy server.

    Args:
        scheme: Scheme of the addresses.
        summary: Description of this kind of server in one sentence.
        transport: Transport protocol of the servers.
        port: Default port.
        connect: Function that connects to a server and, after the handshake, returns the client. Its arguments are an
            address and a seed for the random part of the pauses between attempts.
        usual: Default preset. Empty if the address must name a preset.
        options: Options that only this policy kind has.
        constants: Whether options of an address may add constants to each request.
        shown: Address as shown in lists. By default, scheme, host and port are shown.
    """
    form = AddressForm(
        scheme=scheme,
        example=f"{scheme}://localhost:{port}{'/act' if transport == 'http' else ''}",
        options=(*COMMON, *options, CAMERA, *([CONSTANT] if constants else [])),
        transport=transport,
        port=port,
    )

    def make(address: PolicyAddress) -> Policy:
        # Each client gets its own seed for the random part of pauses between attempts. Results do not depend on the
        # seed.
        return connect(address, 1_000_003 * os.getpid() + next(_COUNT))

    def answers_in(address: PolicyAddress) -> str | None:
        return space_in_world(address, usual)

    return register(
        PolicyKind(
            form=form,
            shown=shown or f"{scheme}://HOST:PORT",
            summary=summary,
            needs=SERVER,
            make=make,
            compares=True,
            require_world=require_own_layout,
            space_in_world=answers_in,
        ),
        registering_place(),
    )


def space_in_world(address: PolicyAddress, usual: str = "") -> str | None:
    """Return the action space that a policy uses in the benchmark for which its address was parsed.

    Return None if the address does not determine it. ``usual`` is the default preset. Raises the errors of
    :func:`betterbench.policies.conventions.presets.adapter_of`.
    """
    from betterbench.policies.conventions.presets import adapter_of, preset

    if not (usual or address.names_adapter):
        return None
    return adapter_of(address, preset(usual) if usual else None).answer.space


def require_own_layout(address: PolicyAddress, world: str) -> None:
    """Raise InvalidInputError if the preset in an address converts betterbench's scenes to LIBERO's conventions."""
    from betterbench.policies.conventions.in_calvin import CALVIN_PRESETS
    from betterbench.policies.conventions.presets import UNTRANSLATED

    named = address.options.get("preset", "")
    if named in UNTRANSLATED:
        raise InvalidInputError(
            "--policy",
            f"the preset {named} converts betterbench's own scenes to LIBERO's conventions, but this run uses "
            f"{world}'s own scenes",
            f"Use preset={UNTRANSLATED[named]}"
            if world == "LIBERO"
            else f"Use preset=NAME ({', '.join(CALVIN_PRESETS)})",
        )
