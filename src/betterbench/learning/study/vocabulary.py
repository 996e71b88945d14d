"""Words, object categories and colors of a variation that a learner has never seen in training.

A learner maps all unknown words, categories and colors to the same index. If a variation contains such unknown entries,
a failure shows missing knowledge rather than a shortcut. For this reason, there are separate results for the variations
without unknown entries.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from betterbench.policies.learned.vocabulary import Vocabulary
from betterbench.tasks import Condition, get_task
from betterbench.tasks.interventions import resolve_condition
from betterbench.tasks.interventions.regimes import Regime, conditions_of


def never_shown(regimes: Iterable[Regime], task: str, variation: str) -> tuple[str, ...]:
    """Return the words, categories and colors of a variation that are not in any condition of the given regimes.

    A regime is a training distribution.
    """
    return _missing(regimes, task, [resolve_condition(task, variation).condition])


def never_shown_before(regimes: Iterable[Regime], task: str, later: Iterable[Regime]) -> tuple[str, ...]:
    """Return the words, categories and colors that the later training distributions add to the earlier ones."""
    return _missing(regimes, task, _conditions(later, task))


def _conditions(regimes: Iterable[Regime], task: str) -> list[Condition]:
    return [condition for regime in regimes for condition in conditions_of(get_task(task), regime)]


def _missing(regimes: Iterable[Regime], task: str, asked: Sequence[Condition]) -> tuple[str, ...]:
    shown = _conditions(regimes, task)
    things = [spec for condition in shown for spec in condition.objects]
    known = Vocabulary.of(
        (condition.instruction.text for condition in shown),
        (spec.category for spec in things),
        (spec.color for spec in things if spec.color is not None),
    )
    words = (word for condition in asked for word in known.unknown_words(condition.instruction.text))
    new = [spec for condition in asked for spec in condition.objects]
    categories = (spec.category for spec in new if spec.category not in known.categories)
    colors = (spec.color for spec in new if spec.color is not None and spec.color not in known.colors)
    return tuple(dict.fromkeys((*words, *categories, *colors)))
