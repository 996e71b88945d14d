"""Every condition of the suite as a policy of the independent family meets it."""

from __future__ import annotations

import functools

from betterbench.tasks import get_task, suite_tasks
from betterbench.tasks.interventions import condition_names, resolve_condition
from betterbench_calibration.independent.occasion import Occasion


@functools.cache
def cases() -> dict[str, Occasion]:
    return {
        case.condition.id: case
        for task in map(get_task, suite_tasks("better60"))
        for name in condition_names(task)
        for case in (Occasion.of(task, resolve_condition(task.id, name).condition),)
    }
