"""Code shared by the policy kinds that use a preset to connect to a server or load a checkpoint."""

from __future__ import annotations

import itertools
import os
from collections.abc import Callable
from typing import TYPE_CHECKING

from betterbench.errors import InvalidInputError
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
"""Options of all servers, and of a checkpoint loaded locally."""

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
    """Add a kind of policy server to the registry.

    Args:
        scheme: Scheme of its addresses.
        summary: One sentence that describes the servers.
        transport: Transport protocol of such a server.
        port: Default port.
        connect: Returns a connected client after the handshake, given an address and the seed of its retry jitter.
        usual: Default preset of an address. It is empty if the address must name a preset.
        options: Options of this kind only.
        constants: Whether an address may add constants to each request.
        shown: Form of the address in lists. If empty, scheme, host and port are shown.
    """
    form = AddressForm(
        scheme=scheme,
        example=f"{scheme}://localhost:{port}{'/act' if transport == 'http' else ''}",
        options=(*COMMON, *options, CAMERA, *([CONSTANT] if constants else [])),
        transport=transport,
        port=port,
    )

    def make(address: PolicyAddress) -> Policy:
        # Each client gets its own seed for the jitter of retries; results do not depend on it.
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
        )
    )


def space_in_world(address: PolicyAddress, usual: str = "") -> str | None:
    """Return the action space of the answers in the address's world, or None if the address does not determine it.

    ``usual`` is the default preset. Raises the errors of
    :func:`betterbench.policies.conventions.presets.adapter_of`.
    """
    from betterbench.policies.conventions.presets import adapter_of, preset

    if not (usual or address.names_adapter):
        return None
    return adapter_of(address, preset(usual) if usual else None).answer.space


def require_own_layout(address: PolicyAddress, world: str) -> None:
    """Raise InvalidInputError for a preset that converts our scenes to another world's conventions."""
    from betterbench.policies.conventions.in_calvin import CALVIN_PRESETS
    from betterbench.policies.conventions.presets import UNTRANSLATED

    named = address.options.get("preset", "")
    if named in UNTRANSLATED:
        raise InvalidInputError(
            "--policy",
            f"the preset {named} converts our scenes to LIBERO's conventions, but this run uses {world}'s own scenes",
            f"Give preset={UNTRANSLATED[named]}"
            if world == "LIBERO"
            else f"Give preset=NAME ({', '.join(CALVIN_PRESETS)})",
        )
