"""Authors that propose the next scenario of a growing suite: the grammar, or a language model."""

from __future__ import annotations

import functools
import itertools
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np

from betterbench.errors import BetterError, one_line
from betterbench.generation.asking import KeptChat, Request, ask_for_scenario
from betterbench.generation.grammar import grammar_of, nouns_of_library
from betterbench.generation.grammar.author import scenario_of
from betterbench.generation.grammar.theme import Choice, Theme
from betterbench.generation.growth.likeness import Distinct, key_of_choice, key_of_scenario
from betterbench.generation.growth.proposals import Outcome, Proposal
from betterbench.generation.scenario import Scenario
from betterbench.sim.assets.catalogue.search import Catalogue
from betterbench.tasks.authoring.templates import TEMPLATES

SAMPLED = 48
"""Maximum number of random color choices compared for a goal. The choice with the least-used colors is taken."""
COMPARED = 400
"""Maximum number of goals compared for a context. The goal least similar to earlier goals is taken."""
PATIENCE = 5
"""Number of consecutive answers without a new scenario after which a template is considered exhausted."""


class Cell(NamedTuple):
    """Template and context of a requested scenario. If the context is empty, any context is allowed."""

    template: str
    context: str


@dataclass(frozen=True, slots=True)
class Proposed:
    """Scenario that an author proposes, or the reason why there is none.

    Attributes:
        outcome: "drawn" if the scenario can be built, or else the category of the problem.
        scenario: The scenario. None if the author wrote none.
        key: Key that is equal for near-duplicates of the scenario. Empty if it is unknown.
        problem: Reason why the scenario cannot be built.
    """

    outcome: Outcome
    scenario: Scenario | None
    key: str = ""
    problem: str = ""


class Source(Protocol):
    """Author that proposes the next scenario for a growing suite.

    It also reports the scenarios that it can write, see :class:`~.quotas.Supply`.
    """

    @property
    def templates(self) -> Sequence[str]:
        """Names of the templates that the author can use."""

    def contexts(self) -> Collection[str] | None:
        """Return the contexts of the scenarios, or None if any context is possible."""

    def goals(self, templates: Collection[str], context: str | None = None) -> int | None:
        """Return the number of scenarios with different goals, or None if it is unlimited."""

    def cells(self) -> Sequence[Cell]:
        """Return the pairs of template and context for which a new scenario may exist. The order is fixed."""

    def propose(self, cell: Cell, number: int) -> Proposed:
        """Return a new scenario for a template and context. ``number`` is unique to this proposal."""

    def take(self, proposal: Proposal) -> None:
        """Register a proposal that was made now or read from the journal."""


class OfflineSource:
    """Author that uses the grammar. Each goal is used only once. Goals with the least-used categories come first.

    Args:
        templates: Names of the templates that the author uses.
        seed: Seed of all draws.
        distinct: Definition of near-duplicate scenarios: their objects have the same categories ("categories"), or the
            same categories and colors ("colors").
        known: Keys of existing tasks. Near-duplicates of these tasks are left out.
    """

    def __init__(
        self, templates: Sequence[str], *, seed: int = 0, distinct: Distinct = "categories", known: Collection[str] = ()
    ) -> None:
        self._templates, self._seed = tuple(templates), seed
        self._left: dict[Cell, list[str]] = {}
        self._choices: dict[tuple[Cell, str], tuple[tuple[Theme, Choice], ...]] = {}
        self.scenarios: Counter[str] = Counter()
        for template in self._templates:
            rng = np.random.default_rng([seed, *template.encode()])
            found = _choices_of(template, distinct)
            self._choices |= found
            for (_, key), choices in found.items():
                self.scenarios[key] += len(choices)
            for cell in dict.fromkeys(cell for cell, _ in found):
                keys = [key for owner, key in found if owner == cell]
                self._left[cell] = [keys[i] for i in rng.permutation(len(keys))]
        self.known = frozenset(known) & self.scenarios.keys()
        self._done = set(self.known)
        self._uses: Counter[tuple[str, str]] = Counter()

    @property
    def templates(self) -> tuple[str, ...]:
        """Names of the templates that the author uses."""
        return self._templates

    def contexts(self) -> tuple[str, ...]:
        """Return the contexts of all themes."""
        return tuple(dict.fromkeys(cell.context for cell in self._left))

    def goals(self, templates: Collection[str], context: str | None = None) -> int:
        """Return the number of different goals. Goals of existing tasks are not counted."""
        keys = {
            key
            for cell, key in self._choices
            if cell.template in templates and context in (None, cell.context) and key not in self.known
        }
        return len(keys)

    def cells(self) -> list[Cell]:
        """Return the pairs of template and context for which at least one goal has not been drawn yet."""
        for cell, keys in self._left.items():
            if any(key in self._done for key in keys[:COMPARED]):
                self._left[cell] = [key for key in keys if key not in self._done]
        return [cell for cell, keys in self._left.items() if keys]

    def propose(self, cell: Cell, number: int) -> Proposed:
        """Return the scenario with the least-used categories and colors for a template and context."""
        fresh = itertools.islice((key for key in self._left[cell] if key not in self._done), COMPARED)
        key = min(fresh, key=lambda k: self._cost(cell, self._choices[cell, k][0][1], colored=False))
        rng = np.random.default_rng([self._seed, number, *cell.template.encode()])
        every = self._choices[cell, key]
        sample = rng.choice(len(every), size=min(SAMPLED, len(every)), replace=False)
        theme, choice = min((every[i] for i in sample), key=lambda found: self._cost(cell, found[1], colored=True))
        return Proposed("drawn", scenario_of(cell.template, theme, choice, rng), key)

    def _cost(self, cell: Cell, choice: Choice, *, colored: bool) -> float:
        """Return the average number of times that the categories in a choice were used before.

        If ``colored`` is set, pairs of category and color are counted instead of categories.
        """
        names = [" ".join(kind) if colored else kind[0] for kinds in choice.values() for kind in kinds]
        return sum(self._uses[cell.template, name] for name in names) / len(names)

    def take(self, proposal: Proposal) -> None:
        """Register a proposal, so that no other scenario with the same goal is drawn."""
        self._done.add(proposal.key)
        if proposal.scenario is None:
            return
        for objects in proposal.read().groups.values():
            for described in objects:
                category, color = described.tags[0].replace(" ", "_"), described.tags[1]
                self._uses.update([(proposal.template, category), (proposal.template, f"{category} {color}")])


@functools.cache
def _choices_of(template: str, distinct: Distinct) -> Mapping[tuple[Cell, str], tuple[tuple[Theme, Choice], ...]]:
    """Return all choices of objects for a template, by context and goal.

    This takes two seconds for all templates together.
    """
    found: dict[tuple[Cell, str], list[tuple[Theme, Choice]]] = {}
    for theme in grammar_of(template).themes:
        cell = Cell(template, theme.context)
        for choice in theme.choices():
            found.setdefault((cell, key_of_choice(template, choice, distinct)), []).append((theme, choice))
    return {place: tuple(choices) for place, choices in found.items()}


class ModelSource:
    """Author that uses a language model.

    Args:
        templates: Names of the templates that the author uses.
        chat: Model with its stored exchanges.
        catalogue: Catalogue that is searched for the assets of a scenario, to detect near-duplicates.
        contexts: Contexts that may be requested. A request may also leave the context to the model.
        tries: Maximum number of answers requested per scenario.
        open_vocabulary: Whether the model may use objects that are not in the library.
        distinct: Definition of near-duplicate scenarios: their objects have the same categories ("categories"), or the
            same categories and colors ("colors").
        known: Names of existing tasks, by their near-duplicate key.
    """

    def __init__(
        self,
        templates: Sequence[str],
        chat: KeptChat,
        catalogue: Catalogue,
        *,
        contexts: Sequence[str] = (),
        tries: int = 3,
        open_vocabulary: bool = False,
        distinct: Distinct = "categories",
        known: Mapping[str, str] | None = None,
    ) -> None:
        self._templates, self._chat, self._catalogue = tuple(templates), chat, catalogue
        self._contexts, self._tries, self._open, self._distinct = tuple(contexts), tries, open_vocabulary, distinct
        self._names: dict[str, str] = dict(known or {})
        self._written: dict[str, list[Scenario]] = {template: [] for template in templates}
        self._misses: Counter[str] = Counter()

    @property
    def templates(self) -> tuple[str, ...]:
        """Names of the templates that the author uses."""
        return self._templates

    def contexts(self) -> None:
        """Return None, because a model may write any context."""

    def goals(self, templates: Collection[str], context: str | None = None) -> None:
        """Return None, because the number of goals is not known."""

    def cells(self) -> list[Cell]:
        """Return the pairs of template and context that can be requested.

        Exhausted templates are left out. The others are paired with each allowed context, and with an empty string,
        which stands for any context.
        """
        left = [template for template in self._templates if self._misses[template] < PATIENCE]
        return [Cell(template, context) for template in left for context in ("", *self._contexts)]

    def propose(self, cell: Cell, number: int) -> Proposed:
        """Have the model write a scenario for a template and context.

        Raises:
            ModelError: If the model cannot be reached; earlier exchanges are kept.
        """
        vocabulary = None if self._open else nouns_of_library(cell.template)
        request = Request(TEMPLATES[cell.template], "", vocabulary, self._written[cell.template], cell.context)
        scenario, problem = ask_for_scenario(request, self._chat, number, tries=self._tries)
        if scenario is None:
            return Proposed("refused", None, problem=problem)
        try:
            key = key_of_scenario(scenario, self._catalogue, self._distinct)
        except BetterError as error:
            return Proposed("refused", scenario, problem=one_line(str(error), most=600))
        if key in self._names:
            return Proposed("near_duplicate", scenario, key, f"has the goal of {self._names[key]}")
        return Proposed("drawn", scenario, key)

    def take(self, proposal: Proposal) -> None:
        """Register a proposal.

        Later scenarios must differ from the proposed one. After repeated failures, the template is treated as
        exhausted.
        """
        self._misses[proposal.template] = 0 if proposal.is_drawn else self._misses[proposal.template] + 1
        if proposal.scenario is not None:
            self._written[proposal.template].append(proposal.read())
        if proposal.is_drawn:
            self._names[proposal.key] = proposal.task_id
