"""Plan of a run: trials and conventions, written before the first trial starts."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

from betterbench.errors import InvalidInputError, require_between
from betterbench.interface import observation_spec
from betterbench.interface.actions import USUAL_ROBOT
from betterbench.sim.robots import robot_space
from betterbench.sim.scenes.stage import quality_preset
from betterbench.sim.worlds import OWN_WORLD, PlanRequest, SceneOptions, World
from betterbench.statistics import StoppingRule
from betterbench.tasks import Looks, TrialId, get_task, looks_named
from betterbench.tasks.interventions import resolve_condition
from betterbench.tasks.trial import Trial
from betterbench.tasks.user_files import origins_of
from betterbench.tasks.worlds.facts import OUR_SUITE
from betterbench.version import __version__

PLAN_VERSION = 1

MAX_TRIALS = 10_000
"""Maximum number of trials per variation, with which the full suite has 1.2 million trials and takes weeks."""

MAX_SEED = 2**31 - 1
"""Largest first seed. Clients and servers of other protocols store seeds in 32 bits."""


@dataclass(frozen=True, slots=True)
class Plan:
    """Policy, trials and settings of a run. A run can only be resumed with the same plan.

    Attributes:
        trials: Trials to run. With ``until_decided``, this is the largest possible set of trials.
        until_decided: Rule that decides when a variation gets no more trials, or None to run all trials.
        world: The world in which the trials are run.
    """

    policy: str
    trials: tuple[Trial, ...]
    action_space: str
    observation: str
    quality: str
    robot: str = USUAL_ROBOT
    looks: Looks = "seen"
    until_decided: StoppingRule | None = None
    world: World = OWN_WORLD

    def __post_init__(self) -> None:
        """Check the robot of each task and, with ``until_decided``, that each variation has its twin with all seeds."""
        self._require_robot()
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
                "trials", f"{what} is missing, but --until-decided needs the twin of every trial", "Plan the run again"
            )

    def _require_robot(self) -> None:
        """Check that every task of our own world is laid out for the robot of the plan."""
        if self.world.name != OWN_WORLD.name:
            return
        for name in dict.fromkeys(t.task for t in self.trials):
            needed = get_task(name).robot
            if needed != self.robot:
                problem = f"{name} is laid out for robot {needed!r}, but the run uses {self.robot!r}"
                raise InvalidInputError(
                    "robot", problem, f"Run it with --robot {needed}, separately from tasks for other robots"
                )

    def to_json(self) -> dict[str, Any]:
        """Return a JSON-serializable dict, with all versions and conventions that affect results."""
        tasks = sorted({t.task for t in self.trials})
        return {
            "plan_version": PLAN_VERSION,
            "package_version": __version__,
            **self.world.plan_head(tasks),
            "policy": self.policy,
            "action_space": self.action_space,
            "observation": observation_spec(self.observation).to_json(),
            **self.world.plan_options(self.scene_options),
            "control_rate_hz": self.world.control_rate_hz,
            "trials": [asdict(t) for t in self.trials],
            **({} if self.until_decided is None else {"until_decided": asdict(self.until_decided)}),
            **origins_of(tasks, worlds=(self.world.name,)),
        }

    @property
    def scene_options(self) -> SceneOptions:
        """Scene options (quality, robot, looks) supported only by some worlds."""
        return SceneOptions(self.quality, self.robot, self.looks)


def make_plan(
    policy: str,
    *,
    tasks: Sequence[str] = (),
    variations: Sequence[str] = (),
    trials: int = 20,
    seed: int = 0,
    action_space: str | None = None,
    observation: str = "default",
    quality: str = "standard",
    looks: str = "seen",
    until_decided: bool = False,
    robot: str | None = None,
) -> Plan:
    """Return the plan for a run of the named tasks, by default all of better60.

    Every variation runs with the seeds ``seed … seed + trials - 1``. The training conditions of each task get as many
    trials in total as the variations, evenly distributed, including the variations' twins. The trials of a plan for
    some variations ("L1", "fast_food/T1") are also in the plan for all variations, so both plans share a certificate.
    The default ``action_space`` is the robot's usual one. With ``looks`` "unseen", objects and rooms have an appearance
    that does not occur in demonstrations.

    The default robot is the one for which the first task is laid out.

    With ``until_decided``, ``trials`` is the maximum per variation, and of the training conditions only the twins are
    run.

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
    observation_spec(observation)
    quality_preset(quality)
    shown = looks_named(looks)
    options = {"variations": tuple(variations), "until_decided": until_decided}
    planned, world = OWN_WORLD.plan(PlanRequest(OUR_SUITE, tuple(tasks), trials, seed, options))
    arm = robot or get_task(planned[0].task).robot
    space = robot_space(arm, action_space)
    return Plan(policy, planned, space, observation, quality, arm, shown, rule, world)


def named_trial(task: str, condition: str | None = None, seed: int = 0) -> TrialId:
    """Return the id of a trial after checking its names. The default condition is the first training condition."""
    require_between("--seed", seed, 0, MAX_SEED)
    trial = TrialId(task, condition or get_task(task).training[0].name, seed)
    resolve_condition(trial.task, trial.condition)
    return trial


def plan_extent(plan: Plan) -> tuple[int, int]:
    """Return the first seed and the number of trials per variation of a plan."""
    seeds = [t.seed for t in plan.trials]
    counts = Counter((t.task, t.condition) for t in plan.trials if t.variation is not None)
    return min(seeds), max(counts.values(), default=len(set(seeds)))
