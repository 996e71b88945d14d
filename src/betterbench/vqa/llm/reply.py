"""Reply of a model, with its token counts and retries."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Reply:
    """Reply of a model.

    Attributes:
        text: Text of the reply.
        prompt_tokens: Number of tokens in the prompt and its images, or None if the server did not report it.
        completion_tokens: Number of tokens in the text, or None if the server did not report it.
        retries: Reason for each attempt that failed before this reply, as "KIND: DETAILS" ("HTTP 429: too many
            requests").
        is_cached: Whether the reply was stored by an earlier request with the same content.
        is_cut: Whether the server cut off the text at the maximum number of tokens (``finish_reason`` "length").
    """

    text: str
    prompt_tokens: int | None = None
    completion_tokens: int | None = None
    retries: tuple[str, ...] = ()
    is_cached: bool = False
    is_cut: bool = False
