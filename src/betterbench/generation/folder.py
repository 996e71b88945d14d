"""Folder of generated scenarios: one file per scenario, and the exchanges with the model that wrote them."""

from __future__ import annotations

import json
import re
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from betterbench.errors import RunConflictError, UnknownNameError
from betterbench.generation.asking import (
    Asked,
    ExchangeFile,
    KeptChat,
    Refused,
    ask_for_scenarios,
    ask_for_template,
    read_exchanges,
)
from betterbench.generation.asking.author import DEFAULT_TRIES
from betterbench.generation.asking.exchanges import FILE_NAME
from betterbench.generation.asking.prompt import PROMPT_ID
from betterbench.generation.choosing import checked_sentence, scenarios_about
from betterbench.generation.grammar import nouns_of_library, write_scenarios
from betterbench.generation.scenario import Scenario
from betterbench.generation.scenario_form import scenario_to_json
from betterbench.jobs import OnCount, write_durably
from betterbench.jobs.conflict import require_same
from betterbench.jobs.outputs import OutputFolder
from betterbench.json_form import read_object
from betterbench.quoting import json_text
from betterbench.tasks.authoring.templates import TEMPLATES
from betterbench.vqa.llm import Chat, ChatEndpoint, endpoint_at

OFFLINE = "offline"
"""Name of the offline author, which does not use a model."""
SETTINGS_NAME = "generate.json"
"""File with the settings of a folder."""
SCENARIOS = "scenarios"
"""Subfolder of the scenarios."""
_LONGEST_SLUG = 40
_MAX_BYTES = 1 << 20

Vocabulary = Literal["library", "open"]
"""Objects that a model may use: library objects, or any."""


@dataclass(frozen=True, slots=True)
class GenerateSettings:
    """Settings of generated scenarios.

    Attributes:
        target: Name of a template, or a sentence.
        num: Number of scenarios; None for 10 per template or 1 per sentence.
        model: "offline", or the address of a chat endpoint with the name of the model, "URL#MODEL".
        seed: Seed of the offline author.
        tries: Maximum number of model answers per scenario.
        vocabulary: Objects that a model may use.
        replay: File of stored exchanges that replaces the model.
        key_variable: Environment variable with the key of the endpoint.
    """

    target: str
    num: int | None = None
    model: str = OFFLINE
    seed: int = 0
    tries: int = DEFAULT_TRIES
    vocabulary: Vocabulary = "library"
    replay: Path | None = None
    key_variable: str = "OPENAI_API_KEY"

    @property
    def asks_model(self) -> bool:
        """Whether the scenarios come from a model or from stored exchanges."""
        return self.model != OFFLINE or self.replay is not None

    @property
    def count(self) -> int:
        """Number of scenarios."""
        if self.num is None:
            return 10 if self.target in TEMPLATES else 1
        return self.num

    @property
    def sentence(self) -> str:
        """Sentence with its period; empty if the target is a template.

        Raises:
            UnknownNameError: If the target is a single word but not a template.
            InvalidInputError: If it has other characters than letters and plain punctuation.
        """
        if self.target in TEMPLATES:
            return ""
        if " " not in self.target.strip():
            raise UnknownNameError("template", self.target, TEMPLATES)
        return checked_sentence(self.target)


@dataclass(frozen=True, slots=True)
class Generated:
    """Scenarios in a folder.

    Attributes:
        template: Name of their template.
        scenarios: Scenarios by number, from 1.
        files: Their files.
        refused: Scenarios without a valid answer from the model.
        reworded: Reason why a given sentence is not the instruction; empty if it is, or if a model was used.
    """

    template: str
    scenarios: Mapping[int, Scenario]
    files: Mapping[int, Path]
    refused: tuple[Refused, ...] = field(default=())
    reworded: str = ""


def generate_scenarios(
    settings: GenerateSettings,
    out: Path,
    *,
    chat: Chat | None = None,
    overwrite: bool = False,
    on_progress: OnCount | None = None,
) -> Generated:
    """Write scenarios into a folder. The same settings give the same bytes, and repeating a call resumes it.

    Args:
        settings: Settings of the scenarios.
        out: The folder.
        chat: Model to use instead of the address in the settings.
        overwrite: Whether to replace files that betterbench did not write or that have changed since.
        on_progress: Called with the number of finished scenarios and of all scenarios.

    Raises:
        InvalidInputError: If a setting is wrong, or the grammar has fewer scenarios.
        UnknownNameError: If there is no such template.
        ModelError: If the model cannot be reached; earlier exchanges are kept.
        RunConflictError: If the folder contains other files, or scenarios with other settings.
    """
    sentence = settings.sentence
    live = chat or endpoint_of(settings)
    kept = {} if settings.replay is None else read_exchanges(settings.replay)
    # invalid input is detected here, before a folder is created
    written = None if settings.asks_model else _offline(settings, sentence)
    with OutputFolder(out, "generate", overwrite=overwrite):
        _write_settings(out, settings, overwrite=overwrite)
        if written is None:
            with ExchangeFile(out / FILE_NAME) as file:
                made = _by_model(settings, sentence, KeptChat(file, live, kept), on_progress)
        else:
            made = written
        files = {number: _write(out, number, scenario) for number, scenario in made.scenarios.items()}
    return Generated(made.template, made.scenarios, files, made.refused, made.reworded)


def endpoint_of(settings: GenerateSettings) -> ChatEndpoint | None:
    """Return the endpoint given in the settings, or None for the offline author.

    Raises:
        InvalidInputError: If the address has no model or is not an HTTP address.
    """
    if settings.model == OFFLINE:
        return None
    return endpoint_at(settings.model, key_variable=settings.key_variable, otherwise=OFFLINE)


def _offline(settings: GenerateSettings, sentence: str) -> Generated:
    if sentence:
        chosen = scenarios_about(sentence, settings.count, seed=settings.seed)
        return Generated(chosen.template, _numbered(chosen.scenarios), {}, reworded=chosen.reworded)
    written = write_scenarios(settings.target, settings.count, seed=settings.seed)
    return Generated(settings.target, _numbered(written), {})


def _numbered(scenarios: tuple[Scenario, ...]) -> dict[int, Scenario]:
    return dict(enumerate(scenarios, start=1))


def _by_model(settings: GenerateSettings, sentence: str, chat: KeptChat, on_progress: OnCount | None) -> Generated:
    template = ask_for_template(sentence, chat, tries=settings.tries) if sentence else settings.target
    asked: Asked = ask_for_scenarios(
        template,
        chat,
        settings.count,
        tries=settings.tries,
        sentence=sentence,
        vocabulary=nouns_of_library(template) if settings.vocabulary == "library" else None,
        on_progress=on_progress,
    )
    return Generated(template, asked.scenarios, {}, asked.refused)


def _write_settings(out: Path, settings: GenerateSettings, *, overwrite: bool) -> None:
    """Write the settings of a folder. Without ``overwrite``, other settings and additional scenarios are rejected."""
    path = out / SETTINGS_NAME
    form: dict[str, object] = {"schema_version": 1, "target": settings.target, "num": settings.count}
    if settings.asks_model:
        source = "replay" if settings.model == OFFLINE else settings.model
        form |= {"model": source, "prompt": PROMPT_ID, "vocabulary": settings.vocabulary}
    else:
        form |= {"model": OFFLINE, "seed": settings.seed}
    changed: tuple[str, ...] = ()
    if path.is_file() and not overwrite:
        number = read_object(path, max_bytes=_MAX_BYTES, cure="Choose another folder").get("num")
        if type(number) is int and number > settings.count:
            problem = f"{out}: this folder contains {number} scenarios, not {settings.count}"
            raise RunConflictError(f"{problem}. Give --num {number} or more, or choose another folder.")
        changed = ("num",) if type(number) is int else ()
    write_settings(out, form, overwrite=overwrite, changed=changed)


def write_settings(out: Path, form: Mapping[str, object], *, overwrite: bool, changed: Collection[str] = ()) -> None:
    """Write the settings of a folder.

    Args:
        out: The folder.
        form: The settings.
        overwrite: Whether other settings may be replaced.
        changed: Fields that may differ from those in the folder.

    Raises:
        RunConflictError: If the folder has other settings.
    """
    path = out / SETTINGS_NAME
    if path.is_file() and not overwrite:
        there = read_object(path, max_bytes=_MAX_BYTES, cure="Choose another folder")
        require_same(
            out, there | {name: form[name] for name in changed}, dict(form), "set of scenarios", where="settings"
        )
    write_durably(path, (json_text(form, indent=1) + "\n").encode())


def _write(out: Path, number: int, scenario: Scenario) -> Path:
    """Write a scenario to a file such as "scenarios/003_packing_a_picnic.json"."""
    path = out / SCENARIOS / f"{number:03d}_{slug_of(scenario.name)}.json"
    text = json.dumps(scenario_to_json(scenario), indent=1)
    write_durably(path, (_RANGE.sub(r"[\1, \2]", text) + "\n").encode())
    return path


_RANGE = re.compile(r"\[\s+([\d.]+),\s+([\d.]+)\s+\]")
"""Pattern of a range of two numbers on four lines, which are joined."""


def slug_of(name: str) -> str:
    """Return a file name of lower-case ASCII letters, digits and underscores."""
    return re.sub(r"[^a-z0-9]+", "_", name.lower()).strip("_")[:_LONGEST_SLUG].strip("_") or "scenario"
