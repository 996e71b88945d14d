"""Folder of generated scenarios: one file per scenario, and the stored exchanges if a model wrote the scenarios."""

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
"""Value of ``--model`` for the offline author, which does not use a language model."""
SETTINGS_NAME = "generate.json"
"""Name of the file with the settings from which a folder was generated."""
SCENARIOS = "scenarios"
"""Name of the subfolder with the scenarios."""
_LONGEST_SLUG = 40
_MAX_BYTES = 1 << 20

Vocabulary = Literal["library", "open"]
"""Objects that a model may use: only library objects ("library"), or any objects ("open")."""


@dataclass(frozen=True, slots=True)
class GenerateSettings:
    """Settings for generating scenarios.

    Attributes:
        target: Name of a template, or a sentence.
        num: Number of scenarios. If it is None, there are 10 for a template and 1 for a sentence.
        model: "offline", or the address of a chat endpoint with the name of the model, "URL#MODEL".
        seed: Seed of the offline author.
        tries: Maximum number of model answers per scenario.
        vocabulary: Objects that a model may use.
        replay: File of stored exchanges. Its answers are used instead of a model.
        key_variable: Environment variable with the API key of the endpoint.
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
        """Number of scenarios to generate."""
        if self.num is None:
            return 10 if self.target in TEMPLATES else 1
        return self.num

    @property
    def sentence(self) -> str:
        """Normalized sentence, ending with a period. Empty if the target is a template.

        Raises:
            UnknownNameError: If the target is a single word but not the name of a template.
            InvalidInputError: If the sentence contains other characters than letters and plain punctuation.
        """
        if self.target in TEMPLATES:
            return ""
        if " " not in self.target.strip():
            raise UnknownNameError("template", self.target, TEMPLATES)
        return checked_sentence(self.target)


@dataclass(frozen=True, slots=True)
class Generated:
    """Scenarios that were written to a folder.

    Attributes:
        template: Name of the template of all scenarios.
        scenarios: Scenarios by number, counted from 1.
        files: File of each scenario, by number.
        refused: Scenarios that could not be written, because the model gave no valid answer.
        reworded: Reason why a given sentence is not used as the instruction. Empty if it is used, or if a model wrote
            the scenarios.
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
    """Write scenarios to a folder.

    The same settings produce the same files. Repeating an interrupted call resumes it where it stopped.

    Args:
        settings: Settings of the scenarios.
        out: Folder for the scenarios.
        chat: Model to use instead of the model in the settings.
        overwrite: Whether to replace files that betterbench did not write, or that were changed after it wrote them.
        on_progress: Called with the number of finished scenarios and the number of all scenarios.

    Raises:
        InvalidInputError: If a setting is invalid, or the grammar has fewer scenarios than requested.
        UnknownNameError: If the template does not exist.
        ModelError: If the model cannot be reached. Earlier exchanges are kept.
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
    """Return the chat endpoint given in the settings, or None if they name the offline author.

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
    """Write the settings used to generate a folder.

    Without ``overwrite``, a folder that has other settings or more scenarios is rejected.
    """
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
            raise RunConflictError(f"{problem}. Use --num {number} or more, or choose another folder.")
        changed = ("num",) if type(number) is int else ()
    write_settings(out, form, overwrite=overwrite, changed=changed)


def write_settings(out: Path, form: Mapping[str, object], *, overwrite: bool, changed: Collection[str] = ()) -> None:
    """Write a file with the settings used to generate the content of a folder.

    Args:
        out: Folder.
        form: Settings as a JSON-serializable mapping.
        overwrite: Whether different settings in the folder may be replaced.
        changed: Names of settings that may differ from those already stored in the folder.

    Raises:
        RunConflictError: If the folder has different settings.
    """
    path = out / SETTINGS_NAME
    if path.is_file() and not overwrite:
        there = read_object(path, max_bytes=_MAX_BYTES, cure="Choose another folder")
        require_same(
            out, there | {name: form[name] for name in changed}, dict(form), "set of scenarios", where="settings"
        )
    write_durably(path, (json_text(form, indent=1) + "\n").encode())


def _write(out: Path, number: int, scenario: Scenario) -> Path:
    """Write a scenario to a file with a name such as "scenarios/003_packing_a_picnic.json", and return its path."""
    path = out / SCENARIOS / f"{number:03d}_{slug_of(scenario.name)}.json"
    text = json.dumps(scenario_to_json(scenario), indent=1)
    write_durably(path, (_RANGE.sub(r"[\1, \2]", text) + "\n").encode())
    return path


_RANGE = re.compile(r"\[\s+([\d.]+),\s+([\d.]+)\s+\]")
"""Pattern of a range of two numbers that is spread over four lines. Such ranges are joined to one line."""


def slug_of(name: str) -> str:
    """Return a file name made from a scenario's name: lower-case ASCII letters, digits and underscores."""
    return re.sub(r"[^a-z0-9]+", "_", name.lower()).strip("_")[:_LONGEST_SLUG].strip("_") or "scenario"
