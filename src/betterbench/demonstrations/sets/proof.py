"""Check that a record demonstrates its training distribution and nothing outside of it."""

from __future__ import annotations

from dataclasses import dataclass

from betterbench.demonstrations.making.attempt import outside_support
from betterbench.demonstrations.shortcuts.facts import EpisodeFacts, facts_of_record
from betterbench.demonstrations.shortcuts.shown import conditions_shown
from betterbench.errors import RecordError
from betterbench.records import Record, subgoal_segments
from betterbench.tasks import Condition, Expected, Task, get_task
from betterbench.tasks.authoring.training_distribution import pairing
from betterbench.tasks.interventions.regimes import Regime, conditions_of
from betterbench.tasks.randomness import FIRST_DEMONSTRATION_SEED

CURE = "Delete the file and run the command again to repeat the demonstration"


@dataclass(frozen=True, slots=True)
class RegimeBounds:
    """Conditions that a training set may demonstrate, and test conditions that it must not demonstrate."""

    shown: tuple[Condition, ...]
    forbidden: tuple[Condition, ...]

    @classmethod
    def of(cls, task: Task, regime: Regime) -> RegimeBounds:
        """Return the bounds for a set that demonstrates the given training distribution of a task."""
        shown = conditions_of(task, regime)
        known = {pairing(condition) for condition in shown}
        tests = conditions_of(task, "covered")
        return cls(shown, tuple(c for c in tests if pairing(c) not in known))


def proven_facts(record: Record, bounds: RegimeBounds, where: str) -> EpisodeFacts:
    """Check that a record demonstrates its training distribution and nothing outside of it.

    Return the facts about the record for the shortcut audit.

    The initial state, the order of the subgoals, the grasps and the releases are computed from the recorded states.

    Raises:
        RecordError: If the record has a test seed, is not successful, has a different initial state or order of
            subgoals than its condition, demonstrates a test condition, or contains a pick or placement outside the
            certified training support.
    """
    meta = record.metadata
    if meta.seed < FIRST_DEMONSTRATION_SEED:
        raise _refusal(where, f"its seed {meta.seed} is a test seed")
    if not record.outcome.success:
        raise _refusal(where, "it did not succeed")
    found = [c for c in conditions_shown(record, bounds.shown) if c.name == meta.condition]
    if not found:
        raise _refusal(where, f"its initial state or instruction differs from that of {meta.task}/{meta.condition}")
    tests = conditions_shown(record, bounds.forbidden)
    if tests:
        raise _refusal(where, f"it demonstrates the test condition {tests[0].id}")
    condition = found[0]
    segments = subgoal_segments(record, condition)
    done = [segment.subgoal for segment in segments if segment.subgoal]
    goals = zip(condition.instruction.subgoals, record.subgoals[0], strict=True)
    asked = [goal.name for goal, there in goals if not there] if condition.expected is Expected.SUCCEED else []
    in_order = done == asked if condition.instruction.ordered else sorted(done) == sorted(asked)
    if asked and not in_order:
        raise _refusal(where, f"its subgoals are {', '.join(done) or 'none'} instead of {', '.join(asked)}")
    outside = outside_support(record.states(), get_task(meta.task), condition)
    if outside is not None:
        raise _refusal(where, outside)
    return facts_of_record(record, condition)


def _refusal(where: str, problem: str) -> RecordError:
    return RecordError(f"{where}: it is not a demonstration of this training distribution: {problem}. {CURE}.")
