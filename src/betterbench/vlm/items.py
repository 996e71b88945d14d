"""Items of a static benchmark, each with its question, images, correct answer and groups."""

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
"""Maximum number of target regions that are kept in memory."""

AXIS, TRAINING = "axis", "training"
"""Kind of group for the axis of an item's scene, and the name of the group for training scenes."""


@dataclass(frozen=True, slots=True)
class Gold:
    """Correct answer to an item: a text, a box or a target region.

    A target region is given by a mask image or as run lengths. Attributes that do not apply to the answer are None.

    Attributes:
        text: The letter of the correct option, "Yes", "No", or the digits of a number.
        box: Left, top, right and bottom edge of the correct box [pixel].
        mask: Name of the image that shows the target region. All pixels above 0 are correct.
        runs: Pixels of the target region as run lengths (see :class:`~betterbench.interface.state.SeenObject`).
    """

    text: str | None = None
    box: tuple[float, ...] | None = None
    mask: str | None = None
    runs: tuple[int, ...] | None = None

    @property
    def written(self) -> str:
        """The correct answer as a string: its text, the name of its mask, or the edges of its box.

        The string is empty if the answer is a target region that is given as run lengths.
        """
        if self.text is not None:
            return self.text
        return self.mask or ("" if self.box is None else f"[{', '.join(f'{v:g}' for v in self.box)}]")


@dataclass(frozen=True, slots=True)
class Detail:
    """The smallest visible object that a question is about.

    Attributes:
        width: Width of the object's box in the original image [pixel].
        height: Height of the object's box in the original image [pixel].
        picture: Width and height of the original image as a whole [pixel].
    """

    width: float
    height: float
    picture: tuple[int, int]


@dataclass(frozen=True, slots=True)
class Item:
    """One item of a benchmark.

    Attributes:
        id: Identifier within the benchmark.
        question: The question, without its options.
        options: Options to choose from, in the order of their letters.
        pictures: Names of the images, in order.
        groups: Name of the item's group for each kind of group, such as "left" for "relation".
        cluster: Name of the scene, image or video that the item is about. Scores of items in the same cluster are not
            independent.
        width: Width of the image [pixel] if the answer is a box or points, and otherwise 0.
        height: Height of the image [pixel] if the answer is a box or points, and otherwise 0.
        words: Additional strings of the item that a prompt can insert, keyed by names such as "object" and "suffix".
        detail: The smallest visible object that the question is about, or None if the source does not state it.
        chance: Probability of guessing the answer, or None if the source does not state it.
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
        """Return the size of the smallest object at the resolution that the model sees [pixel], or None if unknown.

        The size is the geometric mean of the object's width and height.
        """
        if self.detail is None:
            return None
        return size_in_detail((self.detail.width, self.detail.height), self.detail.picture, eyes)

    def spec(self, convention: Convention) -> AnswerSpec:
        """Return the required format of an answer to this item, with the given coordinate convention."""
        return AnswerSpec(self.form, self.options, self.width, self.height, convention)


@dataclass(frozen=True)
class ItemSet:
    """Items of a benchmark and their images.

    Attributes:
        benchmark: Name of the benchmark.
        items: The items, in the order of the data.
        read: Function that returns the content of an image file, given the name of the image. The file has any format
            that Pillow reads.
        files: SHA-256 of each file from which items were read, keyed by file name. The hashes are part of the content
            hash.
        reference: Reference success rates for each group [%], such as those of guessing and of a classifier without
            access to the image.
        content: Content hash of the source, if the source defines one. If empty, the hash is computed from the items.
        twins: Identifier of the static twin of each item about a variation. The twin is the same question about the
            training scene.
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
        """Raise InvalidInputError if there are no items, or if two items have the same identifier."""
        if not self.items:
            raise InvalidInputError(self.benchmark, "it has no items", "Pass the folder that contains its data")
        seen = set[str]()
        for item in self.items:
            if item.id in seen:
                raise InvalidInputError(
                    self.benchmark, f"the identifier {item.id!r} occurs twice", "Use data with one row per item"
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
        """Return the request for an item, with the given prompt and image resolution."""
        return Request(prompt, partial(self._pictures, item, eyes))

    def _pictures(self, item: Item, eyes: Eyes) -> tuple[bytes, ...]:
        return tuple(self._shown(item, name, eyes) for name in item.pictures)

    def _shown(self, item: Item, name: str, eyes: Eyes) -> bytes:
        picture = sendable(self.read(name), f"{self.benchmark}, item {item.id}")
        return picture if eyes is Eyes.NATIVE else shown_picture(picture, eyes).data

    def mask(self, name: str, *, above: int = 0) -> npt.NDArray[np.bool_]:
        """Return the target region in a mask image, as a boolean array (rows, columns).

        The region consists of the pixels with a value above ``above``.
        """
        with self._lock:
            found = self._masks.pop((name, above), None)
            if found is None:
                found = mask_of(self.read(name), name, above=above)
            self._masks[name, above] = found
            if len(self._masks) > _MASKS:
                del self._masks[next(iter(self._masks))]
            return found


def _plain(value: Item | Gold) -> dict[str, Any]:
    """Return the fields of a dataclass as a dict. This is ten times as fast as ``asdict``, which copies each value."""
    return {f.name: getattr(value, f.name) for f in fields(value)}
