"""Extraction of an answer by a language model. The model may only copy parts of the text.

The extractor gets the text and, for a choice, the options. It gets neither the question nor the image nor the correct
answer, so that it cannot answer the question itself. Each part that it copies must occur in the text word for word, and
each number must be a complete number of the text. If a part violates this, the stage is "none". The copied parts are
then read by the same parser as every other answer, in the declared coordinate convention. The extractor neither scales
nor swaps numbers.
"""

from __future__ import annotations

import re

from betterbench.json_form import parse_json
from betterbench.vqa.parsing.answer import NOTHING, AnswerSpec, Read, final_text
from betterbench.vqa.parsing.reading import read_text
from betterbench.vqa.question import Form

LONGEST_SHOWN = 8_000
"""Number of characters that the extractor gets, taken from the end of a text."""
_WANTED = {
    Form.CHOICE: "the option that it finally chooses: its letter, or the words of the option",
    Form.YES_NO: "whether it finally says yes or no",
    Form.NUMBER: "the number that it finally gives",
    Form.BOX: "the coordinates of the box that it finally gives",
    Form.POINT: "the coordinates of the point that it finally gives",
    Form.POINTS: "the coordinates of all points that it finally gives",
}
_NUMBER = re.compile(r"(?<![\w.])-?(?:\d+(?:\.\d*)?|\.\d+)(?!\w)")


def extraction_prompt(spec: AnswerSpec, text: str) -> str:
    """Return the prompt for the extractor."""
    shown = final_text(text)[-LONGEST_SHOWN:]
    options = "".join(f"\n{chr(ord('A') + i)}. {option}" for i, option in enumerate(spec.options))
    return (
        f"A model wrote the text between the lines of equal signs. Copy, word for word, the shortest parts of it that "
        f"state {_WANTED[spec.form]}. Do not correct, convert or complete anything, and do not answer yourself. If the "
        f"text gives no final answer, copy nothing.\n"
        + (f"The options were:{options}\n" if options else "")
        + f"==========\n{shown}\n==========\n"
        'Answer with JSON only: {"copied": ["...", ...]}, or {"copied": []}.'
    )


def read_extraction(spec: AnswerSpec, text: str, reply: str) -> Read:
    """Read the answer that an extractor copied from a text.

    The stage is "none" if the extractor copied nothing, or if a copied part does not occur in the text.

    Args:
        spec: Form of the answer.
        text: Text of the model.
        reply: Reply of the extractor to :func:`extraction_prompt`.
    """
    copied = _copied(reply)
    source = final_text(text)
    if not copied or not all(_occurs(part, source) for part in copied):
        return NOTHING
    read = read_text(spec, "\n".join(copied))
    if read.answer is None and spec.form in (Form.BOX, Form.POINT, Form.POINTS):
        numbers = [number for part in copied for number in _NUMBER.findall(part)]
        read = read_text(spec, _grouped(spec.form, numbers))
    return read.at("extractor")


def _grouped(form: Form, numbers: list[str]) -> str:
    """Format copied numbers as tuples.

    The result is an empty string if the form of the answer requires more or fewer numbers.
    """
    size = 4 if form is Form.BOX else 2
    if not numbers or len(numbers) % size or (form is not Form.POINTS and len(numbers) != size):
        return ""
    groups = [f"({', '.join(numbers[i : i + size])})" for i in range(0, len(numbers), size)]
    return f"[{', '.join(groups)}]"


def _copied(reply: str) -> list[str]:
    found = re.search(r"\{.*\}", final_text(reply), flags=re.DOTALL)
    try:
        form = parse_json(found[0]) if found else {}
    except ValueError:
        return []
    parts = form.get("copied") if isinstance(form, dict) else None
    if not isinstance(parts, list) or not all(isinstance(part, str) for part in parts):
        return []
    return [part for part in parts if part.strip()]


def _occurs(part: str, source: str) -> bool:
    """Return whether a part occurs in the text, as whole words or numbers.

    Differences in white space are ignored.
    """
    words, there = " ".join(part.split()), " ".join(source.split())
    whole = rf"(?<![\w.]){re.escape(words)}(?!\w|\.\d)" if words[:1].isalnum() else re.escape(words)
    if re.search(whole, there) is None:
        return False
    numbers = set(_NUMBER.findall(there))
    return all(number in numbers for number in _NUMBER.findall(words))
