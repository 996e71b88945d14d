"""JSON form of scenarios, with the fields of the prompt in the paper (appendix B.1).

Answers of a language model contain only the fields of the paper. Stored scenarios also contain the format version and
the template. Strings may contain only letters, digits and plain punctuation, because they come from a model and must
not contain markup, control characters or paths.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field, TypeAdapter

from betterbench.errors import UnknownNameError
from betterbench.generation.scenario import DescribedObject, Scenario
from betterbench.json_form import NO_TRUTH, read_form, strict_form
from betterbench.tasks.authoring.template_form import ascending
from betterbench.tasks.authoring.templates import TEMPLATES

SCHEMA_VERSION = 1
"""Format version of stored scenarios."""

CURE = "Write the scenario as docs/generating.md describes"

NAME_PATTERN = r"^[a-z][a-z0-9_]{0,40}$"
"""Pattern of instance names, which are also the names of the objects in a scene."""

LONGEST_NAME, LONGEST_INSTRUCTION, LONGEST_DESCRIPTION, LONGEST_QUERY, LONGEST_TAG = 60, 200, 120, 60, 30
"""Maximum length of each kind of text in a scenario [characters]."""
MOST_GROUPS, MOST_OBJECTS, MOST_TAGS = 8, 12, 8
"""Maximum numbers of groups per scenario, objects per group, and tags per object."""
LARGEST_M, HEAVIEST_KG = 2.0, 50.0
"""Upper bounds of the size [m] and the mass [kg] in a scenario.

The limits of the robot are checked in :mod:`~betterbench.generation.sense`.
"""

_PUNCTUATION = frozenset(" ,.'-()%:")


def plain_text(text: str) -> str:
    """Check that a string contains only Latin letters, digits and plain punctuation, and return it.

    Raise ValueError for any other string.
    """
    for letter in text:
        latin = letter.isalpha() and letter <= "\u024f"
        if not (latin or (letter.isascii() and letter.isdigit()) or letter in _PUNCTUATION):
            raise ValueError(
                f"contains {letter!r} (U+{ord(letter):04X}); write letters, digits, spaces and , . ' - ( ) % : only"
            )
    if not any(letter.isalpha() for letter in text):
        raise ValueError("has no letter; write words")
    if text != " ".join(text.split()):
        raise ValueError("has spaces at an end or repeated spaces; write single spaces between words")
    return text


_Plain = Annotated[str, AfterValidator(plain_text)]
_Name = Annotated[_Plain, Field(min_length=1, max_length=LONGEST_NAME)]
_Tag = Annotated[_Plain, Field(min_length=1, max_length=LONGEST_TAG)]
_Mass = Annotated[float, NO_TRUTH, Field(gt=0.0, le=HEAVIEST_KG)]
_Size = Annotated[float, NO_TRUTH, Field(gt=0.0, le=LARGEST_M)]


@strict_form
@dataclass(frozen=True, slots=True)
class _Object:
    description: Annotated[_Plain, Field(min_length=1, max_length=LONGEST_DESCRIPTION)]
    asset_query: Annotated[_Plain, Field(min_length=1, max_length=LONGEST_QUERY)]
    instance_name: Annotated[str, Field(pattern=NAME_PATTERN)]
    estimated_mass: Annotated[tuple[_Mass, _Mass], AfterValidator(ascending)]
    estimated_size: Annotated[tuple[_Size, _Size], AfterValidator(ascending)]
    tags: Annotated[tuple[_Tag, ...], Field(max_length=MOST_TAGS)] = ()


_Objects = Annotated[tuple[_Object, ...], Field(max_length=MOST_OBJECTS)]
_Groups = Annotated[dict[str, _Objects], Field(min_length=1, max_length=MOST_GROUPS)]


@strict_form
@dataclass(frozen=True, slots=True)
class _Answer:
    scenario_name: _Name
    instruction: Annotated[_Plain, Field(min_length=1, max_length=LONGEST_INSTRUCTION)]
    scene_context: _Name
    instantiation: _Groups


@strict_form
@dataclass(frozen=True, slots=True, kw_only=True)
class _Stored(_Answer):
    schema_version: Annotated[Literal[1], NO_TRUTH]
    template: str


_ANSWER, _STORED = TypeAdapter(_Answer), TypeAdapter(_Stored)


def scenario_to_json(scenario: Scenario) -> dict[str, Any]:
    """Return a scenario as a JSON-serializable dict."""
    return {"schema_version": SCHEMA_VERSION, "template": scenario.template, **answer_to_json(scenario)}


def answer_to_json(scenario: Scenario) -> dict[str, Any]:
    """Return a scenario as a JSON-serializable dict in the format of a model's answer.

    It contains only the fields that the paper defines.
    """
    return {
        "scenario_name": scenario.name,
        "instruction": scenario.instruction,
        "scene_context": scenario.context,
        "instantiation": {
            group: [
                {
                    "description": o.description,
                    "asset_query": o.asset_query,
                    "instance_name": o.instance_name,
                    "estimated_mass": list(o.mass_kg),
                    "estimated_size": list(o.size_m),
                    "tags": list(o.tags),
                }
                for o in objects
            ]
            for group, objects in scenario.groups.items()
        },
    }


def scenario_from_json(form: Mapping[str, Any] | bytes | str, *, where: str = "scenario") -> Scenario:
    """Parse a stored scenario.

    Args:
        form: JSON as bytes or text, or a parsed value.
        where: File or location of the scenario, for error messages.

    Raises:
        InvalidInputError: If a field is missing, unknown, of the wrong type or out of range.
        UnknownNameError: If the template does not exist.
    """
    read = read_form(_STORED, form, where=where, cure=CURE)
    if read.template not in TEMPLATES:
        raise UnknownNameError(f"template in {where}", read.template, TEMPLATES)
    return _scenario(read, read.template)


def scenario_from_answer(form: object, template: str, *, where: str = "scenario") -> Scenario:
    """Parse a scenario in the format that the prompt requests from a model.

    Args:
        form: JSON as bytes or text, or a parsed value.
        template: Name of the template.
        where: Location of the scenario in the answer, for error messages.

    Raises:
        InvalidInputError: If a field is missing, unknown, of the wrong type or out of range.
    """
    return _scenario(read_form(_ANSWER, form, where=where, cure="Correct this field"), template)


def _scenario(read: _Answer, template: str) -> Scenario:
    groups = {
        group: tuple(
            DescribedObject(
                o.description, o.asset_query, o.instance_name, o.estimated_mass, o.estimated_size, tuple(o.tags)
            )
            for o in objects
        )
        for group, objects in read.instantiation.items()
    }
    return Scenario(template, read.scenario_name, read.instruction, read.scene_context, groups)
