"""Effects of changes to the training recipe (levers), for each axis and overall.

The tables have the layout of Table 3 of the BeTTER paper.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

from betterbench.learning.study.contrasts import ArmContrast, ArmFinding, arm_of, contrast_of, success_of
from betterbench.learning.study.outcomes import LearnerOutcome
from betterbench.learning.study.plan import Lever, StudyPlan
from betterbench.report.wording import Figure
from betterbench.tasks import Axis, get_task


@dataclass(frozen=True, slots=True)
class LeverRow:
    """Results of the learners with one recipe.

    Attributes:
        found: Results over all tasks of these learners.
        axes: Success rate on the variations of each axis, by axis name.
        against: Difference from the comparison learners, which have the same tasks and training seeds; None for the
            unchanged recipe.
        start: Arm that provides the initial weights, so that these learners have also seen its demonstrations; None if
            the initial weights are random.
        compared: Recipe change of the comparison learners; None if they have the unchanged recipe.
    """

    found: ArmFinding
    axes: Mapping[str, Figure]
    against: ArmContrast | None
    start: str | None = None
    compared: str | None = None


@dataclass(frozen=True, slots=True)
class LeverTable:
    """Comparison of recipe changes for one arm. The first row is the unchanged recipe.

    Attributes:
        arm: Arm of the learners.
        tasks: Tasks of the learners.
        seeds: Number of training seeds per task.
        rows: Results of each recipe.
    """

    arm: str
    tasks: tuple[str, ...]
    seeds: int
    rows: tuple[LeverRow, ...]


def lever_tables(plan: StudyPlan, learners: Sequence[LearnerOutcome]) -> Iterator[LeverTable]:
    """Yield one table for each combination of arm and tasks that has recipe changes, in the order of the plan."""
    groups: dict[tuple[str, tuple[str, ...]], list[Lever]] = {}
    for lever in plan.levers:
        for arm in lever.arms or tuple(plan.arms):
            groups.setdefault((arm, lever.tasks or tuple(plan.tasks)), []).append(lever)
    for (arm, tasks), levers in groups.items():
        mine = [f for f in learners if f.learner.arm == arm and f.learner.task in tasks]
        plain = [f for f in mine if not f.learner.lever]
        rows = [_row(arm_of("", arm, "", plain), plain)]
        for lever in levers:
            changed = [f for f in mine if f.learner.lever == lever.name]
            if changed:
                found = arm_of("", arm, lever.name, changed)
                others = [f for f in mine if f.learner.lever == (lever.against or "")]
                against = contrast_of(f"{lever.name} on {arm}", "", changed, others)
                rows.append(replace(_row(found, changed, against), start=lever.start, compared=lever.against))
        if plain and len(rows) > 1:
            yield LeverTable(arm, tasks, len({f.learner.seed for f in plain}), tuple(rows))


def _row(found: ArmFinding, learners: Sequence[LearnerOutcome], against: ArmContrast | None = None) -> LeverRow:
    varied = [
        (variation.axis, trial)
        for f in learners
        for variation in get_task(f.learner.task).variations
        for trial in f.of(variation.name)
    ]
    axes = {axis.value: success_of(trial for of, trial in varied if of is axis) for axis in Axis}
    return LeverRow(found, {axis: figure for axis, figure in axes.items() if figure.n}, against)
