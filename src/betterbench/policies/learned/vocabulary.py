"""Vocabulary of a learner: the words, categories, colors and answers that occur in the training data.

Unknown words, which do not occur in the training data, share one index. Unknown categories and colors do so as well.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass

import numpy as np

from betterbench.json_form import strict_form

ABSENT = 0
"""Index of a missing word or object."""
UNKNOWN = 1
"""Index of a word, category or color that is not in the training data."""
_FIRST = 2
MOST_WORDS = 40
"""Maximum number of words of an instruction that are used. Later words are ignored."""

_WORD = re.compile(r"[a-z0-9]+(?:'[a-z]+)?")


def words_of(instruction: str) -> list[str]:
    """Return the words of an instruction in lower case and without punctuation."""
    return _WORD.findall(instruction.lower())


@strict_form
@dataclass(frozen=True, slots=True)
class Vocabulary:
    """Vocabulary of a learner. ``answers`` are the possible answers to the questions of co-training."""

    words: tuple[str, ...]
    categories: tuple[str, ...]
    colors: tuple[str, ...]
    answers: tuple[str, ...] = ()

    @classmethod
    def of(cls, texts: Iterable[str], categories: Iterable[str], colors: Iterable[str]) -> Vocabulary:
        """Collect the vocabulary of training data. Its entries are sorted."""
        words = {word for text in texts for word in words_of(text)}
        return cls(tuple(sorted(words)), tuple(sorted(set(categories))), tuple(sorted(set(colors))))

    def to_json(self) -> dict[str, list[str]]:
        """Return the vocabulary as a JSON-serializable dict.

        If there are no answers, the field ``answers`` is left out.
        """
        named = {name: list(values) for name, values in asdict(self).items()}
        return named if self.answers else {name: values for name, values in named.items() if name != "answers"}

    def sizes(self) -> tuple[int, int, int]:
        """Return how many indices are needed for words, for categories and for colors."""
        words, categories, colors = (_FIRST + len(known) for known in (self.words, self.categories, self.colors))
        return words, categories, colors

    def word_ids(self, instruction: str) -> np.ndarray:
        """Return the indices of the words in an instruction as int64. At most MOST_WORDS words are used."""
        return _ids(words_of(instruction)[:MOST_WORDS], self.words)

    def category_ids(self, names: Sequence[str]) -> np.ndarray:
        """Return the indices of categories as int64."""
        return _ids(names, self.categories)

    def color_ids(self, names: Sequence[str]) -> np.ndarray:
        """Return the indices of colors as int64."""
        return _ids(names, self.colors)

    def unknown_words(self, instruction: str) -> tuple[str, ...]:
        """Return the words of an instruction that are not in the vocabulary."""
        return tuple(word for word in words_of(instruction) if word not in self.words)


def _ids(names: Sequence[str], known: Sequence[str]) -> np.ndarray:
    numbers = {name: _FIRST + i for i, name in enumerate(known)}
    return np.array([numbers.get(name, UNKNOWN) for name in names], dtype=np.int64)
