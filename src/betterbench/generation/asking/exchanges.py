"""Storage of exchanges with a language model, so that they can be replayed without the model.

Each line of ``exchanges.jsonl`` contains the messages, the answer and the verdict of one exchange, and a hash that
reveals changed lines. A request is not sent again if its answer is in the file, so running the same command again
resumes an interrupted run. In another run, ``--replay`` uses the answers in this file instead of a model.
"""

from __future__ import annotations

import hashlib
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field, TypeAdapter

from betterbench.errors import InvalidInputError, ModelError, RecordError
from betterbench.generation.asking.prompt import MAX_TOKENS, PROMPT_ID
from betterbench.jobs.line_journal import LINK, LineJournal, complete_lines, link_after, linked_forms
from betterbench.json_form import dump_json, read_form, strict_form
from betterbench.vqa.llm import Chat, Message

FILE_NAME = "exchanges.jsonl"
"""Name of the file with exchanges in the output folder."""
_CURE = "Restore the file from a copy, or choose another folder"


@strict_form
@dataclass(frozen=True, slots=True)
class Exchange:
    """A request to a model, with the model's answer.

    Attributes:
        prompt: Identifier of the prompt's wording.
        model: Name of the model.
        purpose: Purpose of the request, such as "scenario 3, try 2".
        messages: Messages of the conversation.
        answer: Text of the answer.
        verdict: "accepted", or the problems that were sent back to the model.
        asked_at: Time at which the request was sent, in UTC.
        took_s: Time from the request to the answer [s].
    """

    prompt: str
    model: str
    purpose: str
    messages: list[dict[str, Any]]
    answer: str
    verdict: str
    asked_at: str
    took_s: Annotated[float, Field(ge=0.0)]

    @property
    def key(self) -> str:
        """SHA-256 digest of the messages of the conversation."""
        return key_of(self.messages)


_EXCHANGE = TypeAdapter(Exchange)


def key_of(messages: Sequence[Message]) -> str:
    """Return the SHA-256 digest of the messages of a conversation."""
    return hashlib.sha256(dump_json([dict(m) for m in messages])).hexdigest()


class ExchangeFile(LineJournal):
    """Append-only file of exchanges with a model. Each exchange is synced to disk before the next request."""

    def __init__(self, path: Path) -> None:
        self.known: dict[str, Exchange] = {}
        self._link = ""
        super().__init__(path, alone=True)

    def _take_in(self, lines: list[bytes]) -> None:
        for exchange, link in _parsed(self._path, lines):
            self.known[exchange.key], self._link = exchange, link

    def append(self, exchange: Exchange) -> None:
        """Append an exchange."""
        form = asdict(exchange)
        link = link_after(self._link, form)
        self._append_line({**form, LINK: link})
        self.known[exchange.key], self._link = exchange, link


def _parsed(path: Path, lines: list[bytes]) -> list[tuple[Exchange, str]]:
    found = []
    for number, (form, link) in enumerate(linked_forms(path, lines, cure=_CURE), start=1):
        where = f"{path}: line {number}"
        found.append((read_form(_EXCHANGE, form, where=where, cure=_CURE, raises=RecordError), link))
    return found


def read_exchanges(path: Path) -> dict[str, Exchange]:
    """Read the exchanges in a file, and return them by the digest of their messages.

    Raises:
        InvalidInputError: If the file does not exist or contains no exchange.
        RecordError: If a line is corrupt or was changed.
    """
    if not path.is_file():
        raise InvalidInputError("--replay", f"{path} is not a file", f"Pass the {FILE_NAME} of an earlier run")
    found = {exchange.key: exchange for exchange, _ in _parsed(path, complete_lines(path)[0])}
    if not found:
        raise InvalidInputError("--replay", f"{path} contains no exchange", f"Pass the {FILE_NAME} of an earlier run")
    return found


class KeptChat:
    """Chat that stores its exchanges with a model, or replays stored exchanges if there is no model.

    See :class:`~betterbench.vqa.llm.Chat`.

    Args:
        file: File of the exchanges. A request is not sent again if its answer is in this file.
        chat: Connection to the model. If it is None, only stored exchanges are used.
        kept: Exchanges from another run, by the digest of their messages. Each exchange that is used is copied into the
            file.
    """

    def __init__(
        self,
        file: ExchangeFile,
        chat: Chat | None,
        kept: Mapping[str, Exchange] | None = None,
        *,
        now: Callable[[], datetime] = lambda: datetime.now(UTC),
    ) -> None:
        self._file, self._chat, self._kept, self._now = file, chat, kept or {}, now
        self._open: Exchange | None = None

    @property
    def name(self) -> str:
        """Name of the model."""
        return self._chat.name if self._chat is not None else "replay"

    def ask(self, messages: Sequence[Message], purpose: str) -> str:
        """Return the model's answer to a request. Call :meth:`judge` afterward to store it.

        Raises:
            ModelError: If the model does not answer, or the stored exchanges contain no answer.
        """
        key = key_of(messages)
        self._open = self._file.known.get(key) or self._kept.get(key)
        if self._open is None:
            self._open = self._asked(messages, purpose)
        return self._open.answer

    def judge(self, verdict: str) -> None:
        """Store the last exchange with its verdict, unless the file already contains the exchange."""
        if self._open is not None and self._open.key not in self._file.known:
            self._file.append(replace(self._open, verdict=verdict))
        self._open = None

    def _asked(self, messages: Sequence[Message], purpose: str) -> Exchange:
        if self._chat is None:
            raise ModelError(
                f"The stored exchanges contain no answer to {purpose}. They were made by a different command, "
                f"with a different version of the prompt, or in an interrupted run. Run the original command again "
                f"with its model."
            )
        asked_at, began = self._now(), time.monotonic()
        answer = self._chat.complete(messages, max_tokens=MAX_TOKENS).text
        took_s = round(time.monotonic() - began, 3)
        stamp = asked_at.isoformat(timespec="seconds")
        plain = [dict(message) for message in messages]
        return Exchange(PROMPT_ID, self._chat.name, purpose, plain, encoded(answer), "", stamp, took_s)


def encoded(text: str) -> str:
    """Replace lone surrogates in a string, because they cannot be encoded."""
    return text.encode("utf-8", "replace").decode("utf-8")
