"""A privileged policy: a mind and its skills, answering one action per state."""

from __future__ import annotations

from collections.abc import Callable, Generator

import numpy as np

from betterbench.experts.mind import Bring, Decision, Draw, Freeze, GraspAt, Mind, Rest, Situation
from betterbench.experts.motion import OPEN, delta_action, hold
from betterbench.experts.planner import Planner
from betterbench.experts.skills import Fumble, Skills
from betterbench.scenes import Scene
from betterbench.state import WorldState
from betterbench.tasks import Place

MAX_DECISIONS = 12
"""Decisions after which a policy gives up: twice the longest chain of the suite."""


class PrivilegedAgent:
    """Runs one mind through one episode. It acts through the same action space and limits as any policy."""

    def __init__(
        self,
        name: str,
        scene: Scene,
        make_mind: Callable[[Situation], Mind],
        *,
        fumble: Callable[[Situation], Fumble | None] | None = None,
    ) -> None:
        """Prepare for an episode.

        Args:
            name: Address of the policy.
            scene: The scene the episode runs in.
            make_mind: Makes the mind.
            fumble: Decides on a deliberate clumsiness of the hand.
        """
        self._name = name
        situation = Situation(scene.task, scene.condition, scene.seed)
        self._mind = make_mind(situation)
        self._skills = Skills(
            Planner(scene), 1.0 / scene.control_rate_hz, fumble=None if fumble is None else fumble(situation)
        )
        self._mounts = {p.spec.name: p.shut for p in scene.placements if p.shut is not None}
        self._run: Generator[np.ndarray, WorldState, None] | None = None

    @property
    def name(self) -> str:
        """Address of the policy."""
        return self._name

    def act_on_state(self, state: WorldState) -> np.ndarray:
        """Return the next action in the ``ee_delta`` action space, shape (7,)."""
        if self._run is None:
            self._run = self._live(state)
            return next(self._run)
        return self._run.send(state)

    def _live(self, state: WorldState) -> Generator[np.ndarray, WorldState, None]:
        home = state.ee_pose
        history: tuple[Decision, ...] = ()
        while len(history) < MAX_DECISIONS:
            decision = self._mind.decide(state, history)
            history = (*history, decision)
            if isinstance(decision, Rest):
                break
            if isinstance(decision, Bring):
                goal = Place(decision.target, decision.place)
                state, _ = yield from self._skills.pick_and_place(state, decision.object, goal, decision.relation)
                state = yield from hold(state, 2, gripper=state.gripper_command)
            elif isinstance(decision, Draw):
                mount = self._mounts[decision.drawer]
                state, _ = yield from self._skills.draw(state, decision.drawer, mount, out=decision.out)
            elif isinstance(decision, GraspAt):
                slot = state.info.slot(decision.slot)
                state = yield from self._skills.air_grasp(state, slot.position)
            elif isinstance(decision, Freeze):
                if decision.towards is not None:
                    state = yield from self._skills.approach_and_stop(state, decision.towards)
                break
        if not isinstance(history[-1], Freeze):
            state = yield from self._skills.go_home(state, home)
        while True:
            gripper = state.gripper_command if state.step else OPEN
            state = yield delta_action(state.commanded_pose, state.commanded_pose, gripper)
