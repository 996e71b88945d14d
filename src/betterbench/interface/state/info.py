"""The part of the privileged state that stays the same in an episode: objects, their shapes, slots of the table."""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from typing import Any

from betterbench.errors import UnknownNameError, find_named
from betterbench.geometry import IDENTITY_QUATERNION, Pose, Quaternion, Vector


@dataclass(frozen=True, slots=True)
class Region:
    """A named box or disc in an object's frame that tasks refer to: an opening, a ring, a handle, a stacking surface.

    Attributes:
        name: Kind of the region ("inside", "ring", "handle", "top").
        position: Center in the object frame [m].
        half_size: Half extents along the region's own axes [m]. For a disc the first two are its radius.
        quaternion: Rotation of the region in the object frame (w, x, y, z).
    """

    name: str
    position: Vector
    half_size: Vector
    quaternion: Quaternion = IDENTITY_QUATERNION

    @property
    def pose(self) -> Pose:
        """Pose ``T_object_region``."""
        return Pose(self.position, self.quaternion)


@dataclass(frozen=True, slots=True)
class ObjectInfo:
    """Constant properties of one object of a scene: its kind, its asset, its looks and its size.

    Attributes:
        name: Name in the scene ("burger_1"); it carries no meaning for any verdict.
        kind: Its noun in instructions ("burger"); two objects of one kind are interchangeable.
        asset: Identity of the asset ("burger#3").
        color: Color word a person would use ("red").
        shape: Coarse shape word ("round", "cylinder", "box"), compared when a look-alike is grasped.
        role: "item", "distractor", "container" or "fixture".
        size_m: Extents of the bounding box in the object frame [m]; the origin is the center of its bottom face.
        slot: Name of the slot the object starts at, or None.
    """

    name: str
    kind: str
    asset: str
    category: str
    color: str
    shape: str
    role: str
    fixed: bool
    mass_kg: float
    size_m: Vector
    regions: tuple[Region, ...] = ()
    slot: str | None = None

    def region(self, name: str) -> Region:
        """Return a region by name; an unknown one raises an UnknownNameError."""
        for region in self.regions:  # half of the time of find_named, at every control step
            if region.name == name:
                return region
        return find_named(f"region of {self.name}", name, self.regions)


@dataclass(frozen=True, slots=True)
class SlotInfo:
    """A named start position on the table.

    Attributes:
        position: Center on the table [m], world frame.
        yaw: Nominal heading of what stands there [rad].
        trained_kinds: Kinds of object that stood here in the training distribution.
        picked_kinds: Kinds of object that were picked here in the training distribution.
    """

    name: str
    position: Vector
    yaw: float
    trained_kinds: tuple[str, ...] = ()
    picked_kinds: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class SceneInfo:
    """The part of the privileged state that does not change, for one scene.

    Attributes:
        objects: All objects, in the order in which states list them.
        home_position: End-effector position at reset [m], world frame.
        gripper_opening_m: Largest distance of the finger pads [m].
    """

    objects: tuple[ObjectInfo, ...]
    slots: tuple[SlotInfo, ...]
    home_position: Vector
    gripper_opening_m: float
    _index: dict[str, int] = field(init=False, repr=False, compare=False, default_factory=dict)

    def __post_init__(self) -> None:
        """Index the objects by name."""
        self._index.update({o.name: i for i, o in enumerate(self.objects)})

    def index(self, name: str) -> int:
        """Return an object's position in the lists of a state; an unknown name raises an UnknownNameError."""
        try:
            return self._index[name]
        except KeyError:
            raise UnknownNameError("object", name, self._index) from None

    def object(self, name: str) -> ObjectInfo:
        """Return an object by name."""
        return self.objects[self.index(name)]

    def __contains__(self, name: str) -> bool:
        """Tell whether the scene has an object of this name."""
        return name in self._index

    def of_kind(self, kind: str) -> tuple[ObjectInfo, ...]:
        """Return all objects that an instruction could mean by ``kind``."""
        return tuple(o for o in self.objects if o.kind == kind)

    def slot(self, name: str) -> SlotInfo:
        """Return a slot by name."""
        return find_named("slot", name, self.slots)

    def to_json(self) -> dict[str, Any]:
        """Return the JSON form."""
        objects = [{**_form(o), "regions": [_form(region) for region in o.regions]} for o in self.objects]
        form = {**_form(self), "objects": objects, "slots": [_form(slot) for slot in self.slots]}
        del form["_index"]
        return form


def _form(value: Region | ObjectInfo | SlotInfo | SceneInfo) -> dict[str, Any]:
    """Return the fields of a value by name; ``asdict`` would copy every number, and takes ten times as long."""
    return {f.name: getattr(value, f.name) for f in fields(value)}
