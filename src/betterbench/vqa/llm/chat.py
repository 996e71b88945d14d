"""Client for ``POST URL/chat/completions``, as served by vLLM, SGLang, llama.cpp, Ollama and OpenAI.

It uses only the standard library, with one connection per request, so that many threads can send requests at the same
time.
"""

from __future__ import annotations

import base64
import http.client
import json
import os
import ssl
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Protocol
from urllib.parse import urlsplit

from betterbench.errors import InvalidInputError, ModelError, one_line
from betterbench.json_form import parse_json

Message = Mapping[str, Any]
"""One message of a conversation, with role and content."""

MAX_REPLY_BYTES = 4 * 1024 * 1024
_PASSING = (408, 409, 425, 429, 500, 502, 503, 504)
_LONGEST_PAUSE_S = 30.0


class RefusedError(ModelError):
    """Rejection of a single request (HTTP 400 or 422), for example because of its image; others may succeed."""


class Chat(Protocol):
    """Model that answers messages with a text."""

    @property
    def name(self) -> str:
        """Model name."""

    def complete(self, messages: Sequence[Message], *, max_tokens: int = 256) -> str:
        """Return the answer.

        Raises:
            RefusedError: If this request was rejected.
            ModelError: If no answer can be obtained.
        """


class ChatEndpoint:
    """A model with OpenAI's chat protocol; safe to use from several threads."""

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
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        """Store the address without sending anything.

        Args:
            url: Base address, such as ``http://localhost:8000/v1``; ``/chat/completions`` is added.
            model: Model name at that address.
            key_variable: Environment variable with the API key, if set.
            timeout_s: Longest wait for the beginning of an answer and between its parts [s].
            deadline_s: Longest wait for a whole answer [s], for servers that send it in many small parts.
            tries: Number of times that a request is sent after transient failures.
            further: Further fields of each request, such as vLLM's ``mm_processor_kwargs``.
            sleep: Waits between tries [s]; replaced in tests.

        Raises:
            InvalidInputError: If the address is not an HTTP address.
        """
        try:
            parts = urlsplit(url)
            host, port = parts.hostname, parts.port
        except ValueError as error:
            raise InvalidInputError("URL", f"{one_line(url)!r}: {error}", "Give http://HOST:PORT/v1") from error
        if parts.scheme not in ("http", "https") or not host:
            raise InvalidInputError("URL", f"{one_line(url)!r} is not an HTTP address", "Give http://HOST:PORT/v1")
        self.name, self._host, self._port, self._tls = model, host, port, parts.scheme == "https"
        path = parts.path.rstrip("/").removesuffix("/chat/completions")
        self._path = f"{path}/chat/completions"
        self._where = f"{parts.scheme}://{host}{f':{port}' if port else ''}{self._path}"
        self._key_variable, self._timeout_s, self._tries, self._sleep = key_variable, timeout_s, tries, sleep
        self._deadline_s, self._further = deadline_s, dict(further or {})

    def complete(self, messages: Sequence[Message], *, max_tokens: int = 256) -> str:
        """Return the answer at temperature 0; see :class:`Chat`."""
        form = {"model": self.name, "messages": list(messages), "temperature": 0, "max_tokens": max_tokens}
        form |= self._further
        body = json.dumps(form).encode()
        problem = ""
        for attempt in range(self._tries):
            if attempt:
                self._sleep(min(_LONGEST_PAUSE_S, 2.0 ** (attempt - 1)))
            try:
                status, reply = self._post(body)
            except (OSError, http.client.HTTPException) as error:
                problem = one_line(error) or type(error).__name__
                continue
            if status == http.client.OK:
                return self._text(reply)
            problem = f"HTTP {status}: {_told(reply)}"
            if status not in _PASSING:
                raise self._refusal(status, problem)
        cure = "Check that the server is running, and run the same command again to resume"
        raise ModelError(f"{self._where}: no answer after {self._tries} tries ({problem}). {cure}.")

    def _post(self, body: bytes) -> tuple[int, bytes]:
        headers = {"Content-Type": "application/json", "Accept": "application/json", "Connection": "close"}
        key = os.environ.get(self._key_variable)
        if key:
            headers["Authorization"] = f"Bearer {key}"
        connection: http.client.HTTPConnection
        if self._tls:
            context = ssl.create_default_context()
            connection = http.client.HTTPSConnection(self._host, self._port, timeout=self._timeout_s, context=context)
        else:
            connection = http.client.HTTPConnection(self._host, self._port, timeout=self._timeout_s)
        try:
            connection.request("POST", self._path, body, headers)
            answer = connection.getresponse()
            reply = self._read(answer)
        finally:
            connection.close()
        if len(reply) > MAX_REPLY_BYTES:
            raise ModelError(f"{self._where}: the answer exceeds {MAX_REPLY_BYTES} bytes. Is it a chat endpoint?")
        return answer.status, reply

    def _read(self, answer: http.client.HTTPResponse) -> bytes:
        """Return the beginning of a reply; raise TimeoutError if it is not complete in time."""
        ends_at, reply = time.monotonic() + self._deadline_s, bytearray()
        while len(reply) <= MAX_REPLY_BYTES and (part := answer.read1(MAX_REPLY_BYTES)):
            reply += part
            if time.monotonic() > ends_at:
                raise TimeoutError(f"the answer was not complete after {self._deadline_s:g} s")
        if answer.length and len(reply) <= MAX_REPLY_BYTES:  # the connection was closed early
            raise http.client.IncompleteRead(bytes(reply), answer.length)
        return bytes(reply)

    def _text(self, reply: bytes) -> str:
        try:
            text = _text_of(parse_json(reply)["choices"][0]["message"]["content"])
        except (ValueError, LookupError, TypeError) as error:
            raise ModelError(
                f"{self._where}: the answer has no choices[0].message.content. Give the address of a chat endpoint."
            ) from error
        return text

    def _refusal(self, status: int, problem: str) -> ModelError:
        if status in (400, 413, 422):
            return RefusedError(f"{self._where}: {problem}")
        if status in (401, 403):
            return ModelError(
                f"{self._where}: {problem}. Put the API key into the environment variable {self._key_variable}."
            )
        return ModelError(f"{self._where}: {problem}. Check the address and the name of the model, {self.name!r}.")


class ScriptedChat:
    """Model that answers with a function of the messages, for tests and for models in the caller's process."""

    def __init__(self, answer: Callable[[Sequence[Message]], str], *, name: str = "scripted") -> None:
        self.name, self._answer = name, answer

    def complete(self, messages: Sequence[Message], *, max_tokens: int = 256) -> str:
        """Return the answer; see :class:`Chat`."""
        return self._answer(messages)[: 8 * max_tokens]


PICTURE = "<image>"
"""Mark of a picture's place in a prompt."""

_MEDIA_TYPES = ((b"\x89PNG", "image/png"), (b"GIF8", "image/gif"), (b"RIFF", "image/webp"))


def user_message(text: str, *images: bytes) -> Message:
    """Return a user message with images (PNG, JPEG, GIF or WebP).

    If the text contains :data:`PICTURE` once per image, the images stand at these places; otherwise all images come
    before the text.
    """
    shown = [{"type": "image_url", "image_url": {"url": _data_address(image)}} for image in images]
    parts = text.split(PICTURE)
    if not images or len(parts) != len(images) + 1:
        return {"role": "user", "content": [*shown, {"type": "text", "text": text}]}
    texts = [{"type": "text", "text": part} for part in parts]
    mixed = [item for pair in zip(texts, [*shown, None], strict=True) for item in pair]
    return {"role": "user", "content": [item for item in mixed if item is not None and item.get("text") != ""]}


def _text_of(content: Any) -> str:  # noqa: ANN401 - any JSON
    """Return the text of an answer, which some servers send in parts; raise TypeError if it is of another type."""
    if content is None or isinstance(content, str):
        return content or ""
    if isinstance(content, list) and all(isinstance(part, dict) for part in content):
        return "".join(str(part.get("text") or "") for part in content if part.get("type") == "text")
    raise TypeError


def _data_address(image: bytes) -> str:
    kind = next((kind for start, kind in _MEDIA_TYPES if image.startswith(start)), "image/jpeg")
    return f"data:{kind};base64,{base64.b64encode(image).decode()}"


def _told(reply: bytes) -> str:
    """Return a server's error message."""
    text = reply[:4000].decode("utf-8", "replace")
    try:
        said = parse_json(text)
        error = said.get("error", said) if isinstance(said, dict) else said
        text = str(error.get("message", error)) if isinstance(error, dict) else str(error)
    except ValueError:
        pass
    return one_line(text, most=300) or "no text"
