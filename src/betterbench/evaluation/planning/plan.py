"""Plan of a run, with the trials and the conventions. The plan is written before the first trial starts."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

from betterbench.argument_types import checked_arguments
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
"""Maximum number of trials per variation. With this number, the full suite has 1.2 million trials, which take weeks."""

MAX_SEED = 2**31 - 1
"""Maximum first seed. Clients and servers of other protocols store seeds in 32 bits."""


@dataclass(frozen=True, slots=True)
class Plan:
    """Policy, trials and settings of a run. A run can be resumed only with the same plan.

    Attributes:
        policy: Address of the policy.
        trials: Trials to run. If ``until_decided`` is given, these are all trials that may be needed.
        action_space: Name of the action space.
        observation: Name of the observation preset.
        quality: Name of the rendering preset.
        robot: Name of the robot.
        looks: Set of appearances for objects and rooms: "seen" (as in demonstrations) or "unseen" (held out).
        until_decided: Rule that decides when a variation needs no more trials. If None, all trials are run.
        world: Benchmark in whose simulator the trials are run: betterbench, LIBERO or CALVIN.
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
        """Check that each task is made for the robot.

        If ``until_decided`` is given, check that no training twin is missing. The training twin of a variation's trial
        is the trial of the training condition with the same seed.
        """
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
                "trials",
                f"{what} is missing, but --until-decided needs the training twin of every trial",
                "Plan the run again",
            )

    def _require_robot(self) -> None:
        """Check that each task in betterbench's own simulator is made for the robot of the plan.

        Tasks of other benchmarks are not checked.
        """
        if self.world.name != OWN_WORLD.name:
            return
        for name in dict.fromkeys(t.task for t in self.trials):
            needed = get_task(name).robot
            if needed != self.robot:
                problem = f"{name} is made for robot {needed!r}, but the run uses {self.robot!r}"
                raise InvalidInputError(
                    "robot", problem, f"Run this task with --robot {needed}, separately from tasks for other robots"
                )

    def to_json(self) -> dict[str, Any]:
        """Return the plan as a JSON-serializable dict, with all versions and conventions that affect results."""
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
        """Settings of the scenes (quality, robot, looks). Other benchmarks may ignore them."""
        return SceneOptions(self.quality, self.robot, self.looks)


@checked_arguments
def make_plan(
    policy: str,
    *,
    tasks: str | Sequence[str] = (),
    variations: str | Sequence[str] = (),
    trials: int = 20,
    seed: int = 0,
    action_space: str | None = None,
    observation: str = "default",
    quality: str = "standard",
    looks: str = "seen",
    until_decided: bool = False,
    robot: str | None = None,
) -> Plan:
    """Return the plan for a run of the named tasks. By default, it covers all tasks of the suite better60.

    Each variation is run with the seeds ``seed … seed + trials - 1``. All training conditions of a task together get as
    many trials as all variations of the task together, evenly distributed over the training conditions. These trials
    include the training twins, i.e. the training trials with the same seeds as the variations' trials. A plan for some
    variations ("L1", "fast_food/T1") contains only trials that are also in the plan for all variations, so one
    certificate covers both plans.

    The default robot is the robot of the first task, and the default action space is the robot's standard action space.
    If ``looks`` is "unseen", objects and rooms have an appearance that does not occur in demonstrations. If
    ``until_decided`` is True, ``trials`` is the maximum number per variation, and the only trials of training
    conditions are the training twins.

    Raises:
        InvalidInputError: If a number is out of range, or there is no trial to run.
        UnknownNameError: If a name is unknown.
    """
    require_between("--trials", trials, 1, MAX_TRIALS)
    require_between("--seed", seed, 0, MAX_SEED)
    rule = StoppingRule() if until_decided else None
    if rule is not None and trials < rule.first:
        problem = f"{trials} are too few for a verdict with --until-decided"
        raise InvalidInputError("--trials", problem, f"Use {rule.first} or more trials, or omit --until-decided")
    observation_spec(observation)
    quality_preset(quality)
    shown = looks_named(looks)
    options = {"variations": tuple(variations), "until_decided": until_decided}
    planned, world = OWN_WORLD.plan(PlanRequest(OUR_SUITE, tuple(tasks), trials, seed, options))
    arm = robot or get_task(planned[0].task).robot
    space = robot_space(arm, action_space)
    return Plan(policy, planned, space, observation, quality, arm, shown, rule, world)


def named_trial(task: str, condition: str | None = None, seed: int = 0) -> TrialId:
    """Return the ID of a trial after checking that its task and condition exist.

    By default, the condition is the first training condition of the task.
    """
    require_between("--seed", seed, 0, MAX_SEED)
    trial = TrialId(task, condition or get_task(task).training[0].name, seed)
    resolve_condition(trial.task, trial.condition)
    return trial


def plan_extent(plan: Plan) -> tuple[int, int]:
    """Return the first seed of a plan and its number of trials per variation."""
    seeds = [t.seed for t in plan.trials]
    counts = Counter((t.task, t.condition) for t in plan.trials if t.variation is not None)
    return min(seeds), max(counts.values(), default=len(set(seeds)))
