"""Parser of instructions. It finds the objects that the nouns refer to, and the relations between these objects."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from betterbench.generation.measures import footprint
from betterbench.generation.scenario import DescribedObject, Scenario
from betterbench.generation.sentence_words import (
    DETERMINERS,
    NUMBERS,
    STOPS,
    color_before,
    is_plural_form,
    number_before,
    raw_tokens,
    sentence_tokens,
    words_of_object,
)
from betterbench.generation.stated_goal.direction import read_text
from betterbench.generation.stated_goal.relations import (
    GATHERED,
    HOLES,
    LONGEST_RELATION,
    POSITIONS,
    PRONOUNS,
    RELATIONS,
    RING_OR_SPOUT,
    SIDES,
    SURFACES,
)
from betterbench.generation.vocabulary import collective, head_nouns, known_nouns, nouns_of
from betterbench.sim.assets import categories
from betterbench.sim.assets.catalogue.expansion import COLORS
from betterbench.sim.assets.catalogue.terms import terms
from betterbench.tasks.authoring.templates import TEMPLATES


@dataclass(frozen=True, slots=True)
class Mention:
    """Noun in an instruction that may refer to objects.

    Attributes:
        at: Index of the noun's first token.
        end: Index after the noun's last token.
        objects: Names of the objects that the noun may refer to.
        number: Stated number of objects. If no number is stated, 2 for a plural and 0 for a singular.
    """

    at: int
    end: int
    objects: tuple[str, ...]
    number: int


@dataclass(frozen=True, slots=True)
class Said:
    """Relation that an instruction states.

    Attributes:
        words: Words of the relation ("to the left of").
        meaning: Meaning of the relation ("left").
        subjects: Nouns before the relation that do not belong to an earlier relation.
        target: Noun after the relation, or None if a place or nothing follows.
        place: Place after the relation ("table", "ring"), or "it" for a pronoun. Empty if there is none.
        position: Word that specifies the hole ("left"), or a part of the target ("ring").
    """

    words: str
    meaning: str
    subjects: tuple[Mention, ...]
    target: Mention | None
    place: str
    position: str


class Reader:
    """Parsed words of an instruction, with the objects that they refer to.

    Attributes:
        objects: Objects of the scenario by name. ``role_of`` contains the role of each object.
        surfaces: Words for the surface that all objects stand on, such as the table.
        raw: Words in lower case. ``tokens`` are the same words in the singular.
        mentions: Nouns by the index of their first token. ``taken`` contains the indices of all tokens that belong to
            nouns.
        positions: Indices of words such as "left" that belong to no relation, set by :meth:`relations`.
    """

    def __init__(self, scenario: Scenario) -> None:
        self.scenario = scenario
        self.roles = {group.group_id: group.role for group in TEMPLATES[scenario.template].groups}
        self.objects = {o.instance_name: o for objects in scenario.groups.values() for o in objects}
        self.role_of = {
            o.instance_name: self.roles.get(g, "item") for g, objects in scenario.groups.items() for o in objects
        }
        self.surfaces = SURFACES | frozenset(terms(scenario.context))
        text = read_text(scenario)
        self.raw = raw_tokens(text)
        self.tokens = sentence_tokens(text)
        self.mentions = {mention.at: mention for mention in self._mentions()}
        self.taken = {i for mention in self.mentions.values() for i in range(mention.at, mention.end)}
        self.positions: list[int] = []

    def _mentions(self) -> Iterator[Mention]:
        """Yield the nouns that may refer to objects, in order."""
        known = dict(known_nouns(self.tokens))
        taken = {i for at, noun in known.items() for i in range(at, at + len(noun))}
        heads = {terms(o.asset_query)[-1] for o in self.objects.values() if terms(o.asset_query)}
        for i, word in enumerate(self.tokens):
            if i not in taken and word in heads:
                known[i] = (word,)
        for at, noun in sorted(known.items()):
            end = at + len(noun)
            number = self._number(at, end)
            if at or number:  # "File the papers." begins with a verb
                yield Mention(at, end, self._meant(at, noun), number)

    def _number(self, at: int, end: int) -> int:
        """Return the stated number of objects. Without a number, return 2 for a plural and 0 otherwise."""
        said = number_before(self.raw, at)
        if said:
            return NUMBERS[said]
        return 2 if is_plural_form(self.raw[end - 1]) else 0

    def _meant(self, at: int, noun: tuple[str, ...]) -> tuple[str, ...]:
        """Return the names of the objects that a noun may refer to.

        If the noun occurs in the name of an object, objects with the noun only in their description are left out.
        """
        alias = {"top": "upper", "bottom": "lower"} if noun[-1] == "drawer" else {}
        words = [alias.get(word, word) for word in noun]
        last, color = words[-1], color_before(self.tokens, at)

        def tiers(o: DescribedObject) -> Iterator[bool]:
            query = terms(o.asset_query)
            yield query[-1:] == [last]
            yield last in query or last in terms(o.instance_name.replace("_", " "))
            yield last in words_of_object(o)

        found = self._members(noun[-1]) or self._of_type(noun)
        for tier in zip(*(tuple(tiers(o)) for o in self.objects.values()), strict=True):
            found = found or [name for name, fits in zip(self.objects, tier, strict=True) if fits]
        for wanted in (words[:-1], [color] if color else []):
            narrowed = [name for name in found if wanted and set(wanted) <= words_of_object(self.objects[name])]
            found = narrowed or found
        return tuple(found)

    def _members(self, noun: str) -> list[str]:
        """Return the items that a collective noun refers to, such as the jars for "spices"."""
        members = collective(noun)
        items = (o for name, o in self.objects.items() if self.role_of[name] == "item")
        return [o.instance_name for o in items if members & {*head_nouns(o.asset_query), *head_nouns(o.description)}]

    def _of_type(self, noun: tuple[str, ...]) -> list[str]:
        """Return the container, fixture or drawers whose type a noun names, such as "trash can" for a waste bin."""
        groups = TEMPLATES[self.scenario.template].groups
        receivers = [group for group in groups if group.role in ("container", "fixture", "drawer")]
        named = [g.group_id for g in receivers if any(noun in nouns_of(allowed) for allowed in g.allowed_types)]
        return [o.instance_name for group_id in named for o in self.scenario.groups.get(group_id, ())]

    def relations(self) -> Iterator[Said]:
        """Yield the relations in the instruction.

        Each relation comes with the nouns before it that belong to no earlier relation.
        """
        pending: list[Mention] = []
        at = 0
        while at < len(self.tokens):
            length = self._relation_length(at)
            if length:
                meaning = RELATIONS[tuple(self.tokens[at : at + length])]
                target, place, position, end = self._target(at + length)
                side = self._side_at(end) if meaning == "beside" and (target is not None or place == "it") else None
                if side is not None:
                    meaning, end = side
                    length = end - at
                if not self._is_idiom(at, meaning, place):
                    words = " ".join(self.raw[at : at + length])
                    yield Said(words, meaning, tuple(pending), target, place, position)
                    if place not in self.surfaces:
                        pending = []
                at = end
            elif self.tokens[at] in ("with", "put", "place", "set"):
                pending = [m for m in pending if self.is_item(m)]
                at += 1
            elif at in self.mentions:
                pending.append(self.mentions[at])
                at = self.mentions[at].end
            else:
                if at and self.tokens[at] in POSITIONS:
                    self.positions.append(at)
                at += 1

    def _relation_length(self, at: int) -> int:
        lengths = range(min(LONGEST_RELATION, len(self.tokens) - at), 0, -1)
        # "on the bottom" is not a relation in "on the bottom bun"
        free = (n for n in lengths if at not in self.taken and at + n - 1 not in self.taken)
        return next((n for n in free if tuple(self.tokens[at : at + n]) in RELATIONS), 0)

    def _side_at(self, at: int) -> tuple[str, int] | None:
        """Return the side stated at a position, as in "next to the plate on the left", and the index after it.

        Return None if no side is stated there.
        """
        length = self._relation_length(at)
        meaning = RELATIONS[tuple(self.tokens[at : at + length])] if length else ""
        if meaning not in SIDES or self._target(at + length)[:2] != (None, ""):
            return None
        return meaning, at + length

    def _is_idiom(self, at: int, meaning: str, place: str) -> bool:
        """Return whether the words of a relation are part of an idiom ("to go", "in one pile")."""
        following = self.tokens[at + 1] if at + 1 < len(self.tokens) else ""
        return (self.tokens[at] == "to" and following == "go") or (meaning == "in" and place in GATHERED)

    def _target(self, at: int) -> tuple[Mention | None, str, str, int]:
        """Return the target that follows a relation.

        Returns:
            The noun, the place, the position word before "hole", and the index of the token after the target.
        """
        position = place = ""
        i = at
        while i < len(self.tokens):
            word = self.tokens[i]
            if i in self.mentions and self.mentions[i].objects:
                end = self.mentions[i].end
                if self.tokens[end : end + 1] == ["s"] and RING_OR_SPOUT & set(self.tokens[end + 1 : end + 2]):
                    return self.mentions[i], "", self.tokens[end + 1], end + 2  # "the machine's ring"
                return self.mentions[i], "", position, end
            if word == "of" and place:
                place_before, place = place, ""
                position = place_before if place_before in RING_OR_SPOUT else position
                i += 1
                continue
            if word in PRONOUNS:
                return None, "it", position, i + 1
            if (word in STOPS and word not in POSITIONS) or word in (",", ".") or self._relation_length(i) > 1:
                break
            if word in HOLES and self._before_hole(i):
                position = word
            elif word not in DETERMINERS and word not in COLORS:
                place = word
                self.positions += [i] if word in POSITIONS else []
            i += 1
        return None, place, position, i

    def _before_hole(self, at: int) -> bool:
        return "hole" in self.tokens[at + 1 : at + 3] or "slot" in self.tokens[at + 1 : at + 3]

    def is_item(self, mention: Mention) -> bool:
        """Return whether a noun may refer to an object that is moved."""
        return any(self.role_of[name] in ("item", "distractor") for name in mention.objects)

    def is_on_surface(self, said: Said) -> bool:
        """Return whether a relation only states that an object is on the table or a similar surface."""
        return said.target is None and said.place in self.surfaces and said.meaning in ("on", "in", "at", "from")

    def receiver(self, said: Said) -> bool:
        """Return whether the target of a relation is a container, fixture, drawer, or a pronoun for one of these."""
        if said.target is not None:
            return any(self.role_of[n] in ("container", "fixture", "drawer") for n in said.target.objects)
        return said.place == "it" and any(
            self.role_of[n] in ("container", "fixture", "drawer") for m in self.mentions.values() for n in m.objects
        )

    def moved(self, said: Said) -> str:
        """Return the reason why a relation is rejected, or an empty string.

        A relation is rejected if it moves an object that is not an item.
        """
        wrong = [m for m in said.subjects if m.objects and not self.is_item(m)]
        return f"the {self.raw[wrong[0].end - 1]} is not moved" if wrong else ""

    def sides(self) -> tuple[str, ...]:
        """Return the sides that the anchor has. If its category is not known yet, return all sides."""
        (anchor,) = self.scenario.groups["anchor"] or (None,)
        category = "_".join(anchor.tags[0].split()) if anchor is not None and anchor.tags else ""
        offered = footprint(category).regions if category in categories() else frozenset(SIDES)
        return tuple(side for side in SIDES if side in offered)
