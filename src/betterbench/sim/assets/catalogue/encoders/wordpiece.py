"""Word-piece tokenizer for uncased BERT models.

Words and punctuation marks are split into the longest pieces that the model knows.
"""

from __future__ import annotations

import unicodedata
from collections.abc import Iterator, Sequence

_LONGEST_WORD = 100
"""Maximum length of a word [characters]. Longer words are replaced by the piece for unknown words."""
_IDEOGRAPHS = (
    (0x4E00, 0x9FFF),
    (0x3400, 0x4DBF),
    (0x20000, 0x2A6DF),
    (0x2A700, 0x2B73F),
    (0x2B740, 0x2B81F),
    (0x2B820, 0x2CEAF),
    (0xF900, 0xFAFF),
    (0x2F800, 0x2FA1F),
)
"""Unicode blocks in which each character is a word."""


class WordPieces:
    """Tokenizer that splits texts into word pieces and returns their indices in a vocabulary.

    Args:
        vocabulary: The pieces, in the order of their indices in the model.
    """

    def __init__(self, vocabulary: Sequence[str]) -> None:
        self._numbers = {piece: number for number, piece in enumerate(vocabulary)}
        self._unknown, self._begin, self._end = (self._numbers[name] for name in ("[UNK]", "[CLS]", "[SEP]"))

    def numbers(self, text: str, *, limit: int) -> list[int]:
        """Return the indices of the word pieces in a text, including the start and end markers.

        At most ``limit`` indices are returned.
        """
        found = [number for word in _words(text) for number in self._pieces(word)]
        return [self._begin, *found[: limit - 2], self._end]

    def has_word(self, word: str) -> bool:
        """Return whether the vocabulary contains a lower-case word as a single piece."""
        return word in self._numbers

    def _pieces(self, word: str) -> list[int]:
        if len(word) > _LONGEST_WORD:
            return [self._unknown]
        found, at = [], 0
        while at < len(word):
            start = "##" if at else ""
            for end in range(len(word), at, -1):
                number = self._numbers.get(start + word[at:end])
                if number is not None:
                    found.append(number)
                    at = end
                    break
            else:
                return [self._unknown]
        return found


def _words(text: str) -> Iterator[str]:
    """Yield each word of a text in lower case and without accents, and each punctuation mark."""
    cleaned = "".join(_cleaned(character) for character in text)
    for word in cleaned.split():
        plain = "".join(c for c in unicodedata.normalize("NFD", word.lower()) if unicodedata.category(c) != "Mn")
        begin = 0
        for place, character in enumerate(plain):
            if _is_punctuation(character):
                if begin < place:
                    yield plain[begin:place]
                yield character
                begin = place + 1
        if begin < len(plain):
            yield plain[begin:]


def _cleaned(character: str) -> str:
    if character.isspace():
        return " "
    if character == "\N{REPLACEMENT CHARACTER}" or unicodedata.category(character).startswith("C"):
        return ""
    if any(first <= ord(character) <= last for first, last in _IDEOGRAPHS):
        return f" {character} "
    return character


def _is_punctuation(character: str) -> bool:
    code = ord(character)
    symbol = code < 128 and character.isprintable() and not character.isalnum() and character != " "
    return symbol or unicodedata.category(character).startswith("P")
