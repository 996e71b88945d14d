"""Items of a static benchmark: question, images, correct answer and groups."""

from __future__ import annotations

import hashlib
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields
from functools import cached_property, partial
from typing import Any

import numpy as np
import numpy.typing as npt

from betterbench.errors import InvalidInputError
from betterbench.json_form import dump_json
from betterbench.vlm.models.eyes import Eyes, shown_picture, size_in_detail
from betterbench.vlm.pictures import mask_of, sendable
from betterbench.vqa.asking import Request
from betterbench.vqa.coordinates import Convention
from betterbench.vqa.parsing import AnswerSpec
from betterbench.vqa.question import Form

_MASKS = 32
"""Maximum number of target regions kept in memory."""

AXIS, TRAINING = "axis", "training"
"""Kind of group for the axis of an item's scene, and the group name for training scenes."""


@dataclass(frozen=True, slots=True)
class Gold:
    """Correct answer of an item, in one of several forms.

    Attributes:
        text: The letter of a choice, "Yes", "No", or the digits of a number.
        box: Left, top, right and bottom edge [pixel].
        mask: Name of the image of the target region, in which all pixels above 0 are correct.
        runs: Pixels of the target region as run lengths; see :class:`~betterbench.interface.state.SeenObject`.
    """

    text: str | None = None
    box: tuple[float, ...] | None = None
    mask: str | None = None
    runs: tuple[int, ...] | None = None

    @property
    def written(self) -> str:
        """The correct answer as a string, which is its text, the box edges, the mask name, or empty."""
        if self.text is not None:
            return self.text
        return self.mask or ("" if self.box is None else f"[{', '.join(f'{v:g}' for v in self.box)}]")


@dataclass(frozen=True, slots=True)
class Detail:
    """Smallest visible object of a question.

    Attributes:
        width: Width of its box in the original image [pixel].
        height: Height of its box [pixel].
        picture: Width and height of the original image [pixel].
    """

    width: float
    height: float
    picture: tuple[int, int]


@dataclass(frozen=True, slots=True)
class Item:
    """One item of a benchmark.

    Attributes:
        id: Identifier within the benchmark.
        question: The question without its options.
        options: Options of a choice, in letter order.
        pictures: Names of the images in order.
        groups: Name of the item's group by kind of group ("relation": "left").
        cluster: Items with the same cluster share a scene, image or video, so their scores are not independent.
        width: Columns of the image, for boxes and points; 0 otherwise [pixel].
        height: Rows of the image; 0 otherwise [pixel].
        words: Additional strings of the item for prompts ("object", "suffix").
        detail: Smallest visible object of the question; None if the source does not give it.
        chance: Probability of guessing the answer; None if the source does not give it.
    """

    id: str
    form: Form
    question: str
    gold: Gold
    pictures: tuple[str, ...]
    cluster: str
    options: tuple[str, ...] = ()
    groups: Mapping[str, str] = field(default_factory=dict)
    width: int = 0
    height: int = 0
    words: Mapping[str, str] = field(default_factory=dict)
    detail: Detail | None = None
    chance: float | None = None

    def size_px(self, eyes: Eyes) -> float | None:
        """Return the size of the smallest object at the resolution that the model sees [pixel], if known.

        The size is the geometric mean of width and height.
        """
        if self.detail is None:
            return None
        return size_in_detail((self.detail.width, self.detail.height), self.detail.picture, eyes)

    def spec(self, convention: Convention) -> AnswerSpec:
        """Return the answer format for a coordinate convention."""
        return AnswerSpec(self.form, self.options, self.width, self.height, convention)


@dataclass(frozen=True)
class ItemSet:
    """Items of a benchmark with their images.

    Attributes:
        benchmark: Name of the benchmark.
        items: The items in the order of the data.
        read: Returns the bytes of an image by its name, in any format that Pillow reads.
        files: SHA-256 of the files with the items, by name; part of the content hash.
        reference: Reference rates by name of a group, such as chance and the blind classifier (in percent).
        content: Content hash of the source, where the source defines one; otherwise computed from the items.
        twins: Identifier of the item about the training scene, by identifier of the item about a variation.
    """

    benchmark: str
    items: tuple[Item, ...]
    read: Callable[[str], bytes]
    files: Mapping[str, str] = field(default_factory=dict)
    reference: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    content: str = ""
    twins: Mapping[str, str] = field(default_factory=dict)
    _masks: dict[tuple[str, int], npt.NDArray[np.bool_]] = field(default_factory=dict, repr=False)
    _lock: threading.Lock = field(default_factory=threading.Lock, repr=False)

    def __post_init__(self) -> None:
        """Raise InvalidInputError for an empty set and for identifiers that occur twice."""
        if not self.items:
            raise InvalidInputError(self.benchmark, "has no items", "Give the folder of its data")
        seen = set[str]()
        for item in self.items:
            if item.id in seen:
                raise InvalidInputError(
                    self.benchmark, f"the identifier {item.id!r} occurs twice", "Give data with one row per item"
                )
            seen.add(item.id)

    @cached_property
    def sha256(self) -> str:
        """Content hash of the source, or of the items and their files."""
        if self.content:
            return self.content
        digest = hashlib.sha256(dump_json([self.benchmark, dict(sorted(self.files.items()))]))
        for item in self.items:
            form = {k: v for k, v in _plain(item).items() if k not in ("detail", "chance")}
            digest.update(dump_json(form | {"gold": _plain(item.gold), "form": item.form.value}))
        return digest.hexdigest()

    def request(self, item: Item, prompt: str, eyes: Eyes = Eyes.NATIVE) -> Request:
        """Return the request for an item with a prompt and an image resolution."""
        return Request(prompt, partial(self._pictures, item, eyes))

    def _pictures(self, item: Item, eyes: Eyes) -> tuple[bytes, ...]:
        return tuple(self._shown(item, name, eyes) for name in item.pictures)

    def _shown(self, item: Item, name: str, eyes: Eyes) -> bytes:
        picture = sendable(self.read(name), f"{self.benchmark}, item {item.id}")
        return picture if eyes is Eyes.NATIVE else shown_picture(picture, eyes).data

    def mask(self, name: str, *, above: int = 0) -> npt.NDArray[np.bool_]:
        """Return a target region, shape (rows, columns): the pixels with values greater than ``above``."""
        with self._lock:
            found = self._masks.pop((name, above), None)
            if found is None:
                found = mask_of(self.read(name), name, above=above)
            self._masks[name, above] = found
            if len(self._masks) > _MASKS:
                del self._masks[next(iter(self._masks))]
            return found


def _plain(value: Item | Gold) -> dict[str, Any]:
    """Return the fields by name. ``asdict`` would copy each value, which takes ten times as long."""
    return {f.name: getattr(value, f.name) for f in fields(value)}
