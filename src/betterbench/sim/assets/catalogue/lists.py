"""Reader for the word lists of the asset catalogue."""

from __future__ import annotations

import importlib.resources
from collections.abc import Iterator


def list_lines(file: str) -> Iterator[str]:
    """Yield the lines of a word list, without comments and empty lines."""
    text = importlib.resources.files(__package__).joinpath(file).read_text(encoding="utf-8")
    for line in text.splitlines():
        said = line.partition("#")[0].rstrip()
        if said:
            yield said


def entries_by_name(file: str, separator: str) -> Iterator[tuple[str, list[str]]]:
    """Yield the name and the entries of each line in a word list whose lines have the form ``name: entry, entry``."""
    for line in list_lines(file):
        name, _, said = line.partition(":")
        yield name.strip(), [part.strip() for part in said.split(separator) if part.strip()]
