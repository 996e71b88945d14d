"""Names of licenses, and the kinds of use that each license allows."""

from __future__ import annotations

import functools
import re
from typing import Literal

from betterbench.errors import InvalidInputError

LicenseKind = Literal["free", "restricted", "unknown"]
"""Kind of license. A free license allows commercial use and changes. A restricted license forbids at least one of them.
An unknown license is not recognized."""

LicenseFilter = Literal["free", "any"]
"""Licenses that a search allows."""

_SPOKEN = (
    (r"non ?commercial", "nc"),
    (r"no ?deriv(ative)?s?", "nd"),
    (r"share ?alike", "sa"),
    (r"attribution", "by"),
    (r"creative commons", "cc"),
)
"""Conditions of Creative Commons licenses, each with a pattern for its lower-case long form and with its
abbreviation."""

_CONDITIONS = ("by", "nc", "sa", "nd")
_FREE = re.compile(r"(apache|mit|bsd|isc|zlib|odc by|public domain|unlicense)\b.*")
LONGEST_LICENSE = 80
"""Maximum length of a license name."""


def _plain(text: str) -> str:
    """Convert the text of a license to lower-case words, and abbreviate the conditions of Creative Commons licenses."""
    plain = " ".join(re.sub(r"[^a-z0-9.]+", " ", text.lower()).split())
    for pattern, letters in _SPOKEN:
        plain = re.sub(rf"\b{pattern}\b", letters, plain)
    return plain


def license_name(text: str) -> str:
    """Return the standard name of a license, such as "CC-BY-NC-4.0" for "by-nc". Unknown names stay unchanged.

    A Creative Commons license without a version is given version 4.0, the version that Objaverse uses.
    """
    said = " ".join(text.split())[:LONGEST_LICENSE]
    plain = _plain(said)
    if re.match(r"(cc ?0|cc zero|zero)\b", plain):
        return "CC0-1.0"
    words = plain.split()
    if "by" in words and (words[0] == "cc" or set(words) <= set(_CONDITIONS)):
        version = re.search(r"\d\.\d", plain)
        letters = [letter.upper() for letter in _CONDITIONS if letter in words]
        return "-".join(["CC", *letters, version[0] if version else "4.0"])
    return said


@functools.lru_cache(maxsize=1024)
def license_kind(name: str) -> LicenseKind:
    """Return the kind of a license, given its standard name (:func:`license_name`)."""
    plain = _plain(name)
    if {"nc", "nd"} & set(plain.split()):
        return "restricted"
    known = re.match(r"cc ?0|cc by\b", plain) or _FREE.fullmatch(plain)
    return "free" if known else "unknown"


def require_license(where: str, name: str, *, any_license: bool, option: str) -> None:
    """Raise InvalidInputError unless the license is free or the user has allowed any license.

    Args:
        where: The asset, for the message.
        name: Name of the license. It is empty or "unknown" if the license is not known.
        any_license: Whether the user has allowed restricted and unknown licenses.
        option: Remedy for the message, which says how to state the license and how to allow any license.
    """
    kind = license_kind(name)
    if any_license or kind == "free":
        return
    found = (
        f"its license ({name}) forbids commercial use or changes"
        if kind == "restricted"
        else (
            f"its license ({name}) is not a known free license"
            if name not in ("", "unknown")
            else "its license is not known"
        )
    )
    raise InvalidInputError(where, found, option)
