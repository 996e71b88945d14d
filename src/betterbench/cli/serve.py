"""``better serve``: any policy behind the openpi protocol."""

from __future__ import annotations

import logging
import os
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Annotated

import tyro

from betterbench.cli.console import OUT, say
from betterbench.errors import InvalidInputError
from betterbench.evaluation import TrialName, open_server
from betterbench.evaluation.serving import DEFAULT_CHUNK
from betterbench.policies.batching import MAX_BATCH
from betterbench.policies.server import DEFAULT_PORT, LOOPBACK


def serve(
    policy: Annotated[str, tyro.conf.Positional],
    *,
    host: str = LOOPBACK,
    port: int = DEFAULT_PORT,
    chunk: int = DEFAULT_CHUNK,
    batch: int = MAX_BATCH,
    task: str | None = None,
    condition: str | None = None,
    seed: int = 0,
    api_key_env: str | None = None,
) -> None:
    """Serve a policy behind the openpi protocol, for other people's clients and harnesses, until Ctrl-C or SIGTERM.

    Example: better serve expert --port 8000

    An expert needs the truth, so the server mirrors the scene of its client. Our own clients name their trial; any
    other client plays the one given by --task, --condition and --seed, or else the first training condition whose
    sentence is its prompt.

    Args:
        policy: Address of the policy (see better list policies).
        host: Interface to listen on; 0.0.0.0 lets other machines in.
        port: Port to listen on; 0 for any free one.
        chunk: Actions in one answer of an expert.
        batch: Observations that a policy which takes batches is given at once, at most.
        task: Task of clients that name none.
        condition: Its condition; the first training condition if not given.
        seed: Its seed.
        api_key_env: Environment variable with a key that clients have to show.
    """
    trial = named_trial(task, condition, seed)
    server = open_server(policy, host=host, port=port, chunk=chunk, batch=batch, trial=trial, api_key=_key(api_key_env))
    if api_key_env is None and host not in (LOOPBACK, "localhost", "::1"):
        say(f"Whoever reaches {host} can use this policy; --api-key-env NAME asks for a key.")
    with _connections_logged(), _stopped_by_signal() as stopped, server:
        OUT.print(
            f"serving {policy} at {server.address} (better eval --policy {server.address}; "
            f"openpi-client: WebsocketClientPolicy(host={server.client_host!r}, port={server.port}))",
            markup=False,
            soft_wrap=True,
        )
        stopped.wait()
    say("stopped")


def named_trial(task: str | None, condition: str | None, seed: int) -> TrialName | None:
    """Return the trial that the options name, or None if they name none.

    Raises:
        InvalidInputError: If a condition is named without its task.
        UnknownNameError: If there is no such task.
    """
    if task is None:
        if condition is not None:
            raise InvalidInputError("--condition", "it belongs to a task", "Give --task too")
        return None
    return TrialName.of(task, condition, seed)


def _key(name: str | None) -> str | None:
    if name is None:
        return None
    key = os.environ.get(name, "")
    if not key:
        raise InvalidInputError("--api-key-env", f"the variable {name} is empty", "Set it to the key, then start again")
    return key


@contextmanager
def _connections_logged() -> Iterator[None]:
    """Show who connects; everything else stays as quiet as ever."""
    ours = logging.getLogger("betterbench.policies.server")
    before = ours.level
    ours.setLevel(logging.INFO)
    try:
        yield
    finally:
        ours.setLevel(before)


@contextmanager
def _stopped_by_signal() -> Iterator[threading.Event]:
    """Give an event that SIGTERM and Ctrl-C set; what the signals did before comes back afterwards."""
    stopped = threading.Event()

    def stop(number: int, frame: FrameType | None) -> None:
        del number, frame
        stopped.set()

    before = {number: signal.signal(number, stop) for number in (signal.SIGTERM, signal.SIGINT)}
    try:
        yield stopped
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
