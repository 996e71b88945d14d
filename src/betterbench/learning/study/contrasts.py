"""Success rates and gaps of groups of learners, and differences between two groups on the trials that both groups ran.

A learner is a policy that the study trains. An arm is a mixture of training distributions. The demonstrations for its
learners come from these distributions.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

from betterbench.learning.study.outcomes import LearnerOutcome, TrialOutcome
from betterbench.report.wording import Figure
from betterbench.statistics import (
    Difference,
    Rate,
    difference_of,
    paired_bootstrap,
    sign_flip_p,
    wider_paired_difference,
)
from betterbench.tasks import stream


@dataclass(frozen=True, slots=True)
class ArmFinding:
    """Results of the learners in one arm, on one task or on all tasks.

    Attributes:
        task: Task name; "" for all tasks.
        arm: Name of the arm.
        lever: Name of the change to the training recipe; "" for the unchanged recipe.
        training: Success rate on training conditions.
        variations: Success rate on all variations.
        gap: Illusion gap: success rate on the training twins (the training trials with the same seeds) minus success
            rate on the variations.
        intention: Fraction of the variation trials in which the first grasp attempt is at the right object.
    """

    task: str
    arm: str
    lever: str
    training: Figure
    variations: Figure
    gap: Figure
    intention: Figure


@dataclass(frozen=True, slots=True)
class ArmContrast:
    """Comparison between two groups of learners on the same trials. The second group is the baseline.

    Attributes:
        name: Name of the comparison.
        task: Task name; "" for all tasks.
        success: Difference between the success rates on variations, over pairs of trials. The p-value is from a
            sign-flip test over pairs of learners with the same task and training seed.
        gap: Difference between the illusion gaps. The interval is the wider of two intervals, one computed over trials
            and one over pairs of learners. The p-value is from the same kind of test.
        learners: Number of pairs of learners.
    """

    name: str
    task: str
    success: Figure
    gap: Figure
    learners: int


def success_of(trials: Iterable[TrialOutcome]) -> Figure:
    """Return the success rate over the given trials."""
    ended = [trial.success for trial in trials]
    return Figure.of_rate(Rate(sum(ended), len(ended)))


def gap_of(learners: Sequence[LearnerOutcome], variation: str | None = None) -> Difference:
    """Return the illusion gap of learners, computed over pairs of a variation trial and its training twin.

    The interval accounts for variations that share the same training trial.

    Args:
        learners: The learners with their trials.
        variation: Variation name; None for all variations.
    """
    pairs = [(f.learner, twin, trial) for f in learners for twin, trial in f.pairs(variation)]
    return wider_paired_difference(
        [(twin.success, trial.success) for _, twin, trial in pairs],
        generator=stream("study", 0, f"gap:{variation}"),
        strata=[learner.task for learner, _, _ in pairs],
        clusters=[f"{learner.name}/{twin.condition}/{twin.seed}" for learner, twin, _ in pairs],
    )


def figure_of(found: Difference, n: int, *, noun: str = "pairs", p_value: float | None = None) -> Figure:
    """Convert a difference over ``n`` pairs to a Figure. Without pairs, the value and the interval are None."""
    low, high = (found.low, found.high) if found.value is not None else (None, None)
    return Figure(found.value, low, high, None, n, difference=True, noun=noun, p_value=p_value)


def arm_of(task: str, arm: str, lever: str, chosen: Sequence[LearnerOutcome]) -> ArmFinding:
    """Return the results of an arm's learners.

    Args:
        task: Task name; "" for all tasks.
        arm: Name of the arm.
        lever: Name of the recipe change; "" for the unchanged recipe.
        chosen: The learners with their trials.
    """
    varied = [trial for f in chosen for trial in f.varied]
    known = [trial.intention for trial in varied if trial.intention is not None]
    pairs = sum(len(f.pairs()) for f in chosen)
    training = success_of(trial for f in chosen for trial in f.of(None))
    gap = figure_of(gap_of(chosen), pairs)
    return ArmFinding(
        task, arm, lever, training, success_of(varied), gap, Figure.of_rate(Rate(sum(known), len(varied)))
    )


def contrast_of(name: str, task: str, first: Sequence[LearnerOutcome], second: Sequence[LearnerOutcome]) -> ArmContrast:
    """Compare two groups of learners over pairs with the same task, the same training seed and the same trials.

    Args:
        name: Name of the comparison.
        task: Task name; "" for all tasks.
        first: First group.
        second: Second group, which is the baseline.
    """
    others = {(f.learner.task, f.learner.seed): f for f in second}
    pairs = [
        (f, others[key])
        for f in first
        if (key := (f.learner.task, f.learner.seed)) in others and task in ("", f.learner.task)
    ]
    trials = [(a.learner, x, y) for a, b in pairs for x, y in _same_trials(a, b)]
    success = wider_paired_difference(
        [(x.success, y.success) for _, x, y in trials],
        generator=stream("study", 0, f"contrast:{name}:{task}"),
        strata=[learner.task for learner, _, _ in trials],
        clusters=[learner.name for learner, _, _ in trials],
    )
    means = [(_mean_success(a), _mean_success(b)) for a, b in pairs]
    solved = sign_flip_p([x - y for x, y in means], generator=stream("study", 3, f"contrast:{name}:{task}"))
    gaps = [(a.learner.task, _mean_gap(a), _mean_gap(b)) for a, b in pairs]
    known = [(stratum, x, y) for stratum, x, y in gaps if x is not None and y is not None]
    p = sign_flip_p([x - y for _, x, y in known], generator=stream("study", 1, f"contrast:{name}:{task}"))
    drawn = paired_bootstrap(
        [0.5 + 0.5 * x for _, x, _ in known],
        [0.5 + 0.5 * y for _, _, y in known],
        generator=stream("study", 2, f"contrast:{name}:{task}"),
        strata=[stratum for stratum, _, _ in known],
    )
    gap = difference_of(gap_of([a for a, _ in pairs]), gap_of([b for _, b in pairs]))
    wider = replace(gap, low=min(gap.low, 2.0 * drawn.low), high=max(gap.high, 2.0 * drawn.high))
    tested = p if len(known) > 1 else None  # one pair of learners does not show whether other seeds agree
    found = figure_of(wider, len(known), noun="learner pairs", p_value=tested)
    of_trials = figure_of(success, len(trials), p_value=solved if len(means) > 1 else None)
    return ArmContrast(name, task, of_trials, found, len(known))


def _mean_success(learner: LearnerOutcome) -> float:
    ended = [trial.success for trial in learner.varied]
    return sum(ended) / len(ended) if ended else 0.0


def _mean_gap(learner: LearnerOutcome) -> float | None:
    """Return the illusion gap of one learner as a plain number, without a confidence interval.

    The illusion gap is the success rate on the training twins (the training trials with the same seeds) minus the
    success rate on the variations. Return None if the learner has no pairs of trials.
    """
    pairs = learner.pairs()
    return sum(twin.success - trial.success for twin, trial in pairs) / len(pairs) if pairs else None


def _same_trials(a: LearnerOutcome, b: LearnerOutcome) -> Iterator[tuple[TrialOutcome, TrialOutcome]]:
    there = {(t.variation, t.seed): t for t in b.varied}
    for trial in a.varied:
        if (trial.variation, trial.seed) in there:
            yield trial, there[trial.variation, trial.seed]
