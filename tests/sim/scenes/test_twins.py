"""The first law: a trial and its twin differ in what was intervened on and in nothing else, bit for bit."""

from __future__ import annotations

import functools
import itertools
from collections.abc import Iterable, Iterator

import mujoco
import numpy as np
import pytest
from tests.daily import others_slow, part_of_today
from tests.robots import ROBOTS, task_of

from betterbench.interface.actions import EE_DELTA
from betterbench.sim.scenes import Scene
from betterbench.sim.scenes.builder import ROBOT_PREFIX
from betterbench.sim.scenes.stage import quality_preset
from betterbench.tasks import Changes, all_tasks, get_task
from betterbench.tasks.interventions import vary

pytestmark = pytest.mark.physics

TASKS = [t.id for t in all_tasks()]
SEEDS = part_of_today((0, 7), 2)


@functools.lru_cache(maxsize=32)
def scene(task_id: str, name: str, seed: int, robot: str | None = None) -> Scene:
    task = get_task(task_id)
    condition = task.train(name) if name.startswith("train") else vary(task, task.variation(name))[0]
    quality = quality_preset("fast")
    return Scene(task, condition, seed=seed, action_space=EE_DELTA, quality=quality, robot_name=robot)


def pairs_of(task_id: str, seeds: Iterable[int], robot: str | None = None) -> Iterator[tuple[Scene, Scene, Changes]]:
    """The variations of a task with their twins and what is declared to change."""
    task = get_task(task_id)
    for seed, variation in itertools.product(seeds, task.variations):
        twin = scene(task_id, variation.base, seed, robot)
        yield scene(task_id, variation.name, seed, robot), twin, vary(task, variation)[1]


SECOND = ("morning_coffee", "so101")
"""A task beside the second robot: the law holds out of its reach, too."""


OF_ROBOTS = [task_of(name) for name in ROBOTS]
REST = [name for name in TASKS if name not in OF_ROBOTS]


@pytest.fixture(scope="module", params=[*OF_ROBOTS, *others_slow(REST, 5), pytest.param(SECOND, id="-".join(SECOND))])
def pairs(request: pytest.FixtureRequest) -> list[tuple[Scene, Scene, Changes]]:
    """Tests that ask for pairs run task by task, so that each scene is built once."""
    task_id, robot = request.param if isinstance(request.param, tuple) else (request.param, None)
    return list(pairs_of(task_id, SEEDS, robot))


def bits(value: object) -> bytes:
    return np.ascontiguousarray(value).tobytes()


GEOM = (
    "type",
    "size",
    "pos",
    "quat",
    "friction",
    "rgba",
    "condim",
    "contype",
    "conaffinity",
    "solref",
    "solimp",
    "margin",
    "gap",
    "group",
    "solmix",
    "priority",
    "aabb",
    "rbound",
    "fluid",
)
BODY = ("mass", "inertia", "ipos", "iquat", "gravcomp", "dofnum", "jntnum", "geomnum", "subtreemass")
JOINT = ("type", "pos", "axis", "range", "stiffness", "limited", "actfrclimited", "solref", "solimp", "margin")
MATERIAL = (
    "rgba",
    "specular",
    "shininess",
    "reflectance",
    "emission",
    "texrepeat",
    "texuniform",
    "metallic",
    "roughness",
)
CAMERA = ("pos", "quat", "fovy", "resolution", "sensorsize", "intrinsic", "mode", "projection")
LIGHT = (
    "pos",
    "dir",
    "ambient",
    "diffuse",
    "specular",
    "castshadow",
    "type",
    "attenuation",
    "cutoff",
    "exponent",
    "active",
    "bulbradius",
    "intensity",
    "range",
)


def fields(model: mujoco.MjModel, kind: str, names: tuple[str, ...], i: int) -> dict[str, bytes]:
    return {f"{kind}_{n}": bits(getattr(model, f"{kind}_{n}")[i]) for n in names if hasattr(model, f"{kind}_{n}")}


def mesh_part(model: mujoco.MjModel, mesh: int) -> dict[str, bytes]:
    v, nv = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
    f, nf = model.mesh_faceadr[mesh], model.mesh_facenum[mesh]
    n, nn = model.mesh_normaladr[mesh], model.mesh_normalnum[mesh]
    part = {
        "vertices": bits(model.mesh_vert[v : v + nv]),
        "faces": bits(model.mesh_face[f : f + nf]),
        "normals": bits(model.mesh_normal[n : n + nn]),
        "pos": bits(model.mesh_pos[mesh]),
        "quat": bits(model.mesh_quat[mesh]),
    }
    t, nt = model.mesh_texcoordadr[mesh], model.mesh_texcoordnum[mesh]
    if t >= 0:
        part["uv"] = bits(model.mesh_texcoord[t : t + nt])
    return part


def texture_part(model: mujoco.MjModel, texture: int) -> dict[str, bytes]:
    size = int(model.tex_height[texture] * model.tex_width[texture] * model.tex_nchannel[texture])
    start = int(model.tex_adr[texture])
    shape = bits(
        [model.tex_height[texture], model.tex_width[texture], model.tex_nchannel[texture], model.tex_type[texture]]
    )
    return {"shape": shape, "pixels": bits(model.tex_data[start : start + size])}


def material_part(model: mujoco.MjModel, material: int) -> dict[str, object]:
    part: dict[str, object] = dict(fields(model, "mat", MATERIAL, material))
    for role, texture in enumerate(model.mat_texid[material].tolist()):
        part[f"texture{role}"] = texture_part(model, texture) if texture >= 0 else None
    return part


def body_part(model: mujoco.MjModel, body: int) -> dict[str, object]:
    """Everything of the compiled model that belongs to one body and that physics or a camera can notice."""
    part: dict[str, object] = dict(fields(model, "body", BODY, body))
    part["at"] = bits(model.body_pos[body]) + bits(model.body_quat[body])
    joints = range(model.body_jntadr[body], model.body_jntadr[body] + model.body_jntnum[body])
    part["joints"] = [fields(model, "jnt", JOINT, j) for j in joints]
    dofs = range(model.body_dofadr[body], model.body_dofadr[body] + model.body_dofnum[body])
    part["dofs"] = [fields(model, "dof", ("damping", "armature", "frictionloss", "solref", "solimp"), d) for d in dofs]
    geoms = range(model.body_geomadr[body], model.body_geomadr[body] + model.body_geomnum[body])
    part["geoms"] = [
        {
            **fields(model, "geom", GEOM, g),
            "mesh": mesh_part(model, model.geom_dataid[g]) if model.geom_dataid[g] >= 0 else None,
            "material": material_part(model, model.geom_matid[g]) if model.geom_matid[g] >= 0 else None,
        }
        for g in geoms
    ]
    return part


def object_part(s: Scene, name: str) -> dict[str, object]:
    i = s.info.index(name)
    part = body_part(s.model, int(s.compiled.bodies[i]))
    address, dof = int(s.compiled.qpos_addresses[i]), int(s.compiled.dof_addresses[i])
    if address >= 0:
        slides = bool(s.compiled.slides[i])
        part["qpos"] = bits(s.data.qpos[address : address + (1 if slides else 7)])
        part["qvel"] = bits(s.data.qvel[dof : dof + (1 if slides else 6)])
    state = s.state()
    part["pose"] = state.pose(name)
    part["info"] = s.info.object(name)
    return part


def rest_of_the_world(s: Scene) -> dict[str, object]:
    """Robot, stage, cameras, lights, actuators and options: all that is no object of the condition."""
    m = s.model
    objects = set(s.compiled.bodies.tolist())
    world: dict[str, object] = {m.body(b).name: body_part(m, b) for b in range(m.nbody) if b not in objects}
    # The world body carries the mass of everything below it: what the objects weigh is theirs.
    world["world"] = {k: v for k, v in body_part(m, 0).items() if k != "body_subtreemass"}
    world["cameras"] = {m.camera(c).name: fields(m, "cam", CAMERA, c) for c in range(m.ncam)}
    world["lights"] = {m.light(x).name: fields(m, "light", LIGHT, x) for x in range(m.nlight)}
    world["placed"] = [bits(a) for a in (s.data.cam_xpos, s.data.cam_xmat, s.data.light_xpos, s.data.light_xdir)]
    world["appearance"] = (s.room, s.view_jitter, s.looks)
    world["actuators"] = [
        fields(m, "actuator", ("gainprm", "biasprm", "ctrlrange", "forcerange", "gear", "trntype"), a)
        for a in range(m.nu)
    ]
    world["options"] = {
        n: bits(getattr(m.opt, n))
        for n in (
            "timestep",
            "integrator",
            "cone",
            "impratio",
            "noslip_iterations",
            "gravity",
            "tolerance",
            "iterations",
        )
    }
    world["visual"] = {n: bits(getattr(m.vis.map, n)) for n in ("znear", "zfar", "shadowclip", "shadowscale")}
    world["extent"] = (m.stat.extent, bits(m.stat.center))
    world["controls"] = bits(s.data.ctrl)
    return world


def robot_state(s: Scene) -> tuple[object, ...]:
    state = s.state()
    return (
        bits(s.data.qpos[s.arm_addresses]),
        bits(s.data.qpos[s.finger_addresses]),
        state.ee_pose,
        state.commanded_pose,
        state.joint_positions,
        state.joint_velocities,
        state.finger_width_m,
        state.gripper_command,
    )


def carriers(s: Scene, name: str) -> tuple[str, ...]:
    """What an object hangs in or rests on at the start, and what that does."""
    place = s.condition.object(name).mount or s.condition.preplaced.get(name)
    return () if place is None else (place.target, *carriers(s, place.target))


def assert_rides_along(trial: Scene, twin: Scene, name: str, carrier: str) -> None:
    """An object on one that moved is the same object and is where it was as seen from there."""
    place = {"at", "pose", "qpos"} if trial.compiled.slides[trial.info.index(name)] else {"pose", "qpos"}
    mine, theirs = object_part(trial, name), object_part(twin, name)
    assert {k: v for k, v in mine.items() if k not in place} == {k: v for k, v in theirs.items() if k not in place}
    one, other = (s.state().pose(carrier).inverse() @ s.state().pose(name) for s in (trial, twin))
    assert one.position == pytest.approx(other.position, abs=1e-9)
    assert one.quaternion == pytest.approx(other.quaternion, abs=1e-9)


def assert_twins(trial: Scene, twin: Scene, changes: Changes) -> None:
    changed = changes.objects
    trial.reset()
    twin.reset()
    there, here = ({o.name for o in s.info.objects} for s in (trial, twin))
    assert (there ^ here) <= changed
    for name in sorted((there & here) - changed):
        moved = changed.intersection(carriers(trial, name))
        if moved and carriers(trial, name) == carriers(twin, name):
            assert_rides_along(trial, twin, name, min(moved))
            continue
        assert object_part(trial, name) == object_part(twin, name), f"{trial.condition.id}: {name} was not to change"
    mine, theirs = rest_of_the_world(trial), rest_of_the_world(twin)
    assert mine.keys() == theirs.keys()
    for part in mine:
        assert mine[part] == theirs[part], (trial.condition.id, part)
    assert robot_state(trial) == robot_state(twin)
    assert trial.info.slots == twin.info.slots
    assert trial.info.home_position == twin.info.home_position
    if not changed:
        assert changes.language
        assert trial.compiled.content_hash == twin.compiled.content_hash
        assert trial.model is twin.model
        assert bits(trial.data.qpos) == bits(twin.data.qpos)
        assert bits(trial.data.qvel) == bits(twin.data.qvel)
        assert trial.info == twin.info


def test_twins_differ_in_what_was_intervened_on_and_in_nothing_else(pairs):
    for trial, twin, changes in pairs:
        assert_twins(trial, twin, changes)


def test_what_was_declared_to_change_really_did(pairs):
    """Otherwise the law above would hold for an intervention that does nothing."""
    for trial, twin, changes in pairs:
        for changed in changes.objects:
            if changed in trial.info and changed in twin.info:
                assert trial.reset().pose(changed) != twin.reset().pose(changed), (trial.condition.id, changed)
            else:
                assert (changed in trial.info) != (changed in twin.info), (trial.condition.id, changed)
        if changes.language:
            assert trial.condition.instruction != twin.condition.instruction, trial.condition.id


def test_an_object_that_moves_to_another_slot_takes_that_slot_s_jitter_along(pairs):
    """The jitter belongs to the slot: whatever stands there stands at the same position."""
    for trial, twin, _ in pairs:
        for slot in trial.info.slots:
            one, other = trial.condition.occupant(slot.name), twin.condition.occupant(slot.name)
            if one is None or other is None:
                continue
            a, b = trial.reset().pose(one).position, twin.reset().pose(other).position
            # Each asset settles by less than a millimeter from its nominal pose.
            assert abs(a[0] - b[0]) < 1e-3, (trial.condition.id, slot.name)
            assert abs(a[1] - b[1]) < 1e-3, (trial.condition.id, slot.name)


@pytest.mark.slow
@pytest.mark.parametrize("task_id", TASKS)
def test_twin_law_over_many_seeds(task_id):
    for trial, twin, changes in pairs_of(task_id, range(20, 40)):
        assert_twins(trial, twin, changes)


def test_riding_along_can_fail():
    """A drawer that is drawn out is not where it was as seen from its cabinet, and no other drawer."""
    trial, twin = scene("office_drawer", "T1", 0), scene("office_drawer", "train3", 0)
    trial.reset()
    twin.reset()
    assert_rides_along(trial, twin, "lower", "cabinet")
    with pytest.raises(AssertionError):
        assert_rides_along(trial, twin, "upper", "cabinet")


def test_this_comparison_can_fail():
    """A hair's breadth of another seed, mass or color is noticed."""
    trial, other = scene("fast_food", "train1", 0), scene("fast_food", "train1", 1)
    trial.reset()
    other.reset()
    assert object_part(trial, "fries") != object_part(other, "fries")
    theirs = rest_of_the_world(other)
    drawn = {part for part, value in rest_of_the_world(trial).items() if value != theirs[part]}
    assert {"placed", "appearance"} <= drawn, "the seed draws cameras, light and room"
    assert "options" not in drawn
    assert "actuators" not in drawn
    part = object_part(trial, "fries")
    body = int(trial.compiled.bodies[trial.info.index("fries")])
    before = trial.model.body_mass[body]
    try:
        trial.model.body_mass[body] = np.nextafter(before, 1.0)
        assert object_part(trial, "fries") != part
    finally:
        trial.model.body_mass[body] = before
    assert object_part(trial, "fries") == part
    assert part["geoms"]
    assert any(g["material"] for g in part["geoms"])
    assert ROBOT_PREFIX + "hand" in rest_of_the_world(trial)
