"""The stage that every task shares: its physics, its furniture and its cameras."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from betterbench.errors import InvalidInputError, UnknownNameError
from betterbench.sim.scenes.rooms import ROOMS, UNSEEN_ROOMS
from betterbench.sim.scenes.stage import CAMERAS, FAST, HIGH, STANDARD, Quality, quality_preset, stage_spec


@pytest.fixture(scope="module")
def model() -> mujoco.MjModel:
    return stage_spec(FAST).compile()


def test_physics_is_what_the_measurements_call_for(model):
    option = model.opt
    assert option.timestep == 0.002
    assert option.integrator == mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    assert option.cone == mujoco.mjtCone.mjCONE_ELLIPTIC
    assert option.impratio == 10.0
    assert option.noslip_iterations == 3
    table = model.geom("table")
    assert model.geom_condim[table.id] == 4
    assert model.geom_solref[table.id] == pytest.approx((0.005, 1.0))


def test_the_table_top_is_the_zero_of_height(model):
    table = model.geom("table").id
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    assert data.geom_xpos[table, 2] + model.geom_size[table, 2] == pytest.approx(0.0)
    x, y = data.geom_xpos[table, :2]
    half_x, half_y = model.geom_size[table, :2]
    assert x - half_x < 0.25
    assert x + half_x > 0.85
    assert y == pytest.approx(0.0)
    assert half_y >= 0.5


def test_a_dropped_block_sinks_less_than_two_millimeters():
    spec = stage_spec(FAST)
    body = spec.worldbody.add_body(name="block", pos=[0.5, 0.0, 0.075])
    body.add_freejoint()
    body.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.025, 0.025, 0.025], mass=0.2)
    model = spec.compile()
    data = mujoco.MjData(model)
    lowest = 1.0
    for _ in range(500):
        mujoco.mj_step(model, data)
        lowest = min(lowest, float(data.qpos[2]))
    assert 0.025 - lowest < 2e-3
    assert data.qpos[2] == pytest.approx(0.025, abs=5e-4)


def test_cameras_stand_where_the_paper_s_release_has_them(model):
    assert set(CAMERAS) <= {model.camera(i).name for i in range(model.ncam)}
    assert model.camera("front_official").pos == pytest.approx((1.6, 0.0, 0.9))
    for name, side in (("left_shoulder", 1), ("right_shoulder", -1)):
        assert model.camera(name).pos == pytest.approx((-0.3, side * 0.9, 0.9))
        assert model.cam_fovy[model.camera(name).id] == pytest.approx(47.0)


@pytest.mark.parametrize(
    ("quality", "shadows"), [(FAST, 0), (STANDARD, 1), (HIGH, 1)], ids=["fast", "standard", "high"]
)
def test_at_most_one_light_casts_a_shadow(quality, shadows):
    model = stage_spec(quality).compile()
    assert model.light_castshadow.sum() <= 1
    assert model.vis.quality.offsamples == quality.samples
    assert model.vis.quality.shadowsize == quality.shadow_map_size
    assert quality.shadows == bool(shadows)


def test_two_stages_are_the_same_and_rooms_differ():
    first, again = stage_spec(FAST).compile(), stage_spec(FAST).compile()
    assert np.array_equal(first.tex_data, again.tex_data)
    rooms = (*ROOMS, *UNSEEN_ROOMS)
    assert len({stage_spec(FAST, room=room).compile().tex_data.tobytes() for room in rooms}) == len(rooms)


def test_bad_values_are_named():
    with pytest.raises(UnknownNameError, match="standard"):
        quality_preset("standart")
    with pytest.raises(InvalidInputError, match="samples"):
        Quality("x", shadows=False, shadow_map_size=0, samples=1)
    with pytest.raises(InvalidInputError, match="shadow_map_size"):
        Quality("x", shadows=False, shadow_map_size=256, samples=0)
    with pytest.raises(InvalidInputError, match="quality"):
        Quality.from_json({"name": "x"})
