"""What is not drawn was not to be seen: leaving it out changes no pixel."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from tests.daily import others_slow

from betterbench.interface.actions import EE_DELTA
from betterbench.sim.scenes import Renderer, Scene, gl_backend
from betterbench.sim.scenes.culling import Culling
from betterbench.sim.scenes.stage import FAST, STANDARD, Quality
from betterbench.tasks import all_tasks, get_task

pytestmark = [
    pytest.mark.render,
    pytest.mark.skipif(gl_backend() is None, reason="no off-screen OpenGL is installed"),
]

NOTHING = int(mujoco.mjtGeom.mjGEOM_NONE)


def make(task_name: str, quality: Quality) -> Scene:
    task = get_task(task_name)
    return Scene(task, task.training[0], seed=1, action_space=EE_DELTA, quality=quality)


def wander(scene: Scene, rng: np.random.Generator) -> None:
    """Put the arm anywhere within its joints' limits, so that the wrist looks at table, floor, robot and sky."""
    model, data = scene.model, scene.data
    for joint in range(model.njnt):
        if model.joint(joint).name.startswith("robot/") and model.jnt_limited[joint]:
            data.qpos[model.jnt_qposadr[joint]] = rng.uniform(*model.jnt_range[joint])
    mujoco.mj_forward(model, data)


def everything(renderer: Renderer, scene: Scene, camera: str, size: tuple[int, int], *, labels: bool) -> list:
    images = renderer.render(scene.data, camera, depth=labels, masks=labels, width=size[0], height=size[1])
    return [i for i in (images.rgb, images.depth, images.masks) if i is not None]


@pytest.mark.parametrize("task_name", others_slow((t.id for t in all_tasks()), 6))
def test_culling_changes_no_pixel(task_name, monkeypatch):
    """Every task, both cameras, odd sizes, any posture; with shadows nothing but the sky is left out."""
    rng = np.random.default_rng(7)
    hidden, skies = 0, set()
    cull = Culling.cull

    def noted(*arguments, **more):
        sky = cull(*arguments, **more)
        skies.add(sky)
        return sky

    for quality in (FAST, STANDARD):
        scene = make(task_name, quality)
        with Renderer(scene.model, quality=quality) as renderer:
            for trial in range(6):
                if trial:
                    wander(scene, rng)
                for camera in ("front", "wrist"):
                    size = ((96, 96), (160, 90), (60, 128))[trial % 3]
                    labels = trial % 2 == 0
                    monkeypatch.setattr(Culling, "cull", lambda *_args, **_more: True)
                    plain = everything(renderer, scene, camera, size, labels=labels)
                    monkeypatch.setattr(Culling, "cull", noted)
                    culled = everything(renderer, scene, camera, size, labels=labels)
                    drawn = renderer._scene.geoms[: renderer._scene.ngeom]
                    hidden += sum(int(g.type) == NOTHING for g in drawn)
                    for before, after in zip(plain, culled, strict=True):
                        assert np.array_equal(before, after), (quality.name, trial, camera)
    assert hidden > 50, "nothing was left out: the test shows nothing"
    assert skies == {True, False}


def test_a_floor_that_is_gone_shows_the_sky():
    scene = make("fast_food", FAST)
    with Renderer(scene.model, width=64, height=64, quality=FAST) as renderer:
        floor = scene.model.geom("floor").id
        material = scene.model.geom_matid[floor]
        usual = renderer.render(scene.data, "front").rgb
        for alpha in (0.0, 0.5):
            kept = scene.model.mat_rgba[material].copy()
            try:
                scene.model.mat_rgba[material, 3] = alpha
                seen = renderer.render(scene.data, "front").rgb
                renderer._culling.cull = lambda *_args, **_more: True
                assert np.array_equal(seen, renderer.render(scene.data, "front").rgb), alpha
                del renderer._culling.cull
            finally:
                scene.model.mat_rgba[material] = kept
            assert not np.array_equal(seen, usual), alpha
        assert np.array_equal(usual, renderer.render(scene.data, "front").rgb)


def left_out(renderer: Renderer) -> set[int]:
    """The geoms that the last image left out."""
    return {int(g.objid) for g in renderer._scene.geoms[: renderer._scene.ngeom] if int(g.type) == NOTHING}


def test_exchanging_what_is_invisible_leaves_the_right_things_out():
    """As many geoms as before, but others: their places in the drawing list no longer mean what they meant."""
    scene = make("fast_food", FAST)
    model = scene.model
    meshes = [g for g in range(model.ngeom) if model.geom_group[g] <= 2 and model.geom_type[g] == 7]
    first, last = meshes[0], meshes[-1]
    rgba, materials = model.geom_rgba.copy(), model.geom_matid.copy()
    try:
        model.geom_matid[[first, last]] = -1
        model.geom_rgba[[first, last], 3] = 0.0, 1.0
        with Renderer(model, width=64, height=64, quality=FAST) as renderer:
            renderer.render(scene.data, "wrist")
            model.geom_rgba[[first, last], 3] = 1.0, 0.0
            seen = renderer.render(scene.data, "wrist").rgb
            out = left_out(renderer)
        with Renderer(model, width=64, height=64, quality=FAST) as fresh:
            assert np.array_equal(seen, fresh.render(scene.data, "wrist").rgb)
            assert out == left_out(fresh)
            assert len(out) > 5
    finally:
        model.geom_rgba[:], model.geom_matid[:] = rgba, materials
