from __future__ import annotations

import io
import itertools
import math
from pathlib import Path

import mujoco
import numpy as np
import pytest
import trimesh
from scipy.spatial import KDTree
from tests.daily import others_slow

from betterbench.errors import MissingDependencyError, UnknownNameError
from betterbench.sim.robots import PANDA, build_robot_spec, robot, robot_names
from betterbench.sim.robots.building import COLLISION_GROUP, VISUAL_GROUP
from betterbench.sim.robots.decimation import welded
from betterbench.sim.robots.meshes import mesh_folder, visual_parts
from betterbench.sim.robots.panda import _SHARES, FACE_BUDGET, _paint


@pytest.fixture(scope="module")
def home(arm_model: mujoco.MjModel) -> mujoco.MjData:
    data = mujoco.MjData(arm_model)
    data.qpos[:7] = PANDA.home_joints
    data.qpos[7:9] = 0.04
    mujoco.mj_forward(arm_model, data)
    return data


def test_the_register_knows_the_panda_and_suggests_it() -> None:
    assert "panda" in robot_names()
    assert robot("panda") is PANDA
    with pytest.raises(UnknownNameError, match="panda"):
        robot("pandda")
    with pytest.raises(UnknownNameError):
        build_robot_spec("ur5")


def test_the_ready_pose_is_frankas(arm_model: mujoco.MjModel) -> None:
    # Franka's documentation: the flange at (0.3069, 0, 0.5903), pointing down.
    ready = mujoco.MjData(arm_model)
    ready.qpos[:7] = (0.0, -0.25 * math.pi, 0.0, -0.75 * math.pi, 0.0, 0.5 * math.pi, 0.25 * math.pi)
    mujoco.mj_forward(arm_model, ready)
    assert ready.body("hand").xpos == pytest.approx((0.3069, 0.0, 0.5903), abs=5e-5)
    tcp = ready.site("tcp")
    assert tcp.xpos == pytest.approx((0.3069, 0.0, 0.5903 - 0.1034), abs=5e-5)
    assert tcp.xmat.reshape(3, 3)[:, 2] == pytest.approx((0.0, 0.0, -1.0), abs=1e-9)


def test_home_points_down_as_high_above_the_table_as_in_libero(home: mujoco.MjData) -> None:
    tcp = home.site("tcp")
    assert tcp.xpos == pytest.approx((0.36, 0.0, 0.28), abs=1e-3)
    assert tcp.xmat.reshape(3, 3)[:, 2] == pytest.approx((0.0, 0.0, -1.0), abs=1e-9)


def test_fingers_open_along_the_y_axis_of_the_tool(home: mujoco.MjData, arm_model: mujoco.MjModel) -> None:
    left, right = (home.geom(name).xpos for name in PANDA.pad_geoms)
    rotation = home.site("tcp").xmat.reshape(3, 3)
    apart = rotation.T @ (left - right)
    pad_depth = 2.0 * arm_model.geom("left_pad").size[1]
    assert apart == pytest.approx((0.0, PANDA.gripper_opening_m + pad_depth, 0.0), abs=1e-9)
    middle = rotation.T @ (0.5 * (left + right) - home.site("tcp").xpos)
    assert abs(middle[2]) < 0.012, "the tool center point lies between the pads"
    assert middle[:2] == pytest.approx((0.0, 0.0), abs=1e-9)
    half = arm_model.geom("left_pad").size
    assert middle[2] + half[2] == pytest.approx(PANDA.tip_below_tcp_m), "the pads end with the finger tips"
    assert PANDA.pad_size_m == pytest.approx((2.0 * half[0], 2.0 * half[2]))


def test_the_ready_pose_touches_nothing(home: mujoco.MjData) -> None:
    assert home.ncon == 0


def test_limits_are_those_of_the_robot(arm_model: mujoco.MjModel) -> None:
    for i, name in enumerate(PANDA.arm_joints):
        joint = arm_model.joint(name)
        assert joint.range == pytest.approx((PANDA.joint_low[i], PANDA.joint_high[i]))
        assert arm_model.jnt_actfrcrange[joint.id] == pytest.approx((-PANDA.joint_effort[i], PANDA.joint_effort[i]))
    assert max(PANDA.joint_effort[:4]) <= 87.0
    assert max(PANDA.joint_effort[4:]) <= 12.0


def test_masses_are_explicit_and_add_up(arm_model: mujoco.MjModel) -> None:
    total = 0.629769 + 4.970684 + 0.646926 + 3.228604 + 3.587895 + 1.225946 + 1.666555 + 0.735522 + 0.73 + 2 * 0.015
    assert arm_model.body_mass.sum() == pytest.approx(total)
    assert (arm_model.body_gravcomp[1:] == 1.0).all()


def test_visual_meshes_do_not_touch_physics(arm_model: mujoco.MjModel, tmp_path: Path) -> None:
    full = build_robot_spec("panda").compile()
    groups = full.geom_group
    assert set(groups.tolist()) == {VISUAL_GROUP, COLLISION_GROUP}
    seen = groups == VISUAL_GROUP
    assert (full.geom_contype[seen] == 0).all()
    assert (full.geom_conaffinity[seen] == 0).all()
    assert full.body_mass == pytest.approx(arm_model.body_mass)
    assert full.body_inertia == pytest.approx(arm_model.body_inertia)
    drawn = sum(int(full.mesh_facenum[full.geom_dataid[g]]) for g in np.flatnonzero(seen) if full.geom_dataid[g] >= 0)
    assert drawn <= 8000


def with_larger_finger(cached: bytes) -> bytes:
    """Return a cache file with its first line kept and its vertices twice as far out, as numpy writes it."""
    seal, _, packed = cached.partition(b"\n")
    arrays = dict(np.load(io.BytesIO(packed)))
    buffer = io.BytesIO()
    np.savez(buffer, **{name: 2 * value if name.endswith(".v") else value for name, value in arrays.items()})
    return seal + b"\n" + buffer.getvalue()


def test_meshes_are_made_once_and_a_damaged_cache_is_made_again(tmp_path: Path) -> None:
    calls: list[tuple[str, int, int]] = []

    def load() -> tuple[int, bytes]:
        calls.clear()
        parts = visual_parts(
            {"finger": 1.0},
            lambda _, rank: "a" if rank == 0 else "b",
            faces=200,
            cache_folder=tmp_path,
            progress=lambda *call: calls.append(call),
        )
        return sum(len(p.faces) for p in parts), b"".join(p.vertices.tobytes() + p.faces.tobytes() for p in parts)

    first = load()
    assert calls
    assert calls[-1][1] == calls[-1][2]
    assert 100 <= first[0] <= 200
    assert load() == first
    assert not calls, "the second time comes from the cache"
    (stored,) = tmp_path.iterdir()
    whole = stored.read_bytes()
    for damaged in (
        whole[:100],
        b"",
        whole + b"x",
        with_larger_finger(whole),
        with_larger_finger(whole).split(b"\n", 1)[1],
    ):
        stored.write_bytes(damaged)
        assert load() == first
        assert calls, "a damaged or changed file is not used"
        assert [p.name for p in tmp_path.iterdir()] == [stored.name], "nothing half-written stays behind"
    stored.rename(tmp_path / f"{'0' * 24}{stored.suffix}").rename(stored)
    assert load() == first
    assert not calls


def test_the_cache_of_other_meshes_is_not_used(tmp_path: Path) -> None:
    made = visual_parts({"finger": 1.0}, lambda *_: "a", faces=100, cache_folder=tmp_path / "one")
    other = visual_parts({"finger": 1.0}, lambda *_: "a", faces=200, cache_folder=tmp_path / "other")
    (stored,), (strange,) = ((tmp_path / name).iterdir() for name in ("one", "other"))
    stored.write_bytes(strange.read_bytes())
    again = visual_parts({"finger": 1.0}, lambda *_: "a", faces=100, cache_folder=tmp_path / "one")
    assert len(again[0].faces) == len(made[0].faces) < len(other[0].faces)


def test_an_unwritable_cache_is_no_error(tmp_path: Path) -> None:
    blocked = tmp_path / "file"
    blocked.write_text("in the way")
    parts = visual_parts({"finger": 1.0}, lambda *_: "a", faces=100, cache_folder=blocked / "below")
    assert len(parts) == 1


def test_a_missing_mesh_says_what_to_install(tmp_path: Path) -> None:
    with pytest.raises(MissingDependencyError, match="gymnasium-robotics"):
        visual_parts({"no_such_link": 1.0}, lambda *_: "a", faces=100, cache_folder=tmp_path)


def test_decimation_keeps_the_shape() -> None:
    full = build_robot_spec("panda").compile()
    assert full.nmeshface <= FACE_BUDGET + 300
    data = mujoco.MjData(full)
    mujoco.mj_forward(full, data)
    for link in ("link0", "link3", "link6", "hand"):
        original = trimesh.load_mesh(mesh_folder() / f"{link}.stl").bounds
        body = data.body(link)
        rotation = body.xmat.reshape(3, 3)
        corners = []
        for geom in range(full.ngeom):
            mesh = full.geom_dataid[geom]
            if mesh < 0 or full.geom_bodyid[geom] != body.id:
                continue
            start = full.mesh_vertadr[mesh]
            local = full.mesh_vert[start : start + full.mesh_vertnum[mesh]]
            world = local @ data.geom_xmat[geom].reshape(3, 3).T + data.geom_xpos[geom]
            corners.append((world - body.xpos) @ rotation)
        points = np.vstack(corners)
        assert points.min(axis=0) == pytest.approx(original[0], abs=0.004), link
        assert points.max(axis=0) == pytest.approx(original[1], abs=0.004), link


LINKS = PANDA.arm_bodies
LARGE = ("link5", "link6")
"""Links whose files are so large that link0 stands for them in the quick tests."""
OTHERS = tuple(link for link in (*LINKS, "hand", "finger") if link not in LARGE)


@pytest.mark.parametrize(
    "link",
    [*others_slow(OTHERS, 3), *(pytest.param(link, marks=pytest.mark.slow) for link in LARGE)],
)
def test_decimation_tears_nothing_and_turns_nothing_over(link: str) -> None:
    """Borders keep their length, so that no hole and no flap appears, and triangles look where the surface did."""
    source = trimesh.load_mesh(mesh_folder() / f"{link}.stl", process=False)
    original = welded(np.asarray(source.vertices), np.asarray(source.faces), 1e-4)
    parts = [p for p in visual_parts(_SHARES, _paint, faces=FACE_BUDGET) if p.link == link]
    pieces = [welded(part.vertices, part.faces, 1e-4) for part in parts]
    borders = sum(_border_length(*piece) for piece in pieces)
    assert 0.9 * _border_length(*original) - 0.01 < borders < 1.35 * _border_length(*original) + 0.01
    surface, normals = KDTree(np.asarray(source.triangles_center)), np.asarray(source.face_normals)
    turned = total = 0.0
    for vertices, faces in pieces:
        a, b, c = vertices[faces].swapaxes(0, 1)
        double = np.cross(b - a, c - a)
        areas = np.linalg.norm(double, axis=1)
        _, near = surface.query((a + b + c) / 3.0, k=12)
        cosines = np.einsum("ij,ikj->ik", double / areas[:, None], normals[near]).max(axis=1)
        turned, total = turned + float(areas[cosines < 0.3].sum()), total + float(areas.sum())
    assert turned < 0.015 * total


def _border_length(vertices: np.ndarray, faces: np.ndarray) -> float:
    """Length of all edges that belong to one triangle only [m]."""
    edges = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    unique, times = np.unique(edges, axis=0, return_counts=True)
    start, end = unique[times == 1].T
    return float(np.linalg.norm(vertices[start] - vertices[end], axis=1).sum())


def _array(values: np.ndarray) -> np.ndarray:
    return np.asarray(values)


def _outside(model: mujoco.MjModel, geom: int, points: np.ndarray) -> np.ndarray:
    """Distances [m] of points in the body frame from a collision primitive; negative inside."""
    rotation = np.zeros(9)
    mujoco.mju_quat2Mat(rotation, model.geom_quat[geom])
    local = np.abs((points - model.geom_pos[geom]) @ rotation.reshape(3, 3))
    size = model.geom_size[geom]
    kind = model.geom_type[geom]
    if kind == int(mujoco.mjtGeom.mjGEOM_BOX):
        beyond = local - size
        return _array(np.linalg.norm(np.maximum(beyond, 0.0), axis=1) + np.minimum(beyond.max(axis=1), 0.0))
    radial = np.hypot(local[:, 0], local[:, 1])
    if kind == int(mujoco.mjtGeom.mjGEOM_CAPSULE):
        return _array(np.hypot(radial, np.maximum(local[:, 2] - size[1], 0.0)) - size[0])
    beyond = np.stack([radial - size[0], local[:, 2] - size[1]], axis=1)
    return _array(np.linalg.norm(np.maximum(beyond, 0.0), axis=1) + np.minimum(beyond.max(axis=1), 0.0))


@pytest.mark.parametrize("link", [*PANDA.arm_bodies, "hand", "left_finger"])
def test_collision_shapes_enclose_the_meshes(arm_model: mujoco.MjModel, link: str) -> None:
    mesh = trimesh.load_mesh(mesh_folder() / f"{'finger' if link == 'left_finger' else link}.stl")
    points = np.asarray(mesh.vertices)[::7]
    shapes = [g for g in range(arm_model.ngeom) if arm_model.geom_bodyid[g] == arm_model.body(link).id]
    distances = np.min([_outside(arm_model, g, points) for g in shapes], axis=0)
    # What sticks out most is the rim of the joint covers; the fingers, which grasp, are modeled to 2 mm.
    assert distances.max() < (0.002 if link == "left_finger" else 0.014)
    assert np.quantile(distances, 0.99) < (0.002 if link == "left_finger" else 0.010)


@pytest.mark.parametrize("link", [*PANDA.arm_bodies, "hand", "left_finger"])
def test_collision_shapes_are_not_larger_than_the_links(arm_model: mujoco.MjModel, link: str) -> None:
    bounds = trimesh.load_mesh(mesh_folder() / f"{'finger' if link == 'left_finger' else link}.stl").bounds
    for g in range(arm_model.ngeom):
        if arm_model.geom_bodyid[g] != arm_model.body(link).id:
            continue
        size, kind = arm_model.geom_size[g], arm_model.geom_type[g]
        rotation = np.zeros(9)
        mujoco.mju_quat2Mat(rotation, arm_model.geom_quat[g])
        half = np.abs(rotation.reshape(3, 3)) @ (
            size if kind == int(mujoco.mjtGeom.mjGEOM_BOX) else np.array([size[0], size[0], size[1]])
        )
        assert (arm_model.geom_pos[g] - half > bounds[0] - 0.012).all(), arm_model.geom(g).name
        assert (arm_model.geom_pos[g] + half < bounds[1] + 0.012).all(), arm_model.geom(g).name


def test_the_workspace_is_free_of_self_contact(arm_model: mujoco.MjModel, ik: object) -> None:
    from betterbench.geometry import Pose
    from betterbench.sim.robots import ArmIK

    assert isinstance(ik, ArmIK)
    data = mujoco.MjData(arm_model)
    down = ik.forward(ik.home).quaternion
    for x, y, z in itertools.product((0.3, 0.5, 0.7), (-0.35, 0.0, 0.35), (0.02, 0.4)):
        data.qpos[:7] = ik.reach(ik.home, Pose((x, y, z), down)).q
        data.qpos[7:9] = 0.04
        mujoco.mj_forward(arm_model, data)
        assert data.ncon == 0, (x, y, z)


@pytest.mark.render
def test_it_looks_like_a_white_arm(tmp_path: Path) -> None:
    spec = build_robot_spec("panda")
    spec.worldbody.add_light(pos=(1.0, 1.0, 2.5), dir=(-0.3, -0.3, -1.0), type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL)
    model = spec.compile()
    data = mujoco.MjData(model)
    data.qpos[:7] = PANDA.home_joints
    mujoco.mj_forward(model, data)
    camera = mujoco.MjvCamera()
    camera.lookat, camera.distance, camera.azimuth, camera.elevation = (0.2, 0.0, 0.4), 1.7, 130.0, -15.0
    with mujoco.Renderer(model, 256, 256) as renderer:
        renderer.update_scene(data, camera)
        image = renderer.render()
        renderer.enable_segmentation_rendering()
        renderer.update_scene(data, camera)
        robot_pixels = renderer.render()[:, :, 0] >= 0
    assert 0.05 < robot_pixels.mean() < 0.35
    colors = image[robot_pixels].astype(float)
    assert np.abs(colors - colors.mean(axis=1, keepdims=True)).mean() < 8.0, "grays, no color"
    assert np.quantile(colors.mean(axis=1), 0.7) > 110.0, "mostly light"
    assert math.isclose(float((colors.mean(axis=1) < 60.0).mean()), 0.15, abs_tol=0.14), "with some dark parts"
