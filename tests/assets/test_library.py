"""What every asset of the procedural library has to keep, look by look."""

from __future__ import annotations

import math
import subprocess
import sys

import mujoco
import numpy as np
import pytest

from betterbench.assets import build, categories, colours, looks
from betterbench.errors import InvalidInputError, UnknownNameError
from betterbench.geometry import Pose, tilt_of
from betterbench.scenes.objects import add_asset, rest_pose
from betterbench.scenes.stage import set_physics

FACE_BUDGET, GEOM_BUDGET, JAW_M = 600, 12, 0.078
ALL = [(category, look) for category in categories() for look in looks(category)]
TABLE = {"type": mujoco.mjtGeom.mjGEOM_BOX, "size": [1, 1, 0.02], "pos": [0, 0, -0.02], "condim": 4}


def every(function):
    return pytest.mark.parametrize(("category", "look"), ALL, ids=[f"{c}-{n}" for c, n in ALL])(function)


def world():
    """An empty world with a table."""
    spec = mujoco.MjSpec()
    set_physics(spec)
    spec.worldbody.add_geom(**TABLE)
    return spec


@every
def test_it_keeps_its_budgets(category, look):
    asset = build(category, look=look)
    assert 0 < asset.face_count <= FACE_BUDGET
    assert 0 < len(asset.collision) <= GEOM_BUDGET
    assert asset.licence
    assert asset.source
    assert asset.description
    assert asset.colour in colours(category)
    for part in asset.visual:
        assert part.faces.max() < len(part.vertices)
        assert part.texture is None or max(part.texture.pixels.shape) <= 256
        assert np.ptp(part.vertices, axis=0).min() > 1e-5, "MuJoCo refuses planar meshes"


@every
def test_its_inertia_is_that_of_a_body(category, look):
    asset = build(category, look=look)
    xx, yy, zz, xy, xz, yz = asset.inertia
    moments = np.linalg.eigvalsh(np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]))
    assert moments[0] > 0.0
    assert moments[0] + moments[1] >= moments[2] * (1.0 - 1e-9)
    radius = math.sqrt(moments[2] / asset.mass_kg)
    assert 0.1 * min(asset.size_m) < radius < math.hypot(*asset.size_m)
    low, high = np.array([-0.5, -0.5, 0.0]), np.array([0.5, 0.5, 1.0])
    assert np.all(np.array(asset.centre_of_mass) >= low * asset.size_m)
    assert np.all(np.array(asset.centre_of_mass) <= high * asset.size_m)


@every
def test_its_box_holds_what_is_seen_and_touched(category, look):
    asset = build(category, look=look)
    seen = np.concatenate([part.vertices for part in asset.visual])
    sx, sy, sz = asset.size_m
    low, high = seen.min(axis=0), seen.max(axis=0)
    assert high - low == pytest.approx(asset.size_m, abs=2e-3)
    assert low[2] == pytest.approx(0.0, abs=2e-3)
    for part in asset.collision:
        reach = max(part.size) if part.shape != "box" else math.hypot(*part.size)
        x, y, z = part.position
        assert abs(x) <= 0.5 * sx + reach
        assert abs(y) <= 0.5 * sy + reach
        assert -2e-3 <= z <= sz


@every
def test_its_grasps_fit_a_parallel_jaw(category, look):
    asset = build(category, look=look)
    for grasp in asset.grasps:
        assert 0.008 <= grasp.width_m <= JAW_M
        x, y, z = grasp.pose.position
        assert abs(x) <= 0.5 * asset.size_m[0] + 0.005
        assert abs(y) <= 0.5 * asset.size_m[1] + 0.005
        assert 0.005 < z < asset.size_m[2]
        down = Pose((0.0, 0.0, 0.0), grasp.pose.quaternion).apply((0.0, 0.0, 1.0))
        assert down[2] < -0.99, "the gripper comes from above"
        assert asset.size_m[2] - z < 0.049, "the hand, 45 mm above the tool centre point, must clear the object"


@every
def test_it_stands_where_it_is_put(category, look):
    pose = rest_pose(build(category, look=look))
    assert tilt_of(pose.quaternion) < math.radians(1.0)
    assert math.hypot(*pose.position[:2]) < 2e-3
    assert -1e-3 < pose.position[2] < 1e-3


@pytest.mark.parametrize("category", categories())
def test_looks_differ_and_colours_do_not_change_the_shape(category):
    assert len(looks(category)) >= 4
    assert len({build(category, look=look).content_hash() for look in looks(category)}) == len(looks(category))
    shapes = {build(category, colour=colour).size_m for colour in colours(category)}
    assert len(shapes) == 1
    assert build(category) is build(category, look=0, colour=colours(category)[0])


def test_every_process_makes_the_same_bits():
    code = (
        "from betterbench.assets import build, categories\n"
        "print([build(c, look=3).content_hash() for c in categories()])"
    )
    elsewhere = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert elsewhere.strip() == str([build(c, look=3).content_hash() for c in categories()])


def test_unknown_names_are_answered_with_the_closest_known_ones():
    with pytest.raises(UnknownNameError, match="burger"):
        build("burgers")
    with pytest.raises(UnknownNameError, match="red"):
        build("mug", colour="redd")
    with pytest.raises(InvalidInputError, match="look"):
        build("mug", look=99)


@pytest.mark.parametrize("look", looks("takeaway_box")[:3])
def test_what_is_dropped_into_the_box_stays_in(look):
    spec = world()
    box, burger = build("takeaway_box", look=look), build("burger", look=look)
    add_asset(spec, "box", box)
    add_asset(spec, "burger", burger)
    model = spec.compile()
    data = mujoco.MjData(model)
    data.joint("box_joint").qpos[:3] = rest_pose(box).position
    data.joint("burger_joint").qpos[:3] = (0.04, 0.05, 0.06)
    mujoco.mj_step(model, data, nstep=1000)
    inside = box.region("inside")
    x, y, z = data.joint("burger_joint").qpos[:3]
    assert abs(x) < inside.half_size[0]
    assert abs(y) < inside.half_size[1]
    assert z == pytest.approx(inside.position[2] - inside.half_size[2], abs=2e-3)


@pytest.mark.parametrize("look", looks("mug")[:4])
def test_a_mug_hangs_by_its_handle_without_tipping(look):
    mug = build("mug", look=look)
    grasp = mug.grasp("handle")
    spec = world()
    add_asset(spec, "mug", mug)
    x, _, z = grasp.pose.position
    carrier = spec.worldbody.add_body(name="carrier", pos=[x, 0.0, z])
    carrier.add_joint(name="lift", type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[0, 0, 1])
    carrier.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[0.002, 0, 0], mass=0.5, contype=0, conaffinity=0)
    for side in (-1, 1):
        finger = carrier.add_body(name=f"finger{side}", pos=[0.0, side * (0.5 * grasp.width_m + 0.012), 0.0])
        finger.add_joint(name=f"slide{side}", type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[0, -side, 0])
        finger.add_geom(
            type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.010, 0.004, 0.012], mass=0.05, friction=[1.2, 0.01, 0.001], condim=4
        )
        push = spec.add_actuator(name=f"push{side}", target=f"slide{side}", trntype=mujoco.mjtTrn.mjTRN_JOINT)
        push.gainprm[0] = 1.0
    lift = spec.add_actuator(name="lift", target="lift", trntype=mujoco.mjtTrn.mjTRN_JOINT)
    lift.gainprm[0], lift.biastype = 4000.0, mujoco.mjtBias.mjBIAS_AFFINE
    lift.gaintype = mujoco.mjtGain.mjGAIN_FIXED
    lift.biasprm[1], lift.biasprm[2] = -4000.0, -200.0
    model = spec.compile()
    data = mujoco.MjData(model)
    data.joint("mug_joint").qpos[:3] = rest_pose(mug).position
    data.actuator("push-1").ctrl = data.actuator("push1").ctrl = 40.0
    mujoco.mj_step(model, data, nstep=250)
    for i in range(250):
        data.actuator("lift").ctrl = 0.1 * (i + 1) / 250
        mujoco.mj_step(model, data)
    mujoco.mj_step(model, data, nstep=1000)
    assert data.joint("mug_joint").qpos[2] > 0.09
    assert math.degrees(tilt_of(tuple(data.joint("mug_joint").qpos[3:7]))) < 5.0
