"""Open-loop probes. They replay the motion of a demonstration and ignore observations.

If they can solve trials, the benchmark measures memorization. ``probe:replay`` replays a demonstration of the twin's
condition, usually the same instruction in the same layout. ``probe:no-images`` replays a demonstration of the trained
instruction closest to the trial's. Both use demonstration seeds, never test seeds, as in the training data of a policy.
The probes miss objects at other positions.
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
"""Number of cached demonstrations. Several variations of a task have the same twin."""

_DEMONSTRATIONS: OrderedDict[tuple[str, str, int, str, str, str, str], np.ndarray] = OrderedDict()

OTHER_DEMONSTRATIONS = 500_000
"""Seed offset for another demonstration of the same trial."""


class OpenLoop:
    """Open-loop policy that executes given actions in order and then does not move."""

    def __init__(self, name: str, actions: np.ndarray, scene: Scene) -> None:
        """Make the policy for one episode.

        Args:
            name: Policy address.
            actions: (T, dim) actions to execute, in the scene's action space.
            scene: The episode's scene.
        """
        self._name, self._actions, self._controller = name, actions, scene.controller
        self.ground_truth = {"truth": "", "fault": "", "mishap": ""}

    @property
    def name(self) -> str:
        """Policy address."""
        return self._name

    def act_on_state(self, state: WorldState) -> np.ndarray:
        """Return the next action in the scene's action space, shape (dim,)."""
        if state.step < len(self._actions):
            return np.array(self._actions[state.step])
        if len(self._actions) and self._controller.action_space.neutral is None:
            return np.array(self._actions[-1])
        still = np.zeros(EE_DELTA.dim)
        still[-1] = self._actions[-1][-1] if len(self._actions) else OPEN
        return self._controller.own_action(still)


def make_replay(name: str, scene: Scene, *, play: Callable[[Scene], PrivilegedPolicy]) -> OpenLoop:
    """Return an open-loop probe for one episode.

    Args:
        name: "probe:replay" or "probe:no-images".
        scene: The episode's scene.
        play: Factory of the policy whose motion is replayed, for a scene.
    """
    condition = twin_of(scene) if name == "probe:replay" else by_sentence(scene)
    return OpenLoop(name, demonstration(scene, condition, demonstration_seed(name, scene.seed), play), scene)


def demonstration_seed(name: str, seed: int) -> int:
    """Return the seed of the demonstration that an open-loop probe replays in a trial."""
    return FIRST_DEMONSTRATION_SEED + seed + (0 if name == "probe:replay" else OTHER_DEMONSTRATIONS)


def twin_of(scene: Scene) -> Condition:
    """Return the condition of a scene's training twin, or the scene's own condition if it is a training condition."""
    names = {v.name: v.base for v in scene.task.variations}
    return scene.task.train(names.get(scene.condition.name, scene.condition.name))


def by_sentence(scene: Scene) -> Condition:
    """Return the training condition with the closest instruction. The trial's random stream decides between ties."""
    said = scene.condition.instruction.text
    closeness = [SequenceMatcher(None, said, c.instruction.text).ratio() for c in scene.task.training]
    best = [c for c, value in zip(scene.task.training, closeness, strict=True) if value >= max(closeness) - 1e-9]
    pick = stream(scene.task.id, scene.seed, f"probe:{scene.condition.name}").integers(len(best))
    return best[int(pick)]


def demonstration(
    scene: Scene, condition: Condition, seed: int, play: Callable[[Scene], PrivilegedPolicy]
) -> np.ndarray:
    """Return the (T, dim) actions with which a policy solves a training condition.

    Args:
        scene: A scene of the task, with the action space and quality to use.
        condition: The training condition.
        seed: Demonstration seed.
        play: Factory of the policy for a scene.
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
