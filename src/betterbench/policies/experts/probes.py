"""Open-loop probes: policies that replay the motion of a demonstration and ignore all observations.

If such a policy could solve trials, the benchmark would measure memorization. ``probe:replay`` replays a demonstration
of the training twin (the training trial with the same seed), which usually has the same instruction in the same layout.
``probe:no-images`` replays a demonstration of the training condition whose instruction is closest to that of the trial.
Like the training data of a policy, both use demonstration seeds and never test seeds. The probes miss objects whose
positions differ from those in the demonstration.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable
from difflib import SequenceMatcher

import numpy as np

from betterbench.interface.actions import EE_DELTA
from betterbench.interface.state import PrivilegedPolicy, WorldState
from betterbench.policies.experts.motion import OPEN
from betterbench.sim.scenes import Scene
from betterbench.tasks import Condition, GoalTracker, stream
from betterbench.tasks.randomness import FIRST_DEMONSTRATION_SEED

_KEPT = 256
"""Number of demonstrations that are cached. Several variations of a task share the same training twin."""

_DEMONSTRATIONS: OrderedDict[tuple[str, str, int, str, str, str, str], np.ndarray] = OrderedDict()

OTHER_DEMONSTRATIONS = 500_000
"""Offset that is added to a seed to get another demonstration of the same trial."""


class OpenLoop:
    """Open-loop policy that executes given actions in order and then stops moving."""

    def __init__(self, name: str, actions: np.ndarray, scene: Scene) -> None:
        """Create the policy for one episode.

        Args:
            name: Address of the policy.
            actions: Actions to execute (T, dim), in the scene's action space.
            scene: Scene of the episode.
        """
        self._name, self._actions, self._controller = name, actions, scene.controller
        self.ground_truth = {"truth": "", "fault": "", "mishap": ""}

    @property
    def name(self) -> str:
        """Address of the policy."""
        return self._name

    def act_on_state(self, state: WorldState) -> np.ndarray:
        """Return the next action (dim,) in the scene's action space."""
        if state.step < len(self._actions):
            return np.array(self._actions[state.step])
        if len(self._actions) and self._controller.action_space.neutral is None:
            return np.array(self._actions[-1])
        still = np.zeros(EE_DELTA.dim)
        still[-1] = self._actions[-1][-1] if len(self._actions) else OPEN
        return self._controller.own_action(still)


def make_replay(name: str, scene: Scene, *, play: Callable[[Scene], PrivilegedPolicy]) -> OpenLoop:
    """Create an open-loop probe for one episode.

    Args:
        name: "probe:replay" or "probe:no-images".
        scene: Scene of the episode.
        play: Function that creates the policy for a scene. The motion of this policy is recorded and replayed.
    """
    condition = twin_of(scene) if name == "probe:replay" else by_sentence(scene)
    return OpenLoop(name, demonstration(scene, condition, demonstration_seed(name, scene.seed), play), scene)


def demonstration_seed(name: str, seed: int) -> int:
    """Return the seed of the demonstration that an open-loop probe replays in a trial."""
    return FIRST_DEMONSTRATION_SEED + seed + (0 if name == "probe:replay" else OTHER_DEMONSTRATIONS)


def twin_of(scene: Scene) -> Condition:
    """Return the training condition from which the condition of a scene was derived.

    If the condition is itself a training condition, it is returned unchanged.
    """
    names = {v.name: v.base for v in scene.task.variations}
    return scene.task.train(names.get(scene.condition.name, scene.condition.name))


def by_sentence(scene: Scene) -> Condition:
    """Return the training condition whose instruction is closest to that of the scene.

    If several instructions are equally close, the trial's seed decides.
    """
    said = scene.condition.instruction.text
    closeness = [SequenceMatcher(None, said, c.instruction.text).ratio() for c in scene.task.training]
    best = [c for c, value in zip(scene.task.training, closeness, strict=True) if value >= max(closeness) - 1e-9]
    pick = stream(scene.task.id, scene.seed, f"probe:{scene.condition.name}").integers(len(best))
    return best[int(pick)]


def demonstration(
    scene: Scene, condition: Condition, seed: int, play: Callable[[Scene], PrivilegedPolicy]
) -> np.ndarray:
    """Return the actions (T, dim) with which a policy solves a training condition.

    Args:
        scene: Scene of the task whose action space, rendering quality and robot are used.
        condition: Training condition.
        seed: Seed of the demonstration.
        play: Function that creates the policy for a scene.
    """
    arm, space = scene.compiled.robot.name, scene.action_space
    key = (scene.task.id, condition.name, seed, arm, space.name, scene.quality.name, scene.looks)
    if key in _DEMONSTRATIONS:
        return _DEMONSTRATIONS[key]
    other = Scene(
        scene.task,
        condition,
        seed=seed,
        action_space=space,
        quality=scene.quality,
        looks=scene.looks,
        robot_name=arm,
    )
    tracker = GoalTracker(condition, other.info, template=scene.task.template, control_rate_hz=other.control_rate_hz)
    policy, state = play(other), other.reset()
    actions: list[np.ndarray] = []
    while not tracker.update(state).success and state.step < scene.task.step_limit(condition):
        actions.append(policy.act_on_state(state))
        other.step(actions[-1])
        state = other.state()
    _DEMONSTRATIONS[key] = np.array(actions).reshape(-1, space.dim)
    while len(_DEMONSTRATIONS) > _KEPT:
        _DEMONSTRATIONS.popitem(last=False)
    return _DEMONSTRATIONS[key]
