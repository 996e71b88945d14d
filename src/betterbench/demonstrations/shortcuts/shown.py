"""Facts about recorded demonstrations, computed from the recorded states and the instruction.

The condition named in a record is not trusted.
"""

from __future__ import annotations

import functools
import math
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence

from betterbench.demonstrations.shortcuts.facts import EpisodeFacts, facts_of_record
from betterbench.demonstrations.shortcuts.reading import DataReading
from betterbench.errors import RecordError
from betterbench.interface.state import WorldState
from betterbench.records import Record, RunFolder
from betterbench.tasks import Condition, Task, TrialId, get_task
from betterbench.tasks.interventions import condition_names, resolve_condition
from betterbench.tasks.interventions.balanced import with_slots_of
from betterbench.tasks.interventions.listed_regimes import every_listed_condition
from betterbench.tasks.relations.closed import GAP, opening_m

SETTLED_M = 0.005
"""Maximum distance between a settled object and the region in which its slot places objects [m]."""
AT_TARGET_M = 0.20
"""Maximum horizontal distance between a pre-placed object and its target [m]."""


def every_condition(task: Task) -> tuple[Condition, ...]:
    """Return all conditions of a task, including the conditions of all its training distributions."""
    listed = tuple(condition.name for condition in every_listed_condition(task.id))
    return tuple(resolve_condition(task.id, name).condition for name in (*condition_names(task), *listed))


def conditions_shown(record: Record, conditions: Iterable[Condition]) -> tuple[Condition, ...]:
    """Return the conditions that match the instruction and the first state of a record.

    The kinds and slots of objects, objects already at a target, and open drawers are compared. The condition named in
    the record is ignored.
    """
    task = get_task(record.metadata.task)
    said = [c for c in conditions if c.instruction.text == record.metadata.instruction]
    if not said:
        return ()
    state = record.state(0)
    return tuple(condition for condition in said if _is_start(state, with_slots_of(task, condition), condition))


def _is_start(state: WorldState, task: Task, condition: Condition) -> bool:
    kinds = Counter(spec.kind for spec in condition.objects)
    if kinds != Counter(o.kind for o in state.info.objects):
        return False
    free = [o.name for o in state.info.objects]

    def found(kind: str, is_there: Callable[[str], bool]) -> bool:
        name = next((n for n in free if state.info.object(n).kind == kind and is_there(n)), None)
        if name is not None:
            free.remove(name)
        return name is not None

    def stands_in(slot: str) -> Callable[[str], bool]:
        wanted = task.slot(slot)

        def there(name: str) -> bool:
            x, y, _ = state.pose(name).position
            return max(abs(x - wanted.x), abs(y - wanted.y)) <= wanted.jitter_m + SETTLED_M

        return there

    if not all(found(condition.object(n).kind, stands_in(slot)) for n, slot in condition.layout.items()):
        return False
    for name, place in condition.preplaced.items():
        aims = [o.name for o in state.info.objects if o.kind == condition.object(place.target).kind]
        if not found(condition.object(name).kind, functools.partial(_is_near_one, state, aims)):
            return False
    drawers = [spec for spec in condition.objects if spec.mount is not None]
    return all((opening_m(state, spec) > GAP) == (condition.opened.get(spec.name, 0.0) > GAP) for spec in drawers)


def _is_near_one(state: WorldState, targets: Sequence[str], name: str) -> bool:
    x, y, _ = state.pose(name).position
    ways = (state.pose(target).position for target in targets if target != name)
    return any(math.hypot(x - to_x, y - to_y) <= AT_TARGET_M for to_x, to_y, _ in ways)


def facts_of_run(
    run: RunFolder, trials: Sequence[TrialId], *, conditions: Callable[[Task], tuple[Condition, ...]] = every_condition
) -> Iterator[tuple[TrialId, EpisodeFacts]]:
    """Yield each trial of a run with the facts of its record.

    Args:
        run: Folder of the run.
        trials: Trials to read.
        conditions: Function that returns the conditions of a task that a record may match.

    Raises:
        RecordError: If a record cannot be read, or matches no condition.
    """
    known: dict[str, tuple[Condition, ...]] = {}
    for trial in trials:
        record = run.read_record(trial.task, trial.condition, trial.seed)
        candidates = known.setdefault(trial.task, conditions(get_task(trial.task)))
        shown = conditions_shown(record, candidates)
        if not shown:
            where = run.record_path(trial.task, trial.condition, trial.seed)
            raise RecordError(
                f"{where}: it matches no condition of {trial.task}. Record the trial again with this version."
            )
        yield trial, facts_of_record(record, shown[0])


def reading_of_run(facts: Sequence[EpisodeFacts], trials: int) -> DataReading:
    """Describe the data that an audit read from a run."""
    left = trials - len(facts)
    return DataReading(
        len(facts),
        trials,
        "",
        f"the record of each trial, {len({f.instruction for f in facts}):,} different",
        about=("Gripper and places: the states of the records, which show each object's slot and target",),
        left_out=(f"{left:,} trials without success",) if left else (),
    )
