"""Names of objects, derived from the names of files and folders."""

from __future__ import annotations

import re
from pathlib import Path

LONGEST_WORD = 40
"""Maximum length of a word in a name [characters]. Longer words are ignored."""

_WORD = re.compile(r"[^\W\d_]+")
_NUMBER = re.compile(r"\d{1,40}")
_CASE = re.compile(r"(?<=[a-z])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])")

_GENERIC = """
asset base base_link collision google_16k google_512k google_64k main mesh meshes model models nontextured obj object
poisson scene textured textured_simple textured_vhacd texture tsdf untitled urdf visual visuals
"""
_WITHOUT_A_NAME = frozenset(_GENERIC.split())
"""Generic names of files and folders. If a file or folder has such a name, its parent folder names the object."""


def words_of(text: str) -> tuple[str, ...]:
    """Return the words of a name in lower case. For example, "burgerCheese" has two words and "025_mug" has one.

    Digits separate words. Digits and single letters are left out, unless the name has nothing else.
    """
    words = [word.lower() for word in _WORD.findall(_CASE.sub(" ", text)) if len(word) <= LONGEST_WORD]
    return tuple(word for word in words if len(word) > 1) or tuple(words) or tuple(_NUMBER.findall(text))


def named_by(file: Path, root: Path) -> tuple[Path, str | None]:
    """Return the folder and the file stem that name the object in a file.

    If only the folder names it, the stem is None.

    Neither the folder ``root`` nor a folder above it ever names an object.
    """
    if file.stem.lower() not in _WITHOUT_A_NAME:
        return file.parent, file.stem
    place = file.parent
    while place not in (root, place.parent) and place.name.lower() in _WITHOUT_A_NAME:
        place = place.parent
    return (file.parent, file.stem) if place in (root, place.parent) else (place, None)


def file_words(file: Path, root: Path) -> tuple[str, ...]:
    """Return the words that name the object in a file, for example ("mug",) for "025_mug/google_16k/textured.obj"."""
    place, stem = named_by(file, root)
    return words_of(stem if stem is not None else place.name) or (file.stem.lower(),)


def shown_name(file: Path) -> str:
    """Return the name of a file for display.

    If the folder names the object, it is included ("025_mug/textured.obj").
    """
    whole = file.absolute()
    place, stem = named_by(whole, Path(whole.anchor))
    return file.name if stem is not None else f"{place.name}/{file.name}"
