"""Prompt that requests scenarios.

It has the same inputs and outputs as the paper's prompt (appendix B.1), but a different wording.

Unlike the paper's prompt, this prompt requests one scenario at a time, so that answers are short and rejected
scenarios are corrected in separate conversations.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence

from betterbench.generation.instruction_sense import MOST_WORDS
from betterbench.generation.scenario import Scenario
from betterbench.generation.scenario_form import NAME_PATTERN
from betterbench.tasks.authoring.template import Template
from betterbench.tasks.authoring.template_form import template_to_json
from betterbench.vqa.llm import Message

PROMPT_ID = "betterbench-scenario-1"
"""Identifier of the prompt's wording, which is stored with each exchange. Change it whenever the wording changes."""

MAX_TOKENS = 2048
"""Maximum length of an answer [tokens]. A scenario takes about 600 tokens."""

SYSTEM = f"""You write scenarios for a benchmark of robot manipulation in simulation. A robot arm with a two-finger
gripper stands at a table. A template describes an abstract interaction; you fill it with an everyday situation and with
concrete objects.

You get a template as JSON. Its "meta" describes the interaction, the start and the goal. Its "object_groups" each
have a "group_id", a "description", the "allowed_types" of objects, and a "count_range" [fewest, most].

Write scenarios of this template. For each of them:
- Think of a real situation in which a person would do this, and of the objects that are part of it.
- Fill each object group with as many objects as its count_range allows, each of one of the allowed_types. A group whose
  count_range begins with 0 may be left empty. The objects belong together in this situation.
- Choose objects that the robot can handle: the gripper opens 8 cm, so each object that is moved has a part thinner than
  that; a moved object is at most 25 cm long and weighs at most 2 kg. A container is larger than what goes into it.
- Write the instruction as one plain English sentence in the imperative that states the goal. Do not list the steps or
  their order. Mention only objects that you give. Use at most {MOST_WORDS} words and end with a period.
- Estimate for each object the mass in kilograms and the largest dimension in meters, each as a range [low, high].

Answer with JSON only, without any other text: a list of objects with exactly these fields.
[
  {{
    "scenario_name": "a short name, such as 'Packing a hiking lunch'",
    "instruction": "the sentence for the robot, such as 'Pack the hiking lunch into the box.'",
    "scene_context": "the place or situation, such as 'kitchen'",
    "instantiation": {{
      "<group_id>": [
        {{
          "description": "the look of the object, such as 'A small red apple'",
          "asset_query": "words to search a catalogue of 3D models for, such as 'red apple'",
          "instance_name": "a name used once, matching {NAME_PATTERN}, such as 'red_apple'",
          "estimated_mass": [0.1, 0.2],
          "estimated_size": [0.06, 0.08],
          "tags": ["further words, such as a material or the allowed type"]
        }}
      ]
    }}
  }}
]
Use letters, digits and plain punctuation in all texts."""


def scenario_messages(
    template: Template,
    *,
    number: int,
    count: int = 1,
    sentence: str = "",
    context: str = "",
    vocabulary: Mapping[str, Sequence[str]] | None = None,
    written: Sequence[Scenario] = (),
) -> list[Message]:
    """Return the conversation that requests scenarios.

    Args:
        template: Template to fill.
        number: Number of the first scenario. It makes the request unique.
        count: Number of scenarios to write.
        sentence: Sentence of a user that the scenario must match. Empty if there is no sentence.
        context: Context that the scenario must have. Empty if any context is allowed.
        vocabulary: Allowed asset queries by object group. If it is None, any query is allowed.
        written: Existing scenarios, which must not be repeated.
    """
    parts = [
        f"Template:\n{json.dumps(template_to_json(template), indent=1)}",
        f"Write {count} {'scenario' if count == 1 else 'scenarios'}, beginning with number {number}.",
    ]
    if sentence:
        parts.append(f"The scenario must be about this request, with all objects that it names:\n{sentence}")
    if context:
        parts.append(f"The scene_context must be:\n{context}")
    if vocabulary is not None:
        listed = "\n".join(f"- {group}: {', '.join(nouns)}" for group, nouns in vocabulary.items())
        parts.append(f"Use only these words as asset_query; leave groups that are not listed empty:\n{listed}")
    if written:
        parts.append(f"These exist already; choose other objects:\n{written_lines(written)}")
    return [{"role": "system", "content": SYSTEM}, _user("\n\n".join(parts))]


def written_lines(written: Sequence[Scenario]) -> str:
    """Return the names and the objects of scenarios as text, with one line per scenario."""
    return "\n".join(
        f"- {scenario.name}: {', '.join(o.asset_query for objects in scenario.groups.values() for o in objects)}"
        for scenario in written
    )


def correction(answer: str, problems: Sequence[str]) -> list[Message]:
    """Return the messages that send a rejected answer back to the model together with the problems of the answer."""
    listed = "\n".join(f"- {problem}" for problem in problems)
    cure = "Write the whole answer again, as JSON only, with these fields corrected."
    text = f"This answer was refused:\n{listed}\n\n{cure}"
    return [{"role": "assistant", "content": answer}, _user(text)]


def template_messages(sentence: str, templates: Sequence[Template]) -> list[Message]:
    """Return the messages that ask a model which template fits a sentence."""
    listed = "\n".join(f"- {t.name}: {t.description} {t.goal}" for t in templates)
    system = (
        "You choose the interaction template that fits a request to a robot arm at a table. Answer with JSON only: "
        '{"template": "<name>"}, or {"template": ""} if none fits.'
    )
    return [
        {"role": "system", "content": system},
        _user(f"Templates:\n{listed}\n\nRequest:\n{sentence}"),
    ]


def _user(text: str) -> Message:
    """Return a user message with plain text content, so that text-only model servers accept it too."""
    return {"role": "user", "content": text}
