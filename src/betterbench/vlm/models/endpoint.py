"""Models that are served by a chat endpoint with OpenAI's protocol. Their address is ``URL#MODEL``."""

from __future__ import annotations

from typing import TYPE_CHECKING

from betterbench.vlm.models.kind import ModelKind, ModelOptions

if TYPE_CHECKING:
    from betterbench.vqa.llm import Model, ReplyCache


def _make(options: ModelOptions, cache: ReplyCache | None) -> Model:
    from betterbench.vqa.llm import ChatModel, endpoint_at

    tiles = options.max_tiles
    # vLLM passes this field to the model's processor. InternVL's processor reads the number of tiles under this name.
    further = None if tiles is None else {"mm_processor_kwargs": {"max_dynamic_patch": tiles}}
    endpoint = endpoint_at(
        options.address, key_variable=options.key_variable, otherwise="hf:FOLDER", further=further, cache=cache
    )
    return ChatModel(endpoint, options.max_tokens)


ENDPOINT = ModelKind(scheme="", make=_make)
