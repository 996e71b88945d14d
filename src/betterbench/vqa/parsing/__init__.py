"""Parsing of a model's answers in stages, with one file per answer form.

- ``strict``: the text is only the answer, in the requested form.
- ``tolerant``: the text also contains other words, or the answer has another written form.
- ``extractor``: a language model copied the answer out of the text (:mod:`betterbench.vqa.parsing.extractor`).
- ``none``: no answer, or several different ones.

:func:`read_text` is the only parser of answers in betterbench; ``better vqa`` and ``better vlm`` both use it.
"""

from betterbench.vqa.parsing.answer import AnswerSpec, Read, Stage, final_text
from betterbench.vqa.parsing.reading import read_text

__all__ = ["AnswerSpec", "Read", "Stage", "final_text", "read_text"]
