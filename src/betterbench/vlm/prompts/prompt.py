"""Prompt templates, and the prompts that come with the package."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from importlib import resources

from pydantic import TypeAdapter

from betterbench.errors import InvalidInputError, UnknownNameError
from betterbench.json_form import read_form, strict_form
from betterbench.vlm.items import Item
from betterbench.vqa.asking import answer_line
from betterbench.vqa.coordinates import CONVENTIONS, Convention, Coordinates
from betterbench.vqa.llm.chat import PICTURE

_FIELD = re.compile(r"\{(\w+)\}")


@strict_form
@dataclass(frozen=True, slots=True)
class Prompt:
    """Template for a prompt.

    Attributes:
        id: Identifier, which is stored in a run.
        benchmarks: Benchmarks for which the prompt is meant. The first prompt that lists a benchmark is its default.
        template: String with the fields ``{question}``, ``{options}``, ``{request}`` (the required format of the
            answer), ``{frames}`` and the fields of :attr:`Item.words`.
        source: Source of the wording.
        option: Template for one option, with ``{letter}`` and ``{text}``.
        frame: Template for the line about one image, with ``{number}`` and ``<image>``.
        coordinates: Coordinate convention that the wording states. None if the wording does not state a convention, or
            if ``{request}`` states it.
    """

    id: str
    benchmarks: tuple[str, ...]
    template: str
    source: str
    option: str = ""
    frame: str = ""
    coordinates: Coordinates | None = None

    def text(self, item: Item, convention: Convention) -> str:
        """Return the prompt for an item.

        The strings of the item are inserted verbatim, apart from image markers in these strings, which are replaced.
        """
        letters = ((chr(ord("A") + i), option) for i, option in enumerate(item.options))
        options = [_filled(self.option, {"letter": a, "text": _plain(option)}) for a, option in letters]
        frames = [_filled(self.frame, {"number": str(i + 1)}) for i in range(len(item.pictures))]
        words = {name: _plain(text) for name, text in item.words.items()}
        words |= {"question": _plain(item.question), "request": answer_line(item.spec(convention))}
        template = self.template if options else self.template.replace("{options}\n", "")
        return _filled(template, words | {"options": "\n".join(options), "frames": "\n".join(frames)})

    def convention(self, declared: Coordinates | None, usual: Coordinates | None) -> Coordinates:
        """Return the coordinate convention for the answers.

        Args:
            declared: Convention that the user has declared, or None if the user has declared none.
            usual: Default convention for a prompt with ``{request}``. None for items without points and boxes.

        Raises:
            InvalidInputError: If the wording and the user state different conventions, or if neither of them states
                one.
        """
        if usual is None:
            return declared or "pixels"
        if self.coordinates is not None and declared not in (None, self.coordinates):
            problem = f"the prompt {self.id} asks for {self.coordinates}, but {declared} is declared"
            cure = f"Use --coordinates {self.coordinates}, or a different --prompt"
            raise InvalidInputError("--coordinates", problem, cure)
        if declared is None and self.coordinates is None and "{request}" not in self.template:
            problem = f"is missing, and the prompt {self.id} does not state a coordinate convention"
            raise InvalidInputError("--coordinates", problem, f"Set it to one of {', '.join(CONVENTIONS)}")
        return declared or self.coordinates or usual


def _plain(text: str) -> str:
    return text.replace(PICTURE, "image")


def _filled(template: str, words: Mapping[str, str]) -> str:
    return _FIELD.sub(lambda found: words.get(found[1], ""), template)


@lru_cache(maxsize=1)
def _packaged() -> dict[str, Prompt]:
    raw = resources.files(__package__ or "betterbench.vlm.prompts").joinpath("prompts.json").read_bytes()
    prompts = read_form(TypeAdapter(list[Prompt]), raw, where="prompts.json", cure="Install betterbench again")
    return {prompt.id: prompt for prompt in prompts}


PROMPTS: Mapping[str, Prompt] = _packaged()
"""All prompts, keyed by their identifier."""


def prompts_of(benchmark: str) -> tuple[Prompt, ...]:
    """Return the prompts for a benchmark. The first one is the default."""
    return tuple(prompt for prompt in PROMPTS.values() if benchmark in prompt.benchmarks)


def find_prompt(benchmark: str, identifier: str | None) -> Prompt:
    """Return the prompt with the given identifier, or the default prompt of a benchmark if the identifier is None.

    Raises:
        UnknownNameError: If the benchmark has no prompt with this identifier.
    """
    known = {prompt.id: prompt for prompt in prompts_of(benchmark)}
    if identifier is None:
        return next(iter(known.values()))
    if identifier not in known:
        raise UnknownNameError(f"prompt of {benchmark}", identifier, known)
    return known[identifier]
