"""Base classes of policies with an adapter and of clients for policy servers."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, Generic

import numpy as np

from betterbench.errors import HandshakeError, one_line, printable
from betterbench.interface import EpisodeStart, Observation, ObservationSpec, PolicyInfo
from betterbench.policies.address import PolicyAddress
from betterbench.policies.clients.connection import (
    Connection,
    ConnectionLimits,
    PolicyConnection,
    api_key,
    errors_of,
)
from betterbench.policies.conventions.adapter import Adapter
from betterbench.policies.conventions.handshake import Declaration, compare_declarations, declare_adapter, space_cure
from betterbench.policies.conventions.image_rule import EVERY_CAMERA

_LONGEST_TEXT = 2000
_MOST_ENTRIES = 100


def describe_remote_policy(
    address: PolicyAddress,
    adapter: Adapter,
    declared: Mapping[str, Any],
    *,
    needs_images: bool | None = None,
    cameras: Sequence[object] | None = None,
    says_actions: bool = True,
) -> PolicyInfo:
    """Return the description of a policy on a server. The description is stored with the run.

    Args:
        address: Address of the policy.
        adapter: Adapter that converts observations and actions.
        declared: Metadata that the server sends, stored as text.
        needs_images: Whether the policy uses images, as declared by the server. With None, the policy needs images if
            the adapter has image inputs. If the adapter names cameras, they are rendered in any case.
        cameras: Cameras that the server declares, or None if the policy may use all cameras.
        says_actions: Whether the server declares the format of its actions. If it does not, and the address names
            neither a preset nor an adapter, the conventions of the default adapter are assumed. The assumption is
            stored in the metadata as "assumed" and reported before the run starts.
    """
    named = any(camera != EVERY_CAMERA for camera in adapter.cameras)
    metadata = {"adapter": json.dumps(adapter.to_json(), sort_keys=True)}
    if not says_actions and not address.names_adapter:
        answer = adapter.answer
        metadata["assumed"] = (
            f"policy server {address.scheme}://{address.target} does not declare its action conventions; "
            f"assuming those of preset {adapter.name} ({answer.space}, rotation {answer.rotation}, gripper "
            f"{answer.gripper}). Add ?preset=NAME or ?adapter=FILE to confirm them."
        )
    for name, value in sorted(declared.items(), key=lambda item: str(item[0]))[:_MOST_ENTRIES]:
        metadata[f"server: {one_line(str(name)[:100])}"] = plain_text(value)
    return PolicyInfo(
        str(address),
        action_space=adapter.answer.space,
        needs_images=bool(adapter.views) if needs_images is None else needs_images or named,
        metadata=metadata,
        execution=address.execution(adapter.horizon),
        cameras=None if cameras is None or named else tuple(map(plain_text, cameras[:_MOST_ENTRIES])),
    )


def plain_text(value: object) -> str:
    """Convert a value from the server's metadata to printable text of limited length."""
    try:
        text = value if isinstance(value, str) else json.dumps(value, default=str)
    except TypeError:  # a dict with keys that are not strings
        text = str(value)
    whole = printable(text, most=_LONGEST_TEXT)
    if whole == text:
        return text
    # The digest reveals changes in the omitted part of the text when the metadata is compared later.
    digest = hashlib.sha256(text.encode("utf-8", "surrogatepass")).hexdigest()
    return f"{printable(text[:_LONGEST_TEXT], most=_LONGEST_TEXT)}... (sha256 {digest})"


def check_start(adapter: Adapter, start: EpisodeStart, who: str) -> None:
    """Raise HandshakeError if an episode uses a different action space than the policy."""
    if start.action_space != adapter.answer.space:
        raise HandshakeError(
            f"action space: the run uses {start.action_space!r}, but {who} returns actions in "
            f"{adapter.answer.space!r}. {space_cure(adapter.answer.space)}."
        )


class AdaptedPolicy:
    """Policy that uses an adapter and can check its conventions against a run."""

    adapter: Adapter
    server: Declaration
    offered: Declaration | None = None
    """betterbench's conventions, written with the server's names for formats. None if both use the same names."""

    @property
    def _compared(self) -> Declaration:
        """Conventions of the policy that :meth:`check` compares with a run."""
        return self.server

    def check(self, *, space: str, observation: ObservationSpec, rate_hz: float) -> None:
        """Check that a run and the policy use the same conventions.

        Raises HandshakeError if they differ. The message quotes both values.
        """
        adapter, theirs = self.adapter, self._compared
        ours = replace(declare_adapter("the run", adapter, rate_hz=rate_hz), action_space=space)
        compare_declarations(ours, theirs)
        if space != adapter.answer.space:
            raise HandshakeError(
                f"action space: the run uses {space!r}, but {theirs.who} returns actions in {adapter.answer.space!r}. "
                f"{space_cure(adapter.answer.space)}."
            )
        rendered = {camera.name for camera in observation.cameras}
        missing = [c for c in adapter.cameras if c != EVERY_CAMERA and c not in rendered]
        if missing:
            raise HandshakeError(
                f"cameras: {theirs.who} needs {', '.join(missing)} (adapter {adapter.name}), but the run "
                f"renders {', '.join(sorted(rendered)) or 'none'}. Select an observation that has these "
                "cameras with --observation, or add camera.KEY=NAME to the address."
            )
        if adapter.depths and not observation.depth:
            raise HandshakeError(
                f"depth: adapter {adapter.name} needs depth images, which the observation {observation.name} lacks. "
                "In CALVIN, use --observation calvin_depth. In other benchmarks, remove depths from the adapter."
            )
        if adapter.control_rate_hz != rate_hz:
            raise HandshakeError(
                f"control rate: the run uses {rate_hz:g} Hz, but adapter {adapter.name} requires "
                f"{adapter.control_rate_hz:g} Hz. Correct control_rate_hz in the adapter."
            )


class ServerClient(AdaptedPolicy, Generic[Connection]):
    """Client for a policy on a server. Each environment needs its own client.

    :func:`betterbench.policies.kinds.make_policy` lists the errors that creating a client can raise. ``act`` raises
    PolicyError if no usable reply arrives, and PolicyUnavailableError if the server cannot be reached.
    """

    info: PolicyInfo
    _within = False
    """Whether the run itself serves the policy. Error messages then do not mention a server."""
    feeds_back = False
    """Whether the client can include the last executed action in the state that it sends (see ``Feedback`` in
    :mod:`betterbench.policies.conventions.adapter`).
    """

    def __init__(self, address: PolicyAddress, adapter: Adapter, *, seed: int) -> None:
        """Store the settings. The constructor of the subclass must open the connection.

        ``seed`` determines the random part of the pauses between connection attempts.
        """
        if adapter.feedback is not None and not self.feeds_back:
            raise address.error(
                f"adapter {adapter.name} sends the policy's last answer back, which only http:// supports",
                "Remove feedback from the adapter",
            )
        self._address, self._where = address, address.server_name
        self._key = api_key(address, "api_token_env" if "api_token_env" in address.options else "api_key_env")
        self.adapter, self.server = adapter, Declaration(self._where)
        self._connection = PolicyConnection(self._where, self._dial, ConnectionLimits.of(address, seed=seed))
        self._declared: dict[str, str] | None = None  # set at the first handshake

    def _dial(self, timeout_s: float) -> Connection:
        """Connect and compare conventions within the given time [s].

        Called for the first connection and for each reconnection.
        """
        raise NotImplementedError

    def _require_same(self, declared: Mapping[Any, Any]) -> None:
        """Check that the server declares the same values as at the first connection.

        A changed value may mean that the server has loaded another checkpoint, and a run must not mix two checkpoints.
        Raises HandshakeError with the old and the new value.
        """
        told = {str(name): plain_text(value) for name, value in declared.items()}
        if self._declared is None:
            self._declared = told
        before = self._declared
        for name in sorted(before.keys() | told.keys()):
            if before.get(name) != told.get(name):
                was, now = (one_line(side.get(name, "nothing"), most=200) for side in (before, told))
                raise HandshakeError(
                    f"{self._where} has changed after a restart: {one_line(name, most=100)} was {was} and is "
                    f"now {now}. Start the server with the first policy and run the same command again, or "
                    "use --allow-changed-policy to continue with both policies in one run."
                )

    def _actions(self, reply: object, observation: Observation) -> np.ndarray:
        """Convert a reply to actions, (horizon, dim) float64.

        Raises PolicyError if the reply is malformed. The message names the server.
        """
        if self._within:
            return self.adapter.actions(reply, observation)
        with errors_of(self._where):
            return self.adapter.actions(reply, observation)

    @property
    def figures(self) -> dict[str, float]:
        """Numbers of requests, retries and reconnects in this episode, by name."""
        return self._connection.figures

    def reset(self, start: EpisodeStart) -> None:
        """Begin an episode. Raises HandshakeError if the episode uses a different action space."""
        check_start(self.adapter, start, self._where)
        self._connection.count_anew()

    def close(self) -> None:
        """Close the connection to the server."""
        self._connection.close()
