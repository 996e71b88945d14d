"""Base classes for policies that use an adapter, and for policies that run on a server."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, Generic

from betterbench.errors import HandshakeError, one_line, printable
from betterbench.interface import EpisodeStart, ObservationSpec, PolicyInfo
from betterbench.policies.address import PolicyAddress
from betterbench.policies.clients.connection import Connection, ConnectionLimits, PolicyConnection, api_key
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
    """Return the description of a policy on a server, which is stored with the run.

    ``needs_images`` is False if the server declares that the policy does not use images. If it is None, the policy
    needs images if the adapter has any. The cameras that the adapter names are always rendered and sent. ``cameras``
    are the cameras that the server declares, or None if the policy may use every camera. ``says_actions`` is False if
    the server does not declare the format of its actions. If the address then names neither a preset nor an adapter,
    the client has to assume conventions. They are stored in the metadata as "assumed" and are reported before the run
    starts.
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
    """Convert a value that the server has declared to a text of limited length."""
    try:
        text = value if isinstance(value, str) else json.dumps(value, default=str)
    except TypeError:  # a dict with keys that are not strings
        text = str(value)
    whole = printable(text, most=_LONGEST_TEXT)
    if whole == text:
        return text
    # The digest shows changes in the omitted or unprintable part of the text when a run is resumed.
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
    """Policy with a fixed adapter. The conventions of the policy are compared with those of the run."""

    adapter: Adapter
    server: Declaration
    offered: Declaration | None = None
    """Declaration of betterbench in the terms that the server uses, or None if the server uses betterbench's terms."""

    @property
    def _compared(self) -> Declaration:
        """Conventions of the policy, in the form in which they are compared with those of a run."""
        return self.server

    def check(self, *, space: str, observation: ObservationSpec, rate_hz: float) -> None:
        """Compare the conventions of a run with those of the policy.

        Raises HandshakeError if they differ. The message quotes both values.
        """
        adapter, theirs = self.adapter, self._compared
        ours = replace(declare_adapter("the run", adapter, rate_hz=rate_hz), action_space=space)
        compare_declarations(ours, theirs)
        if space != adapter.answer.space:
            raise HandshakeError(
                f"action space: the run says {space!r}, but {theirs.who} returns actions in {adapter.answer.space!r}. "
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
                f"control rate: the run says {rate_hz:g} Hz, but adapter {adapter.name} says "
                f"{adapter.control_rate_hz:g} Hz. Correct control_rate_hz in the adapter."
            )


class ServerClient(AdaptedPolicy, Generic[Connection]):
    """Client for a policy on a server. Each environment needs its own client.

    :func:`betterbench.policies.kinds.make_policy` lists the errors that creating a client can raise. ``act`` raises
    PolicyError if no usable reply arrives, and PolicyUnavailableError if the server cannot be reached.
    """

    info: PolicyInfo
    feeds_back = False
    """Whether the client can send the policy's last answer back to the policy (see ``Feedback`` in
    :mod:`betterbench.policies.conventions.adapter`).
    """

    def __init__(self, address: PolicyAddress, adapter: Adapter, *, seed: int) -> None:
        """Store the settings. The subclass opens the connection as soon as it can compare conventions.

        ``seed`` determines the random part of the pauses between attempts to connect.
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

        This is also called after the server has restarted.
        """
        raise NotImplementedError

    def _require_same(self, declared: Mapping[Any, Any]) -> None:
        """Check that the server declares the same conventions as at the first connection.

        If a value has changed, raise HandshakeError with the old and the new value, because the run would otherwise mix
        two checkpoints.
        """
        told = {str(name): plain_text(value) for name, value in declared.items()}
        before, self._declared = self._declared or told, self._declared or told
        for name in sorted(before.keys() | told.keys()):
            if before.get(name) != told.get(name):
                was, now = (one_line(side.get(name, "nothing"), most=200) for side in (before, told))
                raise HandshakeError(
                    f"{self._where} has changed after a restart: {one_line(name, most=100)} was {was} and is "
                    f"now {now}. Start the server with the first policy and run the same command again, or "
                    "use --allow-changed-policy to continue with both policies in one run."
                )

    @property
    def figures(self) -> dict[str, float]:
        """Measurements in the episode so far, by name: numbers of requests, retries and reconnects."""
        return self._connection.figures

    def reset(self, start: EpisodeStart) -> None:
        """Begin an episode. Raises HandshakeError if the episode uses a different action space."""
        check_start(self.adapter, start, self._where)
        self._connection.count_anew()

    def close(self) -> None:
        """Close the connection to the server."""
        self._connection.close()
