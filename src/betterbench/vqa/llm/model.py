"""Vision-language models that answer a prompt about images, and their addresses."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

from betterbench.errors import InvalidInputError, one_line
from betterbench.vqa.llm.chat import Chat, ChatEndpoint, user_message

_EXAMPLE = "http://localhost:8000/v1#my-model"


class Model(Protocol):
    """A vision-language model."""

    @property
    def name(self) -> str:
        """Model name."""

    def answer(self, prompt: str, pictures: Sequence[bytes]) -> str:
        """Return the answer to a prompt about images (PNG, JPEG, GIF or WebP).

        A prompt may mark the places of its images, see :func:`~betterbench.vqa.llm.chat.user_message`.

        Raises:
            RefusedError: If this request was rejected.
            ModelError: If no answer can be obtained.
        """


@dataclass(frozen=True, slots=True)
class ChatModel:
    """A chat endpoint as a model.

    Attributes:
        max_tokens: Longest answer [tokens].
    """

    chat: Chat
    max_tokens: int = 256

    @property
    def name(self) -> str:
        """Model name."""
        return self.chat.name

    def answer(self, prompt: str, pictures: Sequence[bytes]) -> str:
        """Return the answer; see :class:`Model`."""
        return self.chat.complete([user_message(prompt, *pictures)], max_tokens=self.max_tokens)


def endpoint_at(
    address: str,
    *,
    option: str = "--model",
    key_variable: str = "OPENAI_API_KEY",
    otherwise: str = "",
    further: Mapping[str, Any] | None = None,
) -> ChatEndpoint:
    """Return the chat endpoint at an address with the name of its model, ``URL#MODEL``.

    Args:
        address: The address.
        option: Option for the error.
        key_variable: Environment variable with the API key.
        otherwise: Another value that the option accepts, for the error.
        further: Further fields of each request.

    Raises:
        InvalidInputError: If the address has no model or is not an HTTP address.
    """
    url, _, model = address.partition("#")
    if not model or not url:
        problem = f"{one_line(address, most=80)!r} is not an address with a model"
        raise InvalidInputError(
            option, problem, f"Write {f'{otherwise}, or ' if otherwise else ''}URL#MODEL: {_EXAMPLE}"
        )
    return ChatEndpoint(url, model, key_variable=key_variable, further=further)
