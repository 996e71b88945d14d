"""Author of scenarios that uses a language model.

It checks and stores the model's answers, and asks the model to correct invalid answers.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from betterbench.errors import BetterError, InvalidInputError, UnknownNameError, one_line, require_between
from betterbench.generation.asking.exchanges import KeptChat
from betterbench.generation.asking.prompt import correction, scenario_messages, template_messages
from betterbench.generation.grammar.author import MOST_SCENARIOS
from betterbench.generation.instruction_sense import noun_problems
from betterbench.generation.scenario import Scenario
from betterbench.generation.scenario_form import scenario_from_answer
from betterbench.generation.sense import sense_problems
from betterbench.generation.stated_goal import goal_problems, stated_goal
from betterbench.jobs import OnCount
from betterbench.json_form import parse_json
from betterbench.tasks.authoring.template import Template
from betterbench.tasks.authoring.templates import TEMPLATES
from betterbench.vqa.llm import Message

DEFAULT_TRIES, MOST_TRIES = 3, 20
"""Default and maximum number of requests per scenario."""
_LONGEST_ECHO = 8_000
"""Maximum length of a rejected answer that is sent back [characters]."""
_MOST_PROBLEMS = 8
"""Maximum number of problems that are sent back to the model at once."""
_MOST_SHOWN = 50
"""Maximum number of earlier scenarios listed in the prompt."""


@dataclass(frozen=True, slots=True)
class Refused:
    """Scenario for which the model did not give a valid answer.

    Attributes:
        number: Number of the scenario, counted from 1.
        tries: Number of answers that the model gave.
        problem: First problem in the last answer.
    """

    number: int
    tries: int
    problem: str


@dataclass(frozen=True, slots=True)
class Asked:
    """Scenarios by number (from 1) that a model wrote, and the scenarios for which the model gave no valid answer."""

    scenarios: Mapping[int, Scenario]
    refused: tuple[Refused, ...]


def ask_for_scenarios(
    template: str,
    chat: KeptChat,
    count: int,
    *,
    tries: int = DEFAULT_TRIES,
    sentence: str = "",
    vocabulary: Mapping[str, Sequence[str]] | None = None,
    on_progress: OnCount | None = None,
) -> Asked:
    """Have a model write different scenarios for a template.

    Args:
        template: Name of the template.
        chat: Model with its stored exchanges.
        count: Number of scenarios.
        tries: Maximum number of answers per scenario. The problems of a rejected answer are sent back to the model.
        sentence: Sentence of a user that each scenario must match. Empty if there is no sentence.
        vocabulary: Allowed asset queries by object group. If it is None, any query is allowed.
        on_progress: Called with the number of finished scenarios and the number of all scenarios.

    Raises:
        UnknownNameError: If the template does not exist.
        InvalidInputError: If a number is out of range.
        ModelError: If the model cannot be reached; earlier exchanges are kept.
    """
    require_between("--num", count, 1, MOST_SCENARIOS)
    require_between("--tries", tries, 1, MOST_TRIES)
    if template not in TEMPLATES:
        raise UnknownNameError("template", template, TEMPLATES)
    written: dict[int, Scenario] = {}
    refused: list[Refused] = []
    for number in range(1, count + 1):
        request = Request(TEMPLATES[template], sentence, vocabulary, list(written.values()))
        found, problem = ask_for_scenario(request, chat, number, tries=tries)
        if found is None:
            refused.append(Refused(number, tries, problem))
        else:
            written[number] = found
        if on_progress is not None:
            on_progress(number, count)
    return Asked(written, tuple(refused))


@dataclass(frozen=True, slots=True)
class Request:
    """Requirements for a scenario that a model writes.

    Attributes:
        template: Template of the scenario.
        sentence: Sentence of a user that the scenario must match. Empty if there is no sentence.
        vocabulary: Allowed asset queries by object group. If it is None, any query is allowed.
        before: Earlier scenarios. The new scenario must not repeat the set of objects of any of them.
        context: Required context. Empty if any context is allowed.
    """

    template: Template
    sentence: str
    vocabulary: Mapping[str, Sequence[str]] | None
    before: Sequence[Scenario]
    context: str = ""


def ask_for_scenario(
    request: Request, chat: KeptChat, number: int, *, tries: int = DEFAULT_TRIES
) -> tuple[Scenario | None, str]:
    """Have a model write a scenario.

    Returns:
        The scenario and an empty string. If no answer is valid, None and the first problem in the last answer.

    Raises:
        ModelError: If the model cannot be reached; earlier exchanges are kept.
    """
    messages = scenario_messages(
        request.template,
        number=number,
        sentence=request.sentence,
        context=request.context,
        vocabulary=request.vocabulary,
        written=request.before[-_MOST_SHOWN:],
    )
    return _corrected(chat, messages, request, tries, f"scenario {number}")


def _corrected(
    chat: KeptChat, messages: list[Message], request: Request, tries: int, purpose: str
) -> tuple[Scenario | None, str]:
    """Request a scenario, and send the problems of each rejected answer back to the model.

    Returns:
        The scenario and an empty string. If no answer is valid, None and the first problem in the last answer.
    """
    problems: Sequence[str] = ()
    for attempt in range(1, tries + 1):
        answer = chat.ask(messages, f"{purpose}, try {attempt}")
        scenario, problems = _checked(answer, request)
        chat.judge("; ".join(problems) or "accepted")
        if scenario is not None:
            return scenario, ""
        messages = [*messages, *correction(answer[:_LONGEST_ECHO], problems[:_MOST_PROBLEMS])]
    return None, problems[0]


def _checked(answer: str, request: Request) -> tuple[Scenario | None, Sequence[str]]:
    """Parse the scenario in a model's answer. If it is invalid, return None and the list of its problems."""
    try:
        (form,) = parsed_list(answer)
        scenario = scenario_from_answer(form, request.template.name, where="answer[0]")
    except BetterError as error:
        return None, [str(error)]
    problems = [str(p) for p in sense_problems(scenario, where="answer[0]", mixed=bool(request.sentence))]
    problems += _vocabulary_problems(scenario, request.vocabulary)
    problems += _sentence_problems(scenario, request)
    if request.context and scenario.context != request.context:
        problems.append(f"answer[0].scene_context: is {scenario.context!r}. Write {request.context!r}.")
    twin = next((s for s in request.before if _objects(s) == _objects(scenario)), None)
    if twin is not None:
        problems.append(f"answer[0]: instantiation: has the same objects as the scenario {twin.name!r}. Choose others.")
    return (None, problems) if problems else (scenario, ())


def parsed_list(answer: str) -> list[Any]:
    """Parse a model's answer. It must be a JSON list with one scenario. A code fence around the list is removed.

    Raises:
        InvalidInputError: If the answer is empty, is not JSON, or is not a list of one object.
    """
    text = without_fence(answer)
    cure = "Answer with a JSON list of one scenario and nothing else"
    if not text:
        raise InvalidInputError("answer", "is empty", cure)
    if text[0] not in "[{":
        raise InvalidInputError("answer", f"is not JSON: {one_line(text, most=120)!r}", cure)
    try:
        found = parse_json(text, unique=True)
    except ValueError as error:
        raise InvalidInputError("answer", f"is not JSON ({one_line(error, most=120)})", cure) from error
    if not isinstance(found, list):
        raise InvalidInputError("answer", "is a JSON object and not a list", cure)
    if len(found) != 1:
        raise InvalidInputError("answer", f"is a list of {len(found)} scenarios", cure)
    return found


def without_fence(answer: str) -> str:
    """Strip white space and a surrounding Markdown code fence from an answer."""
    text = answer.strip()
    if text.startswith("```") and text.endswith("```") and "\n" in text:
        text = text.partition("\n")[2].removesuffix("```").strip()
    return text


def _vocabulary_problems(scenario: Scenario, vocabulary: Mapping[str, Sequence[str]] | None) -> list[str]:
    if vocabulary is None:
        return []
    found = []
    for group, objects in scenario.groups.items():
        known = vocabulary.get(group, ())
        for number, described in enumerate(objects):
            if described.asset_query not in known:
                path = f"answer[0]: instantiation.{group}[{number}].asset_query"
                message = str(UnknownNameError("object of the library", described.asset_query, known))
                found.append(f"{path}: {message}")
    return found


def _sentence_problems(scenario: Scenario, request: Request) -> list[str]:
    """Return the differences of a scenario from the user's sentence: missing objects, missing places, other goals."""
    if not request.sentence:
        return []
    asked = replace(scenario, instruction=request.sentence)
    found = [f"instantiation: the request {p}. Add it." for p, _ in noun_problems(asked, request.template)]
    found += [f"instruction: the request {p}. {cure}." for p, cure in goal_problems(asked, request.template)]
    wanted, stated = stated_goal(asked), stated_goal(scenario)
    if not (wanted.regions.items() <= stated.regions.items() and set(wanted.onto) <= set(stated.onto)):
        found.append("instruction: lacks a place that the request states. Keep the places of the request.")
    return [f"answer[0]: {problem}" for problem in found]


def _objects(scenario: Scenario) -> list[tuple[str, list[str]]]:
    return sorted((group, sorted(o.asset_query for o in objects)) for group, objects in scenario.groups.items())


def ask_for_template(sentence: str, chat: KeptChat, *, tries: int = DEFAULT_TRIES) -> str:
    """Have a model choose a template for a sentence, and return the name of the template.

    Raises:
        InvalidInputError: If the model chooses no template, or does not give a readable answer.
        ModelError: If the model cannot be reached.
    """
    require_between("--tries", tries, 1, MOST_TRIES)
    messages = template_messages(sentence, list(TEMPLATES.values()))
    problem = ""
    for attempt in range(1, tries + 1):
        answer = chat.ask(messages, f"template, try {attempt}")
        name, problem = _template_in(answer)
        chat.judge(problem or "accepted")
        if name:
            return name
        messages = [*messages, *correction(answer[:_LONGEST_ECHO], [problem])]
    raise InvalidInputError(
        "sentence",
        f"the model chose no template ({problem})",
        "Use one of the templates listed by `better list templates`",
    )


def _template_in(answer: str) -> tuple[str, str]:
    """Return the template named in a model's answer, and an empty string.

    If the answer names no template, return an empty string and the problem.
    """
    try:
        found = parse_json(without_fence(answer), unique=True)
    except (ValueError, BetterError) as error:
        return "", f"answer: is not JSON ({one_line(error, most=120)})"
    name = found.get("template") if isinstance(found, dict) else None
    if isinstance(name, str) and name in TEMPLATES:
        return name, ""
    return "", str(UnknownNameError("template", name if isinstance(name, str) else "", TEMPLATES))
