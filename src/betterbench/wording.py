"""Counts with nouns, and lists, in sentences."""

from collections.abc import Sequence


def listed(items: Sequence[str]) -> str:
    """Join items as "a", "a and b" or "a, b and c"."""
    return "".join(items) if len(items) < 2 else f"{', '.join(items[:-1])} and {items[-1]}"


def plural(count: int, one: str, many: str | None = None) -> str:
    """Return the count with its noun: "1 trial", "2 trials"."""
    return f"{count} {one if count == 1 else many or one + 's'}"
