"""Scenarios: templates filled in with an instruction, a context and described objects."""

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class DescribedObject:
    """Object of a scenario, before an asset is chosen for it.

    Attributes:
        description: Appearance in words ("a shiny red apple").
        asset_query: Words to search the catalogue for.
        instance_name: Name that is unique in the scenario ("apple_red").
        mass_kg: Estimated range of the mass [kg].
        size_m: Estimated range of the largest dimension [m].
        tags: Additional words, such as a material.
    """

    description: str
    asset_query: str
    instance_name: str
    mass_kg: tuple[float, float]
    size_m: tuple[float, float]
    tags: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Scenario:
    """Template that a language model or the grammar has filled in.

    Attributes:
        template: Name of the template.
        name: Name of the scenario ("Making a ham sandwich").
        instruction: Sentence that states the goal without listing the steps ("Make a ham sandwich on the plate.").
        context: Place or situation ("kitchen").
        groups: Objects by the ``group_id`` of the template's object groups.
    """

    template: str
    name: str
    instruction: str
    context: str
    groups: Mapping[str, tuple[DescribedObject, ...]]
