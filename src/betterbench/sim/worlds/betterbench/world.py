"""World of betterbench's own scenes: plans, and the execution order of trials.

MuJoCo, which ``sim.robots`` and ``sim.scenes`` import, is imported at first use: a list of suites needs no simulator.
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
    """Run options in our own scenes.

    Attributes:
        variations: Variations to run, as "L1" or "fast_food/T1". By default, all.
        until_decided: Whether to run only the variations and their twins, each as often as the verdict requires.
    """

    variations: tuple[str, ...] = ()
    until_decided: bool = False


@dataclass(frozen=True, slots=True)
class OwnWorld(World):
    """Our own scenes. This value does not depend on the run."""

    facts: ClassVar[WorldFacts] = OURS
    action_spaces: ClassVar[tuple[str, ...]] = PLAYED_IN[""]
    observations: ClassVar[Mapping[str, str]] = {name: name for name in ("default", "official", "droid", "state_only")}
    drawn_by: ClassVar[str] = ""
    options: ClassVar[type | None] = OwnOptions

    def plan(self, asked: PlanRequest) -> tuple[tuple[Trial, ...], OwnWorld]:
        """Return the trials of tasks, with every variation and the training conditions.

        Every variation has the seeds ``seed … seed + trials - 1``, and the training conditions of each task as many
        trials in total as the variations, evenly distributed. They include the twins of the variations.
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
                "--variations", f"{', '.join(variations)} does not select any trial", "Give other variations"
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
        """Return a trial's scene. Images are rendered by the worker."""
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
        """Return the versions of the suite, the engine and the tasks."""
        from betterbench.sim.scenes import engine_version  # noqa: PLC0415 - see above

        return {
            "suite_version": SUITE_VERSION,
            "engine": {"mujoco": engine_version()},
            "task_versions": {name: get_task(name).version for name in tasks},
        }

    def plan_options(self, options: SceneOptions) -> dict[str, Any]:
        """Return the render preset, the robot and the looks of a plan."""
        from betterbench.sim.scenes import quality_preset  # noqa: PLC0415 - see above

        return {
            "quality": quality_preset(options.quality).to_json(),
            "robot": options.robot,
            "looks": options.looks,
        }

    def conventions(self, robot: str) -> dict[str, Any]:
        """Return the robot and the fixed conventions of our scenes."""
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
        """Decimate a robot's meshes into the cache. Later runs find them there and report nothing."""
        from betterbench.sim.robots import build_robot_spec  # noqa: PLC0415 - see above

        build_robot_spec(robot, progress=on_progress)

    def step_limits(self, trials: Sequence[Trial]) -> dict[TrialId, int]:
        """Return the step limit of each trial."""
        limits = _limits(trials)
        return {trial.id: limits[trial.task, trial.condition] for trial in trials}

    def in_order(self, trials: Sequence[Trial], *, last: int) -> list[Trial]:
        """Return the trials grouped by compiled scene, with long tasks first.

        The ``last`` trials are ordered by length, because workers should wait only for short trials at the end of a
        run.
        """
        limits = _limits(trials)
        longest = {task: max(s for (of, _), s in limits.items() if of == task) for task, _ in limits}
        ordered = sorted(trials, key=lambda t: (-longest[t.task], t.task, t.seed))
        begin = max(0, len(ordered) - last)
        return ordered[:begin] + sorted(ordered[begin:], key=lambda t: -limits[t.task, t.condition])

    def interventions(self, trial: Trial) -> tuple[str, ...]:
        """Return the operations of a variation, as strings."""
        found = trial.resolve()
        return () if found.variation is None else tuple(str(i) for i in found.variation.interventions)


OWN_WORLD = OwnWorld()


def _limits(trials: Sequence[Trial]) -> dict[tuple[str, str], int]:
    """Return the step limit of each task and condition."""
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
                "--variations", f"{name!r} belongs to no task of this run", "Add its task with --tasks"
            )
