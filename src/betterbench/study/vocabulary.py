"""What of a variation a learner has never been shown: words of its instruction, categories and colors of its things.

A learner reads all of these as one number, that of the unknown. That it fails there is ignorance and no shortcut, so
variations of which everything has been shown are counted apart as well.
"""

from __future__ import annotations

from collections.abc import Iterable

from betterbench.interventions import resolve_condition
from betterbench.interventions.regimes import Regime, conditions_of
from betterbench.learned.vocabulary import Vocabulary
from betterbench.tasks import get_task


def never_shown(regimes: Iterable[Regime], task: str, variation: str) -> tuple[str, ...]:
    """Return the words, categories and colors of a variation that no condition of some regimes has, in that order."""
    shown = [condition for regime in regimes for condition in conditions_of(get_task(task), regime)]
    things = [spec for condition in shown for spec in condition.objects]
    known = Vocabulary.of(
        (condition.instruction.text for condition in shown),
        (spec.category for spec in things),
        (spec.color for spec in things if spec.color is not None),
    )
    test = resolve_condition(task, variation).condition
    words = known.unknown_words(test.instruction.text)
    categories = (spec.category for spec in test.objects if spec.category not in known.categories)
    colors = (spec.color for spec in test.objects if spec.color is not None and spec.color not in known.colors)
    return tuple(dict.fromkeys((*words, *categories, *colors)))
