"""Parser for multiple-choice answers. An answer may be the letter or the words of an option."""

from __future__ import annotations

import re
import unicodedata

from betterbench.json_form import parse_json
from betterbench.vqa.parsing.answer import NOTHING, Read

_CLAIM_WORDS = (
    "answer|option|choice|antwort|respuesta|opción|réponse|risposta|resposta|ответ|вариант|答案|选项|答え|回答|정답|답"
)
CLAIM = rf"(?:{_CLAIM_WORDS})s?(?:\s+(?:is|are|ist|es|est|è|é|would\s+be|should\s+be)|是|为|は|은|는)?"
"""Regular expression for words that announce an answer, in the languages that models use."""

_CLAIMED = re.compile(rf"(?i:{CLAIM})[\s:：=\-]*(?i:option\s+)?[\"'`*(\[\\{{]*([A-Z])(?![A-Za-z0-9'’])")
_NEXT_LETTER = re.compile(r"[)\]*.:,\s]*(?:,|/|or|and|&|oder|und|ou|o|y|et|或|和)\s*[(\[*]*([A-Z])(?![A-Za-z0-9'’])")
_MARKED = re.compile(r"\(([A-Z])\)|\*\*\(?([A-Z])[).:]?\*\*|(?m:^)\s*\(?([A-Z])[).:](?=\s|$)")
_ALONE = re.compile(r"(?<![A-Za-z0-9'’])([A-Z])(?![A-Za-z0-9'’])")
_ARTICLE = re.compile(r"\s+(?!(?:because|since|as|and|or|but|is|which|it|due|for|given|with|if|in)\b)[a-z]")
_DENIED_BEFORE = re.compile(
    r"(?:\b(?:not|never|nor|neither|cannot|nicht|non|не)|n['’]t|不是)(?:\s+be)?(?:\s+(?:the|a|an))?"
    r"(?:\s+(?:answer|option|choice))?[\s\"'`*(\[]*$",
    re.IGNORECASE,
)
_DENIED_AFTER = re.compile(
    r"[)\]*\"'`]*\s+(?:(?:is|are|was)n['’]t\b|(?:is|are|was|cannot\s+be)\s+(?:not|wrong|incorrect|false)\b)",
    re.IGNORECASE,
)
_LONGEST_DENIAL = 40
_WRAPPED = (
    re.compile(r"<answer>([^<]{0,2000})</answer>", re.IGNORECASE),
    re.compile(r"\\boxed\{(?:\\text\{)?([^{}]{0,2000})\}"),
)
FENCE = re.compile(r"```(?:\w+)?\s*(.*?)```", re.DOTALL)
"""Block of code in Markdown, in which models write JSON."""


def letters_of(options: tuple[str, ...]) -> dict[str, str]:
    """Return a mapping from letters to the options that they stand for."""
    return {chr(ord("A") + i): option for i, option in enumerate(options)}


def read_choice(options: tuple[str, ...], text: str) -> Read:
    """Return the letter of the option that a text names."""
    text, letters = unicodedata.normalize("NFKC", text), letters_of(options)
    found = _strict(letters, text)
    if found is not None:
        return found
    for inside in _wrapped(text):
        found = _strict(letters, inside)
        if found is not None:
            return found.at("tolerant")
    answer = _claimed(letters, text)
    return NOTHING if answer is None else Read(answer, "tolerant")


def _strict(letters: dict[str, str], text: str) -> Read | None:
    """Read a text that consists of an option, of its letter, or of both. Return None for any other text."""
    text = text.strip()
    first = re.match(r"\(?([A-Z])\s*(?:[).:]\s*(.*))?$", text, flags=re.DOTALL)
    if first and first[1] in letters:
        said, option = (first[2] or "").strip().rstrip(".").lower(), letters[first[1]]
        if said in ("", option.lower().rstrip(".")):
            return Read(first[1], "strict")
        if any(said == other.lower().rstrip(".") for other in letters.values()):
            return NOTHING  # the text has the letter of one option and the words of another
        return None
    plain = text.rstrip(".").lower()
    same = [letter for letter, option in letters.items() if plain == option.lower().rstrip(".")]
    if same:
        return Read(same[0], "strict") if len(same) == 1 else NOTHING
    small = re.fullmatch(r"[(\[*]*([A-Za-z])[)\].:*]*", text)
    if small and small[1].upper() in letters:
        return Read(small[1].upper(), "tolerant")
    return None


def _wrapped(text: str) -> list[str]:
    """Return the contents of markup (such as a box) that models put around the final answer, the last one first."""
    inside = [found for pattern in _WRAPPED for found in reversed(pattern.findall(text))]
    for part in (text, *reversed(FENCE.findall(text))):
        if part.lstrip().startswith("{"):
            try:
                form = parse_json(part.strip())
            except ValueError:
                continue
            inside += [str(v) for k, v in form.items() if str(k).lower() in ("answer", "option", "choice", "letter")]
    return inside


def _claimed(letters: dict[str, str], text: str) -> str | None:
    """Return the letter of the option that a text names as its answer.

    A letter that a sentence declares to be the answer takes precedence. If there is none, the result is the only letter
    in the text. If the text has no letter, the result is the letter of the only option that the text quotes.
    """
    claims = [
        m
        for m in _CLAIMED.finditer(text)
        if m[1] in letters and not _is_article(text, m) and not _is_denied(text, m.start(1), m.end(1))
    ]
    if claims:
        return None if _names_another(letters, text, claims[-1]) else claims[-1][1]
    begun = re.match(r"\(?([A-Z])\s*[).:]", text)
    if begun and begun[1] in letters and len({m for m in _marked(text) if m in letters}) == 1:
        return begun[1]
    marked = {m for m in _marked(text) if m in letters}
    if len(marked) == 1:
        return marked.pop()
    alone = {
        m[1]
        for m in _ALONE.finditer(text)
        if m[1] in letters and not _is_article(text, m) and not _is_denied(text, m.start(1), m.end(1))
    }
    plain = text.rstrip(".").lower()
    inside = [k for k, option in letters.items() if _is_named(option.lower(), plain)]
    longest = [k for k in inside if not any(letters[k] != letters[o] and letters[k] in letters[o] for o in inside)]
    if len(alone) == 1 and (not longest or longest == [*alone]):
        return alone.pop()
    return longest[0] if len(longest) == 1 and not alone else None


def _marked(text: str) -> list[str]:
    found = ((m, m.lastindex or 0) for m in _MARKED.finditer(text))
    return [m[i] for m, i in found if not _is_denied(text, m.start(i), m.end(i))]


def _is_named(option: str, text: str) -> bool:
    """Return whether a text contains the words of an option without negating them."""
    words = re.finditer(rf"(?<!\w){re.escape(option)}(?!\w)", text)
    return any(not _is_denied(text, m.start(), m.end()) for m in words)


def _is_denied(text: str, start: int, end: int) -> bool:
    """Return whether a letter or an option is negated ("not A", "option A is wrong")."""
    before = text[max(0, start - _LONGEST_DENIAL) : start]
    return bool(_DENIED_BEFORE.search(before) or _DENIED_AFTER.match(text[end : end + _LONGEST_DENIAL]))


def _is_article(text: str, found: re.Match[str]) -> bool:
    """Return whether an "A" is the article of the word that follows."""
    return found[1] == "A" and _ARTICLE.match(text, found.end(1)) is not None


def _names_another(letters: dict[str, str], text: str, claim: re.Match[str]) -> bool:
    """Return whether a second letter follows the one that is declared to be the answer ("The answer is A or B")."""
    following = _NEXT_LETTER.match(text, claim.end(1))
    return following is not None and following[1] in letters and following[1] != claim[1]
