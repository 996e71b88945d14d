"""State of one person's review of objects. The browser page is in a different module.

The state consists of the current object, the edit in progress, and the decisions. An edit is a change that has not been
saved. An edit is saved as a line of the review file by :meth:`ReviewDesk.keep`, when the person begins a different kind
of edit, or when the person gives a verdict.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar, Literal

from pydantic import ValidationError

from betterbench.errors import BetterError, one_line
from betterbench.geometry import IDENTITY_QUATERNION, Pose, Quaternion, from_axis_angle, multiply, normalize, rotate
from betterbench.interface.state import Region
from betterbench.jobs.decisions import now
from betterbench.review.base_desk import Desk
from betterbench.review.queue import QueuedObject
from betterbench.sim.assets import Asset, Grasp
from betterbench.sim.assets.authoring.draft import JAW_OPENS_ALONG_Y
from betterbench.sim.assets.authoring.registry import asset_of
from betterbench.sim.assets.importing.measures import visual_surface
from betterbench.sim.assets.importing.review import (
    Change,
    GraspChange,
    History,
    MassChange,
    NameChange,
    Plane,
    PoseChange,
    RegionChange,
    Review,
    ReviewState,
    ScaleChange,
    SupportChange,
    Verdict,
    changed,
)
from betterbench.sim.assets.importing.review.changes import Decision, said
from betterbench.sim.assets.importing.solid import Solid, solid_of
from betterbench.sim.scenes.tryouts import Tryout, try_drop, try_lift

Mode = Literal["pose", "support", "grasp", "frame"]
MODES: tuple[Mode, ...] = ("pose", "support", "grasp", "frame")

TURN_DEGREES, FINE_DEGREES = 90.0, 5.0
SIZE_STEP = 1.05
FRAME_NAMES = ("opening", "inside", "floor", "top", "rim", "base", "slot")
"""Names for new placement frames. A new frame gets the first name that is free."""


@dataclass(slots=True)
class ReviewDesk(Desk[QueuedObject, Review, Change]):
    """State of one review of objects, as shown on the review page.

    The gizmo on the page can rotate the object, or move its support plane, a grasp or a placement frame (``MODES``).
    """

    ITEM: ClassVar[str] = "object"
    SUBJECT: ClassVar[str] = "object"

    mode: str = "pose"
    _solid: tuple[ReviewState, Solid] | None = None

    @property
    def state(self) -> ReviewState | None:
        """The current object with all saved changes, or None if it cannot be imported."""
        return self.at_hand.state

    @property
    def history(self) -> History:
        """Decisions about the current object."""
        return self.journal.history(self.at_hand.content)

    @property
    def judged(self) -> int:
        """Number of objects in the queue that have a verdict."""
        return sum(verdict is not None for verdict in self.verdicts())

    def verdicts(self) -> list[Verdict | None]:
        """Return the current verdict on each object in the queue, or None for objects without a verdict."""
        return [self.journal.history(item.content).verdict for item in self.queue]

    @property
    def asset(self) -> Asset | None:
        """The current object as an asset, or None if it cannot be imported."""
        state = self.state
        return None if state is None else asset_of(state.imported.draft, "reviewed", color="gray")

    @property
    def solid(self) -> Solid | None:
        """Grid cells that the current object occupies, or None if the object cannot be imported."""
        state = self.state
        if state is None:
            return None
        if self._solid is None or self._solid[0] is not state:
            asset = self.asset
            self._solid = None if asset is None else (state, solid_of(*visual_surface(asset)))
        return None if self._solid is None else self._solid[1]

    @property
    def grasp(self) -> Grasp | None:
        """The selected grasp, with the edit in progress applied. None if the object has no grasp."""
        if isinstance(self.edit, GraspChange):
            return self.edit.after
        grasps = () if self.state is None else self.state.imported.draft.grasps
        return grasps[self.selected % len(grasps)] if grasps else None

    @property
    def region(self) -> Region | None:
        """The selected placement frame, with the edit in progress applied. None if the object has no such frame."""
        if isinstance(self.edit, RegionChange):
            return self.edit.after
        regions = () if self.state is None else self.state.imported.draft.regions
        return regions[self.selected % len(regions)] if regions else None

    @property
    def plane(self) -> Plane:
        """Plane on which the object rests, with the edit in progress applied."""
        return self.edit.after if isinstance(self.edit, SupportChange) else Plane()

    @property
    def turn(self) -> Quaternion:
        """Rotation (w, x, y, z) of the object in the edit in progress, relative to its last saved pose."""
        if not isinstance(self.edit, PoseChange):
            return IDENTITY_QUATERNION
        w, x, y, z = self.edit.before
        return normalize(multiply(self.edit.after, (w, -x, -y, -z)))

    def _open(self) -> None:
        self.at_hand.load(self.history)

    # ------------------------------------------------------------------------------------------------------- editing

    def turn_by(self, axis: Sequence[float], degrees: float) -> None:
        """Rotate the object about a world axis.

        If the edit in progress is already a rotation, the two rotations are combined.
        """
        step = from_axis_angle([math.radians(degrees) * v for v in axis])
        self.turn_to(normalize(multiply(step, self.turn)))

    def turn_to(self, turn: Quaternion) -> None:
        """Set the rotation of the object relative to its saved state."""
        state = self._begin(PoseChange)
        if state is not None:
            self.edit = PoseChange(state.turned, normalize(multiply(turn, state.turned)))

    def size(self, longest_m: float) -> None:
        """Scale the object so that its longest side has the given length [m]."""
        state = self._begin(ScaleChange)
        if state is not None:
            self.edit = ScaleChange(max(state.size_m), longest_m)

    def size_by(self, factor: float) -> None:
        """Scale the object by a factor.

        If the edit in progress is already a scaling, the two factors are multiplied.
        """
        if self.state is not None:
            longest = self.edit.after if isinstance(self.edit, ScaleChange) else max(self.state.size_m)
            self.size(round(factor * longest, 4))

    def weigh(self, mass_kg: float) -> None:
        """Set the mass of the object [kg]."""
        state = self._begin(MassChange)
        if state is not None:
            self.edit = MassChange(state.imported.draft.mass_kg, mass_kg)

    def call(self, name: str) -> None:
        """Set the name of the object."""
        state = self._begin(NameChange)
        if state is not None:
            self.edit = NameChange(state.name, name.strip())

    def drag(self, pose: Pose) -> None:
        """Move the element that the gizmo controls to a pose in the object's frame.

        If the gizmo controls the object itself, the object is only rotated.
        """
        if self.mode == "pose":
            self.turn_to(pose.quaternion)
        elif self.mode == "support" and self._begin(SupportChange) is not None:
            normal = rotate(pose.quaternion, (0.0, 0.0, 1.0))
            height = sum(n * p for n, p in zip(normal, pose.position, strict=True))
            self.edit = SupportChange(Plane(), Plane(normal, height))
        elif self.mode == "grasp" and self._begin(GraspChange) is not None and self.grasp is not None:
            before = self.edit.before if isinstance(self.edit, GraspChange) else self.grasp
            self.edit = GraspChange(before, replace(self.grasp, pose=pose, symmetric_yaw=False))
        elif self.mode == "frame" and self._begin(RegionChange) is not None and self.region is not None:
            former = self.edit.before if isinstance(self.edit, RegionChange) else self.region
            moved = replace(self.region, position=pose.position, quaternion=pose.quaternion)
            self.edit = RegionChange(former, moved)

    def add(self) -> None:
        """Add a new grasp or placement frame in the middle of the object.

        The new grasp or frame remains an edit in progress until it is saved.
        """
        state = self.state
        if state is None or not self.keep():
            return
        draft = state.imported.draft
        x, y, z = state.size_m
        if self.mode == "grasp":
            name = _free("grasp", [g.name for g in draft.grasps])
            first = min((g.preference for g in draft.grasps), default=1) - 1
            pose = Pose((0.0, 0.0, round(0.6 * z, 4)), JAW_OPENS_ALONG_Y)
            width = min(max(y, 0.004), 0.076)
            self.edit = GraspChange(None, Grasp(name, pose, round(width, 4), 0.002, preference=first))
        elif self.mode == "frame":
            taken = [r.name for r in draft.regions]
            name = next((n for n in FRAME_NAMES if n not in taken), _free("frame", taken))
            self.edit = RegionChange(None, Region(name, (0.0, 0.0, z), (0.25 * x, 0.25 * y, 0.001)))
        else:
            self._say("Choose grasps (3) or frames (4) first.", problem=True)

    def remove(self) -> None:
        """Remove the selected grasp or placement frame, and save this change."""
        if self.mode == "grasp" and self.grasp is not None:
            former = self.edit.before if isinstance(self.edit, GraspChange) else self.grasp
            self.edit = None if former is None else GraspChange(former, None)
        elif self.mode == "frame" and self.region is not None:
            before = self.edit.before if isinstance(self.edit, RegionChange) else self.region
            self.edit = None if before is None else RegionChange(before, None)
        else:
            self._say("There is nothing to remove.", problem=True)
            return
        self.keep()

    def keep(self) -> bool:
        """Save the edit in progress as a change. If this fails, store the reason in ``message`` and return False."""
        edit, state, item = self.edit, self.state, self.at_hand
        if edit is None or state is None:
            return True
        self.edit = None
        if edit.before == edit.after:
            return True
        try:
            # Reject a size of several meters, which would take a minute to compute.
            self.journal.check(self._review(edit))
            new = changed(state, edit, where=item.name)
            self._write(edit)
        except (BetterError, ValidationError) as error:
            self._say(one_line(error), problem=True)
            return False
        item.states.append(new)
        self._say(f"Kept: {said(edit)}.")
        return True

    # ------------------------------------------------------------------------------------------------------ decisions

    def accept(self) -> None:
        """Accept the object with its changes, and go to the next object."""
        if self.keep() and self.state is not None:
            self._judge(Verdict("fix" if self.history.changes else "accept"))

    def _undone(self, review: Review) -> None:
        if not isinstance(review.decision, Verdict) and len(self.at_hand.states) > 1:
            self.at_hand.states.pop()
        undone = review.decision
        what = f"verdict {undone.verdict}" if isinstance(undone, Verdict) else said(undone)  # type: ignore[arg-type]
        self._say(f"Undone: {what}.")

    def _write(self, decision: Decision) -> None:
        self.journal.append(self._review(decision))

    def _review(self, decision: Decision) -> Review:
        item, state = self.at_hand, self.state
        size = (0.0, 0.0, 0.0) if state is None else state.size_m
        return Review(self.author, now(), item.content, item.name, size, decision)

    # --------------------------------------------------------------------------------------------------------- trials

    def try_drop(self) -> Tryout | None:
        """Simulate dropping the object onto a table. The edit in progress is saved first."""
        asset = self.asset if self.keep() else None
        asset = self.asset if asset is not None else None
        return None if asset is None else self._told(try_drop(asset))

    def try_lift(self) -> Tryout | None:
        """Simulate lifting the object by the selected grasp, or by its first grasp.

        The edit in progress is saved first.
        """
        if not self.keep():
            return None
        asset = self.asset
        if asset is None or not asset.grasps:
            self._say("The object has no grasp: add one (3, N).", problem=True)
            return None
        chosen = self.grasp if self.mode == "grasp" else asset.grasps[0]
        return None if chosen is None else self._told(try_lift(asset, chosen))

    def _told(self, tryout: Tryout) -> Tryout:
        self._say(tryout.sentence, problem=not tryout.passed)
        return tryout

    # -------------------------------------------------------------------------------------------------------- helpers

    def _begin(self, kind: type[Change]) -> ReviewState | None:
        """Begin an edit of the given kind. If an edit of another kind is in progress, it is saved first.

        Returns:
            The state of the object to edit. None if the object cannot be imported, or if the previous edit could not be
            saved.
        """
        if self.edit is not None and not isinstance(self.edit, kind) and not self.keep():
            return None
        return self.state


def _free(stem: str, taken: Sequence[str]) -> str:
    """Return an unused name for a grasp: "grasp" if it is free, and otherwise "grasp2", "grasp3" and so on."""
    return next(name for k in range(1, len(taken) + 2) if (name := stem if k == 1 else f"{stem}{k}") not in taken)
