"""Client for Isaac GR00T's inference server: ``gr00t://host:port``.

The server uses ZeroMQ REQ/REP. Each request is a msgpack map with the name of an endpoint, the data for this endpoint
and, if required, a token. The server declares its modalities (images, states and actions). The client compares them
with the adapter each time it connects. Source: Isaac-GR00T, ``gr00t/policy/server_client.py`` (N1.6) and
``gr00t/eval/service.py`` (N1.5).

A policy without an observation history can process the observations of many environments in one request
(:class:`Gr00tBatchClient`). A policy that needs images or states from several time steps gets one client per
environment. Such a client must receive every observation, so it executes the chunks itself and returns one action at a
time.

For real-time chunking (``rtc_overlap_steps``), the client sends the unexecuted actions of the previous chunk as
``observation.action``, and the numbers of overlapping and frozen steps as options. NVIDIA/Isaac-GR00T#520 (N1.6:
``gr00t/policy/gr00t_policy.py``, ``README_RTC.md``) and the action head of N1.7 (``gr00t/model/gr00t_n1d7``) expect
this format. The policies in GR00T's main branch ignore these entries. The client logs a warning if it detects this.

N1.6 and N1.7 use the same requests, but encode the arrays and modalities in their replies differently.

Servers of the first N1.5 releases serialize messages with torch's pickle format. They are not supported, because
unpickling an untrusted answer can run arbitrary code.
"""

from __future__ import annotations

import logging
import threading
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np

from betterbench.errors import HandshakeError, PolicyError, one_line
from betterbench.interface import EpisodeStart, Execution, Observation, Policy, PolicyInfo
from betterbench.policies.address import PolicyAddress
from betterbench.policies.clients.connection import errors_of
from betterbench.policies.clients.endpoint_server import ERROR_REPLY, EndpointServer
from betterbench.policies.clients.previous_chunk import moved_up, rows_left
from betterbench.policies.clients.remote import ServerClient, check_start, describe_remote_policy
from betterbench.policies.conventions.adapter import Adapter, set_entry
from betterbench.policies.conventions.modality import SEEN, Modalities, name_of
from betterbench.policies.conventions.presets import GR00T_NEW_EMBODIMENT, adapter_of
from betterbench.policies.protocols.wire import decode_gr00t, encode_gr00t

logger = logging.getLogger(__name__)

RequestLayout = Literal["nested", "flat", "n1.5"]
"""Layout of an observation in a request.

"nested": one map per modality (N1.6 and N1.7). "flat": a single map with keys such as ``video.front`` (N1.6 and N1.7
with the simulation wrapper). "n1.5": the same flat map, sent directly as the request data, without options (N1.5).
"""

Seen = Mapping[str, Mapping[str, np.ndarray]]
"""Images and states of one environment at one time step, by modality and name. The first two axes of each array are
batch and time, both of length 1.
"""

RAMP_RATE = 6.0
"""Default value of ``Overlap.ramp_rate``, as in N1.6's action head."""

FROZEN_TOLERANCE = 0.05
"""Tolerance for comparing the frozen actions of the old and the new chunk, relative to the largest action."""

_PICKLES = (b"PK\x03\x04", b"\x80\x02")
_NO_PICKLES = (
    "The server is an old N1.5 release, which pickles its messages. This is not supported, because unpickling an "
    "untrusted answer can run arbitrary code. Update Isaac-GR00T, whose newer servers use msgpack."
)


class Gr00tServer(EndpointServer):
    """Connection to a GR00T server. Messages are encoded with msgpack.

    When the connection is opened, the server's modalities are compared with the adapter.
    """

    def __init__(self, address: PolicyAddress, adapter: Adapter, token: str | None, *, timeout_s: float) -> None:
        self._adapter = adapter
        super().__init__(address, token, timeout_s=timeout_s)

    def _greet(self, end: float) -> None:
        super()._greet(end)
        self.modalities = Modalities.read(self._first("get_modality_config", end), self._where)
        self.modalities.check(self._adapter, self._where)

    def _encode(self, question: Mapping[str, Any]) -> bytes:
        return encode_gr00t(question)

    def _check_frame(self, answer: bytes, endpoint: str) -> None:
        if answer.startswith(_PICKLES) or (answer == ERROR_REPLY and endpoint == "ping"):
            raise PolicyError(f"{self._where} answers {answer[:5]!r} to {endpoint}. {_NO_PICKLES}")

    def _decode(self, answer: bytes, endpoint: str) -> Any:  # noqa: ANN401, ARG002 - as decoded
        with errors_of(self._where):
            return decode_gr00t(answer)


class Gr00tClient(ServerClient[Gr00tServer]):
    """Client for a GR00T policy. Each environment needs its own client."""

    def __init__(self, address: PolicyAddress, *, seed: int = 0) -> None:
        super().__init__(address, adapter_of(address, GR00T_NEW_EMBODIMENT), seed=seed)
        for name in ("constants", "depths"):
            if getattr(self.adapter, name):
                raise address.error(
                    f"adapter {self.adapter.name} has {name}, which GR00T does not use",
                    f"Remove {name} from the adapter",
                )
        self._layout = address.choice("layout", get_args(RequestLayout), "nested")
        self._lock = threading.Lock()
        self.modalities = self._connection.open().modalities
        if self.modalities.prefixed and "layout" not in address.options:
            self._layout = "n1.5"
        declared = {"layout": self._layout, "modalities": self.modalities.to_json()}
        self.info = describe_remote_policy(
            address, self.adapter, declared, says_actions=self.modalities.action is not None
        )

    def _dial(self, timeout_s: float) -> Gr00tServer:
        server = Gr00tServer(self._address, self.adapter, self._key, timeout_s=timeout_s)
        try:
            self._require_same(server.modalities.to_json())
        except HandshakeError:
            server.close()
            raise
        return server

    def act(self, observation: Observation) -> np.ndarray:
        """Return the next action chunk as an array (horizon, dim) float64."""
        return self._ask([self._seen(observation)], [observation])[0]

    def _seen(self, observation: Observation) -> Seen:
        """Convert one observation to the images and states that the policy receives."""
        seen: dict[str, dict[str, np.ndarray]] = {kind: {} for kind in SEEN}
        for key, image in self.adapter.images(observation).items():
            seen["video"][name_of(key)] = image[None, None]
        for rule in self.adapter.states:
            value = self.adapter.state(rule, observation)
            seen["state"][name_of(rule.key)] = np.atleast_1d(np.asarray(value))[None, None]
        return seen

    def _ask(self, seen: Sequence[Seen], observations: Sequence[Observation]) -> list[np.ndarray]:
        """Request the action chunks of one or more environments."""
        return self._read(self._answer(seen, observations, {}, None), observations)

    def _answer(
        self,
        seen: Sequence[Seen],
        observations: Sequence[Observation],
        more: Mapping[str, Any],
        options: Mapping[str, Any] | None,
    ) -> dict[str, np.ndarray]:
        """Send a request and return the action arrays in the answer, each (environments, horizon, dim).

        The keys are the names of the actions without the prefix "action.". The entries in ``more`` are added to the
        observation, which requires the nested layout. ``options`` are sent next to the observation.
        """
        message: dict[str, Any] = {
            kind: {name: np.concatenate([one[kind][name] for one in seen]) for name in seen[0][kind]} for kind in SEEN
        }
        instructions = [self.adapter.instruction.write(observation.instruction) for observation in observations]
        data = self._data(message, instructions)
        if more:
            data = {"observation": {**data["observation"], **more}, "options": options}
        with self._lock:
            reply = self._connection.request(lambda server, timeout_s: server.call("get_action", data, timeout_s))
        return self._arrays(reply, len(observations))

    def _read(self, arrays: Mapping[str, np.ndarray], observations: Sequence[Observation]) -> list[np.ndarray]:
        """Return the action chunk of each environment from the arrays of an answer."""
        return [
            self._actions(self._as_adapter({name: array[i] for name, array in arrays.items()}), observation)
            for i, observation in enumerate(observations)
        ]

    def _data(self, message: dict[str, Any], instructions: list[str]) -> dict[str, Any]:
        """Return the data of a ``get_action`` request in the layout that the server expects."""
        language = self.modalities.language
        name = language[0] if language else name_of(self.adapter.instruction.key)
        if self._layout == "nested":
            observation = {**message, "language": {name: [[instruction] for instruction in instructions]}}
            return {"observation": observation, "options": None}
        flat: dict[str, Any] = {f"{kind}.{n}": array for kind in SEEN for n, array in message[kind].items()}
        if self._layout == "n1.5":
            # N1.5 takes the first element of each entry, so a plain string would be reduced to its first letter.
            return {**flat, name: [[instruction] for instruction in instructions]}
        return {"observation": {**flat, name: instructions}, "options": None}

    def _arrays(self, reply: object, count: int) -> dict[str, np.ndarray]:
        """Return the action arrays in a reply, each (count, horizon, dim), by name without the prefix "action."."""
        actions = reply[0] if isinstance(reply, list) and len(reply) == 2 else reply
        if not isinstance(actions, Mapping):
            raise PolicyError(f"{self._where}: expected actions in reply to get_action, got {type(reply).__name__}.")
        widths = {name_of(key): width for key, width in self.adapter.answer.columns.items()}
        arrays = {}
        for key, value in actions.items():
            name = str(key).removeprefix("action.")
            shown = one_line(name, most=40)
            if not isinstance(value, np.ndarray) or value.dtype.kind not in "fiu":
                raise PolicyError(f"{self._where}: the action {shown!r} is not an array of real numbers.")
            array = value
            if value.ndim == 2 and widths.get(name) == 1 and value.shape[1] != 1:
                array = value[:, :, None]  # N1.5 drops the last axis if it has length 1
            elif value.ndim == 2 and count == 1:
                array = value[None]
            if array.ndim != 3 or len(array) != count:
                raise PolicyError(
                    f"{self._where}: the action {shown!r} has shape {value.shape}. "
                    f"Send ({count}, horizon, size), one chunk for each environment in the request."
                )
            if name in arrays:
                raise PolicyError(f"{self._where}: the action {shown!r} occurs twice in the reply. Send it once.")
            arrays[name] = array
        return arrays

    def _as_adapter(self, arrays: Mapping[str, np.ndarray]) -> dict[str, Any]:
        """Rename the arrays to the keys that the adapter expects."""
        message: dict[str, Any] = {}
        for key in self.adapter.answer.columns:
            name = name_of(key)
            if name not in arrays:
                there = ", ".join(sorted(one_line(other, most=40) for other in arrays)[:20]) or "none"
                raise PolicyError(f"{self._where}: the reply has no action {name!r}. It has: {there}.")
            set_entry(message, key, arrays[name])
        return message


class Gr00tBatchClient(Gr00tClient):
    """Client for a GR00T policy without an observation history. One client serves many environments."""

    def reset(self, start: EpisodeStart) -> None:
        """Begin an episode in one of the environments. The client keeps no state between episodes."""
        check_start(self.adapter, start, self._where)

    def act_batch(self, observations: Sequence[Observation]) -> list[np.ndarray]:
        """Return the next action chunk of each environment. A single request contains all observations."""
        return self._ask([self._seen(observation) for observation in observations], observations)


class Gr00tHistoryClient(Gr00tClient):
    """Client for a GR00T policy that needs observations from several time steps.

    The client must receive the observation of every control step, and it executes the action chunks itself.
    """

    def __init__(self, address: PolicyAddress, *, seed: int = 0) -> None:
        super().__init__(address, seed=seed)
        if self.info.execution.ahead or self.info.execution.ensemble is not None:
            self.close()
            raise address.error(
                "the server needs observations of several time steps, so chunks cannot be requested ahead of time",
                "Omit the options ahead and ensemble",
            )
        self._horizon = self.info.execution.horizon
        self.info = PolicyInfo(
            self.info.name,
            action_space=self.info.action_space,
            needs_images=self.info.needs_images,
            metadata={**self.info.metadata, "played by the client": f"{self._horizon or 'all'} actions of each chunk"},
            execution=Execution(),
        )
        self._frames: dict[int, Seen] = {}
        self._chunk: list[np.ndarray] = []

    def reset(self, start: EpisodeStart) -> None:
        """Clear the observations and actions of the last episode. Reset the server too, if it has a reset endpoint."""
        super().reset(start)
        self._frames, self._chunk = {}, []
        with self._lock:
            self._connection.request(_forget)

    def act(self, observation: Observation) -> np.ndarray:
        """Return the next action as an array (1, dim) float64.

        The client requests a new chunk when all actions of the last chunk have been executed.
        """
        steps = self.modalities.steps
        self._frames[observation.step] = self._seen(observation)
        oldest = observation.step + min(wanted[0] for wanted in steps.values())
        # Keep one observation from before the oldest required step, because it is used if that step was not observed.
        for step in sorted(s for s in self._frames if s < oldest)[:-1]:
            del self._frames[step]
        if not self._chunk:
            seen = {
                kind: {
                    name: np.concatenate([self._frame(observation.step + s)[kind][name] for s in steps[kind]], axis=1)
                    for name in self._frames[observation.step][kind]
                }
                for kind in SEEN
            }
            self._chunk = list(self._ask([seen], [observation])[0][: self._horizon])
        return self._chunk.pop(0)[None]

    def _frame(self, step: int) -> Seen:
        """Return the latest observation at or before a step, or the first observation if the step precedes it."""
        before = [s for s in self._frames if s <= step]
        return self._frames[max(before) if before else min(self._frames)]


@dataclass(frozen=True, slots=True)
class Overlap:
    """Overlap of a new action chunk with the previous chunk, for real-time chunking.

    Attributes:
        steps: Number of control steps that both chunks cover.
        frozen: Number of steps at the beginning of the overlap for which the new chunk repeats the actions of the old
            chunk.
        ramp_rate: Rate at which the influence of the old chunk decays during the remaining steps of the overlap.
    """

    steps: int
    frozen: int
    ramp_rate: float

    @classmethod
    def of(cls, address: PolicyAddress, ahead: int) -> Overlap | None:
        """Read the overlap from an address. Return None if the address does not request real-time chunking.

        By default, the first ``ahead`` steps of the overlap are frozen. Raises InvalidInputError if the numbers of
        steps contradict each other.
        """
        given = [name for name in ("rtc_frozen_steps", "rtc_ramp_rate") if name in address.options]
        if "rtc_overlap_steps" not in address.options:
            if given:
                raise address.error(f"{given[0]} has no effect without rtc_overlap_steps", "Set both options")
            return None
        overlap = cls(
            address.whole("rtc_overlap_steps"),
            address.whole("rtc_frozen_steps", ahead),
            address.number("rtc_ramp_rate", RAMP_RATE),
        )
        if not overlap.steps >= 1 or overlap.frozen > overlap.steps:
            raise address.error(
                f"{overlap.frozen} frozen steps do not fit into an overlap of {overlap.steps} steps",
                "Set rtc_overlap_steps to at least 1 and at least rtc_frozen_steps (which is ahead by default)",
            )
        return overlap


class Gr00tOverlapClient(Gr00tClient):
    """Client for a GR00T policy with real-time chunking. Each environment needs its own client."""

    def __init__(self, address: PolicyAddress, overlap: Overlap, *, seed: int = 0) -> None:
        super().__init__(address, seed=seed)
        wrong = ("it cannot be combined with the option ensemble") if self.info.execution.ensemble is not None else ""
        wrong = (
            (f"requests with layout={self._layout} have no entry for the previous chunk")
            if self._layout != "nested"
            else wrong
        )
        wrong = "the server needs observations of several time steps" if self.modalities.remembers else wrong
        if wrong:
            self.close()
            raise address.error(f"rtc_overlap_steps cannot be used: {wrong}", "Omit rtc_overlap_steps")
        self._overlap = overlap
        self._last: tuple[int, dict[str, np.ndarray]] | None = None  # step of the last request, and its answer
        self._told = False

    def reset(self, start: EpisodeStart) -> None:
        """Begin an episode. The first chunk of the episode does not continue a previous chunk."""
        super().reset(start)
        self._last = None

    def act(self, observation: Observation) -> np.ndarray:
        """Return the next action chunk as an array (horizon, dim) float64.

        The request contains the unexecuted actions of the last chunk.
        """
        more, options = self._continuation(observation.step)
        arrays = self._answer([self._seen(observation)], [observation], more, options)
        if more and not self._told:
            self._compare(more["action"], arrays)
        self._last = (observation.step, arrays)
        return self._read(arrays, [observation])[0]

    def _continuation(self, step: int) -> tuple[dict[str, Any], dict[str, Any] | None]:
        """Return the additional observation entries and the options for a chunk that continues the last chunk.

        Return ({}, None) if too few unexecuted actions of the last chunk remain.
        """
        if self._last is None:
            return {}, None
        asked_at, arrays = self._last
        left = min((rows_left(asked_at, array, step=step) for array in arrays.values()), default=0)
        steps = min(self._overlap.steps, left)
        if not steps or steps < self._overlap.frozen:
            return {}, None
        action = {name: moved_up(asked_at, array, step=step).astype(np.float32) for name, array in arrays.items()}
        options = {
            "action_horizon": next(iter(action.values())).shape[1],
            "rtc_overlap_steps": steps,
            "rtc_frozen_steps": self._overlap.frozen,
            "rtc_ramp_rate": self._overlap.ramp_rate,
        }
        return {"action": action}, options

    def _compare(self, sent: Mapping[str, np.ndarray], answered: Mapping[str, np.ndarray]) -> None:
        """Log a warning, once, if the new chunk differs from the old chunk in the frozen steps.

        A difference shows that the server ignores the options for real-time chunking.
        """
        kept = slice(0, self._overlap.frozen)
        for name, old in sent.items():
            new = answered.get(name)
            if new is None or new.shape != old.shape or not self._overlap.frozen:
                continue
            # Models compute in bfloat16, which has 8 bits of precision relative to the range of the data.
            if np.abs(new[:, kept] - old[:, kept]).max() > FROZEN_TOLERANCE * max(float(np.abs(old).max()), 1e-6):
                self._told = True
                logger.warning(
                    "%s does not keep the %d actions of rtc_frozen_steps, so it does not continue chunks. The "
                    "policies of NVIDIA's main branch ignore rtc_overlap_steps (see NVIDIA/Isaac-GR00T#520).",
                    self._where,
                    self._overlap.frozen,
                )
                return


def connect_gr00t(address: PolicyAddress, *, seed: int = 0) -> Policy:
    """Connect to a GR00T server. The client supports batches if the policy does not use an observation history."""
    overlap = Overlap.of(address, address.whole("ahead", 0))
    if overlap is not None:
        return Gr00tOverlapClient(address, overlap, seed=seed)
    client = Gr00tBatchClient(address, seed=seed)
    if not client.modalities.remembers:
        return client
    client.close()
    return Gr00tHistoryClient(address, seed=seed)


def _forget(server: Gr00tServer, timeout_s: float) -> None:
    """Call the server's reset endpoint. The error of N1.5 servers, which lack this endpoint, is ignored."""
    try:
        server.call("reset", {"options": None}, timeout_s)
    except PolicyError as error:
        if "nknown endpoint" not in str(error):
            raise
