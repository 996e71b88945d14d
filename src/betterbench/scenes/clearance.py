"""Collision checks on a private copy of a scene, for planners: which bodies would touch in a given configuration."""

from __future__ import annotations

import copy
from collections.abc import Sequence

import mujoco
import numpy as np

from betterbench.geometry import Pose, distance
from betterbench.scenes.scene import Scene
from betterbench.state import WorldState

ROBOT_PARTS = frozenset({"left_finger", "right_finger", "hand", "arm"})


class Clearance:
    """Tells what the robot, and an object in its gripper, would touch. It never changes the scene it was made from."""

    def __init__(self, scene: Scene, *, margin_m: float = 0.004, penetration_m: float = 0.002) -> None:
        """Copy the scene's model; the robot has to keep ``margin_m`` from everything.

        ``penetration_m`` is the overlap of the held object with others that still counts as free; it has to be above
        the depth of a resting contact.
        """
        self._compiled = scene.compiled
        self._labels = scene.body_names
        self._index = {name: i for i, name in enumerate(self._labels)}
        self._model = copy.copy(scene.model)
        self._data = mujoco.MjData(self._model)
        self._penetration = penetration_m
        self._shut = {i: p.shut.position for i, p in enumerate(scene.placements) if p.shut is not None}
        labels = self._compiled.geom_labels
        robot = [self._index[name] for name in ROBOT_PARTS]
        self._model.geom_margin[np.isin(labels, robot)] = margin_m
        self._arm, self._fingers = scene.arm_addresses, scene.finger_addresses

    def load(self, state: WorldState) -> None:
        """Take over where everything is."""
        for i, name in enumerate(o.name for o in state.info.objects):
            self._place(i, state.pose(name))

    def _place(self, i: int, pose: Pose) -> None:
        address = self._compiled.qpos_addresses[i]
        if self._compiled.slides[i]:
            self._data.qpos[address] = distance(pose.position, self._shut[i])
        elif address >= 0:
            self._data.qpos[address : address + 3] = pose.position
            self._data.qpos[address + 3 : address + 7] = pose.quaternion

    def touches(
        self,
        joints: Sequence[float] | np.ndarray,
        *,
        finger_width_m: float,
        held: str | None = None,
        held_pose: Pose | None = None,
        ignore: frozenset[str] = frozenset(),
    ) -> tuple[str, ...]:
        """Return what would be touched with these joint angles [rad]: one text "a-b" per pair, none if all is free.

        ``held`` moves with the gripper, at ``held_pose`` (``T_world_object``); the robot may touch ``ignore``.
        """
        data = self._data
        data.qpos[self._arm] = joints
        data.qpos[self._fingers] = 0.5 * finger_width_m
        held_index = -1
        if held is not None and held_pose is not None:
            held_index = self._index[held]
            self._place(held_index, held_pose)
        mujoco.mj_kinematics(self._model, data)
        mujoco.mj_comPos(self._model, data)
        mujoco.mj_collision(self._model, data)
        found: set[str] = set()
        pairs = self._compiled.geom_labels[data.contact.geom].tolist()
        for (a, b), depth in zip(pairs, data.contact.dist.tolist(), strict=True):
            if a < 0 or b < 0 or a == b:
                continue
            one, two = self._labels[a], self._labels[b]
            if (one in ROBOT_PARTS) != (two in ROBOT_PARTS):
                thing = two if one in ROBOT_PARTS else one
                if thing != held and thing not in ignore:
                    found.add(f"{one}-{two}")
            elif held_index in (a, b) and depth < -self._penetration:
                found.add(f"{one}-{two}")
        return tuple(sorted(found))
