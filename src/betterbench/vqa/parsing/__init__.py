"""Parsing of a model's answers in stages, with one file for each form of answer.

- ``strict``: the text consists only of the answer in the requested form.
- ``tolerant``: the text also contains other words, or the answer is written in a different form.
- ``extractor``: a language model copied the answer out of the text (:mod:`betterbench.vqa.parsing.extractor`).
- ``none``: the text contains no answer, or several different answers.

:func:`read_text` is the only parser of answers in betterbench. Both ``better vqa`` and ``better vlm`` use it.
"""

from betterbench.vqa.parsing.answer import AnswerSpec, Read, Stage, final_text
from betterbench.vqa.parsing.reading import read_text

__all__ = ["AnswerSpec", "Read", "Stage", "final_text", "read_text"]
