"""Web page for the operator, with the live camera image, the twin as an overlay, the setup steps, and all controls.

The page does not show the policy or the condition. The page consists of ``page.html``, ``page.js`` and ``page.css``,
and is served by :class:`~betterbench.browser.plain.PlainServer`.
"""

from __future__ import annotations

import functools
import io
import json
from collections.abc import Callable
from dataclasses import asdict
from typing import Annotated, Any, Literal

import numpy as np
from PIL import Image
from pydantic import BaseModel, Field, TypeAdapter

from betterbench.browser.plain import Answer, PlainServer, file_of_package
from betterbench.json_form import read_form
from betterbench.real.outcomes import OUTCOMES
from betterbench.real.session import Command, RealSession
from betterbench.sim.scenes.image_files import jpeg_bytes

_LIVE_QUALITY = 85
_OUTLINE = np.array([255, 64, 160], dtype=np.uint8)
"""Color of the outlines in the overlay. No object or tablecloth has this color."""


class _Sent(BaseModel, extra="forbid", strict=True):
    """Command that the page sends."""

    name: Literal["arm", "disarm", "start", "force", "end", "enter", "undo", "again", "release", "stop"]
    value: Annotated[str, Field(max_length=40)] = ""
    note: Annotated[str, Field(max_length=500)] = ""


_SENT = TypeAdapter(_Sent)


class OperatorPage:
    """Web page through which an operator runs a session."""

    def __init__(self, session: RealSession, *, host: str, port: int) -> None:
        """Start listening for the browser. Raise InvalidInputError if the port is in use."""
        self._session = session
        get: dict[str, Callable[[], Answer | None]] = {
            "": functools.partial(file_of_package, __package__, "page.html", "text/html"),
            "page.js": functools.partial(file_of_package, __package__, "page.js", "text/javascript"),
            "page.css": functools.partial(file_of_package, __package__, "page.css", "text/css"),
            "state": self._state,
            "ghost.png": self._ghost,
            "twin.jpg": self._twin,
        }
        for camera in session.cameras:
            get[f"{camera}.jpg"] = functools.partial(self._live, camera)
        self.server = PlainServer(get, self._obey, host=host, port=port, verb="better real run")

    def _state(self) -> Answer:
        view = self._session.view
        form = asdict(view)
        form["agreement"] = None
        if view.agreement is not None:
            found = view.agreement
            form["agreement"] = {
                "score": round(found.score, 2),
                "accepted": found.accepted,
                "sentences": found.sentences,
                "left_out": found.left_out,
            }
        form["cameras"] = self._session.cameras
        form["outcomes"] = [asdict(outcome) for outcome in OUTCOMES]
        return "application/json", json.dumps(form).encode()

    def _live(self, camera: str) -> Answer | None:
        reading = self._session.reading
        frame = None if reading is None else reading.frames.get(camera)
        return None if frame is None else ("image/jpeg", jpeg_bytes(frame.image, quality=_LIVE_QUALITY))

    def _twin(self) -> Answer | None:
        view = self._session.twin_view
        return None if view is None else ("image/jpeg", jpeg_bytes(view.image, quality=_LIVE_QUALITY))

    def _ghost(self) -> Answer | None:
        """Return the objects of the twin with their outlines, on a transparent background."""
        view = self._session.twin_view
        return None if view is None else ("image/png", ghost_png(view.image, list(view.masks.values())))

    def _obey(self, form: dict[str, Any]) -> object:
        sent = read_form(_SENT, form, where="page", cure="Reload the page")
        if sent.name == "stop":
            self._session.halt()
        else:
            self._session.put(Command(sent.name, sent.value, sent.note))
        return {}


def ghost_png(image: np.ndarray, masks: list[np.ndarray]) -> bytes:
    """Return the masked parts of an image and their outlines as a PNG that is transparent everywhere else."""
    inside = np.zeros(image.shape[:2], dtype=bool)
    edge = np.zeros_like(inside)
    for mask in masks:
        inside |= mask
        padded = np.pad(mask, 1)
        core = padded[1:-1, :-2] & padded[1:-1, 2:] & padded[:-2, 1:-1] & padded[2:, 1:-1]
        edge |= mask & ~core
    layers = np.dstack([image, np.where(inside, 110, 0).astype(np.uint8)])
    layers[edge] = [*_OUTLINE, 255]
    buffer = io.BytesIO()
    Image.fromarray(layers).save(buffer, "PNG")
    return buffer.getvalue()
