"""State of one person's review of scenes. The browser page is in a different module.

The state consists of the current scene, the edit in progress, and the decisions.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar, Literal

from pydantic import ValidationError

from betterbench.certification.certificate import CLAUSES, TrialCertificate
from betterbench.certification.examine import examine_condition
from betterbench.errors import BetterError, one_line
from betterbench.geometry import Pose, Vector, from_yaw, yaw_of
from betterbench.interface.actions import EE_DELTA
from betterbench.interface.state import Region
from betterbench.jobs.decisions import Verdict, now
from betterbench.review.base_desk import Desk
from betterbench.review.scenes.changes import (
    FrameChange,
    SceneChange,
    SceneDecision,
    SceneHistory,
    SceneReview,
    SlotChange,
    SlotPlace,
    said,
)
from betterbench.review.scenes.forms import is_same_frame, moved_frames, scene_content
from betterbench.review.scenes.queue import QueuedScene, condition_of, support_of
from betterbench.sim.assets.authoring.registry import moved_regions
from betterbench.sim.scenes import Placement, Scene
from betterbench.sim.scenes.stage import QUALITIES
from betterbench.tasks import Condition, Slot, Task

Mode = Literal["slot", "frame"]
MODES: tuple[Mode, ...] = ("slot", "frame")
STEP_M, STEP_DEGREES = 0.005, 5.0
"""Distance [m] and angle [degrees] by which one key press moves or turns the selected slot or frame."""
SEEDS = 5
"""Number of seeds that the page can show for a scene."""


@dataclass(slots=True)
class SceneDesk(Desk[QueuedScene, SceneReview, SceneChange]):
    """State of one review of scenes.

    The gizmo can move a slot (the start position of an object) or a placement frame (``MODES``).

    Attributes:
        movable: Names of the assets that come from a folder of imported assets. Only the placement frames of these
            assets can be moved.
        seed: Seed of the trial that is shown for the current scene.
        certified: Result of certifying the current scene, or None if it was not certified yet.
    """

    ITEM: ClassVar[str] = "scene"
    SUBJECT: ClassVar[str] = "task"

    mode: str = "slot"
    movable: frozenset[str] = frozenset()
    seed: int = 0
    certified: TrialCertificate | None = None
    scene: Scene | None = None
    problem: str = ""

    @property
    def history(self) -> SceneHistory:
        """Decisions about the task of the current scene."""
        return self.journal.history(self.at_hand.task.content)

    @property
    def task(self) -> Task:
        """Task of the current scene, with all saved changes."""
        return self.at_hand.task.changed(self.history.changes)

    @property
    def condition(self) -> Condition:
        """Condition (training or variation) of the current scene."""
        return condition_of(self.task, self.at_hand.condition)

    @property
    def content(self) -> str:
        """Hash of the current scene with all saved changes."""
        return scene_content(self.task, self.condition, self.history.changes)

    @property
    def is_changed(self) -> bool:
        """Whether any saved change affects the current scene."""
        task = self.at_hand.task.changed(())
        return self.content != scene_content(task, condition_of(task, self.at_hand.condition))

    def verdicts(self) -> list[Verdict | None]:
        """Return the current verdict on each scene in the queue, or None for scenes without a verdict."""
        return [scene.verdict(self.journal.history(scene.task.content)) for scene in self.queue]

    # -------------------------------------------------------------------------------------------------- slots, frames

    @property
    def slots(self) -> tuple[Slot, ...]:
        """Slots that the condition uses, with the edit in progress applied."""
        used = dict.fromkeys(self.condition.layout.values())
        return tuple(self._edited(self.task.slot(name)) for name in used)

    def _edited(self, slot: Slot) -> Slot:
        edit = self.edit
        if not isinstance(edit, SlotChange) or edit.slot != slot.name:
            return slot
        return replace(slot, x=edit.after.x, y=edit.after.y, yaw=edit.after.yaw)

    @property
    def slot(self) -> Slot | None:
        """The selected slot, with the edit in progress applied. None if the condition uses no slots."""
        slots = self.slots
        return slots[self.selected % len(slots)] if slots else None

    @property
    def frames(self) -> tuple[tuple[Placement, Region], ...]:
        """Placement frames of all objects that hold other objects in the task, with the edit in progress applied."""
        if self.scene is None:
            return ()
        edit = self.edit
        targets = self.condition.instruction.subgoals
        wanted = {goal.target for goal in targets}
        wanted |= {place.target for place in self.condition.preplaced.values()}
        found = []
        for placement in self.scene.placements:
            if placement.spec.name in wanted:
                for region in placement.asset.regions:
                    is_edited = (
                        isinstance(edit, FrameChange)
                        and edit.asset == placement.asset.category
                        and edit.after.name == region.name
                    )
                    shown = edit.after if is_edited and isinstance(edit, FrameChange) else region
                    found.append((placement, shown))
        return tuple(found)

    @property
    def frame(self) -> tuple[Placement, Region] | None:
        """The selected placement frame and its object, with the edit in progress applied. None if there is no frame."""
        frames = self.frames
        return frames[self.selected % len(frames)] if frames else None

    def poses(self) -> dict[str, Pose]:
        """Return the initial pose ``T_world_object`` of each object, with the edit in progress applied."""
        if self.scene is None:
            return {}
        poses = {p.spec.name: p.pose for p in self.scene.placements}
        if not isinstance(self.edit, SlotChange):
            return poses
        a, b = self.edit.before, self.edit.after
        move = Pose((b.x, b.y, 0.0), from_yaw(b.yaw)) @ Pose((a.x, a.y, 0.0), from_yaw(a.yaw)).inverse()
        return {name: move @ poses[name] if name in self._carried(self.edit.slot) else poses[name] for name in poses}

    def _carried(self, slot: str) -> set[str]:
        """Return the names of the objects that move when a slot is moved.

        They are the object in the slot, and all objects that stand on or in that object.
        """
        condition = self.condition
        found = {name for name, place in condition.layout.items() if place == slot}
        on = {name: place.target for name, place in condition.preplaced.items()}
        on |= {spec.name: spec.mount.target for spec in condition.objects if spec.mount is not None}
        while more := {name for name, target in on.items() if target in found and name not in found}:
            found |= more
        return found

    # -------------------------------------------------------------------------------------------------------- moving

    def step_seed(self) -> None:
        """Show the current scene with the next seed. The edit in progress is saved first."""
        if self.keep():
            self.seed = (self.seed + 1) % SEEDS
            self._open()
            self._say(f"Seed {self.seed}.")

    def _open(self) -> None:
        """Build the current scene. If this fails, store the reason in ``problem``."""
        self.scene, self.problem, self.certified = None, "", None
        try:
            with moved_regions(moved_frames(self.history.changes)):
                self.scene = Scene(
                    self.task,
                    self.condition,
                    seed=self.seed,
                    action_space=EE_DELTA,
                    quality=QUALITIES["standard"],
                )
        except BetterError as error:
            self.problem = one_line(error)

    # ------------------------------------------------------------------------------------------------------- editing

    def drag(self, pose: Pose) -> None:
        """Move the selected slot or placement frame to a pose in the world frame. A slot stays on the table."""
        if self.mode == "slot" and self.slot is not None:
            x, y, _ = pose.position
            yaw = self.slot.yaw + math.remainder(yaw_of(pose.quaternion) - self.slot.yaw, math.tau)
            self._move_slot(x, y, yaw)
        elif self.mode == "frame" and self.frame is not None:
            placement, region = self.frame
            local = self.poses()[placement.spec.name].inverse() @ pose
            self._move_frame(placement, region, local)

    def nudge(self, along: Vector, degrees: float = 0.0) -> None:
        """Move the selected slot or placement frame by a vector [m], and turn it about the vertical axis."""
        if self.mode == "slot" and self.slot is not None:
            slot = self.slot
            self._move_slot(slot.x + along[0], slot.y + along[1], slot.yaw + math.radians(degrees))
        elif self.mode == "frame" and self.frame is not None:
            placement, region = self.frame
            world = self.poses()[placement.spec.name] @ region.pose
            turn = Pose(world.position, from_yaw(math.radians(degrees))) @ Pose((0.0, 0.0, 0.0), world.quaternion)
            self._move_frame(placement, region, self.poses()[placement.spec.name].inverse() @ turn.translated(*along))

    def _move_slot(self, x: float, y: float, yaw: float) -> None:
        if self.slot is None:
            return
        kept = self.task.slot(self.slot.name)
        before = SlotPlace(kept.x, kept.y, kept.yaw)
        self.edit = SlotChange(kept.name, before, SlotPlace(round(x, 4), round(y, 4), round(yaw, 4)))

    def _move_frame(self, placement: Placement, region: Region, local: Pose) -> None:
        category = placement.asset.category
        if category not in self.movable:
            self._say(
                f"The frames of {category} are part of the library. Only the frames of assets from --asset-dir can be "
                f"moved.",
                problem=True,
            )
            return
        x, y, z = (round(v, 5) + 0.0 for v in local.position)
        w, i, j, k = (round(v, 7) + 0.0 for v in local.quaternion)
        kept = placement.asset.region(region.name)
        self.edit = FrameChange(category, kept, replace(kept, position=(x, y, z), quaternion=(w, i, j, k)))

    def keep(self) -> bool:
        """Save the edit in progress as a change. If this fails, store the reason in ``message`` and return False."""
        edit = self.edit
        if edit is None:
            return True
        self.edit = None
        if edit.before == edit.after or (isinstance(edit, FrameChange) and is_same_frame(edit.before, edit.after)):
            return True
        try:
            self.at_hand.task.changed((*self.history.changes, edit))
            self._write(edit)
        except (BetterError, ValidationError) as error:
            self._say(one_line(error), problem=True)
            return False
        self._open()
        self._say(f"Kept: {said(edit)}.")
        return True

    # ------------------------------------------------------------------------------------------------------ decisions

    def accept(self) -> None:
        """Accept the scene with all changes that affect it, and go to the next scene."""
        if self.keep():
            if self.problem:
                self._say("The scene cannot be built. Reject it, or undo the change.", problem=True)
                return
            self._judge(Verdict("fix" if self.is_changed else "accept"))

    def _undone(self, review: SceneReview) -> None:
        at = [k for k, item in enumerate(self.queue) if item.name == review.subject]
        self._go(at[0] if at else self.index)
        undone = review.decision
        if isinstance(undone, SlotChange | FrameChange):
            self._say(f"Undone: {said(undone)}.")
        elif isinstance(undone, Verdict):
            self._say(f"Undone: {undone.verdict} of {review.subject}.")

    def _write(self, decision: SceneDecision) -> None:
        item = self.at_hand
        self.journal.append(
            SceneReview(self.author, now(), item.task.content, item.task.name, item.condition, self.content, decision)
        )

    # ------------------------------------------------------------------------------------------------------ certifying

    def certify(self) -> None:
        """Certify the scene with the current seed, as ``better certify`` does. The edit in progress is saved first."""
        if not self.keep():
            return
        if self.problem:
            self._say(self.problem, problem=True)
            return
        task, name = self.task, self.at_hand.condition
        try:
            with moved_regions(moved_frames(self.history.changes)):
                found = examine_condition(
                    task,
                    self.condition,
                    self.seed,
                    support=support_of(task, name),
                    training=name in {condition.name for condition in task.training},
                )
        except BetterError as error:
            self._say(one_line(error), problem=True)
            return
        self.certified = found
        if found.passed:
            self._say(f"Certified with seed {self.seed}: the expert needs {found.steps} of {found.step_limit} steps.")
        else:
            failed = "; ".join(f"({letter}) {found.clauses[letter].text or CLAUSES[letter]}" for letter in found.failed)
            self._say(f"Not certified with seed {self.seed}: {one_line(failed, most=300)}.", problem=True)


def bodies_of(scene: Scene) -> Mapping[str, int]:
    """Return the MuJoCo body id of each object in a scene, keyed by the name of the object."""
    return {p.spec.name: int(body) for p, body in zip(scene.placements, scene.compiled.bodies, strict=True)}
