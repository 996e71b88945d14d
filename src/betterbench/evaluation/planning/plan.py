"""The plan of a run: its trials and conventions. It is written before the first trial starts."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Annotated, Any

from pydantic import Field

from betterbench.errors import InvalidInputError, UnknownNameError, require_between
from betterbench.interface import observation_spec
from betterbench.interface.actions import ACTION_SPACES
from betterbench.json_form import strict_form
from betterbench.sim.scenes import CONTROL_RATE_HZ, engine_version
from betterbench.sim.scenes.stage import quality_preset
from betterbench.sim.worlds import WorldSettings
from betterbench.statistics import StoppingRule
from betterbench.tasks import (
    SUITE_VERSION,
    Condition,
    Looks,
    Task,
    TrialId,
    Variation,
    get_task,
    looks_named,
    suite_tasks,
)
from betterbench.tasks.interventions import ResolvedCondition, resolve_condition
from betterbench.tasks.user_files import origins_of
from betterbench.version import __version__

PLAN_VERSION = 1

MAX_TRIALS = 10_000
"""Maximum trials per variation; 1.2 million trials in the whole suite, which take weeks."""

MAX_SEED = 2**31 - 1
"""Largest first seed: clients and servers of other protocols store it in 32 bits."""


@strict_form
@dataclass(frozen=True, slots=True)
class Trial:
    """One planned trial; ``variation``, ``axis`` and ``base_condition`` are None on a training condition."""

    task: str
    condition: str
    variation: str | None
    axis: str | None
    base_condition: str | None
    seed: Annotated[int, Field(ge=0)]
    expected: str

    @property
    def id(self) -> TrialId:
        """Task, condition and seed."""
        return TrialId(self.task, self.condition, self.seed)

    def resolve(self) -> ResolvedCondition:
        """Return the condition of the trial."""
        return resolve_condition(self.task, self.condition)


@dataclass(frozen=True, slots=True)
class Plan:
    """Policy, trials and settings of a run. A run is resumed with the same plan; another plan is refused.

    Attributes:
        trials: Trials to run; with ``until_decided``, the maximum set of trials.
        until_decided: Rule after which a variation gets no more trials, or None to run all.
        world: The foreign world (LIBERO, CALVIN) of the trials, or None for betterbench's own scenes.
    """

    policy: str
    trials: tuple[Trial, ...]
    action_space: str
    observation: str
    quality: str
    robot: str = "panda"
    looks: Looks = "seen"
    until_decided: StoppingRule | None = None
    world: WorldSettings | None = None

    def __post_init__(self) -> None:
        """Check that a plan until decided has every pair: each variation and its twin with all seeds."""
        if self.until_decided is None:
            return
        planned = {t.id for t in self.trials}
        varied = [t for t in self.trials if t.variation is not None]
        pairs = {(t.task, name) for t in varied for name in (t.condition, str(t.base_condition))}
        seeds = {t.seed for t in varied}
        wanted = {TrialId(task, name, seed) for task, name in pairs for seed in seeds}
        if not varied or not wanted <= planned:
            what = "a variation" if not varied else str(min(wanted - planned, key=str))
            raise InvalidInputError(
                "trials", f"{what} is missing, but a run until decided needs every pair", "Plan the run again"
            )

    def to_json(self) -> dict[str, Any]:
        """Return the JSON form, with every version and convention that results depend on."""
        if self.world is not None:
            return self._foreign_json(self.world)
        return {
            "plan_version": PLAN_VERSION,
            "package_version": __version__,
            "suite_version": SUITE_VERSION,
            "engine": {"mujoco": engine_version()},
            "task_versions": {name: get_task(name).version for name in sorted({t.task for t in self.trials})},
            "policy": self.policy,
            "action_space": self.action_space,
            "observation": observation_spec(self.observation).to_json(),
            "quality": quality_preset(self.quality).to_json(),
            "robot": self.robot,
            "looks": self.looks,
            "control_rate_hz": CONTROL_RATE_HZ,
            "trials": [asdict(t) for t in self.trials],
            **({} if self.until_decided is None else {"until_decided": asdict(self.until_decided)}),
            **origins_of({t.task for t in self.trials}),
        }

    def _foreign_json(self, world: WorldSettings) -> dict[str, Any]:
        """Return the JSON form of a plan in a foreign world, whose suite and engine are not ours."""
        return {
            "plan_version": PLAN_VERSION,
            "package_version": __version__,
            "world": world.to_json(),
            "policy": self.policy,
            "action_space": self.action_space,
            "observation": observation_spec(self.observation).to_json(),
            "control_rate_hz": world.control_rate_hz,
            "trials": [asdict(t) for t in self.trials],
        }


def make_plan(
    policy: str,
    *,
    tasks: Sequence[str] = (),
    variations: Sequence[str] = (),
    trials: int = 20,
    seed: int = 0,
    action_space: str = "ee_delta",
    observation: str = "default",
    quality: str = "standard",
    looks: str = "seen",
    until_decided: bool = False,
) -> Plan:
    """Return the plan of a run of the named tasks, or of those of better60.

    Every variation is run with the seeds ``seed … seed + trials - 1``, and the training conditions of each task with as
    many trials in total as its variations, evenly distributed. The first of them are the twins of the variations. Each
    trial of a plan with some variations ("L1", "fast_food/T1") is also in the plan of all variations, so they share a
    certificate. With ``looks`` "unseen", objects and rooms have looks that do not occur in demonstrations.

    With ``until_decided``, ``trials`` is the maximum per variation, and only the twins among the training conditions
    are run.

    Raises:
        InvalidInputError: If a number is out of range or no trial is left to run.
        UnknownNameError: If a name is unknown.
    """
    require_between("--trials", trials, 1, MAX_TRIALS)
    require_between("--seed", seed, 0, MAX_SEED)
    rule = StoppingRule() if until_decided else None
    if rule is not None and trials < rule.first:
        problem = f"{trials} are too few for a verdict with --until-decided"
        raise InvalidInputError("--trials", problem, f"Give {rule.first} or more, or leave out --until-decided")
    if action_space not in ACTION_SPACES:
        raise UnknownNameError("action space", action_space, ACTION_SPACES)
    observation_spec(observation)
    quality_preset(quality)
    shown = looks_named(looks)
    planned: list[Trial] = []
    chosen = [get_task(name) for name in dict.fromkeys(tasks or suite_tasks("better60"))]
    _check_variations(chosen, variations)
    for task in chosen:
        kept = [v for v in task.variations if not variations or {v.name, f"{task.id}/{v.name}"} & set(variations)]
        if not kept:
            continue
        bases = {v.base for v in kept}
        training = [c for c in task.training if not (variations or until_decided) or c.name in bases]
        whole = math.ceil(len(task.variations) * trials / len(task.training))
        share = trials if until_decided else min(math.ceil(len(kept) * trials / len(training)), max(whole, trials))
        planned += [_trial(task, v, s) for v in kept for s in range(seed, seed + trials)]
        planned += [_trial(task, c, s) for c in training for s in range(seed, seed + max(share, trials))]
    if not planned:
        raise InvalidInputError("--variations", f"{', '.join(variations)} selects no trial", "Name other variations")
    return Plan(policy, tuple(planned), action_space, observation, quality, looks=shown, until_decided=rule)


def named_trial(task: str, condition: str | None = None, seed: int = 0) -> TrialId:
    """Return the id of an existing trial; its condition is the first training condition if None."""
    require_between("--seed", seed, 0, MAX_SEED)
    trial = TrialId(task, condition or get_task(task).training[0].name, seed)
    resolve_condition(trial.task, trial.condition)
    return trial


def plan_extent(plan: Plan) -> tuple[int, int]:
    """Return the first seed of a plan and its trials per variation, as options of ``better eval``."""
    seeds = [t.seed for t in plan.trials]
    counts = Counter((t.task, t.condition) for t in plan.trials if t.variation is not None)
    return min(seeds), max(counts.values(), default=len(set(seeds)))


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
