"""What every asset of the procedural library has to keep, look by look.

``pytest tests/sim/assets -k CATEGORY`` checks all looks of one category.
"""

from __future__ import annotations

import math
import re
import runpy
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from PIL import Image
from tests.daily import others_slow, part_of_today

from betterbench.errors import InvalidInputError, UnknownNameError
from betterbench.geometry import Pose, distance, from_yaw, rotate, tilt_of
from betterbench.sim.assets import build, build_unpainted, categories, colors, looks, unseen_looks
from betterbench.sim.assets.authoring import generator, unregister
from betterbench.sim.robots.building import FIRM
from betterbench.sim.robots.panda import PAD_FRICTION, PAD_HALF_SIZE
from betterbench.sim.robots.physics import PHYSICS
from betterbench.sim.scenes.objects import add_asset, rail_of, rest_pose

FACE_BUDGET, GEOM_BUDGET, JAW_M = 600, 12, 0.078
GEOM_EXCEPTIONS = {"spice_rack": 19}
"""A hole needs four walls and four corners to be an octagon, and the rack has three; it is fixed, so that its parts
never meet anything but the jars in its holes."""
THIN_M, LIP_M = 0.008, 0.003
"""Least thickness that a jaw takes [m]: of a body, and of the upright lip of a plate, which both pads press flat."""
PINCH_M = 0.008
"""Least height of what is between the pads [m]."""
PAD_M = PAD_HALF_SIZE[2]
"""Distance by which the pads reach below the tool center point [m]."""
MOUNTED = ("lower_drawer", "upper_drawer")
"""Things that hang in rails instead of standing. The origin is that of their box without the knob."""
TABLE = {"type": mujoco.mjtGeom.mjGEOM_BOX, "size": [1, 1, 0.02], "pos": [0, 0, -0.02], "condim": 4}


def world():
    """An empty world with a table."""
    spec = mujoco.MjSpec()
    PHYSICS.set_scene(spec)
    spec.worldbody.add_geom(**TABLE)
    return spec


def keeps_its_budgets(asset):
    assert 0 < asset.face_count <= FACE_BUDGET
    assert 0 < len(asset.collision) <= GEOM_EXCEPTIONS.get(asset.category, GEOM_BUDGET)
    assert asset.license
    assert asset.source
    assert asset.description
    assert asset.color in colors(asset.category)
    for part in asset.visual:
        assert part.faces.max() < len(part.vertices)
        assert part.texture is None or max(part.texture.pixels.shape) <= 256
        assert np.ptp(part.vertices, axis=0).min() > 1e-5, "MuJoCo refuses planar meshes"


def has_the_inertia_of_a_body(asset):
    xx, yy, zz, xy, xz, yz = asset.inertia
    moments = np.linalg.eigvalsh(np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]))
    assert moments[0] > 0.0
    assert moments[0] + moments[1] >= moments[2] * (1.0 - 1e-9)
    radius = math.sqrt(moments[2] / asset.mass_kg)
    assert 0.1 * min(asset.size_m) < radius < math.hypot(*asset.size_m)
    low, high = np.array([-0.5, -0.5, 0.0]), np.array([0.5, 0.5, 1.0])
    assert np.all(np.array(asset.center_of_mass) >= low * asset.size_m)
    assert np.all(np.array(asset.center_of_mass) <= high * asset.size_m)


def has_a_box_that_holds_what_is_seen_and_touched(asset):
    seen = np.concatenate([part.vertices for part in asset.visual])
    low, high = seen.min(axis=0), seen.max(axis=0)
    assert high - low == pytest.approx(asset.size_m, abs=2e-3)
    assert low[2] == pytest.approx(0.0, abs=2e-3)
    middle = 0.5 * (low + high)[:2]
    if asset.category in MOUNTED:
        knob = asset.region("knob")
        front = asset.region("front").position[0]
        assert (low[0], high[0]) == pytest.approx((-front, knob.position[0] + knob.half_size[0]), abs=2e-3)
        middle[0] = 0.0
    assert middle == pytest.approx((0.0, 0.0), abs=3e-3)
    for part in asset.collision:
        reach = max(part.size) if part.shape != "box" else math.hypot(*part.size)
        x, y, z = part.position
        assert low[0] - reach <= x <= high[0] + reach
        assert low[1] - reach <= y <= high[1] + reach
        assert -2e-3 <= z <= high[2]


def has_grasps_that_fit_a_parallel_jaw(asset):
    seen = np.concatenate([part.vertices for part in asset.visual])
    low, high = seen.min(axis=0), seen.max(axis=0)
    for grasp in asset.grasps:
        assert (LIP_M if grasp.name == "rim" else THIN_M) <= grasp.width_m <= JAW_M
        x, y, z = grasp.pose.position
        assert low[0] - 0.005 <= x <= high[0] + 0.005
        assert low[1] - 0.005 <= y <= high[1] + 0.005
        assert z > 0.005
        assert z - PAD_M < asset.size_m[2] - PINCH_M, "the pads take hold of it"
        down = Pose((0.0, 0.0, 0.0), grasp.pose.quaternion).apply((0.0, 0.0, 1.0))
        assert down[2] < -0.99, "the gripper comes from above"
        assert asset.size_m[2] - z < 0.049, "the hand, 45 mm above the tool center point, must clear the object"
        if grasp.name == "rim":
            assert z - PAD_M > asset.region("floor").position[2], "the inner pad must clear the floor"


def stands_where_it_is_put(asset):
    pose = rest_pose(asset)
    assert tilt_of(pose.quaternion) < math.radians(1.0)
    assert math.hypot(*pose.position[:2]) < 2e-3
    assert -1e-3 < pose.position[2] < 1e-3


def looks_differ_and_colors_do_not_change_the_shape(category, chosen):
    assert len(looks(category)) >= 8
    assert len(unseen_looks(category)) >= 4
    assert len({build(category, look=look).content_hash() for look in chosen}) == len(chosen)
    shapes = {build_unpainted(category, color=color).size_m for color in colors(category)}
    assert len(shapes) == 1
    assert build(category) is build(category, look=0, color=colors(category)[0])


def is_the_same_without_its_textures(asset):
    bare = build_unpainted(asset.category, look=asset.look, color=asset.color)
    assert all(part.texture is None for part in bare.visual)
    unpainted = replace(asset, visual=tuple(replace(part, texture=None) for part in asset.visual))
    assert bare.content_hash() == unpainted.content_hash()
    words = [(a.shape, a.description, a.tags, a.traits, a.parameters, a.keeps_upright) for a in (bare, unpainted)]
    assert words[0] == words[1]


CONTRACTS = (
    keeps_its_budgets,
    has_the_inertia_of_a_body,
    has_a_box_that_holds_what_is_seen_and_touched,
    has_grasps_that_fit_a_parallel_jaw,
    stands_where_it_is_put,
)


def check_category(category, *, parts=1):
    """Check the looks of a category; a failure names the asset (category, color and look) and the contract.

    Every look is built a second time, without textures, if all are checked, and otherwise the first one.
    """
    chosen = (*part_of_today(looks(category), parts), *part_of_today(unseen_looks(category), parts))
    for look in chosen:
        asset = build(category, look=look)
        built_again = (is_the_same_without_its_textures,) if parts == 1 or look == chosen[0] else ()
        for contract in (*CONTRACTS, *built_again):
            try:
                contract(asset)
            except AssertionError as error:
                raise AssertionError(f"{asset.identity}: {contract.__name__}: {error}") from error
    looks_differ_and_colors_do_not_change_the_shape(category, chosen)


@pytest.mark.parametrize("category", part_of_today(categories(), 5))
def test_every_fourth_look_keeps_the_contracts(category):
    """Other looks and categories each day; the slow test has all of them."""
    check_category(category, parts=4)


@pytest.mark.slow
@pytest.mark.parametrize("category", categories())
def test_every_look_keeps_the_contracts(category):
    check_category(category)


def test_every_process_makes_the_same_bits():
    today = part_of_today(categories(), 5)
    code = f"from betterbench.sim.assets import build\nprint([build(c, look=3).content_hash() for c in {today}])"
    elsewhere = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert elsewhere.strip() == str([build(c, look=3).content_hash() for c in today])


def test_an_asset_of_each_category_keeps_its_bytes(golden):
    golden("content_hashes.txt", "".join(f"{c} {build(c).content_hash()}\n" for c in categories()))


def test_unknown_names_are_answered_with_the_closest_known_ones():
    with pytest.raises(UnknownNameError, match="burger"):
        build("burgers")
    with pytest.raises(UnknownNameError, match="red"):
        build("mug", color="redd")
    with pytest.raises(InvalidInputError, match="look"):
        build("mug", look=99)


NEW = """
import numpy as np
from betterbench.sim.assets.authoring import Draft, block, generator

@generator("{category}", colors=("red",))
def {name}(rng: np.random.Generator, _color: str) -> Draft:
    return Draft(
        shape="box",
        description="A box.",
        tags=("box",),
        mass_kg=0.1,
        parts=block("box", (-0.02, -0.02, 0.0), (0.02, 0.02, rng.uniform(0.03, 0.05)), (1.0, 0.0, 0.0)),
    )
"""


def load(path, code):
    """Runs a user's file, as a task file is run."""
    path.write_text(code)
    runpy.run_path(str(path))


def test_a_file_of_the_user_registers_its_own_asset(tmp_path):
    load(tmp_path / "mine.py", NEW.format(category="carton", name="carton"))
    try:
        load(tmp_path / "mine.py", NEW.format(category="carton", name="carton"))
        assert "carton" in categories()
        assert colors("carton") == ("red",)
        check_category("carton")
        with pytest.raises(UnknownNameError, match=r"Did you mean 'carton'"):
            build("cartons")
    finally:
        unregister("carton")
    assert "carton" not in categories()
    with pytest.raises(UnknownNameError):
        build("carton")


def test_two_generators_of_one_name_are_one_clear_error(tmp_path):
    before = build("mug").content_hash()
    with pytest.raises(
        InvalidInputError, match=r"'mug'.*it is registered by both cup in .*mine\.py and mug in .*mug\.py"
    ):
        load(tmp_path / "mine.py", NEW.format(category="mug", name="cup"))
    assert build("mug").content_hash() == before


def test_a_generator_needs_a_name_a_color_and_a_look():
    for wrong in ({"category": "", "colors": ("red",)}, {"category": "x", "colors": ()}):
        with pytest.raises(InvalidInputError, match="a name, and at least one color, one look and one unseen look"):
            generator(**wrong)
    with pytest.raises(InvalidInputError, match="a name, and at least one color, one look and one unseen look"):
        generator("x", colors=("red",), looks=0)


PAGE = Path(__file__).parents[3] / "docs" / "adding-an-asset.md"


@pytest.mark.parametrize("name", others_slow(["candle", "book"], 2))
def test_the_assets_of_the_contributors_page_work(tmp_path, monkeypatch, name):
    """Carries the page out: the file, the checks that it names, and the picture."""
    candle, book, look = re.findall(r"```python\n(.*?)```", PAGE.read_text(), flags=re.DOTALL)
    script, file, picture = (tmp_path / other for other in ("look.py", f"{name}.py", f"{name}.png"))
    script.write_text(look)
    load(file, {"candle": candle, "book": book}[name])
    try:
        check_category(name)
    finally:
        unregister(name)
    monkeypatch.setattr(sys, "argv", [str(script), str(file), name, str(picture)])
    try:  # the script loads the file by itself
        runpy.run_path(str(script), run_name="__main__")
    finally:
        unregister(name)
    assert np.ptp(np.asarray(Image.open(picture)), axis=(0, 1)).min() > 50, "there is something to see"


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


def lift(asset, grasp, *, push_n=40.0, height_m=0.1):
    """Pinches an asset as it stands, lifts it, holds it for 2 s and returns the pose in which it hangs.

    The gripper hangs on a vertical slide: two pads like the robot's, pushed together by a constant force.
    """
    spec = world()
    add_asset(spec, "object", asset)
    x, y, z = grasp.pose.position
    ox, oy, _ = rotate(grasp.pose.quaternion, (0.0, 1.0, 0.0))
    carrier = spec.worldbody.add_body(name="carrier", pos=[x, y, z], quat=from_yaw(math.atan2(oy, ox) - 0.5 * math.pi))
    carrier.add_joint(name="lift", type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[0, 0, 1])
    carrier.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[0.002, 0, 0], mass=0.5, contype=0, conaffinity=0)
    for side in (-1, 1):
        finger = carrier.add_body(name=f"finger{side}", pos=[0.0, side * (0.5 * grasp.width_m + 0.012), 0.0])
        finger.add_joint(name=f"slide{side}", type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[0, -side, 0])
        finger.add_geom(
            type=mujoco.mjtGeom.mjGEOM_BOX,
            size=PAD_HALF_SIZE,
            mass=0.05,
            friction=PAD_FRICTION,
            **FIRM,
            condim=4,
        )
        push = spec.add_actuator(name=f"push{side}", target=f"slide{side}", trntype=mujoco.mjtTrn.mjTRN_JOINT)
        push.gainprm[0] = 1.0
    actuator = spec.add_actuator(name="lift", target="lift", trntype=mujoco.mjtTrn.mjTRN_JOINT)
    actuator.gainprm[0], actuator.biastype = 4000.0, mujoco.mjtBias.mjBIAS_AFFINE
    actuator.gaintype = mujoco.mjtGain.mjGAIN_FIXED
    actuator.biasprm[1], actuator.biasprm[2] = -4000.0, -200.0
    model = spec.compile()
    data = mujoco.MjData(model)
    data.joint("object_joint").qpos[:3] = rest_pose(asset).position
    data.actuator("push-1").ctrl = data.actuator("push1").ctrl = push_n
    mujoco.mj_step(model, data, nstep=250)
    for i in range(250):
        data.actuator("lift").ctrl = height_m * (i + 1) / 250
        mujoco.mj_step(model, data)
    mujoco.mj_step(model, data, nstep=1000)
    return pose_of(data, "object")


def pose_of(data, name):
    """Pose of a body at the last step."""
    mujoco.mj_kinematics(data.model, data)
    return Pose(tuple(data.body(name).xpos.tolist()), tuple(data.body(name).xquat.tolist()))


def settled(things, *, seconds=5.0, fixed=()):
    """Lets things go at their poses and returns where they are before and after."""
    spec = world()
    for name, (asset, pose) in things.items():
        add_asset(spec, name, asset, pose=pose if name in fixed else None)
    model = spec.compile()
    data = mujoco.MjData(model)
    for name, (_, pose) in things.items():
        if name not in fixed:
            data.joint(f"{name}_joint").qpos[:] = (*pose.position, *pose.quaternion)
    before = {name: pose_of(data, name) for name in things}
    mujoco.mj_step(model, data, nstep=round(seconds / model.opt.timestep))
    return before, {name: pose_of(data, name) for name in things}


@pytest.mark.parametrize("look", looks("mug")[:4])
def test_a_mug_hangs_by_its_handle_without_tipping(look):
    mug = build("mug", look=look)
    hung = lift(mug, mug.grasp("handle"))
    assert hung.position[2] > 0.09
    assert math.degrees(tilt_of(hung.quaternion)) < 5.0


@pytest.mark.parametrize("number", [0, 1, 6])
@pytest.mark.parametrize("category", ["dinner_plate", "serving_plate", "shallow_bowl"])
def test_a_plate_hangs_by_its_rim_without_tipping(category, number):
    """Half the force of the robot's pads is enough; a fifth lets the large plate slip and turn by 20 degrees."""
    plate = build(category, look=0)
    grasp = [g for g in plate.grasps if g.name == "rim"][number]
    hung = lift(plate, grasp, push_n=20.0)
    assert hung.position[2] > 0.09
    assert math.degrees(tilt_of(hung.quaternion)) < 6.0


STACKS = {
    "plates": ("dinner_plate", "dinner_plate", "dinner_plate"),
    "plates on a wider one": ("serving_plate", "dinner_plate", "dinner_plate"),
    "burger": ("bun_bottom", "patty", "patty", "cheese_slice", "lettuce_leaf", "bun_top"),
}


@pytest.mark.parametrize("stack", STACKS)
@pytest.mark.parametrize("look", [0, 5])
def test_a_stack_stays_as_it_was_built(stack, look):
    """Each layer lies 3 mm off the one below, to one side and the other in turn, as a hand would leave it."""
    things, height = {}, 0.0
    for i, category in enumerate(STACKS[stack]):
        asset = build(category, look=look)
        rest = rest_pose(asset)
        off = (0.0, 0.003)[i % 2]
        things[f"{i}_{category}"] = (asset, Pose((off, -off, height + rest.position[2]), rest.quaternion))
        names = {r.name for r in asset.regions}
        height += asset.region("floor" if "floor" in names else "top").position[2]
    before, after = settled(things)
    for name, pose in after.items():
        assert distance(pose.position, before[name].position) < 1e-3, name
        assert math.degrees(tilt_of(pose.quaternion)) < 1.0, name


@pytest.mark.parametrize("jar", ["spice_jar", "plain_salt_jar", "pill_bottle"])
@pytest.mark.parametrize("hole", ["hole_1", "hole_2", "hole_3"])
def test_a_jar_dropped_a_little_beside_its_hole_ends_on_its_floor(jar, hole):
    """2 mm off the middle, toward the next hole, the outside and both corners between; 5 mm above the rack."""
    rack, asset = build("spice_rack"), build(jar, look=2)
    x, y, z = rack.region(hole).position
    for angle in (0.0, 0.25 * math.pi, 0.5 * math.pi, 1.25 * math.pi):
        start = (x + 0.002 * math.cos(angle), y + 0.002 * math.sin(angle), rack.size_m[2] + 0.005)
        things = {"rack": (rack, Pose((0.0, 0.0, 0.0))), "jar": (asset, Pose(start))}
        _, after = settled(things, seconds=1.0, fixed=("rack",))
        assert after["jar"].position[2] == pytest.approx(z, abs=1e-3)
        assert math.hypot(after["jar"].position[0] - x, after["jar"].position[1] - y) < 0.004
        assert math.degrees(tilt_of(after["jar"].quaternion)) < 4.0


@pytest.mark.parametrize("category", MOUNTED)
def test_a_drawer_stays_where_it_is_left_and_stops_at_both_ends(category):
    cabinet, drawer = build("drawer_cabinet"), build(category)
    slide = rail_of(drawer)
    spec = world()
    add_asset(spec, "cabinet", cabinet, pose=Pose((0.0, 0.0, 0.0)))
    add_asset(spec, "drawer", drawer, pose=cabinet.region(category.removesuffix("_drawer")).pose, slide=slide)
    spec.add_exclude(bodyname1="cabinet", bodyname2="drawer")
    model = spec.compile()
    data = mujoco.MjData(model)
    joint = data.joint("drawer_joint")
    for start in (0.0, 0.4 * slide.travel_m, slide.travel_m):
        mujoco.mj_resetData(model, data)
        joint.qpos[0] = start
        mujoco.mj_step(model, data, nstep=2500)
        assert joint.qpos[0] == pytest.approx(start, abs=2e-4)
        joint.qfrc_applied[0] = 0.8 * slide.friction_n
        mujoco.mj_step(model, data, nstep=500)
        assert joint.qpos[0] == pytest.approx(start, abs=1e-3), "a brush of the hand leaves it where it is"
    for force, stop in ((10.0, slide.travel_m), (-10.0, 0.0)):
        joint.qfrc_applied[0] = force
        mujoco.mj_step(model, data, nstep=1000)
        assert joint.qpos[0] == pytest.approx(stop, abs=3e-3)
        joint.qfrc_applied[0] = 0.0
        mujoco.mj_step(model, data, nstep=500)
        assert joint.qpos[0] == pytest.approx(stop, abs=2e-3), "it does not come back from its stop"


LOOK_ALIKES = {
    ("soap_bar", "computer_mouse"): "xyz",
    ("sponge", "cheese_slice"): "xy",
    ("stapler_block", "stapler"): "xyz",
    ("round_block", "burger"): "xyz",
    ("pill_bottle", "spice_jar"): "xyz",
    ("plain_salt_jar", "spice_jar"): "xyz",
    ("plain_pepper_jar", "spice_jar"): "xyz",
    ("plain_paprika_jar", "spice_jar"): "xyz",
    ("shallow_bowl", "dinner_plate"): "xy",
}
"""What resembles what, and in which extents; a bowl and a sponge are as wide and higher."""


@pytest.mark.parametrize(("fake", "real"), LOOK_ALIKES)
def test_a_look_alike_has_the_size_of_what_it_resembles(fake, real):
    for look in looks(fake):
        one, other = (build_unpainted(category, look=look).size_m for category in (fake, real))
        for axis in LOOK_ALIKES[fake, real]:
            i = "xyz".index(axis)
            assert one[i] == pytest.approx(other[i], rel=0.15), f"{axis} at look {look}"


def test_drinks_and_bowls_and_nothing_else_of_the_library_keep_upright():
    kept = [name for name in categories() if build_unpainted(name).keeps_upright]
    assert kept == ["cereal_bowl", "drink_cup", "shallow_bowl"]


def shade(asset):
    """Mean color of what is seen, weighted by area, each in [0, 1]."""
    total, weight = np.zeros(3), 0.0
    for part in asset.visual:
        corners = part.vertices[part.faces]
        area = (
            0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1).sum()
        )
        color = np.array(part.rgba[:3])
        if part.texture is not None:
            color = color * part.texture.pixels.reshape(-1, 3).mean(axis=0) / 255.0
        total, weight = total + area * color, weight + area
    return total / weight


@pytest.mark.parametrize(
    ("fake", "real", "color"), [("tumbler", "cup", "blue"), ("shallow_bowl", "dinner_plate", "red")]
)
def test_a_look_alike_has_the_color_of_what_it_resembles(fake, real, color):
    """Its hue comes from the same word: nearer to the real thing of this color than the real thing of any other."""
    for look in looks(fake):
        own = shade(build(fake, look=look, color=color))
        away = {c: float(np.linalg.norm(own - shade(build(real, look=look, color=c)))) for c in colors(real)}
        assert min(away, key=lambda c: away[c]) == color, f"look {look}: {away}"
