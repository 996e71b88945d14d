"""Kinds of models for ``better vlm``. The beginning of a model's address determines its kind.

Each kind is a module that defines one :class:`ModelKind`: :mod:`~betterbench.vlm.models.endpoint` (``URL#MODEL``),
:mod:`~betterbench.vlm.models.hugging_face` (``hf:FOLDER``) and, in the package for learned policies,
``betterbench.learning.training.model_kind`` (``learned:CHECKPOINT``). The command line lists all kinds.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from betterbench.errors import InvalidInputError
from betterbench.vlm.models.eyes import Eyes

if TYPE_CHECKING:
    from betterbench.vqa.llm import Model, ReplyCache


@dataclass(frozen=True, slots=True, kw_only=True)
class ModelOptions:
    """Options of a ``better vlm`` command that affect its model.

    Attributes:
        address: Address of the model.
        own_set: Whether the questions come from a set made by ``better vqa``, rather than from a published benchmark or
            the coordinate probe.
        eyes: Resolution of the images.
        max_tiles: Maximum number of tiles per image. If None, it is the model's own maximum.
        max_tokens: Maximum length of an answer [tokens].
        key_variable: Environment variable that contains the key of an endpoint.
        coordinates: Coordinate convention that the user has declared, or None.
        data: Folder with the data of the benchmark. None if the command generates the data itself.
        records: Run from which the frames in the questions come. It is only used by a model that receives recorded
            states instead of images.
    """

    address: str
    own_set: bool
    eyes: Eyes = Eyes.NATIVE
    max_tiles: int | None = None
    max_tokens: int = 1024
    key_variable: str = "OPENAI_API_KEY"
    coordinates: str | None = None
    data: Path | None = None
    records: Path | None = None

    @property
    def target(self) -> str:
        """Address without its scheme, such as ``FOLDER`` for ``hf:FOLDER``."""
        return self.address.partition(":")[2]


def require_no_records(options: ModelOptions) -> None:
    """Raise InvalidInputError if ``--records`` is given, because a model that receives images does not use it."""
    if options.records is not None:
        cure = "Leave it out, or use the model learned:CHECKPOINT"
        raise InvalidInputError("--records", "applies only to a learned policy", cure)


@dataclass(frozen=True, slots=True, kw_only=True)
class ModelKind:
    """Kind of model that ``better vlm`` can evaluate.

    Attributes:
        scheme: Part of the address before the first colon. Empty for the kind that accepts all other addresses.
        make: Function that creates the model at an address. If the function is given a cache, the reply to a repeated
            request is taken from the cache. The function raises a BetterError if there is no such model.
        require: Function that is called before ``make``. It raises InvalidInputError for options that this kind does
            not support.
        sees: Whether the model receives images. If it does, its coordinate convention can be probed.
        one_at_a_time: Whether the model answers one request at a time, regardless of ``--at-once``.
    """

    scheme: str
    make: Callable[[ModelOptions, ReplyCache | None], Model]
    require: Callable[[ModelOptions], None] = require_no_records
    sees: bool = True
    one_at_a_time: bool = False


def kind_of(address: str, kinds: Iterable[ModelKind]) -> ModelKind:
    """Return the kind of the model at an address.

    Args:
        address: Address of the model.
        kinds: All kinds. One of them must have an empty scheme.
    """
    by_scheme = {kind.scheme: kind for kind in kinds}
    return by_scheme.get(address.partition(":")[0], by_scheme[""])
