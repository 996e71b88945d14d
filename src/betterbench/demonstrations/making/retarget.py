"""Transfer a skill to another scene, keeping its motion relative to the object or the target region.

A pick or a slide keeps its motion relative to the object: ``T_new(t) = T_object_new  T_object_source^-1
T_target_source(t)``. If the object in the new scene is a different instance of the object's category, the motion is
also shifted. A placement keeps the path of the object's base relative to the target region, because the object may be
held differently. The poses are the commands sent to the controller, not the measured poses of the arm (Mandlekar et
al., MimicGen, 2023).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from betterbench.demonstrations.making.sources import (
    SAME_GOAL_M,
    SourceSkill,
    grasp_shift,
    moved_along_x,
    nearest_goal,
    region_frame,
)
from betterbench.demonstrations.making.transit import retimed
from betterbench.geometry import Pose, angle_between, distance, from_yaw, rotate
from betterbench.interface.state import WorldState
from betterbench.records import SkillWindow
from betterbench.sim.assets import Asset
from betterbench.tasks.relations.placing import foot_offset

CHECKED_EVERY_M = 0.025
"""Minimum distance between two poses of a skill that are checked for collisions [m]."""
CHECKED_EVERY_RAD = 0.25
"""Minimum rotation between two poses of a skill that are checked for collisions [rad]."""


@dataclass(frozen=True, slots=True, eq=False)
class CarriedOver:
    """Skill that was transferred to another scene.

    Attributes:
        source: Name of the source demonstration of the skill.
        targets: Commanded poses ``T_world_tcp``, one per control step.
        gripper: Gripper command of each step.
        change: Index of the first step at which the gripper opens or closes.
    """

    source: str
    targets: tuple[Pose, ...]
    gripper: tuple[float, ...]
    change: int

    def begin_within(self, radius_m: float) -> int:
        """Return the first step of the final approach.

        In the final approach, all poses are close to the pose at which the gripper opens or closes.

        Args:
            radius_m: Maximum distance from that pose [m].
        """
        there = self.targets[self.change].position
        step = self.change
        while step > 0 and distance(self.targets[step - 1].position, there) <= radius_m:
            step -= 1
        return step

    def from_step(self, begin: int, *, faster: float = 1.0) -> CarriedOver:
        """Return the part of the skill that begins at a given step.

        The motion is sped up until the gripper opens or closes.

        After that step, the motion keeps its recorded speed.

        Args:
            begin: First step to keep.
            faster: Speed-up factor of the motion.
        """
        before = retimed(self.targets[begin : self.change + 1], faster)
        gripper = (self.gripper[begin],) * (len(before) - 1) + self.gripper[self.change :]
        return CarriedOver(self.source, (*before[:-1], *self.targets[self.change :]), gripper, len(before) - 1)

    def checkpoints(self, begin: int, end: int) -> list[Pose]:
        """Return the poses at which to check the steps ``begin`` to ``end`` for collisions.

        The poses at the steps ``begin`` and ``end`` are included.
        """
        found = [self.targets[begin]]
        for pose in self.targets[begin + 1 : end]:
            far = distance(pose.position, found[-1].position) >= CHECKED_EVERY_M
            if far or angle_between(pose.quaternion, found[-1].quaternion) >= CHECKED_EVERY_RAD:
                found.append(pose)
        found.append(self.targets[end])
        return found


def carry_pick(skill: SourceSkill, state: WorldState, name: str, asset: Asset, *, turn_rad: float = 0.0) -> CarriedOver:
    """Transfer a pick to an object in another scene.

    The grasp is rotated about the object's z axis by ``turn_rad`` [rad].
    """
    grasp = skill.object_pose.inverse() @ skill.targets[skill.change]
    turned = state.pose(name) @ Pose((0.0, 0.0, 0.0), from_yaw(turn_rad))
    to_new = turned @ grasp_shift(skill.asset, grasp, asset) @ skill.object_pose.inverse()
    return CarriedOver(skill.source, tuple(to_new @ t for t in skill.targets), skill.gripper, skill.change)


def carry_slide(skill: SourceSkill, state: WorldState, name: str, asset: Asset, *, slide_m: float) -> CarriedOver:
    """Transfer a slide to a drawer in another scene. The drawer is moved by ``slide_m`` along its own x axis [m]."""
    moved = carry_pick(skill, state, name, asset)
    axis = rotate(state.pose(name).quaternion, (1.0, 0.0, 0.0))
    ratio = slide_m / skill.slid_m if abs(skill.slid_m) > 1e-6 else 1.0
    start, extra, shifted = moved.targets[moved.change].position, 0.0, []
    for i, target in enumerate(moved.targets):
        if i > moved.change and moved.gripper[i] > 0.0:
            along = sum(a * (p - q) for a, p, q in zip(axis, target.position, start, strict=True))
            extra = (ratio - 1.0) * along
        shifted.append(moved_along_x(target, state.pose(name), extra))
    return CarriedOver(moved.source, tuple(shifted), moved.gripper, moved.change)


def carry_place(
    skill: SourceSkill,
    state: WorldState,
    window: SkillWindow,
    *,
    keep_tool: bool = False,
    foot: tuple[float, float, float] | None = None,
) -> CarriedOver | None:
    """Transfer a placement to the target and the grasped object in another scene.

    Args:
        skill: The placement in the source demonstration.
        state: Current state, with the object in the gripper.
        window: Names of the object and the target in this scene.
        keep_tool: Whether to keep the rotation of the tool instead of the rotation of the object, for objects that may
            have any heading.
        foot: World position of the object's base at the release [m]. The default is the expert's candidate placement
            that is nearest to the release in the source demonstration.

    Returns:
        The transferred placement; None if no candidate placement of the expert is near the release.
    """
    to_new = region_frame(state, window) @ skill.frame.inverse()
    shift = (0.0, 0.0, 0.0)
    if skill.anchor is not None:
        wanted = to_new.apply(skill.anchor)
        goal = foot or nearest_goal(state, window, wanted, within_m=SAME_GOAL_M)
        if goal is None:
            return None
        shift = (goal[0] - wanted[0], goal[1] - wanted[1], goal[2] - wanted[2])
    held = state.ee_pose.inverse() @ state.pose(window.object)
    T_tcp_foot = held @ Pose(foot_offset(state.info.object(window.object)))
    T_foot_tcp = None if keep_tool else T_tcp_foot.inverse()
    return CarriedOver(
        skill.source,
        tuple(_placing(to_new @ t, skill.T_tcp_foot, T_tcp_foot, shift, T_foot_tcp) for t in skill.targets),
        skill.gripper,
        skill.change,
    )


def _placing(
    target: Pose, T_tcp_foot_source: Pose, T_tcp_foot: Pose, shift: Sequence[float], T_foot_tcp: Pose | None
) -> Pose:
    """Return the tool pose that places the object's base as in the source demonstration, relative to the target.

    If ``T_foot_tcp`` is None, the tool keeps its rotation from the source demonstration. If it is given, the object
    keeps its rotation.
    """
    foot = (target @ T_tcp_foot_source).translated(*shift)
    if T_foot_tcp is not None:
        return foot @ T_foot_tcp
    dx, dy, dz = rotate(target.quaternion, T_tcp_foot.position)
    x, y, z = foot.position
    return Pose((x - dx, y - dy, z - dz), target.quaternion)
