"""Decisions about an imported object: changes (with the values before and after each change), verdicts, and undo.

Poses, planes, grasps and regions are given in the object's frame at the time of the change. Its origin is in the middle
of the bottom of the bounding box, with z up.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import Field

from betterbench.geometry import Quaternion, Vector
from betterbench.interface.state import Region
from betterbench.jobs.decisions import Undo, Verdict
from betterbench.json_form import strict_form
from betterbench.sim.assets.asset import Grasp
from betterbench.sim.assets.importing.upright import LEAST_M, MOST_M

HEAVIEST_KG = 20.0

_Length = Annotated[float, Field(ge=LEAST_M, le=MOST_M)]
_Mass = Annotated[float, Field(gt=0.0, le=HEAVIEST_KG)]
_Name = Annotated[str, Field(min_length=1, max_length=80, pattern=r"^[^\x00-\x1f\x7f]*\S[^\x00-\x1f\x7f]*$")]


@strict_form
@dataclass(frozen=True, slots=True)
class Plane:
    """Plane on which an object rests, given by its unit normal and its height along the normal [m]."""

    normal: Vector = (0.0, 0.0, 1.0)
    height_m: float = 0.0


@strict_form
@dataclass(frozen=True, slots=True)
class PoseChange:
    """Rotation of the object. ``before`` and ``after`` are rotations (w, x, y, z) relative to the imported pose.

    After the rotation, the collision shape, grasps and regions are computed again.
    """

    before: Quaternion
    after: Quaternion
    kind: Literal["pose"] = "pose"


@strict_form
@dataclass(frozen=True, slots=True)
class ScaleChange:
    """New size of the object. ``before`` and ``after`` are lengths of the longest side of its bounding box [m].

    The mass stays the same. The collision shape, grasps and regions are computed again after the change.
    """

    before: _Length
    after: _Length
    kind: Literal["scale"] = "scale"


@strict_form
@dataclass(frozen=True, slots=True)
class SupportChange:
    """New plane on which the object rests. ``before`` is always the bottom of the bounding box.

    The object is turned by the smallest rotation that makes the plane horizontal. Parts below the plane do not touch
    the table. The collision shape, grasps and regions are computed again.
    """

    before: Plane
    after: Plane
    kind: Literal["support"] = "support"


@strict_form
@dataclass(frozen=True, slots=True)
class GraspChange:
    """Grasp that was moved, added (``before`` is None) or removed (``after`` is None)."""

    before: Grasp | None
    after: Grasp | None
    kind: Literal["grasp"] = "grasp"


@strict_form
@dataclass(frozen=True, slots=True)
class RegionChange:
    """Placement frame (opening, floor, base or top) that was moved, added or removed.

    As in :class:`GraspChange`, ``before`` is None for an added frame, and ``after`` is None for a removed frame.
    """

    before: Region | None
    after: Region | None
    kind: Literal["region"] = "region"


@strict_form
@dataclass(frozen=True, slots=True)
class MassChange:
    """Change to the mass of the object [kg]. The inertia changes in proportion to the mass."""

    before: _Mass
    after: _Mass
    kind: Literal["mass"] = "mass"


@strict_form
@dataclass(frozen=True, slots=True)
class NameChange:
    """Change to the name of the object. The name determines the object's description and tags."""

    before: _Name
    after: _Name
    kind: Literal["name"] = "name"


Change = PoseChange | ScaleChange | SupportChange | GraspChange | RegionChange | MassChange | NameChange
"""A change to an object."""
Decision = Annotated[
    PoseChange | ScaleChange | SupportChange | GraspChange | RegionChange | MassChange | NameChange | Verdict | Undo,
    Field(discriminator="kind"),
]
"""A change, a verdict or an undo."""


def said(change: Change) -> str:
    """Describe a change to an object in a short English phrase."""
    match change:
        case PoseChange():
            return "turned"
        case ScaleChange():
            return f"longest side {100 * change.before:.3g} cm → {100 * change.after:.3g} cm"
        case SupportChange():
            return f"support plane {1000 * change.after.height_m:+.0f} mm"
        case MassChange():
            return f"mass {1000 * change.before:.3g} g → {1000 * change.after:.3g} g"
        case NameChange():
            return f"name {change.before} → {change.after}"
        case GraspChange() | RegionChange():
            named = change.after or change.before
            how = "added" if change.before is None else "removed" if change.after is None else "moved"
            what = "grasp" if isinstance(change, GraspChange) else "frame"
            return f"{what} {named.name if named else ''} {how}"
