"""InternVL checkpoints in the Hugging Face format that run in this process. Their address is ``hf:FOLDER``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from betterbench.vlm.models.eyes import MYOPIC, Eyes
from betterbench.vlm.models.kind import ModelKind, ModelOptions
from betterbench.vlm.models.tiles import MOST_TILES

if TYPE_CHECKING:
    from betterbench.vqa.llm import Model, ReplyCache


def _make(options: ModelOptions, cache: ReplyCache | None) -> Model:
    del cache  # only requests to an endpoint are stored
    from betterbench.vlm.models.intern_vl import InternVl

    return InternVl(
        Path(options.target).expanduser(),
        most_tiles=(options.max_tiles or MOST_TILES) if options.eyes is Eyes.NATIVE else 1,
        side=MYOPIC if options.eyes is Eyes.NATIVE_224 else None,
        max_tokens=options.max_tokens,
    )


HUGGING_FACE = ModelKind(scheme="hf", make=_make, one_at_a_time=True)
