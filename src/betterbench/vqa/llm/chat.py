"""Client for ``POST URL/chat/completions``, an interface that vLLM, SGLang, llama.cpp, Ollama and OpenAI offer.

The client only uses the standard library. Many threads can send requests at the same time, each on its own connection.
"""

from __future__ import annotations

import base64
import http.client
import json
import os
import re
import ssl
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from datetime import UTC, datetime
from email.utils import parsedate_to_datetime
from functools import cached_property
from typing import Any, Protocol
from urllib.parse import urlsplit

from betterbench.errors import InvalidInputError, ModelError, one_line
from betterbench.json_form import parse_json
from betterbench.vqa.llm.cache import ReplyCache
from betterbench.vqa.llm.connections import Connections
from betterbench.vqa.llm.reply import Reply

Message = Mapping[str, Any]
"""One message of a conversation, with a role and a content."""

MAX_REPLY_BYTES = 4 * 1024 * 1024
_PASSING = (408, 409, 425, 429, 500, 502, 503, 504)
_BUSY = 429
_BUSY_TRIES = 10
"""Minimum number of tries before giving up on a server that limits the request rate."""
_LONGEST_PAUSE_S = 30.0
LONGEST_WISH_S = 300.0
"""Maximum pause that a server may request with ``Retry-After`` [s]."""
_SECONDS = re.compile(r"\d{1,9}(?:\.\d{1,9})?")


class RefusedError(ModelError):
    """A single request was rejected (HTTP 400, 413 or 422), for example because of its image.

    Other requests may still succeed.

    Attributes:
        retries: Reasons why earlier attempts to send the request failed, see :class:`~betterbench.vqa.llm.reply.Reply`.
    """

    retries: tuple[str, ...] = ()


class Chat(Protocol):
    """Model that replies to chat messages with text."""

    @property
    def name(self) -> str:
        """Name of the model."""

    def complete(self, messages: Sequence[Message], *, max_tokens: int = 256) -> Reply:
        """Return the reply to a conversation.

        Raises:
            RefusedError: If this request was rejected.
            ModelError: If no answer can be obtained.
        """


class ChatEndpoint:
    """Client for a model that is served with OpenAI's chat protocol. Several threads can use it at the same time."""

    def __init__(
        self,
        url: str,
        model: str,
        *,
        key_variable: str = "OPENAI_API_KEY",
        timeout_s: float = 120.0,
        deadline_s: float = 600.0,
        tries: int = 4,
        further: Mapping[str, Any] | None = None,
        cache: ReplyCache | None = None,
        sleep: Callable[[float], None] | None = None,
    ) -> None:
        """Store the settings. No request is sent yet.

        Args:
            url: Base address, such as ``http://localhost:8000/v1``. ``/chat/completions`` is added to it.
            model: Name of the model at that address.
            key_variable: Name of the environment variable that may contain the API key.
            timeout_s: Maximum time to wait for the first part of an answer, and for each further part [s].
            deadline_s: Maximum time to wait for a whole answer [s]. It matters for servers that send an answer in many
                small parts.
            tries: Maximum number of times that a request is sent if transient failures occur. If the server limits the
                request rate (HTTP 429), the request is sent at least ten times.
            further: Additional fields for each request, such as vLLM's ``mm_processor_kwargs``.
            cache: Stored replies to earlier requests. A request with a stored reply is not sent.
            sleep: Function that waits between tries [s]. Tests replace it.

        Raises:
            InvalidInputError: If the address is not an HTTP address.
        """
        try:
            parts = urlsplit(url)
            host, port = parts.hostname, parts.port
        except ValueError as error:
            raise InvalidInputError("URL", f"{one_line(url)!r}: {error}", "Write it as http://HOST:PORT/v1") from error
        if parts.scheme not in ("http", "https") or not host:
            raise InvalidInputError(
                "URL", f"{one_line(url)!r} is not an HTTP address", "Write it as http://HOST:PORT/v1"
            )
        self.name, self._host, self._port, self._is_secure = model, host, port, parts.scheme == "https"
        path = parts.path.rstrip("/").removesuffix("/chat/completions")
        self._path = f"{path}/chat/completions"
        self._where = f"{parts.scheme}://{host}{f':{port}' if port else ''}{self._path}"
        self._key_variable, self._timeout_s, self._tries = key_variable, timeout_s, tries
        self._deadline_s, self._further, self._cache = deadline_s, dict(further or {}), cache
        self._connections = Connections(self._connect)
        self._sleep = sleep or self._connections.pause

    def opened(self) -> AbstractContextManager[Connections]:
        """Return a context manager that keeps connections open between requests and can stop requests."""
        return self._connections.kept()

    def complete(self, messages: Sequence[Message], *, max_tokens: int = 256) -> Reply:
        """Return the reply at temperature 0, see :class:`Chat`."""
        form = {"model": self.name, "messages": list(messages), "temperature": 0, "max_tokens": max_tokens}
        form |= self._further
        body = json.dumps(form).encode()
        if self._cache is None:
            return self._asked(body)
        key = self._cache.key(self._where, body)
        known = self._cache.get(key)
        if known is not None:
            return known
        reply = self._asked(body)
        self._cache.put(key, reply)
        return reply

    def _asked(self, body: bytes) -> Reply:
        """Send a request and return the reply. After transient failures, the request is sent again."""
        failed: list[str] = []
        while True:
            wish = None
            try:
                answer, content = self._post(body)
            except (OSError, http.client.HTTPException) as error:
                failed.append(_failure(error))
                most = self._tries
            else:
                if answer.status == http.client.OK:
                    return self._reply(content, tuple(failed))
                problem = f"HTTP {answer.status}: {_told(content)}"
                if answer.status not in _PASSING:
                    raise self._refusal(answer.status, problem, tuple(failed))
                failed.append(problem)
                most = max(self._tries, _BUSY_TRIES) if answer.status == _BUSY and self._tries > 1 else self._tries
                wish = _wished_pause(answer.headers.get("Retry-After"), datetime.now(UTC))
            if self._connections.is_stopped:
                raise ModelError(f"{self._where}: the request was stopped. Run the same command again to resume.")
            if len(failed) >= most:
                raise self._gave_up(failed, wish)
            self._sleep(min(LONGEST_WISH_S, max(wish or 0.0, min(_LONGEST_PAUSE_S, 2.0 ** (len(failed) - 1)))))

    def _gave_up(self, failed: Sequence[str], wish: float | None) -> ModelError:
        waits = f"; the server asks to wait {wish:.0f} s" if wish is not None and wish > LONGEST_WISH_S else ""
        cure = "Check that the server is running, and run the same command again to resume"
        return ModelError(f"{self._where}: no answer after {len(failed)} tries ({failed[-1]}{waits}). {cure}.")

    @cached_property
    def _tls(self) -> ssl.SSLContext | None:
        return ssl.create_default_context() if self._is_secure else None

    def _connect(self) -> http.client.HTTPConnection:
        if self._tls is None:
            return http.client.HTTPConnection(self._host, self._port, timeout=self._timeout_s)
        return http.client.HTTPSConnection(self._host, self._port, timeout=self._timeout_s, context=self._tls)

    def _post(self, body: bytes) -> tuple[http.client.HTTPResponse, bytes]:
        headers = {"Content-Type": "application/json", "Accept": "application/json"}
        key = os.environ.get(self._key_variable)
        if key:
            headers["Authorization"] = f"Bearer {key}"
        answer, reply = self._connections.post(self._path, body, headers, self._read)
        if len(reply) > MAX_REPLY_BYTES:
            raise ModelError(
                f"{self._where}: the answer exceeds {MAX_REPLY_BYTES} bytes. Check that the address is a chat endpoint."
            )
        return answer, reply

    def _read(self, answer: http.client.HTTPResponse) -> bytes:
        """Read the content of a reply, up to the maximum allowed size.

        Raises:
            TimeoutError: If the reply is not complete in time.
        """
        ends_at, reply = time.monotonic() + self._deadline_s, bytearray()
        while len(reply) <= MAX_REPLY_BYTES and (part := answer.read1(MAX_REPLY_BYTES)):
            reply += part
            if time.monotonic() > ends_at:
                raise TimeoutError(f"the answer was not complete after {self._deadline_s:g} s")
        if answer.length and len(reply) <= MAX_REPLY_BYTES:  # the server closed the connection too early
            raise http.client.IncompleteRead(bytes(reply), answer.length)
        return bytes(reply)

    def _reply(self, content: bytes, failed: tuple[str, ...]) -> Reply:
        try:
            form = parse_json(content)
            text = _text_of(_content_of(form))
        except (ValueError, LookupError, TypeError, AttributeError) as error:
            raise ModelError(
                f"{self._where}: the answer has no choices[0].message.content, but begins with {_told(content)!r}. "
                f"Use the address of a chat endpoint. If it is one, run the same command again to resume."
            ) from error
        usage = form.get("usage")
        counts = usage if isinstance(usage, dict) else {}
        return Reply(
            text,
            _count(counts.get("prompt_tokens")),
            _count(counts.get("completion_tokens")),
            failed,
            is_cut=form["choices"] != [] and form["choices"][0].get("finish_reason") == "length",
        )

    def _refusal(self, status: int, problem: str, failed: tuple[str, ...]) -> ModelError:
        if status in (400, 413, 422):
            refused = RefusedError(f"{self._where}: {problem}")
            refused.retries = failed
            return refused
        if status in (401, 403):
            return ModelError(
                f"{self._where}: {problem}. Put the API key into the environment variable {self._key_variable}."
            )
        return ModelError(f"{self._where}: {problem}. Check the address and the name of the model, {self.name!r}.")


class ScriptedChat:
    """Chat model whose replies are computed by a function.

    It is meant for tests and for models in the caller's own process.
    """

    def __init__(self, answer: Callable[[Sequence[Message]], str], *, name: str = "scripted") -> None:
        self.name, self._answer = name, answer

    def complete(self, messages: Sequence[Message], *, max_tokens: int = 256) -> Reply:
        """Return the reply that the function gives, see :class:`Chat`."""
        return Reply(self._answer(messages)[: 8 * max_tokens])


PICTURE = "<image>"
"""Placeholder for an image in a prompt."""

_MEDIA_TYPES = (
    (re.compile(rb"\x89PNG\r\n\x1a\n"), "image/png"),
    (re.compile(rb"\xff\xd8\xff"), "image/jpeg"),
    (re.compile(rb"GIF8[79]a"), "image/gif"),
    (re.compile(rb"RIFF....WEBP", re.DOTALL), "image/webp"),
)
"""File signatures of the image formats that endpoints accept according to their documentation, with media types."""


def user_message(text: str, *images: bytes) -> Message:
    """Return a user message with images (PNG, JPEG, GIF or WebP).

    If the text contains :data:`PICTURE` once for each image, the images are inserted at these places. Otherwise, all
    images come before the text.

    Raises:
        InvalidInputError: If an image has a different format.
    """
    shown = [{"type": "image_url", "image_url": {"url": _data_address(image)}} for image in images]
    parts = text.split(PICTURE)
    if not images or len(parts) != len(images) + 1:
        return {"role": "user", "content": [*shown, {"type": "text", "text": text}]}
    texts = [{"type": "text", "text": part} for part in parts]
    mixed = [item for pair in zip(texts, [*shown, None], strict=True) for item in pair]
    return {"role": "user", "content": [item for item in mixed if item is not None and item.get("text") != ""]}


def _content_of(form: Any) -> Any:  # noqa: ANN401 - any JSON
    """Return the content of a reply, or None if the reply has no choice or no content.

    For example, the content may have been removed by a filter on the server.
    """
    if form.get("error"):
        raise LookupError("choices")
    choices = form["choices"]
    return choices[0]["message"].get("content") if choices != [] else None


def _text_of(content: Any) -> str:  # noqa: ANN401 - any JSON
    """Return the text of an answer. Some servers send this text in parts.

    Raises:
        TypeError: If the content is not text.
    """
    if content is None or isinstance(content, str):
        return content or ""
    if isinstance(content, list) and all(isinstance(part, dict) for part in content):
        return "".join(str(part.get("text") or "") for part in content if part.get("type") == "text")
    raise TypeError


def media_type(image: bytes) -> str | None:
    """Return the media type of a PNG, JPEG, GIF or WebP file from its first bytes, or None for other files."""
    return next((kind for start, kind in _MEDIA_TYPES if start.match(image)), None)


def _data_address(image: bytes) -> str:
    kind = media_type(image)
    if kind is None:
        problem = f"begins with {image[:8]!r}, which is not PNG, JPEG, GIF or WebP"
        raise InvalidInputError("image", problem, "Convert the image to PNG")
    return f"data:{kind};base64,{base64.b64encode(image).decode()}"


def _told(reply: bytes) -> str:
    """Extract the error message from the reply of a server."""
    text = reply[:4000].decode("utf-8", "replace")
    try:
        said = parse_json(text)
        error = said.get("error", said) if isinstance(said, dict) else said
        text = str(error.get("message", error)) if isinstance(error, dict) else str(error)
    except ValueError:
        pass
    return one_line(text, most=300) or "no text"


def _count(value: Any) -> int | None:  # noqa: ANN401 - any JSON
    """Return a token count, or None if the value is not a valid count."""
    return value if type(value) is int and 0 <= value < 1 << 40 else None


def _failure(error: OSError | http.client.HTTPException) -> str:
    """Describe a connection error by its kind and its details."""
    kinds = (
        (TimeoutError, "timeout"),
        (ConnectionRefusedError, "connection refused"),
        ((ConnectionResetError, BrokenPipeError, http.client.RemoteDisconnected), "connection reset"),
        (http.client.IncompleteRead, "connection closed early"),
        (OSError, "connection failed"),
    )
    kind = next((name for of, name in kinds if isinstance(error, of)), "not HTTP")
    return f"{kind}: {one_line(error, most=200) or type(error).__name__}"


def _wished_pause(value: str | None, now: datetime) -> float | None:
    """Convert a ``Retry-After`` header (seconds or an HTTP date) to a pause [s].

    Return None if the header is missing or malformed.
    """
    text = (value or "").strip()
    if _SECONDS.fullmatch(text):
        return float(text)
    try:
        at = parsedate_to_datetime(text)
        return max(0.0, ((at if at.tzinfo else at.replace(tzinfo=UTC)) - now).total_seconds())
    except (ValueError, OverflowError):
        return None
