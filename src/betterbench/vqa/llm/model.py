"""Vision-language models that answer a prompt about images, and the addresses of such models."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Any, Protocol

from betterbench.errors import InvalidInputError, one_line
from betterbench.jobs.item_threads import NoResource, Stoppable
from betterbench.vqa.llm.cache import ReplyCache
from betterbench.vqa.llm.chat import Chat, ChatEndpoint, user_message
from betterbench.vqa.llm.reply import Reply

_EXAMPLE = "http://localhost:8000/v1#my-model"


class Model(Protocol):
    """Vision-language model."""

    @property
    def name(self) -> str:
        """Name of the model."""

    def answer(self, prompt: str, pictures: Sequence[bytes]) -> str | Reply:
        """Return the answer to a prompt about images (PNG, JPEG, GIF or WebP), with the token counts if they are known.

        A prompt may contain placeholders for the images, see :func:`~betterbench.vqa.llm.chat.user_message`.

        Raises:
            RefusedError: If this request was rejected.
            ModelError: If no answer can be obtained.
        """


@dataclass(frozen=True, slots=True)
class ChatModel:
    """Chat endpoint that is used as a :class:`Model`.

    Attributes:
        chat: The endpoint.
        max_tokens: Maximum number of tokens in an answer.
    """

    chat: Chat
    max_tokens: int = 256

    @property
    def name(self) -> str:
        """Name of the model."""
        return self.chat.name

    def answer(self, prompt: str, pictures: Sequence[bytes]) -> Reply:
        """Return the answer, see :class:`Model`."""
        return self.chat.complete([user_message(prompt, *pictures)], max_tokens=self.max_tokens)

    def opened(self) -> AbstractContextManager[Stoppable]:
        """Return a context manager that keeps the connections of the endpoint open between requests."""
        return opened(self.chat)


def opened(asked: object) -> AbstractContextManager[Stoppable]:
    """Return a context manager to use while requests are sent to a model.

    If the model has a method ``opened``, which opens its connections, return the result of this method. If not, return
    a context manager that does nothing.
    """
    found = getattr(asked, "opened", None)
    resource: AbstractContextManager[Stoppable] = NoResource() if found is None else found()
    return resource


def endpoint_at(
    address: str,
    *,
    option: str = "--model",
    key_variable: str = "OPENAI_API_KEY",
    otherwise: str = "",
    further: Mapping[str, Any] | None = None,
    cache: ReplyCache | None = None,
) -> ChatEndpoint:
    """Return the chat endpoint for an address of the form ``URL#MODEL``.

    Args:
        address: The address.
        option: Name of the option in error messages.
        key_variable: Name of the environment variable that may contain the API key.
        otherwise: Value that the option accepts instead of an address, for error messages.
        further: Additional fields for each request.
        cache: Stored replies to earlier requests.

    Raises:
        InvalidInputError: If the address names no model or is not an HTTP address.
    """
    url, _, model = address.partition("#")
    if not model or not url:
        problem = f"{one_line(address, most=80)!r} is not an address with a model"
        raise InvalidInputError(
            option, problem, f"Write {f'{otherwise}, or ' if otherwise else ''}URL#MODEL: {_EXAMPLE}"
        )
    return ChatEndpoint(url, model, key_variable=key_variable, further=further, cache=cache)
