"""``better serve``: serve any policy over the openpi protocol."""

from __future__ import annotations

import logging
import os
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import TYPE_CHECKING, Annotated

import tyro

from betterbench.cli.console import OUT, say
from betterbench.cli.robot_option import USUAL_OPTION, ChosenRobot
from betterbench.errors import InvalidInputError
from betterbench.quoting import shell_word

if TYPE_CHECKING:
    from betterbench.interface import BatchPolicy
    from betterbench.tasks import TrialId


def serve_command(
    policy: Annotated[str, tyro.conf.Positional],
    *,
    host: str = "127.0.0.1",
    port: int = 8000,
    chunk: int | None = None,
    layout: str | None = None,
    batch: int | None = None,
    clients: int | None = None,
    task: str | None = None,
    condition: str | None = None,
    seed: int | None = None,
    arm: ChosenRobot = USUAL_OPTION,
    api_key_env: str | None = None,
) -> None:
    """Serve a policy over the openpi protocol to other clients and harnesses, until Ctrl-C or SIGTERM.

    An expert needs privileged state, so the server runs a shadow simulation of its client's scene. Clients of
    betterbench send the name of their trial. For other clients, --task, --condition and --seed specify the trial.
    Without --task, the first training condition whose instruction equals the client's prompt is used.

    Example: better serve expert --port 8000

    Args:
        policy: Policy address (see `better list policies`).
        host: Interface to listen on; 0.0.0.0 accepts other machines.
        port: Port to listen on; 0 for any free port.
        chunk: Number of actions per expert answer; default 8.
        layout: Preset of the observations and actions of a served expert, to test a client or an adapter; default:
            native and openpi_libero.
        batch: Maximum number of observations per act_batch call, for policies that implement it; default 16.
        clients: Maximum number of simultaneous clients; 128 if not given. Further clients are rejected until one
            disconnects.
        task: Task for clients that do not send one.
        condition: Condition of that task; default: its first training condition.
        seed: Seed of that trial; default 0.
        arm: Robot in an expert's scenes.
        api_key_env: Environment variable with the API key that clients must send.
    """
    from betterbench.evaluation import open_server
    from betterbench.evaluation.serving.server import DEFAULT_CHUNK
    from betterbench.policies.batching import MAX_BATCH
    from betterbench.policies.serving.callers import LOOPBACK_NAMES
    from betterbench.policies.serving.server import MAX_CLIENTS
    from betterbench.tasks.user_files import loading_options

    trial = chosen_trial(task, condition, seed)
    key = _key(api_key_env)
    if chunk is not None:
        _require_expert(policy, "--chunk", "determines its own chunk length")
    if arm != USUAL_OPTION:
        _require_expert(policy, "--robot", "uses the robot that its observations come from")
    server = open_server(
        policy,
        host=host,
        port=port,
        chunk=DEFAULT_CHUNK if chunk is None else chunk,
        batch=MAX_BATCH if batch is None else batch,
        clients=MAX_CLIENTS if clients is None else clients,
        trial=trial,
        robot=arm.of([] if trial is None else [trial.task]),
        layout=layout,
        api_key=key,
        made=None if batch is None else _batch_policy(policy),
    )
    if api_key_env is None and host not in LOOPBACK_NAMES:
        say(f"Anyone who can reach {host} can use this policy; --api-key-env NAME requires an API key.")
    arm_words = "".join(f" {word}" for word in arm.words)
    evaluation = f"better eval --policy {shell_word(server.address)}{loading_options()} --trials 3{arm_words}"
    with _connections_logged(), stopped_by_signal() as stopped, server:
        OUT.print(
            f"serving {policy} at {server.address}\n"
            f"evaluate    {evaluation}\n"
            f"or call     openpi_client's WebsocketClientPolicy(host={server.client_host!r}, port={server.port})\n"
            "Ctrl-C stops.",
            markup=False,
            soft_wrap=True,
        )
        stopped.wait()
    say("stopped")


def chosen_trial(task: str | None, condition: str | None, seed: int | None) -> TrialId | None:
    """Return the trial given by the options, or None if no task is given.

    Raises:
        InvalidInputError: If a condition or seed is given without a task.
    """
    if task is None:
        for option, value in (("--condition", condition), ("--seed", seed)):
            if value is not None:
                raise InvalidInputError(option, "this option applies only with --task", "Add --task TASK")
        return None
    from betterbench.evaluation import named_trial

    return named_trial(task, condition, 0 if seed is None else seed)


def _require_expert(policy: str, option: str, does: str) -> None:
    """Raise InvalidInputError if an option that applies only to experts is given with another policy.

    A policy address of an unknown kind is not rejected here, because it causes an error later.
    """
    from betterbench.policies.kinds import find_kind

    kind = find_kind(policy)
    if kind is not None and not kind.needs_of(policy).state:
        raise InvalidInputError(option, f"{policy} is not an expert and {does}", f"Leave out {option}")


def _batch_policy(policy: str) -> BatchPolicy:
    """Create a policy that answers several observations in one call.

    Raises:
        InvalidInputError: If the policy does not support batches.
    """
    from betterbench.interface import BatchPolicy
    from betterbench.policies.factory import close_policy
    from betterbench.policies.kinds import make_policy, needs_of

    made = make_policy(policy) if needs_of(policy).thread else None
    if isinstance(made, BatchPolicy):
        return made
    close_policy(made)
    raise InvalidInputError(
        "--batch", f"{policy} does not support batches", "Leave out --batch, or implement act_batch in the policy"
    )


def _key(name: str | None) -> str | None:
    if name is None:
        return None
    key = os.environ.get(name, "")
    if not key:
        raise InvalidInputError(
            "--api-key-env", f"the environment variable {name} is empty or not set", "Set this variable to the API key"
        )
    return key


@contextmanager
def _connections_logged() -> Iterator[None]:
    """Log the connections of clients while the context is open, unless the log level hides everything but errors."""
    ours = logging.getLogger("betterbench.policies.serving.server")
    before = ours.level
    if ours.getEffectiveLevel() <= logging.WARNING:
        ours.setLevel(logging.INFO)
    try:
        yield
    finally:
        ours.setLevel(before)


@contextmanager
def stopped_by_signal() -> Iterator[threading.Event]:
    """Yield an event that is set when the process receives SIGTERM or Ctrl-C.

    A second signal ends the process immediately, in case the policy hangs.
    """
    stopped = threading.Event()

    def stop(number: int, frame: FrameType | None) -> None:
        del frame
        if stopped.is_set():
            os._exit(128 + number)
        stopped.set()

    before = {number: signal.signal(number, stop) for number in (signal.SIGTERM, signal.SIGINT)}
    try:
        yield stopped
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
