"""Requests to Dexbotic's inference server (``http://host:7891/v1/infer``), and parsing of its model description.

``POST /v1/infer`` takes JSON with the prompt, a state, and base64-encoded PNG images, which are numbered by camera
slot. The answer contains ``actions``. ``GET /v1/capabilities`` describes the camera slots, the state and the action
size of the model. ``POST /v1/reset`` begins an episode. Older releases have ``POST /process_frame`` instead, which
takes the same data as a multipart form and returns ``response``. A flag in the form marks the first request of an
episode. Source: dexmal/dexbotic, ``dexbotic/exp/base_exp.py``, ``dexbotic/client.py`` and
``docs/InferenceAPI.md``; dexmal/dexbotic-benchmark, ``evaluation/policies/base_vla_agent.py``.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any
from uuid import uuid4

import numpy as np

from betterbench.errors import HandshakeError, PolicyError, one_line
from betterbench.policies.conventions.adapter import Adapter
from betterbench.policies.protocols.wire import png_of

FORM_PATH = "/process_frame"
INFER_PATH = "/v1/infer"

OBSERVATION = "observation"
_ANSWER, _FORM_ANSWER = "actions", "response"


@dataclass(frozen=True, slots=True)
class Route:
    """Endpoints of a Dexbotic server, derived from the path to which requests are sent.

    Attributes:
        form: Whether requests are sent as multipart forms instead of JSON (older releases).
        capabilities: Path at which the server describes its model. Empty for older releases.
        reset: Path that begins a new episode. Empty for older releases.
    """

    form: bool
    capabilities: str
    reset: str

    @classmethod
    def of(cls, path: str) -> Route | None:
        """Return the endpoints of a Dexbotic server, given a request path.

        Return None if Dexbotic does not use this path. The path may begin with a prefix that a proxy has added.
        """
        bare = path.rstrip("/")
        if bare.endswith(FORM_PATH):
            return cls(True, "", "")
        if not bare.endswith(INFER_PATH):
            return None
        before = bare.removesuffix("infer")
        return cls(False, f"{before}capabilities", f"{before}reset")


def encode_form(request: Mapping[str, Any], *, first: bool) -> tuple[str, bytes]:
    """Encode a request as a form. Return the content type and the body.

    Args:
        request: Request in the layout :data:`presets.DEXBOTIC`. Its ``observation`` contains the prompt, the images by
            camera slot and, if the model uses one, a state. Other entries (``send.KEY=VALUE``) become fields of the
            form.
        first: Whether this is the first request of an episode, at which a model with an observation history clears it.

    Raises:
        PolicyError: If the request has a different layout.
    """
    seen = request.get(OBSERVATION)
    images = seen.get("images") if isinstance(seen, Mapping) else None
    if not isinstance(seen, Mapping) or not isinstance(images, Mapping) or not all(map(str.isdecimal, images)):
        raise PolicyError(f"{FORM_PATH} requires the layout of preset dexbotic. Use this preset or another path.")
    fields = {"text": str(seen.get("prompt", "")), "episode_first_frame": str(first)}
    if isinstance(seen.get("state"), np.ndarray):
        fields["states"] = json.dumps(seen["state"].tolist())
    fields |= {key: str(value) for key, value in request.items() if key != OBSERVATION}
    mark = f"betterbench-{uuid4().hex}"
    parts = [
        f'--{mark}\r\nContent-Disposition: form-data; name="{_quoted(name)}"\r\n\r\n{value}\r\n'.encode()
        for name, value in fields.items()
    ]
    for slot in sorted(images, key=int):
        head = f'--{mark}\r\nContent-Disposition: form-data; name="image"; filename="{slot}.png"\r\n'
        parts += [f"{head}Content-Type: image/png\r\n\r\n".encode(), png_of(images[slot]), b"\r\n"]
    return f"multipart/form-data; boundary={mark}", b"".join((*parts, f"--{mark}--\r\n".encode()))


def read_form_answer(reply: object) -> object:
    """Convert an answer of ``/process_frame`` to the layout of ``/v1/infer``."""
    return {_ANSWER: reply[_FORM_ANSWER]} if isinstance(reply, Mapping) and _FORM_ANSWER in reply else reply


def compare_capabilities(told: object, adapter: Adapter, where: str) -> dict[str, Any]:
    """Compare a server's description of its model with an adapter, and return the description.

    Raises HandshakeError if the model does not generate actions, if it requires an image or a state that the adapter
    does not send, or if the action sizes differ. The message quotes the values of both sides.
    """
    if not isinstance(told, Mapping):
        raise HandshakeError(
            f"{where}: expected a map as the description of the server's capabilities. Update the server."
        )
    found = []
    if told.get("vla") is False:
        found.append("the model generates text instead of actions")
    modalities = _map(told, "modalities")
    given = {key[-1] for rule in adapter.views if (key := rule.key)[:2] == (OBSERVATION, "images")}
    slots = _map(modalities, "images").get("slots")
    for slot in slots if isinstance(slots, list) else []:
        if isinstance(slot, Mapping) and slot.get("required") is True and str(slot.get("slot")) not in given:
            number, name = (one_line(slot.get(key), most=40) for key in ("slot", "name"))
            found.append(f"images: the model needs slot {number} ({name}), the adapter sends {_listed(given)}")
    if _map(modalities, "state").get("required") is True and not adapter.states:
        found.append("state: the model needs a state, the adapter sends none")
    size, columns = _map(told, "action_spec").get("action_dim"), sum(adapter.answer.columns.values())
    if isinstance(size, int) and not isinstance(size, bool) and size != columns:
        found.append(f"actions: the model returns {size} numbers, the adapter reads {columns}")
    if found:
        raise HandshakeError(
            f"{where} and adapter {adapter.name} declare different conventions: {'; '.join(found)}. "
            "Use another preset, or adapter=FILE."
        )
    return {str(key): value for key, value in told.items()}


def _map(form: Mapping[Any, Any], name: str) -> Mapping[Any, Any]:
    found = form.get(name)
    return found if isinstance(found, Mapping) else {}


def _listed(slots: set[str]) -> str:
    return f"slot {', '.join(sorted(slots))}" if slots else "no image"


def _quoted(name: str) -> str:
    return name.replace('"', "%22").replace("\r", "%0D").replace("\n", "%0A")
