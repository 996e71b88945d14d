"""Parsers for yes-or-no answers and for counts."""

from __future__ import annotations

import re

from betterbench.vqa.parsing.answer import NOTHING, Read
from betterbench.vqa.parsing.choice import CLAIM

_SPELLINGS = {
    "Yes": ("yes", "true", "ja", "oui", "sí", "sì", "sim", "да", "是", "是的", "はい", "예", "네"),
    "No": ("no", "false", "nein", "non", "não", "нет", "否", "不是", "いいえ", "아니요"),
}
_NUMBER_WORDS = [
    *("zero", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten", "eleven", "twelve"),
    *("thirteen", "fourteen", "fifteen", "sixteen", "seventeen", "eighteen", "nineteen", "twenty"),
]
_NOT = r"(?:\bnot|n['’]t)\s+(?:be\s+)?"
_DENIED_NUMBER = re.compile(rf"{_NOT}(?:\d+|{'|'.join(_NUMBER_WORDS)})\b")
_UNKNOWING = re.compile(r"no idea|no way to (?:know|tell)|no answer|not sure|cannot (?:tell|determine|say)|can't tell")


def read_yes_no(text: str) -> Read:
    """Read whether a text says "Yes" or "No"."""
    lower = re.sub(rf"{_NOT}(?:yes|no)\b", " ", text.lower())
    for said, meant in (("true", " no "), ("false", " yes ")):
        lower = re.sub(rf"{_NOT}{said}\b", meant, lower)
    words = re.findall(r"[^\W\d_]+", lower)
    if not words:
        return NOTHING
    polarities = [name for word in words for name, spellings in _SPELLINGS.items() if word in spellings]
    if len(words) == 1 and len(polarities) == 1:
        return Read(polarities[0], "strict" if lower == text.lower() else "tolerant")
    if _UNKNOWING.search(lower):
        return NOTHING
    claimed = re.findall(rf"{CLAIM}[\s:：\"'*`]*([^\W\d_]+)", lower)
    for word in reversed(claimed):
        for name, spellings in _SPELLINGS.items():
            if word in spellings:
                return Read(name, "tolerant")
    if not polarities:
        return NOTHING
    first = next((name for name, spellings in _SPELLINGS.items() if words[0] in spellings), None)
    return Read(first or polarities[0], "tolerant") if first or len(set(polarities)) == 1 else NOTHING


def read_number(text: str) -> Read:
    """Read a count from a text, and return it as digits."""
    if re.fullmatch(r"\d{1,4}\.?", text):
        return Read(str(int(text.rstrip("."))), "strict")
    lower = _DENIED_NUMBER.sub(" ", text.lower())
    if re.search(r"-\d|\d[.,]\d", lower):
        return NOTHING  # a count is neither negative nor fractional
    for part in (*reversed(re.findall(rf"(?:{CLAIM}|total|count is)[\s:：*]*(\w+)", lower)), lower):
        words = re.findall(r"[a-z]+|\d+", part)
        found = {
            str(int(w)) if w.isdigit() else str(_NUMBER_WORDS.index(w))
            for w in words
            if (w.isdigit() and len(w) < 5) or w in _NUMBER_WORDS
        }
        if any(w.isdigit() and len(w) >= 5 for w in words):
            return NOTHING
        if len(found) == 1:
            return Read(found.pop(), "tolerant")
        if not found and words[:1] in (["no"], ["none"]) and not _UNKNOWING.search(lower):
            return Read("0", "tolerant")
    return NOTHING
