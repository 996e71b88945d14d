"""Web page for a judge, with the videos and the instruction of a trial, and the outcomes with keys and definitions.

The page does not receive the condition, the policy or the entries of other people. The page consists of ``judge.html``,
``judge.js`` and ``judge.css``, and is served by :class:`~betterbench.browser.plain.PlainServer`.
"""

from __future__ import annotations

import functools
import json
import threading
from collections.abc import Callable
from dataclasses import asdict
from typing import Annotated, Any, Literal

from pydantic import BaseModel, Field, TypeAdapter

from betterbench.browser.plain import Answer, PlainServer, file_of_package
from betterbench.json_form import read_form
from betterbench.real.judging import JudgeDesk
from betterbench.real.outcomes import OUTCOMES


class _Sent(BaseModel, extra="forbid", strict=True):
    """Command that the page sends, together with the index of the video that is displayed on it."""

    name: Literal["enter", "undo", "next", "previous"]
    film: Annotated[int, Field(ge=0)]
    value: Annotated[str, Field(max_length=40)] = ""
    note: Annotated[str, Field(max_length=500)] = ""


_SENT = TypeAdapter(_Sent)


class JudgePage:
    """Web page of one judge.

    Attributes:
        server: Server of the page.
    """

    def __init__(self, desk: JudgeDesk, *, host: str, port: int) -> None:
        """Start listening for the browser. Raise InvalidInputError if the port is in use."""
        self._desk, self._lock = desk, threading.Lock()
        get: dict[str, Callable[[], Answer | None]] = {
            "": functools.partial(file_of_package, __package__, "judge.html", "text/html"),
            "judge.js": functools.partial(file_of_package, __package__, "judge.js", "text/javascript"),
            "judge.css": functools.partial(file_of_package, __package__, "judge.css", "text/css"),
            "state": self._state,
        }
        for number, trial in enumerate(desk.trials):
            for place, camera in enumerate(sorted(trial.header.films)):
                get[f"film/{number}/{place}"] = functools.partial(self._film, number, camera)
        self.server = PlainServer(get, self._obey, host=host, port=port, verb="better real judge")

    def state(self) -> dict[str, Any]:
        """Return the content of the page as a JSON-serializable dict."""
        desk = self._desk
        return {
            "film": desk.index,
            "films": len(desk.trials),
            "cameras": len(desk.at_hand.header.films),
            "judged": desk.done,
            "person": desk.person,
            "instruction": desk.at_hand.header.instruction,
            "chosen": desk.chosen,
            "message": desk.message,
            "is_problem": desk.is_problem,
            "outcomes": [{k: v for k, v in asdict(outcome).items() if k != "scored"} for outcome in OUTCOMES],
        }

    def _state(self) -> Answer:
        with self._lock:
            return "application/json", json.dumps(self.state()).encode()

    def _film(self, number: int, camera: str) -> Answer:
        return "video/mp4", self._desk.film(number, camera)

    def _obey(self, form: dict[str, Any]) -> object:
        """Execute a command and return the new content of the page.

        A command about a video that is no longer displayed is ignored.
        """
        sent = read_form(_SENT, form, where="page", cure="Reload the page")
        with self._lock:
            if sent.film == self._desk.index:
                if sent.name == "enter":
                    self._desk.choose(sent.value, sent.note)
                elif sent.name == "undo":
                    self._desk.undo()
                else:
                    self._desk.step(1 if sent.name == "next" else -1)
            return self.state()
