"""Privileged policies, each consisting of a decision rule and motor skills."""

from __future__ import annotations

import functools
from collections.abc import Callable, Generator
from dataclasses import dataclass

import numpy as np

from betterbench.interface.state import PrivilegedPolicy, WorldState
from betterbench.policies.decisions import Bring, Decision, Draw, Freeze, GraspAt, GraspOffset, Rest, Situation, Wander
from betterbench.policies.experts.address import WITNESS, Address
from betterbench.policies.experts.motion import OPEN, delta_action, disturbed, hold
from betterbench.policies.experts.planner import Planner
from betterbench.policies.experts.probes import make_replay
from betterbench.policies.experts.registry import EXPERTS, REPLAYS, parse_address, witnessed
from betterbench.policies.experts.skills import Skills
from betterbench.policies.experts.witness import Witness
from betterbench.policies.faulty import BrokenRule, Clumsy, Crash, Slow
from betterbench.sim.scenes import Scene, engine_version
from betterbench.tasks import TargetRegion, stream
from betterbench.tasks.demonstrated import Releases, demonstrated_if_measured
from betterbench.tasks.randomness import FIRST_DEMONSTRATION_SEED

MAX_DECISIONS = 12
"""Number of decisions after which a policy gives up. It is twice the length of the longest task in the suite."""


@dataclass(frozen=True, slots=True)
class ExecutionNoise:
    """Errors that a policy makes when it executes its decisions.

    Attributes:
        grasp_offset: Deliberate grasp error, or None.
        action_noise_m: Standard deviation of the noise added to the translation of each control step [m].
        speed: Speed of motions, as a fraction of the normal speed.
        crash_step: Control step at which the policy raises an error, or None.
    """

    grasp_offset: GraspOffset | None = None
    action_noise_m: float = 0.0
    speed: float = 1.0
    crash_step: int | None = None


class _DecisionLoop:
    """Loop that converts the decisions of a rule to actions.

    Neither the loop nor the generator that it runs refers to the agent, because such a reference cycle would keep the
    scene in memory until the next garbage collection.
    """

    def __init__(self, scene: Scene, rule: BrokenRule, noise: ExecutionNoise, skills: Skills | None) -> None:
        self.rule = rule
        self.mishap: str | None = None
        self._exact = noise.grasp_offset is None
        self._skills = skills or Skills(
            Planner(scene),
            1.0 / scene.control_rate_hz,
            functools.partial(stream, scene.task.id, scene.seed),
            _trained_releases(scene),
            grasp_offset=noise.grasp_offset,
            speed=noise.speed,
        )
        self._mounts = {p.spec.name: p.shut for p in scene.placements if p.shut is not None}

    def actions(self, state: WorldState) -> Generator[np.ndarray, WorldState, None]:
        """Yield the actions of an episode that begins in the given state.

        After each action, the caller sends the next state to the generator.
        """
        home = state.ee_pose
        history: tuple[Decision, ...] = ()
        while len(history) < MAX_DECISIONS:
            decision = self.rule.decide(state, history)
            history = (*history, decision)
            if isinstance(decision, Rest | Freeze):
                break
            state = yield from self._carry_out(state, decision)
        if isinstance(history[-1], Freeze) and history[-1].toward is not None:
            state = yield from self._skills.approach_and_stop(state, history[-1].toward)
        elif not isinstance(history[-1], Freeze):
            state = yield from self._skills.go_home(state, home)
        while True:
            gripper = state.gripper_command if state.step else OPEN
            state = yield delta_action(state.commanded_pose, state.commanded_pose, gripper)

    def _carry_out(self, state: WorldState, decision: Decision) -> Generator[np.ndarray, WorldState, WorldState]:
        worked = True
        if isinstance(decision, Bring):
            goal = TargetRegion(decision.target, decision.region)
            state, worked = yield from self._skills.pick_and_place(state, decision.object, goal, decision.relation)
            state = yield from hold(state, 2, gripper=state.gripper_command)
        elif isinstance(decision, Draw):
            mount = self._mounts[decision.drawer]
            state, worked = yield from self._skills.draw(state, decision.drawer, mount, out=decision.out)
        elif isinstance(decision, GraspAt):
            slot = state.info.slot(decision.slot)
            state = yield from self._skills.air_grasp(state, slot.position)
        elif isinstance(decision, Wander):
            state = yield from self._skills.wander(state)
        if not worked and self._exact and self.mishap is None:
            because = f": {self._skills.obstacle}" if self._skills.obstacle else ""
            self.mishap = f"the gripper could not execute {decision}{because}"
        return state


def _trained_releases(scene: Scene) -> Callable[[str, str, str], Releases | None]:
    """Return a function that looks up the release points of demonstrations by target, relation and region.

    In trials, the expert uses these points. Its success then shows that motions from training can solve the trial.
    While demonstrations are being made, the function always returns None.
    """
    return (lambda *_: None) if scene.seed >= FIRST_DEMONSTRATION_SEED else measured_releases(scene)


def measured_releases(scene: Scene) -> Callable[[str, str, str], Releases | None]:
    """Return a function that looks up release points, measured in demonstrations, at the targets in a scene.

    It also works while demonstrations are being made.
    """
    condition = scene.condition
    known = demonstrated_if_measured(scene.task, engine=engine_version())
    grounds = {o.name: o.name if o.mount is None else o.mount.target for o in condition.objects}

    def trained(target: str, relation: str, region: str) -> Releases | None:
        slot = condition.layout.get(grounds[target])
        return None if known is None else known.releases_at((slot, relation, region, 1))

    return trained


class PrivilegedAgent:
    """Privileged policy for one episode, which consists of a decision rule and motor skills.

    Its actions are subject to the same limits as those of any other policy.
    """

    def __init__(
        self,
        name: str,
        scene: Scene,
        rule: BrokenRule,
        *,
        noise: ExecutionNoise | None = None,
        skills: Skills | None = None,
    ) -> None:
        """Create the policy for one episode.

        Args:
            name: Address of the policy.
            scene: Scene of the episode.
            rule: Decision rule.
            noise: Errors in the execution of decisions. By default, there are no errors.
            skills: Motor skills. By default, the motor skills of the expert.
        """
        self._name = name
        self._execution = noise or ExecutionNoise()
        self._loop = _DecisionLoop(scene, rule, self._execution, skills)
        self._controller = scene.controller
        self._noise = stream(scene.task.id, scene.seed, f"action noise:{scene.condition.name}")
        self._run: Generator[np.ndarray, WorldState, None] | None = None

    @property
    def name(self) -> str:
        """Address of the policy."""
        return self._name

    @property
    def ground_truth(self) -> dict[str, str]:
        """Ground truth about the episode, which is stored in the run journal but not in records.

        The entry ``fault`` describes the first wrong decision, and ``truth`` is the outcome label that this decision
        implies. Both are empty if all decisions were right. ``mishap`` describes a right decision that the gripper
        could not execute. A witness (an expert that compares itself with other rules) adds ``same``, which contains the
        names of the rules that made the same decisions, separated by spaces.
        """
        rule = self._loop.rule
        fault = rule.fault
        same = {"same": " ".join(rule.same)} if isinstance(rule, Witness) else {}
        return {
            **same,
            "truth": "" if fault is None else fault.label,
            "fault": "" if fault is None else f"decision {fault.decision}: {fault.text}",
            "mishap": self._loop.mishap or "",
        }

    def act_on_state(self, state: WorldState) -> np.ndarray:
        """Return the next action (dim,) in the scene's action space.

        Motions are planned in the action space ``ee_delta``. They are converted if the scene uses another action space.

        Raises:
            RuntimeError: At the control step at which the policy is supposed to crash.
        """
        if self._execution.crash_step is not None and state.step >= self._execution.crash_step:
            raise RuntimeError("this faulty policy raises an error on purpose")
        if self._run is None:
            self._run = self._loop.actions(state)
            action = next(self._run)
        else:
            action = self._run.send(state)
        return self._controller.own_action(disturbed(action, self._execution.action_noise_m, self._noise))

    def close(self) -> None:
        """End the episode, so that the scene (about 25 MB) is freed as soon as nothing else refers to it."""
        run, self._run = self._run, None
        if run is not None:
            run.close()


def make_expert(address: str, scene: Scene) -> PrivilegedPolicy:
    """Create a privileged policy for one episode.

    Args:
        address: Address of the policy.
        scene: Scene of the episode.

    Raises:
        UnknownNameError: If the policy or an option does not exist.
        InvalidInputError: If an option is out of range.
    """
    asked = parse_address(address)
    if asked.name in REPLAYS:
        return make_replay(asked.name, scene, play=lambda other: make_expert("expert", other))
    situation = Situation(scene.task, scene.condition, scene.seed)
    if asked.name == WITNESS:
        rule: BrokenRule = Witness(situation, {name: EXPERTS[name].rule(situation, 1.0) for name in witnessed()})
    else:
        rule = EXPERTS[asked.name].rule(situation, asked.strength)
    return PrivilegedAgent(address, scene, rule, noise=_noise_of(rule, asked))


def _noise_of(rule: BrokenRule, asked: Address) -> ExecutionNoise:
    """Return the execution errors that a decision rule prescribes."""
    slow = isinstance(rule, Slow) and rule.applies
    return ExecutionNoise(
        grasp_offset=rule.grasp_offset if isinstance(rule, Clumsy) else None,
        action_noise_m=asked.action_noise_m,
        speed=Slow.speed if slow else 1.0,
        crash_step=rule.crash_step if isinstance(rule, Crash) else None,
    )
