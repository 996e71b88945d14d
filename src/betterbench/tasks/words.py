"""Grammar for sentences about objects, such as verbs that agree with a kind's name."""

from __future__ import annotations


def is_plural(kind: str) -> bool:
    """Tell whether a kind's name is a plural: "fries" is a plural, "glass" and "cactus" are not."""
    return kind.endswith("s") and not kind.endswith(("ss", "us", "is"))


def agreeing(kind: str, one: str, many: str) -> str:
    """Return the word that agrees with a kind: "is" with "burger", "are" with "fries"."""
    return many if is_plural(kind) else one


def place_words(kind: str, region: str) -> str:
    """Return the text for a region of a target: "the laptop (upper right)", "the white plate (layer 1)", "the box"."""
    name = f"layer {region}" if region.isdigit() else region.replace("_", " ")
    return f"the {kind} ({name})" if name else f"the {kind}"
