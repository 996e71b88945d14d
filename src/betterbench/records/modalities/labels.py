"""Ids in masks: instance ids within a scene, and semantic ids of categories, which are the same in every scene."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Sequence
from importlib import resources

from betterbench.errors import InvalidInputError

NOTHING = 0
"""Instance id and semantic id of pixels that show the sky instead of a body."""

STAGE = ("floor", "table", "pedestal", "arm", "hand", "left_finger", "right_finger", "other")
"""Parts of a scene other than objects, in the order of their instance ids from 1. "other" means all remaining bodies.
"""

FIRST_OBJECT = 10
"""Instance id of the first object in a scene. The other objects follow in the order of ``scene.objects``."""

FIRST_OWN = 1024
"""First semantic id of user-defined categories. The ids of these categories are computed from their names."""

_LAST = 0xFFFF


def _known() -> dict[str, int]:
    text = resources.files("betterbench.records.modalities").joinpath("semantics.json").read_text(encoding="utf-8")
    return dict(json.loads(text)["ids"])


SEMANTIC_IDS: dict[str, int] = _known()
"""Semantic ids of the stage and of all assets that come with betterbench, by category (``semantics.json``)."""


def semantic_id(category: str) -> int:
    """Return the semantic id of a category.

    Built-in categories have fixed ids from 1 to 1023. For a user-defined category, the id is 1024 plus the first four
    bytes of the SHA-256 of its name, as a big-endian number, modulo 64512.
    """
    known = SEMANTIC_IDS.get(category)
    if known is not None:
        return known
    digest = int.from_bytes(hashlib.sha256(category.encode()).digest()[:4], "big")
    return FIRST_OWN + digest % (_LAST + 1 - FIRST_OWN)


def semantic_ids(categories: Iterable[str]) -> dict[str, int]:
    """Return the semantic ids of the built-in categories and the given categories, ordered by id.

    Raises:
        InvalidInputError: If two categories have the same id (probability 1/64512 for two user-defined categories).
    """
    names: dict[int, str] = {}
    for category in (*SEMANTIC_IDS, *categories):
        other = names.setdefault(semantic_id(category), category)
        if other != category:
            problem = f"has the semantic id of {other!r}"
            raise InvalidInputError(f"category {category!r}", problem, "Rename one of the two categories")
    return {names[number]: number for number in sorted(names)}


def semantics_of_instances(categories: Sequence[str]) -> list[int]:
    """Return the semantic id of each instance id in a scene, given the categories of the scene's objects in order."""
    stage = [NOTHING, *(semantic_id(name) for name in STAGE)]
    return [*stage, *[NOTHING] * (FIRST_OBJECT - len(stage)), *(semantic_id(name) for name in categories)]
