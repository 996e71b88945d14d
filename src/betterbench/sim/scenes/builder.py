"""Compilation of a scene from a condition and a seed. Assets are chosen and placed, and geoms are labeled."""

from __future__ import annotations

import functools
import hashlib
import itertools
import math
import threading
from collections import OrderedDict
from collections.abc import Mapping
from dataclasses import dataclass

import mujoco
import numpy as np

from betterbench.errors import InvalidInputError
from betterbench.geometry import Pose, Vector, from_yaw, yaw_of
from betterbench.sim.assets import Asset, build
from betterbench.sim.robots import RobotSpec, build_robot_spec, robot
from betterbench.sim.scenes.appearance import look_of
from betterbench.sim.scenes.instances import ROBOT_PREFIX
from betterbench.sim.scenes.objects import add_asset, rail_of, rest_pose
from betterbench.sim.scenes.rooms import Room
from betterbench.sim.scenes.stage import WRIST_CAMERA, Quality, add_mounted_camera, stage_spec
from betterbench.tasks import Condition, Looks, ObjectSpec, TargetRegion, Task, stream
from betterbench.tasks.demonstrated import FlatPose, demonstrated, final_pose, joint_index
from betterbench.tasks.relations import relation as relation_named
from betterbench.tasks.relations.closed import MOUNTS
from betterbench.tasks.relations.layer import LAYERS


@dataclass(frozen=True, slots=True)
class Placement:
    """Object of a scene: its description, its asset, and its pose ``T_world_object`` at reset.

    For a drawer, ``shut`` is its pose when closed.
    """

    spec: ObjectSpec
    asset: Asset
    pose: Pose
    shut: Pose | None = None

    @property
    def anchored(self) -> Pose | None:
        """Pose of a fixed object or a closed drawer in the compiled model.

        It is None for an object that moves freely.
        """
        return self.pose if self.spec.fixed else self.shut


@dataclass(frozen=True, slots=True, eq=False)
class CompiledScene:
    """Compiled model, with the bodies, joint addresses and geoms that belong to each object.

    Scenes with the same assets share it.

    Attributes:
        content_hash: Hash of everything that the model is compiled from (hex, 16 characters).
        bodies: Body id of each object, in scene order.
        qpos_addresses: First index into qpos of each object, or -1 if the object is fixed.
        dof_addresses: First index into qvel of each object, or -1 if the object is fixed.
        slides: Boolean array (n,) that is True for drawers. The only joint coordinate of a drawer is its opening [m].
        geom_labels: Index of each geom's label (ngeom,), or -1 for a geom without one. Labels are the object names,
            followed by :data:`LABELS`.
    """

    model: mujoco.MjModel
    content_hash: str
    robot: RobotSpec
    bodies: np.ndarray
    qpos_addresses: np.ndarray
    dof_addresses: np.ndarray
    slides: np.ndarray
    geom_labels: np.ndarray


LABELS = ("left_finger", "right_finger", "hand", "arm", "table", "floor")
"""Names that contacts use for bodies other than objects."""


def slot_pose(task: Task, seed: int, slot_name: str) -> tuple[Vector, float]:
    """Return the position on the table [m] and the heading [rad] of the object in a slot of a trial.

    The random offset (jitter) of the object belongs to the slot. It depends neither on the object in the slot nor on
    objects elsewhere.
    """
    slot = task.slot(slot_name)
    dx, dy, dyaw = stream(task.id, seed, f"slot:{slot_name}").uniform(-1.0, 1.0, 3)
    position = (slot.x + slot.jitter_m * float(dx), slot.y + slot.jitter_m * float(dy), 0.0)
    return position, slot.yaw + slot.yaw_jitter * float(dyaw)


def place_objects(task: Task, condition: Condition, seed: int, *, shown: Looks = "seen") -> tuple[Placement, ...]:
    """Return all objects of a condition with their assets and poses. Their order does not depend on names."""
    chosen = {
        o.name: build(o.category, look=look_of(task.id, seed, o, shown=shown), color=o.color) for o in condition.objects
    }
    poses: dict[str, Pose] = {}
    for name, slot in condition.layout.items():
        position, yaw = slot_pose(task, seed, slot)
        ground = Pose(position, from_yaw(yaw))
        poses[name] = ground if condition.object(name).fixed else ground @ rest_pose(chosen[name])
    shut: dict[str, Pose] = {}
    for o in condition.objects:
        if o.mount is not None:
            mount = chosen[o.mount.target].region(o.mount.region)
            shut[o.name] = poses[o.mount.target] @ mount.pose
            poses[o.name] = shut[o.name] @ Pose((_opening(condition, o.name, chosen[o.name]), 0.0, 0.0))
    flats = {name: _drawn_pose(task, condition, seed, name, chosen) for name in condition.preplaced}
    _move_apart(condition, flats, chosen)
    together = _drawn_together(task, condition, seed, chosen)
    for name, place in condition.preplaced.items():
        if name in together:
            middle = Pose(_middle(task, chosen[place.target], place.region))
            poses[name] = poses[place.target] @ middle @ together[name]
            continue
        below = _below(condition, place)
        on = poses[below].apply(_middle(task, chosen[below], place.region))
        flat = flats[name]
        mx, my, _ = _middle(task, chosen[place.target], place.region)
        x, y, _ = poses[place.target].apply((mx + 0.001 * flat.x_mm, my + 0.001 * flat.y_mm, 0.0))
        yaw = yaw_of(poses[place.target].quaternion) + math.radians(flat.yaw_deg)
        poses[name] = Pose((x, y, on[2]), from_yaw(yaw)) @ rest_pose(chosen[name])
    placements = [Placement(o, chosen[o.name], poses[o.name], shut.get(o.name)) for o in condition.objects]

    def order(p: Placement) -> tuple[str, ...]:
        there = condition.preplaced.get(p.spec.name) or p.spec.mount
        where = condition.layout.get(p.spec.name, "" if there is None else f"~{there.region}")
        return (p.spec.role, p.asset.identity, where)

    return tuple(sorted(placements, key=order))


def _opening(condition: Condition, name: str, asset: Asset) -> float:
    """Return how far a drawer is open at the start of a trial [m]. Raises an error if it cannot be opened that far."""
    opening, travel = condition.opened.get(name, 0.0), rail_of(asset).travel_m
    if not 0.0 <= opening <= travel:
        raise InvalidInputError(
            f"{condition.id} opened[{name!r}]", f"{opening} m is out of range", f"Use a distance from 0 to {travel} m"
        )
    return opening


def _below(condition: Condition, place: TargetRegion) -> str:
    """Return the name of the object that supports a pre-placed object.

    In a stack, this is the object in the next lower layer. Otherwise it is the target.
    """
    for name, other in condition.preplaced.items():
        if other.target == place.target and place.region in LAYERS[1:] and other.region == _under(place.region):
            return name
    return place.target


def _under(layer: str) -> str:
    return LAYERS[LAYERS.index(layer) - 1]


def _middle(task: Task, target: Asset, region: str) -> Vector:
    """Return the center of a target's supporting surface, in the frame of the target [m]."""
    relation = relation_named(task.template.relation)
    if relation.surface is None:
        problem = f"objects cannot be pre-placed {relation.name!r} a target, because the relation has no surface"
        raise InvalidInputError(f"{task.id} preplace", problem, "Define a surface function for the relation")
    return relation.surface({r.name: r for r in target.regions}, region)


def _drawn_pose(task: Task, condition: Condition, seed: int, name: str, chosen: Mapping[str, Asset]) -> FlatPose:
    """Draw the pose of a pre-placed object at its target from the final poses of objects in demonstrations.

    The trial's random stream selects one of these poses. In a container, the object is then moved away from the walls
    if necessary. This is never necessary if the assets are those of the demonstration.

    Raises InvalidInputError if no measured demonstration places an object at this target.
    """
    place, kind = condition.preplaced[name], condition.object(name).kind
    asset, on = chosen[name], chosen[place.target]
    target, relation = condition.object(place.target).kind, relation_named(task.template.relation)
    known = demonstrated(task, engine=engine_version())
    assets = (asset.identity, on.identity)
    poses = known.final_poses_at(target, relation.name, place.region, kind=kind, assets=assets)
    if not poses:
        problem = (
            f"no demonstration places an object {relation.name} {target}{'.' if place.region else ''}{place.region}"
        )
        raise InvalidInputError(
            f"{task.id} preplace {name}", problem, ("Pre-place the object at a target where training places objects")
        )
    flat = final_pose(task, seed, kind=kind, region=place.region, poses=poses)
    if not relation.falls or known.shows(target, relation.name, place.region, assets=assets):
        return flat
    size_mm = 500.0 * max(asset.size_m[:2])
    x_most, y_most = (max(0.0, 1000.0 * half - size_mm) for half in on.region("inside").half_size[:2])
    return FlatPose(min(max(flat.x_mm, -x_most), x_most), min(max(flat.y_mm, -y_most), y_most), flat.yaw_deg)


def _drawn_together(task: Task, condition: Condition, seed: int, chosen: Mapping[str, Asset]) -> dict[str, Pose]:
    """Return poses for objects that share a target region at the start, such as two objects in one container.

    The poses are ``T_middle_object``, i.e. relative to the center of the target region. All objects in a region get
    their poses from one demonstration with the same assets, because objects in a container lean on each other. If there
    is no such demonstration, the objects of the region are left out.
    """
    places: dict[TargetRegion, list[str]] = {}
    for name, place in condition.preplaced.items():
        places.setdefault(place, []).append(name)
    found: dict[str, Pose] = {}
    for place, names in places.items():
        if len(names) < 2:
            continue
        # If objects are of the same kind, their names only determine which object gets which pose.
        names.sort(key=lambda n: (condition.object(n).kind, n))
        objects = [(condition.object(n).kind, chosen[n].identity) for n in names]
        on, relation = chosen[place.target].identity, task.template.relation
        known = demonstrated(task, engine=engine_version()).joint_poses_at(on, relation, place.region)
        posed = [poses for joint in known if (poses := joint.posed(objects)) is not None]
        if posed:
            kinds = [kind for kind, _ in objects]
            drawn = posed[joint_index(task, seed, kinds=kinds, region=place.region, count=len(posed))]
            found |= dict(zip(names, drawn, strict=True))
    return found


def _move_apart(condition: Condition, flats: dict[str, FlatPose], chosen: Mapping[str, Asset]) -> None:
    """Separate two objects that were drawn into the same container and would overlap.

    This is necessary if no demonstration ended with the same assets in the container (see :func:`_drawn_together`),
    because the two poses then come from different demonstrations. Both objects keep their heading. They are moved along
    the line through their centers, to opposite sides of the container's center. Layers of a stack are separate regions
    and are not moved.
    """
    for first, second in itertools.combinations(flats, 2):
        if condition.preplaced[first] != condition.preplaced[second]:
            continue
        a, b = flats[first], flats[second]
        angle = math.atan2(b.y_mm - a.y_mm, b.x_mm - a.x_mm)
        reach_a, reach_b = (_reach_mm(chosen[n], angle - math.radians(flats[n].yaw_deg)) for n in (first, second))
        apart = reach_a + reach_b + 1.0
        if math.dist(a[:2], b[:2]) >= apart:
            continue
        # The outer edges are equally far from the center.
        middle_a, middle_b = -(0.5 * (apart + reach_a + reach_b) - reach_a), 0.5 * (apart + reach_a + reach_b) - reach_b
        for name, flat, along in ((first, a, middle_a), (second, b, middle_b)):
            flats[name] = FlatPose(along * math.cos(angle), along * math.sin(angle), flat.yaw_deg)


def _reach_mm(asset: Asset, angle: float) -> float:
    """Return the distance [mm] from an object's center to its elliptical outline, at an angle [rad] in its frame."""
    x, y, _ = asset.size_m
    return 500.0 * math.hypot(x * math.cos(angle), y * math.sin(angle))


_CACHE: OrderedDict[str, CompiledScene] = OrderedDict()
_CACHE_SIZE = 32
_LOCK = threading.Lock()


def compile_scene(placements: tuple[Placement, ...], quality: Quality, *, robot_name: str, room: Room) -> CompiledScene:
    """Return the compiled model for a set of objects, from the cache if possible.

    The model depends only on the assets, the fixed poses, the robot, the render quality and the room. It does not
    depend on names, slots and start poses of free objects, so trials that differ only in layout or language share one
    model.
    """
    digest = hashlib.sha256(f"{mujoco.__version__}|{robot_name}|{quality}|{room}".encode())
    for p in placements:
        digest.update(f"|{p.asset.content_hash()}|{p.spec.fixed}|{p.anchored or ''}".encode())
    key = digest.hexdigest()[:16]
    with _LOCK:
        if key in _CACHE:
            _CACHE.move_to_end(key)
            return _CACHE[key]
        compiled = _compile(placements, quality, key, robot_name, room)
        _CACHE[key] = compiled
        while len(_CACHE) > _CACHE_SIZE:
            _CACHE.popitem(last=False)
        return compiled


def _compile(
    placements: tuple[Placement, ...], quality: Quality, key: str, robot_name: str, room: Room
) -> CompiledScene:
    description = robot(robot_name)
    spec = stage_spec(quality, room=room, front=description.front_camera)
    arm = build_robot_spec(robot_name)
    spec.worldbody.add_frame().attach_body(arm.worldbody.first_body(), ROBOT_PREFIX, "")
    add_mounted_camera(spec.body(ROBOT_PREFIX + description.hand_body), WRIST_CAMERA, description.wrist_camera)
    names = [f"object{i}_{p.asset.category}" for i, p in enumerate(placements)]
    for name, p in zip(names, placements, strict=True):
        add_asset(spec, name, p.asset, pose=p.anchored, slide=None if p.shut is None else rail_of(p.asset))
    for drawer in [n for n, p in zip(names, placements, strict=True) if p.shut is not None]:
        # A drawer is guided by its rails, so its collisions with the carcass are excluded.
        for cabinet in [n for n, p in zip(names, placements, strict=True) if _takes_drawers(p.asset)]:
            spec.add_exclude(bodyname1=drawer, bodyname2=cabinet)
    model = spec.compile()
    bodies = np.array([model.body(name).id for name in names], dtype=np.int32)
    qpos = np.full(len(names), -1, dtype=np.int32)
    dofs = np.full(len(names), -1, dtype=np.int32)
    for i, p in enumerate(placements):
        if not p.spec.fixed:
            joint = int(model.body_jntadr[bodies[i]])
            qpos[i], dofs[i] = model.jnt_qposadr[joint], model.jnt_dofadr[joint]
    slides = np.array([p.shut is not None for p in placements])
    return CompiledScene(model, key, description, bodies, qpos, dofs, slides, _label_geoms(model, bodies, description))


def _takes_drawers(asset: Asset) -> bool:
    return any(r.name in MOUNTS for r in asset.regions)


def _label_geoms(model: mujoco.MjModel, bodies: np.ndarray, description: RobotSpec) -> np.ndarray:
    n = len(bodies)
    label_of = {name: n + i for i, name in enumerate(LABELS)}
    body_label = np.full(model.nbody, -1, dtype=np.int32)
    for body in range(1, model.nbody):
        name = model.body(body).name
        if name.startswith(ROBOT_PREFIX):
            part = name.removeprefix(ROBOT_PREFIX)
            body_label[body] = label_of[description.contact_name(part) or "arm"]
        elif name in label_of:
            body_label[body] = label_of[name]
    body_label[bodies] = np.arange(n)
    labels: np.ndarray = body_label[model.geom_bodyid].copy()
    for geom in range(model.ngeom):
        name = model.geom(geom).name
        if name in label_of:
            labels[geom] = label_of[name]
    return labels


@functools.lru_cache(maxsize=1)
def engine_version() -> str:
    """Version of the physics engine (MuJoCo)."""
    return str(mujoco.__version__)
