"""Reply of a model with its token counts and retries."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Reply:
    """Reply of a model.

    Attributes:
        text: The text.
        prompt_tokens: Tokens of the prompt and its images as the server counted them; None if it did not.
        completion_tokens: Tokens of the text as the server counted them; None if it did not.
        retries: Reason of each try that failed before this reply, as "KIND: DETAILS" ("HTTP 429: too many requests").
        is_cached: Whether the reply was stored by an earlier request with the same content.
        is_cut: Whether the server ended the text at the longest answer (``finish_reason`` "length").
    """

    text: str
    prompt_tokens: int | None = None
    completion_tokens: int | None = None
    retries: tuple[str, ...] = ()
    is_cached: bool = False
    is_cut: bool = False
