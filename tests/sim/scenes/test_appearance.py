"""What varies by seed besides the slots: rooms, looks, cameras, light and the start of the arm."""

from __future__ import annotations

import json

import mujoco
import numpy as np
import pytest
from pydantic import TypeAdapter

from betterbench.errors import RecordError
from betterbench.geometry import angle_between, distance
from betterbench.interface.actions import EE_DELTA
from betterbench.interface.state import ViewJitter
from betterbench.sim.assets import build, looks, unseen_looks
from betterbench.sim.robots import PANDA, ArmIK
from betterbench.sim.scenes import Renderer, Scene, StoredView, load_model
from betterbench.sim.scenes.appearance import (
    CAMERA_SHIFT_M,
    CAMERA_TURN_RAD,
    LOOK_SETS,
    START_SHIFT_M,
    START_TURN_RAD,
    UNSEEN_LOOK_SETS,
    look_of,
    look_set_of,
    room_of,
    start_joints_of,
    view_jitter_of,
)
from betterbench.sim.scenes.cameras import camera_matrices
from betterbench.sim.scenes.rooms import ROOMS, UNSEEN_ROOMS
from betterbench.sim.scenes.stage import CAMERAS, FAST, STANDARD, WRIST_CAMERA
from betterbench.tasks import ObjectSpec, get_task, suite_tasks

SEEDS = range(60)


def scene(task_id: str = "fast_food", seed: int = 0, **options) -> Scene:
    task = get_task(task_id)
    return Scene(task, task.training[0], seed=seed, action_space=EE_DELTA, quality=FAST, **options)


def test_seeds_draw_eight_rooms_and_three_held_out_ones():
    for task in suite_tasks("better60"):
        seen = {room_of(task, seed).name for seed in range(200)}
        unseen = {room_of(task, seed, shown="unseen").name for seed in range(200)}
        assert seen == {room.name for room in ROOMS}
        assert unseen == {room.name for room in UNSEEN_ROOMS}
        assert not seen & unseen
    assert len(ROOMS) >= 8
    assert len(UNSEEN_ROOMS) >= 3


def test_looks_and_rooms_are_drawn_independently_and_equally_often():
    mug, can = ObjectSpec("a", "mug", "mug", "red"), ObjectSpec("b", "can", "can", "red")
    pairs = {(look_of("morning_coffee", s, mug), room_of("morning_coffee", s).name) for s in range(400)}
    assert {look for look, _ in pairs} == set(looks("mug"))
    assert len(pairs) > 8, "a look does not come with one room only"
    assert len({(look_of("morning_coffee", s, mug), look_of("morning_coffee", s, can)) for s in range(400)}) > 8
    shown = {look_of("morning_coffee", s, mug, shown="unseen") for s in range(400)}
    assert shown == set(unseen_looks("mug"))


def test_a_cabinet_and_its_drawers_share_their_look():
    for seed in SEEDS:
        kinds = ("drawer_cabinet", "upper_drawer", "lower_drawer")
        assert len({look_of("office_drawer", seed, ObjectSpec(k, k, k)) for k in kinds}) == 1


@pytest.mark.physics
@pytest.mark.parametrize(("shown", "most"), [("seen", LOOK_SETS), ("unseen", UNSEEN_LOOK_SETS)])
def test_one_scene_is_compiled_for_each_set_of_looks(shown, most):
    sets = [look_set_of("cheeseburger", seed, shown=shown) for seed in range(40)]
    assert 3 <= len(set(sets)) <= most
    seed = next(n for n, number in enumerate(sets) if number in sets[n + 1 :])
    again = sets.index(sets[seed], seed + 1)
    other = next(n for n, number in enumerate(sets) if number != sets[seed])
    one, same, different = (scene("cheeseburger", n, looks=shown).compiled.content_hash for n in (seed, again, other))
    assert one == same != different


@pytest.mark.slow
@pytest.mark.physics
def test_runs_compile_a_few_scenes_only():
    hashes = {scene("cheeseburger", seed).compiled.content_hash for seed in range(40)}
    assert 8 < len(hashes) <= LOOK_SETS
    held_out = {scene("cheeseburger", seed, looks="unseen").compiled.content_hash for seed in range(24)}
    assert 3 <= len(held_out) <= UNSEEN_LOOK_SETS
    assert not hashes & held_out


def test_cameras_are_jittered_within_their_bounds_each_by_itself():
    drawn = [view_jitter_of("fast_food", seed) for seed in SEEDS]
    for camera in (*CAMERAS, WRIST_CAMERA):
        shifts = np.array([j.cameras[camera].shift_m for j in drawn])
        turns = np.array([j.cameras[camera].turn_rad for j in drawn])
        for values, bound in ((shifts, CAMERA_SHIFT_M), (turns, CAMERA_TURN_RAD)):
            assert np.abs(values).max() <= bound
            assert (np.ptp(values, axis=0) > 1.6 * bound).all()
    assert len({j.cameras[c].shift_m for j in drawn for c in CAMERAS}) == len(drawn) * len(CAMERAS)
    assert view_jitter_of("fast_food", 3) == view_jitter_of("fast_food", 3) != view_jitter_of("fruit_lunch", 3)


def test_the_arm_starts_near_home_within_its_limits():
    arm = ArmIK(PANDA)
    home = arm.forward(arm.home)
    starts = [np.array(start_joints_of("fast_food", seed, PANDA)) for seed in SEEDS]
    for joints in starts:
        assert (joints > arm.low).all()
        assert (joints < arm.high).all()
        tool = arm.forward(joints)
        assert np.abs(np.subtract(tool.position, home.position)).max() <= START_SHIFT_M + 1e-4
        assert angle_between(tool.quaternion, home.quaternion) <= START_TURN_RAD + 1e-3
    places = np.array([arm.forward(q).position for q in starts])
    assert (np.ptp(places, axis=0) > 1.6 * START_SHIFT_M).all()
    assert 0.2 <= home.position[2] <= 0.3, "as high above the table as in LIBERO"


@pytest.mark.physics
@pytest.mark.render
def test_images_follow_from_model_state_and_jitter_bit_for_bit():
    """A stored scene, a recorded state and the jitter of the record's metadata give the pixels of the live scene."""
    s = scene(seed=5)
    s.reset()
    for _ in range(8):
        s.step(np.array([0.3, -0.4, -0.5, 0.0, 0.0, 0.3, -1.0]))
    form = json.dumps(s.view_jitter.to_json())
    jitter = TypeAdapter(ViewJitter).validate_json(form)
    assert jitter == s.view_jitter
    view = StoredView(load_model(s.files()), STANDARD, width=96, height=96)
    with Renderer(s.model, width=96, height=96, quality=STANDARD) as renderer:
        for camera in (*CAMERAS, WRIST_CAMERA):
            live = renderer.render(s.data, camera, depth=True, masks=True)
            stored = view.draw(s.data.qpos, camera, jitter=jitter, depth=True, masks=True)
            assert np.array_equal(live.rgb, stored.rgb), camera
            assert np.array_equal(live.depth, stored.depth), camera
            assert np.array_equal(live.masks, stored.masks), camera
            plain = view.draw(s.data.qpos, camera, jitter=ViewJitter())
            assert not np.array_equal(live.rgb, plain.rgb), f"the jitter of {camera} shows"
    view.close()


@pytest.mark.physics
@pytest.mark.render
def test_camera_matrices_agree_with_jittered_pixels():
    s = scene("morning_coffee", seed=9)
    s.reset()
    body = int(s.compiled.bodies[[p.spec.name for p in s.placements].index("red_mug")])
    with Renderer(s.model, width=256, height=256, quality=FAST) as renderer:
        for camera in CAMERAS:
            seen = renderer.render(s.data, camera, rgb=False, depth=True, masks=True)
            points = camera_matrices(s.model, s.data, camera).unproject(seen.depth)[seen.masks == body]
            assert distance(points.mean(axis=0), s.data.xpos[body]) < 0.08
            table = camera_matrices(s.model, s.data, camera).unproject(seen.depth)
            heights = table[seen.masks == s.model.body("table").id][:, 2]
            assert abs(float(np.median(heights))) < 1e-3, camera


@pytest.mark.physics
def test_cameras_are_jittered_again_at_every_step():
    s = scene(seed=2)
    s.reset()
    fixed = s.model.camera("front").id
    before, wrist = s.data.cam_xpos.copy(), s.data.cam_xpos[s.model.camera("wrist").id].copy()
    s.step(np.array([0.0, 0.0, -1.0, 0.0, 0.0, 0.0, -1.0]))
    assert np.array_equal(before[fixed], s.data.cam_xpos[fixed])
    assert distance(wrist, s.data.cam_xpos[s.model.camera("wrist").id]) > 1e-4
    plain = mujoco.MjData(s.model)
    plain.qpos[:] = s.data.qpos
    mujoco.mj_forward(s.model, plain)
    assert distance(plain.cam_xpos[fixed], s.data.cam_xpos[fixed]) > 1e-4


def test_no_named_color_is_lost_on_a_table_top():
    """Colors of things as a person names them differ from each table top by far more than what is just noticeable."""
    named = {
        "white": (0.93, 0.93, 0.92),
        "black": (0.08, 0.08, 0.09),
        "red": (0.75, 0.10, 0.08),
        "blue": (0.10, 0.22, 0.65),
        "yellow": (0.95, 0.80, 0.15),
        "orange": (0.95, 0.52, 0.10),
        "lettuce green": (0.45, 0.72, 0.22),
        "patty brown": (0.28, 0.16, 0.10),
        "bun": (0.85, 0.60, 0.30),
    }
    for room in (*ROOMS, *UNSEEN_ROOMS):
        for name, color in named.items():
            assert np.linalg.norm(_lab(color) - _lab(room.table)) > 20.0, (room.name, name)


def _lab(color) -> np.ndarray:
    """CIELAB coordinates of an sRGB color in [0, 1], white point D65."""
    c = np.asarray(color, float)
    linear = np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4)
    xyz = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]]) @ linear
    f = np.cbrt(xyz / np.array([0.9505, 1.0, 1.089]))
    return np.array([116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])])


def test_light_never_clips_a_white_thing():
    """On a surface that faces the key light, which is the brightest case of a matte thing."""
    for room in (*ROOMS, *UNSEEN_ROOMS):
        light = room.light
        key = np.array(light.key_direction) / np.linalg.norm(light.key_direction)
        fill = np.array([-light.key_direction[0], -2.0 * light.key_direction[1], -0.8])
        facing = max(0.0, float(key @ (fill / np.linalg.norm(fill))))
        total = np.array(light.ambient) + np.array(light.key) + light.fill * facing + 0.08
        assert total.max() <= 1.02, room.name
        assert total.max() / total.min() < 1.1, f"white stays white in {room.name}"


def test_every_category_has_held_out_looks():
    for category in ("mug", "drawer_cabinet", "fries_box"):
        assert not set(looks(category)) & set(unseen_looks(category))
        assert len(unseen_looks(category)) >= 4
        assert build(category, look=unseen_looks(category)[0]) != build(category)


def test_a_stranger_s_version_of_mujoco_stays_on_one_line():
    files = scene("morning_coffee").files()
    name = next(n for n in files if n.endswith(".json"))
    index = json.loads(files[name])
    files = {**files, name: json.dumps({**index, "mujoco": "9.9\n\x1b[31mrun this"}).encode()}
    with pytest.raises(RecordError, match="Install that version") as caught:
        load_model(files)
    assert str(caught.value).isprintable()
