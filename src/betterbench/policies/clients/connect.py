"""From the address of a policy behind a protocol, or of a checkpoint, to a client."""

from __future__ import annotations

import itertools
import os

from betterbench.interface import Policy
from betterbench.policies.address import HTTP, PolicyAddress

_COUNT = itertools.count()


def connect(address: str, *, world: str = "") -> Policy:
    """Return a client; the handshake has been done when it comes back. ``world`` is the foreign world of the run.

    Raises:
        UnknownNameError: If the scheme or an option does not exist.
        InvalidInputError: If an option is malformed, or the layout of observations is left open.
        PolicyUnavailableError: If the server cannot be reached.
        HandshakeError: If it declares other conventions.
        MissingDependencyError: If an extra is not installed.
    """
    parsed = PolicyAddress.parse(address, world=world)
    # Each client jitters in its own way; results do not depend on it.
    seed = 1_000_003 * os.getpid() + next(_COUNT)
    # Imported when asked for: not every machine has what each of them needs.
    if parsed.scheme == "openpi":
        from betterbench.policies.clients.openpi import OpenpiClient  # noqa: PLC0415

        return OpenpiClient(parsed, seed=seed)
    if parsed.scheme == "vla-eval":
        from betterbench.policies.clients.vla_eval import VlaEvalClient  # noqa: PLC0415

        return VlaEvalClient(parsed, seed=seed)
    if parsed.scheme == "gr00t":
        from betterbench.policies.clients.gr00t import connect_gr00t  # noqa: PLC0415

        return connect_gr00t(parsed, seed=seed)
    if parsed.scheme == "being-h":
        from betterbench.policies.clients.being_h import BeingHClient  # noqa: PLC0415

        return BeingHClient(parsed, seed=seed)
    if parsed.scheme == "starvla":
        from betterbench.policies.clients.starvla import StarVlaClient  # noqa: PLC0415

        return StarVlaClient(parsed, seed=seed)
    if parsed.scheme in HTTP:
        from betterbench.policies.clients.http_act import HttpActClient  # noqa: PLC0415

        return HttpActClient(parsed, seed=seed)
    from betterbench.policies.clients.lerobot import load_lerobot  # noqa: PLC0415

    return load_lerobot(parsed)
