"""Collision checks for planners: contacts of a robot configuration, computed on a private copy of the scene."""

from __future__ import annotations

import copy
from collections.abc import Sequence

import mujoco
import numpy as np

from betterbench.geometry import Pose, distance
from betterbench.interface.state import WorldState
from betterbench.sim.robots.readers import numbers_of
from betterbench.sim.scenes.instances import ROBOT_PREFIX
from betterbench.sim.scenes.scene import Scene

DISTMAX_M = 0.001
"""Distance beyond which MuJoCo stops computing the distance between two geoms [m]."""
ROBOT_PARTS = frozenset({"left_finger", "right_finger", "hand", "arm"})


class Clearance:
    """Collision checker for the robot and an object in its gripper. It works on a copy of the scene.

    Attributes:
        keeps_apart: Whether to check contacts between robot parts that have to stay apart according to the robot's
            description.
    """

    def __init__(self, scene: Scene, *, margin_m: float = 0.004, penetration_m: float = 0.002) -> None:
        """Copy the model of a scene. ``margin_m`` is the distance that the robot must keep from all other bodies.

        ``penetration_m`` is the depth by which the held object may overlap with other objects. It must be larger than
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
        # Check only the robot and the held object, each against everything except the robot. Contacts among the other
        # objects and among robot parts are not needed. Computing them would take a third of the time.
        self._looks = scene.model.geom_contype, scene.model.body_contype
        self._geoms = [np.flatnonzero(labels == i) for i in range(len(self._labels))]
        self._model.geom_contype[:] = self._model.body_contype[:] = 0
        for i in robot:
            self._let_look(i, looks=True)
            self._model.geom_conaffinity[self._geoms[i]] = 0
            self._model.body_conaffinity[self._model.geom_bodyid[self._geoms[i]]] = 0
        self.keeps_apart = False
        self._kept_apart = _kept_apart(scene)
        self._held = -1
        self._arm, self._fingers = scene.arm_addresses.tolist(), scene.finger_addresses.tolist()
        self._jaw = self._compiled.robot.jaw
        self._numbers = numbers_of(self._data.qpos)

    def load(self, state: WorldState) -> None:
        """Move the objects to the poses that they have in the given state."""
        for i, name in enumerate(o.name for o in state.info.objects):
            self._place(i, state.pose(name))

    def _place(self, i: int, pose: Pose) -> None:
        address = self._compiled.qpos_addresses[i]
        if self._compiled.slides[i]:
            self._data.qpos[address] = distance(pose.position, self._shut[i])
        elif address >= 0:
            self._data.qpos[address : address + 3] = pose.position
            self._data.qpos[address + 3 : address + 7] = pose.quaternion

    def _let_look(self, i: int, *, looks: bool) -> None:
        """Set whether a labeled body is checked against all other bodies.

        An unchecked body can still be found in contact with a body that is checked.
        """
        geoms, (of_geoms, of_bodies) = self._geoms[i], self._looks
        bodies = self._model.geom_bodyid[geoms]
        self._model.geom_contype[geoms] = of_geoms[geoms] if looks else 0
        self._model.body_contype[bodies] = of_bodies[bodies] if looks else 0

    def touches(
        self,
        joints: Sequence[float] | np.ndarray,
        *,
        finger_width_m: float,
        held: str | None = None,
        held_pose: Pose | None = None,
        ignore: frozenset[str] = frozenset(),
    ) -> tuple[str, ...]:
        """Return the contacts at the given joint angles [rad], as one string "a-b" per pair of bodies.

        The object ``held`` moves with the gripper and has the pose ``held_pose`` (``T_world_object``). Contacts with
        the bodies in ``ignore`` are allowed.
        """
        data = self._data
        for address, angle in zip(self._arm, joints, strict=True):
            self._numbers[address] = angle
        for address, position in zip(self._fingers, self._jaw.joints_at(finger_width_m), strict=True):
            self._numbers[address] = position
        held_index = -1
        if held is not None and held_pose is not None:
            held_index = self._index[held]
            self._place(held_index, held_pose)
        if held_index != self._held:
            for i, looks in ((self._held, False), (held_index, True)):
                if i >= 0:
                    self._let_look(i, looks=looks)
            self._held = held_index
        mujoco.mj_kinematics(self._model, data)
        mujoco.mj_collision(self._model, data)
        found = self._folded() if self.keeps_apart else set()
        if not data.ncon:
            return tuple(sorted(found))  # on a planned path, most configurations have no contacts
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

    def _folded(self) -> set[str]:
        """Return the contacts between robot parts that are required to stay apart."""
        model, data, found = self._model, self._data, set()
        for pair, one, two in self._kept_apart:
            if mujoco.mj_geomDistance(model, data, one, two, DISTMAX_M, None) < 0.0:
                found.add(pair)
        return found


def _kept_apart(scene: Scene) -> tuple[tuple[str, int, int], ...]:
    """Return the pairs of robot geoms that are required to stay apart, each with its body names as one string "a-b"."""
    model, solid = scene.model, scene.model.geom_contype != 0

    def geoms(body: str) -> list[int]:
        return np.flatnonzero(solid & (model.geom_bodyid == model.body(ROBOT_PREFIX + body).id)).tolist()

    pairs = scene.compiled.robot.kept_apart
    return tuple((f"{a}-{b}", one, two) for a, b in pairs for one in geoms(a) for two in geoms(b))
