"""Images and labels: upright, true to the geometry, repeatable, and independent of each other."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from betterbench.errors import InvalidInputError, UnknownNameError
from betterbench.interface.actions import EE_DELTA
from betterbench.sim.scenes import Renderer, Scene, gl_backend, gl_context
from betterbench.sim.scenes.cameras import camera_matrices
from betterbench.sim.scenes.gl_context import renderer_fingerprint
from betterbench.sim.scenes.stage import CAMERAS, FAST, HIGH, QUALITIES, STANDARD, Quality, quality_preset, stage_spec
from betterbench.tasks import get_task

pytestmark = [
    pytest.mark.render,
    pytest.mark.skipif(gl_backend() is None, reason="no off-screen OpenGL is installed"),
]
SIZE = 96


@pytest.fixture(scope="module")
def scene() -> Scene:
    task = get_task("fast_food")
    return Scene(task, task.training[0], seed=0, action_space=EE_DELTA, quality=FAST)


@pytest.fixture(scope="module")
def renderer(scene):
    with Renderer(scene.model, width=SIZE, height=SIZE, quality=FAST) as made:
        yield made


def posts(*places: tuple[float, float, float]) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """The stage with a bright red box at each place."""
    spec = stage_spec(FAST)
    for i, place in enumerate(places):
        body = spec.worldbody.add_body(name=f"post{i}", pos=place)
        body.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.03, 0.03, 0.03], rgba=[1, 0, 0, 1])
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return model, data


def rays(model: mujoco.MjModel, data: mujoco.MjData, camera: str) -> tuple[np.ndarray, np.ndarray]:
    """Distances along the optical axis and body numbers by ray casting against what is visible."""
    view = camera_matrices(model, data, camera, width=SIZE, height=SIZE)
    columns, rows = np.meshgrid(np.arange(SIZE), np.arange(SIZE))
    K = view.K
    x, y = (columns - K[0, 2]) / K[0, 0], (rows - K[1, 2]) / K[1, 1]
    forward = np.stack([x, y, np.ones_like(x)], axis=-1).reshape(-1, 3)
    rotation = np.empty(9)
    mujoco.mju_quat2Mat(rotation, np.array(view.T_world_camera.quaternion))
    directions = forward @ rotation.reshape(3, 3).T
    origin = np.array(view.T_world_camera.position)
    groups = np.array([1, 1, 1, 0, 0, 0], dtype=np.uint8)
    depth, bodies = np.full(len(directions), np.inf), np.full(len(directions), -1)
    hit = np.zeros(1, dtype=np.int32)
    for i, direction in enumerate(directions):
        length = float(np.linalg.norm(direction))
        distance = mujoco.mj_ray(model, data, origin, direction / length, groups, 1, -1, hit)
        if distance >= 0.0:
            depth[i], bodies[i] = distance / length, model.geom_bodyid[hit[0]]
    return depth.reshape(SIZE, SIZE), bodies.reshape(SIZE, SIZE)


@pytest.mark.parametrize("camera", ["front", "wrist"])
def test_depth_and_masks_agree_with_ray_casting(scene, renderer, camera):
    view = renderer.render(scene.data, camera, depth=True, masks=True)
    depth, bodies = rays(scene.model, scene.data, camera)
    assert (view.masks == bodies).mean() > 0.985
    same = (view.masks == bodies) & np.isfinite(depth)
    assert np.median(np.abs(view.depth[same] - depth[same])) < 5e-4
    assert np.quantile(np.abs(view.depth[same] - depth[same]), 0.97) < 5e-3


def test_front_is_upright_with_the_robot_s_left_on_the_right():
    model, data = posts((0.70, -0.25, 0.03), (0.35, 0.25, 0.03))
    with Renderer(model, width=SIZE, height=SIZE, quality=FAST) as renderer:
        view = renderer.render(data, "front", masks=True)
    near_row, near_column = np.argwhere(view.masks == model.body("post0").id).mean(axis=0)
    far_row, far_column = np.argwhere(view.masks == model.body("post1").id).mean(axis=0)
    assert near_row > far_row + 15, "what is near the camera is lower in the image"
    assert far_column > near_column + 25, "+y is on the right"
    red = view.rgb[view.masks == model.body("post0").id].mean(axis=0)
    assert red[0] > 2.0 * red[1], "channels are in the order red, green, blue"


def test_a_known_point_lands_on_its_mask():
    place = (0.5, 0.2, 0.03)
    model, data = posts(place)
    with Renderer(model, width=SIZE, height=SIZE, quality=FAST) as renderer:
        for camera in ("front", "left_shoulder", "right_shoulder", "front_official"):
            masks = renderer.render(data, camera, rgb=False, masks=True).masks
            pixels, depths = camera_matrices(model, data, camera, width=SIZE, height=SIZE).project(np.array([place]))
            u, v = pixels[0]
            assert depths[0] > 0.0
            assert masks[round(v), round(u)] == model.body("post0").id


def test_unprojecting_the_depth_gives_the_table_back(scene, renderer):
    view = renderer.render(scene.data, "front", depth=True, masks=True)
    points = camera_matrices(scene.model, scene.data, "front", width=SIZE, height=SIZE).unproject(view.depth)
    table = points[view.masks == scene.model.body("table").id]
    assert np.abs(np.median(table[:, 2])) < 2e-3


def test_the_same_state_gives_the_same_pixels(scene, renderer):
    first = renderer.render(scene.data, "front", depth=True, masks=True)
    renderer.render(scene.data, "wrist", depth=True, masks=True)
    again = renderer.render(scene.data, "front", depth=True, masks=True)
    with Renderer(scene.model, width=SIZE, height=SIZE, quality=FAST) as other:
        anew = other.render(scene.data, "front", depth=True, masks=True)
    for a, b in ((first, again), (first, anew)):
        assert np.array_equal(a.rgb, b.rgb)
        assert np.array_equal(a.depth, b.depth)
        assert np.array_equal(a.masks, b.masks)


def test_images_are_copies(scene, renderer):
    first = renderer.render(scene.data, "front").rgb
    kept = first.copy()
    renderer.render(scene.data, "wrist")
    assert np.array_equal(first, kept)


def test_labels_do_not_depend_on_the_quality(scene, renderer):
    plain = renderer.render(scene.data, "front", depth=True, masks=True)
    with Renderer(scene.model, width=SIZE, height=SIZE, quality=STANDARD) as other:
        fine = other.render(scene.data, "front", depth=True, masks=True)
    assert np.array_equal(plain.masks, fine.masks)
    assert np.array_equal(plain.depth, fine.depth)
    assert not np.array_equal(plain.rgb, fine.rgb)


def test_another_camera_changes_no_pixel_of_this_one():
    with_one, with_two = stage_spec(FAST), stage_spec(FAST)
    with_two.worldbody.add_camera(name="spy", pos=[1.0, 1.0, 1.0])
    images = []
    for spec in (with_one, with_two):
        model = spec.compile()
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        with Renderer(model, width=SIZE, height=SIZE, quality=FAST) as renderer:
            images.append(renderer.render(data, "front").rgb)
    assert np.array_equal(*images)


@pytest.mark.parametrize("quality", [STANDARD, HIGH], ids=lambda q: q.name)
def test_the_empty_table_has_no_specks_of_false_shadow(quality):
    model = stage_spec(quality).compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    with Renderer(model, width=256, height=256, quality=quality) as renderer:
        view = renderer.render(data, "front", masks=True)
    bright = view.rgb.astype(int).sum(axis=2)
    around = np.stack([np.roll(bright, (i, j), (0, 1)) for i in (-1, 0, 1) for j in (-1, 0, 1)])
    table = view.masks == model.body("table").id
    inner = table & np.all([np.roll(table, (i, j), (0, 1)) for i in (-2, 0, 2) for j in (-2, 0, 2)], axis=0)
    assert ((np.median(around, axis=0) - bright > 40) & inner).sum() <= 3


def test_the_workspace_fills_the_front_view(scene, renderer):
    view = camera_matrices(scene.model, scene.data, "front", width=SIZE, height=SIZE)
    corners = np.array([(x, y, 0.0) for x in (0.30, 0.70) for y in (-0.25, 0.25)])
    pixels, _ = view.project(corners)
    assert pixels.min() > 0
    assert pixels.max() < SIZE
    assert np.ptp(pixels[:, 0]) > 0.75 * SIZE


def test_bad_requests_are_named(scene, renderer):
    with pytest.raises(UnknownNameError, match="front"):
        renderer.render(scene.data, "frnt")
    with pytest.raises(InvalidInputError):
        renderer.render(scene.data, "front", width=100_000)
    closed = Renderer(scene.model, width=16, height=16, quality=FAST)
    closed.close()
    with pytest.raises(InvalidInputError, match="closed"):
        closed.render(scene.data, "front")


def test_the_fingerprint_names_the_renderer():
    fingerprint = renderer_fingerprint()
    assert fingerprint["backend"] in ("egl", "osmesa", "glfw")
    assert fingerprint["renderer"]
    assert set(CAMERAS) <= {"front", "front_official", "left_shoulder", "right_shoulder"}


@pytest.mark.parametrize("quality", QUALITIES.values(), ids=QUALITIES)
def test_qualities_are_values(quality):
    assert Quality.from_json(quality.to_json()) == quality
    assert quality_preset(quality.name) is quality
    assert (quality.shadow_map_size > 0) == quality.shadows


def test_images_do_not_depend_on_the_order_in_which_rows_are_read(scene, renderer):
    """Mesa reads from the top, other OpenGL from the bottom: the same image, depth and mask either way."""
    usual = renderer.render(scene.data, "front", depth=True, masks=True)
    kept = gl_context.CONTEXT.from_top
    try:
        gl_context.CONTEXT.from_top = gl_context.read_from_top(wanted=False)
        assert not gl_context.CONTEXT.from_top
        turned = renderer.render(scene.data, "front", depth=True, masks=True)
    finally:
        gl_context.CONTEXT.from_top = gl_context.read_from_top(wanted=kept)
    assert np.array_equal(usual.rgb, turned.rgb)
    assert np.array_equal(usual.depth, turned.depth)
    assert np.array_equal(usual.masks, turned.masks)
    assert usual.rgb.flags.c_contiguous
    assert turned.rgb.flags.c_contiguous
