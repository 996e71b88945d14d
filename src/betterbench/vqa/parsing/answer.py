"""Form of an answer, the value that is read from a text, and the part of a text that is searched for an answer."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from typing import Literal

from betterbench.vqa.coordinates import CONVENTIONS, Convention
from betterbench.vqa.question import Form

Stage = Literal["strict", "tolerant", "extractor", "none"]
"""Stage of parsing in which a value was found."""

LONGEST = 20_000
"""Number of characters at the end of a text that are searched for an answer.

The answer is there, because it follows the reasoning.
"""

_THINKING = re.compile(r"<(/?)(?:think|thinking|thought|reasoning)>", re.IGNORECASE)


@dataclass(frozen=True, slots=True)
class AnswerSpec:
    """Form of an answer.

    Attributes:
        form: Kind of value.
        options: Options of a choice, in the order of their letters.
        width: Number of columns of the image, for boxes and points [pixel].
        height: Number of rows of the image, for boxes and points [pixel].
        convention: Coordinate convention that the user declared.
    """

    form: Form
    options: tuple[str, ...] = ()
    width: int = 0
    height: int = 0
    convention: Convention = CONVENTIONS["pixels"]


@dataclass(frozen=True, slots=True)
class Read:
    """Answer read from a text.

    Attributes:
        answer: The value, or None. For a choice, this is the letter of the option. For a yes-or-no question, it is
            "Yes" or "No", and for a count, its digits. A box or a point has the form "[...]" and several points have
            the form "[[...], ...]", in pixels, with the column before the row.
        stage: Parsing stage that found the value.
    """

    answer: str | None
    stage: Stage

    def at(self, stage: Stage) -> Read:
        """Return the same value with a different parsing stage. If there is no value, the stage remains "none"."""
        return self if self.answer is None else replace(self, stage=stage)


NOTHING = Read(None, "none")


def final_text(text: str) -> str:
    """Return the end of a reply, without the reasoning in thinking tags. Only this part is searched for the answer.

    If a reply ends inside the reasoning because the token limit was reached, it contains no answer.
    """
    kept, start, inside = list[str](), 0, False
    for tag in _THINKING.finditer(text):
        if tag[1]:  # the opening tag may be missing because it was part of the prompt
            kept = kept if inside else []
        elif not inside:
            kept.append(text[start : tag.start()])
        inside, start = not tag[1], tag.end()
    text = " ".join(kept if inside else [*kept, text[start:]])
    return text[-LONGEST:].strip()
