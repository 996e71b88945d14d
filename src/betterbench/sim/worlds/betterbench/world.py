"""World of betterbench's own scenes. It plans the trials of a run and the order in which they are executed.

``sim.robots`` and ``sim.scenes`` import MuJoCo. They are therefore imported only when a function needs them, so that
listing the suites works without a simulator.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

from betterbench.errors import InvalidInputError
from betterbench.interface.actions import PLAYED_IN, ActionSpace
from betterbench.sim.worlds.process import WorldProcesses
from betterbench.sim.worlds.world import USUAL_SCENE, PlanRequest, SceneOptions, World
from betterbench.tasks import (
    SUITE_VERSION,
    THRESHOLDS,
    Condition,
    Task,
    TrialId,
    Variation,
    get_task,
    suite_tasks,
)
from betterbench.tasks.trial import Trial
from betterbench.tasks.worlds.facts import OURS, WorldFacts

if TYPE_CHECKING:
    from betterbench.sim.scenes import Scene


@dataclass(frozen=True, slots=True)
class OwnOptions:
    """Options of a run in betterbench's own scenes.

    Attributes:
        variations: Variations to run, written like "L1" or "fast_food/T1". By default, all variations are run.
        until_decided: Whether to stop running a variation as soon as its verdict is decided. If so, the only trials are
            those of the variations and of their training twins (the training trials with the same seeds).
    """

    variations: tuple[str, ...] = ()
    until_decided: bool = False


@dataclass(frozen=True, slots=True)
class OwnWorld(World):
    """Betterbench's own scenes. The class has no fields, so this world is the same in every run."""

    facts: ClassVar[WorldFacts] = OURS
    action_spaces: ClassVar[tuple[str, ...]] = PLAYED_IN[""]
    observations: ClassVar[Mapping[str, str]] = {name: name for name in ("default", "official", "droid", "state_only")}
    drawn_by: ClassVar[str] = ""
    options: ClassVar[type | None] = OwnOptions

    def plan(self, asked: PlanRequest) -> tuple[tuple[Trial, ...], OwnWorld]:
        """Plan the trials of the requested tasks: every variation, and the training conditions.

        Every variation is run with the seeds ``seed … seed + trials - 1``. All training conditions of a task together
        get as many trials as all of its variations. These trials are evenly distributed and include the training twins
        of the variations, i.e. the training trials with the same seeds.
        """
        options = asked.options_as(OwnOptions, world=self.facts.title)
        trials, seed, variations = 20 if asked.trials is None else asked.trials, asked.seed, options.variations
        planned: list[Trial] = []
        chosen = [get_task(name) for name in dict.fromkeys(asked.tasks or suite_tasks(asked.suite))]
        _check_variations(chosen, variations)
        for task in chosen:
            kept = [v for v in task.variations if not variations or {v.name, f"{task.id}/{v.name}"} & set(variations)]
            if not kept:
                continue
            bases = {v.base for v in kept}
            training = [c for c in task.training if not (variations or options.until_decided) or c.name in bases]
            whole = math.ceil(len(task.variations) * trials / len(task.training))
            evenly = min(math.ceil(len(kept) * trials / len(training)), max(whole, trials))
            share = trials if options.until_decided else evenly
            planned += [_trial(task, v, s) for v in kept for s in range(seed, seed + trials)]
            planned += [_trial(task, c, s) for c in training for s in range(seed, seed + max(share, trials))]
        if not planned:
            raise InvalidInputError(
                "--variations", f"{', '.join(variations)} does not select any trial", "Choose other variations"
            )
        return tuple(planned), self

    def open_scene(
        self,
        processes: WorldProcesses,
        *,
        task: str,
        condition: str,
        seed: int,
        action_space: ActionSpace,
        images: bool,
        depth: bool = False,
        options: SceneOptions = USUAL_SCENE,
    ) -> Scene:
        """Open the scene of a trial. Its images are rendered in the process of the worker that calls this method."""
        from betterbench.sim.scenes import Scene, quality_preset  # noqa: PLC0415 - see above

        del processes, images, depth
        found = Trial(task, condition, None, None, None, seed, "").resolve()
        return Scene(
            found.task,
            found.condition,
            seed=seed,
            action_space=action_space,
            quality=quality_preset(options.quality),
            robot_name=options.robot,
            looks=options.looks,
        )

    def plan_head(self, tasks: Sequence[str]) -> dict[str, Any]:
        """Return the versions of the suite, the engine and the tasks, in the format of plans."""
        from betterbench.sim.scenes import engine_version  # noqa: PLC0415 - see above

        return {
            "suite_version": SUITE_VERSION,
            "engine": {"mujoco": engine_version()},
            "task_versions": {name: get_task(name).version for name in tasks},
        }

    def plan_options(self, options: SceneOptions) -> dict[str, Any]:
        """Return the render preset, the robot and the object variants of a run, in the format of plans."""
        from betterbench.sim.scenes import quality_preset  # noqa: PLC0415 - see above

        return {
            "quality": quality_preset(options.quality).to_json(),
            "robot": options.robot,
            "looks": options.looks,
        }

    def conventions(self, robot: str) -> dict[str, Any]:
        """Return the robot and the fixed conventions of betterbench's scenes."""
        from betterbench.sim.robots import robot as robot_named  # noqa: PLC0415 - see above
        from betterbench.sim.scenes import TIMESTEP_S  # noqa: PLC0415 - see above

        return {
            "robot": robot_named(robot).to_json(),
            "control_rate_hz": self.control_rate_hz,
            "physics_timestep_s": TIMESTEP_S,
            "thresholds": THRESHOLDS.to_json(),
            "images": "upright, RGB, uint8, (height, width, 3)",
            "quaternions": "w x y z, w >= 0",
            "poses": "tool center point in the robot base frame [m]",
            "units": "m, kg, s, rad",
        }

    def prepare(self, robot: str, on_progress: Callable[[str, int, int], None]) -> None:
        """Decimate the robot's meshes and store them in the cache, unless an earlier run has already done so."""
        from betterbench.sim.robots import build_robot_spec  # noqa: PLC0415 - see above

        build_robot_spec(robot, progress=on_progress)

    def step_limits(self, trials: Sequence[Trial]) -> dict[TrialId, int]:
        """Return the maximum number of control steps of each trial."""
        limits = _limits(trials)
        return {trial.id: limits[trial.task, trial.condition] for trial in trials}

    def in_order(self, trials: Sequence[Trial], *, last: int) -> list[Trial]:
        """Return the trials sorted by compiled scene, with the tasks that take longest first.

        The ``last`` trials are sorted by their step limit instead, with the longest first. At the end of a run, idle
        workers then wait only for short trials.
        """
        limits = _limits(trials)
        longest = {task: max(s for (of, _), s in limits.items() if of == task) for task, _ in limits}
        ordered = sorted(trials, key=lambda t: (-longest[t.task], t.task, t.seed))
        begin = max(0, len(ordered) - last)
        return ordered[:begin] + sorted(ordered[begin:], key=lambda t: -limits[t.task, t.condition])

    def interventions(self, trial: Trial) -> tuple[str, ...]:
        """Return the interventions of a trial's variation, as strings. A training trial has none."""
        found = trial.resolve()
        return () if found.variation is None else tuple(str(i) for i in found.variation.interventions)


OWN_WORLD = OwnWorld()


def _limits(trials: Sequence[Trial]) -> dict[tuple[str, str], int]:
    limits = dict[tuple[str, str], int]()
    for trial in {(t.task, t.condition): t for t in trials}.values():
        found = trial.resolve()
        limits[trial.task, trial.condition] = found.task.step_limit(found.condition)
    return limits


def _trial(task: Task, of: Variation | Condition, seed: int) -> Trial:
    if isinstance(of, Condition):
        return Trial(task.id, of.name, None, None, None, seed, of.expected.value)
    return Trial(task.id, of.name, of.name, of.axis.value, of.base, seed, of.expected.value)


def _check_variations(tasks: Sequence[Task], names: Sequence[str]) -> None:
    known = {v.name for t in tasks for v in t.variations} | {f"{t.id}/{v.name}" for t in tasks for v in t.variations}
    for name in names:
        if name not in known:
            from_task, _, short = name.rpartition("/")
            task = get_task(from_task) if from_task else tasks[0]
            task.variation(short)
            raise InvalidInputError(
                "--variations", f"no task of this run has the variation {name!r}", "Add its task with --tasks"
            )
