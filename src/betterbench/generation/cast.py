"""Casts: scenarios with an asset chosen for each described object."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from betterbench.errors import InvalidInputError
from betterbench.generation.scenario import Scenario
from betterbench.tasks.condition import ObjectSpec


@dataclass(frozen=True, slots=True)
class Cast:
    """Scenario with an asset for each description.

    Attributes:
        scenario: Scenario with the descriptions of the objects.
        groups: Chosen objects by ``group_id``, in the order of the descriptions. An object's ``name`` is the
            ``instance_name`` of its description. Its ``kind`` is its noun phrase in instructions, without an article.
            The kind is unique in the cast: "red mug" if the cast contains a blue mug too, or else "mug".
        look_alikes: Look-alikes of each item, by the item's name. They are distractors of other categories with the
            same color or shape, starting with the most similar one. The names and kinds of these distractors are unique
            too.
        seed: Seed for all choices that the descriptions do not determine.
    """

    scenario: Scenario
    groups: Mapping[str, tuple[ObjectSpec, ...]]
    look_alikes: Mapping[str, tuple[ObjectSpec, ...]] = field(default_factory=dict)
    seed: int = 0

    def one(self, group_id: str) -> ObjectSpec:
        """Return the only object of a cast group.

        Raises:
            InvalidInputError: If the group does not have exactly one object.
        """
        objects = self.groups.get(group_id, ())
        if len(objects) != 1:
            raise InvalidInputError(
                f"cast group {group_id!r}", f"has {len(objects)} objects", "Choose exactly one object"
            )
        return objects[0]
