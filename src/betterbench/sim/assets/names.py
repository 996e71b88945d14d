"""Words of names as files and folders have them."""

from __future__ import annotations

import re
from pathlib import Path

LONGEST_WORD = 40
"""Longest word of a name; longer ones are not words [characters]."""

_WORD = re.compile(r"[^\W\d_]+")
_NUMBER = re.compile(r"\d{1,40}")
_CASE = re.compile(r"(?<=[a-z])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])")

_GENERIC = """
asset base base_link collision google_16k google_512k google_64k main mesh meshes model models nontextured obj object
poisson scene textured textured_simple textured_vhacd texture tsdf untitled urdf visual visuals
"""
_WITHOUT_A_NAME = frozenset(_GENERIC.split())
"""Names of files and folders that say nothing about the object; the folder around them names it."""


def words_of(text: str) -> tuple[str, ...]:
    """Return the words of a name in small letters: "burgerCheese", "025_mug" and "red-mug" have two, one and two.

    Digits separate words and are left out, as single letters are, unless there is nothing else.
    """
    words = [word.lower() for word in _WORD.findall(_CASE.sub(" ", text)) if len(word) <= LONGEST_WORD]
    return tuple(word for word in words if len(word) > 1) or tuple(words) or tuple(_NUMBER.findall(text))


def named_by(file: Path, root: Path) -> tuple[Path, str | None]:
    """Return the folder and the stem that name the object of a file; no stem where a folder above it names it.

    The folder ``root`` and those above it never name an object.
    """
    if file.stem.lower() not in _WITHOUT_A_NAME:
        return file.parent, file.stem
    place = file.parent
    while place not in (root, place.parent) and place.name.lower() in _WITHOUT_A_NAME:
        place = place.parent
    return (file.parent, file.stem) if place in (root, place.parent) else (place, None)


def file_words(file: Path, root: Path) -> tuple[str, ...]:
    """Return the words that name the object of a file: those of "025_mug/google_16k/textured.obj" are ("mug",)."""
    place, stem = named_by(file, root)
    return words_of(stem if stem is not None else place.name) or (file.stem.lower(),)


def shown_name(file: Path) -> str:
    """Return the name of a file for people, with its folder where that names the object ("025_mug/textured.obj")."""
    whole = file.absolute()
    place, stem = named_by(whole, Path(whole.anchor))
    return file.name if stem is not None else f"{place.name}/{file.name}"
