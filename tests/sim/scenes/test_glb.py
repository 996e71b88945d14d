"""A scene as binary glTF: a reader of that format finds the shapes of the compiled model where they are."""

from __future__ import annotations

import io

import mujoco
import numpy as np
import pytest
import trimesh

from betterbench.interface.actions import EE_DELTA
from betterbench.sim.scenes import Scene
from betterbench.sim.scenes.glb import body_files
from betterbench.tasks import get_task

pytestmark = pytest.mark.physics
NAMES = ("object0_lunchbox", "object1_apple", "robot/hand")


@pytest.fixture(scope="module")
def model():
    task = get_task("fruit_lunch")
    return Scene(task, task.train("train1"), seed=0, action_space=EE_DELTA).model


@pytest.fixture(scope="module")
def files(model):
    return body_files(model)


def corners_of(model, body):
    """Return the vertices of the visible shapes of a body in its frame, (n, 3) [m], straight from the model."""
    found = []
    for geom in np.flatnonzero((model.geom_bodyid == body) & (model.geom_group <= 2)):
        if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_PLANE:
            return None
        if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_MESH:
            mesh = model.geom_dataid[geom]
            begin = model.mesh_vertadr[mesh]
            points = model.mesh_vert[begin : begin + model.mesh_vertnum[mesh]]
        else:
            signs = np.stack(np.meshgrid(*[[-1, 1]] * 3), axis=-1).reshape(-1, 3)
            points = model.geom_aabb[geom, :3] + signs * model.geom_aabb[geom, 3:]
        turned = np.empty((len(points), 3))
        for row, point in enumerate(points):
            mujoco.mju_rotVecQuat(turned[row], point.astype(float), model.geom_quat[geom])
        found.append(turned + model.geom_pos[geom])
    return np.concatenate(found)


def test_every_visible_body_has_a_file_with_its_shapes_where_they_are(model, files):
    assert {model.body(b).name for b in files} >= {*NAMES, "table"}
    for body, data in files.items():
        loaded = trimesh.load(io.BytesIO(data), file_type="glb", process=False)
        wanted = corners_of(model, body)
        if wanted is not None:
            assert np.allclose(loaded.bounds, [wanted.min(axis=0), wanted.max(axis=0)], atol=1e-5), model.body(
                body
            ).name


def test_triangles_face_outward_and_the_files_repeat(model, files):
    for body in (model.body(name).id for name in NAMES):
        for mesh in trimesh.load(io.BytesIO(files[body]), file_type="glb", process=False).geometry.values():
            normals = mesh.vertex_normals[mesh.faces].mean(axis=1)
            agree = (normals * mesh.face_normals).sum(axis=1)[mesh.area_faces > 1e-12]
            assert (agree > 0.0).mean() > 0.99
    assert body_files(model) == files


def test_colors_textures_and_their_coordinates_are_those_of_the_model(model, files):
    body = model.body("object0_lunchbox").id
    meshes = list(trimesh.load(io.BytesIO(files[body]), file_type="glb", process=False).geometry.values())
    geoms = np.flatnonzero((model.geom_bodyid == body) & (model.geom_group <= 2))
    materials = {int(model.geom_matid[g]) for g in geoms}
    textured = [m for m in materials if model.mat_texid[m, mujoco.mjtTextureRole.mjTEXROLE_RGB] >= 0]
    assert len(meshes) == len(materials)
    assert sum(mesh.visual.material.baseColorTexture is not None for mesh in meshes) == len(textured) > 0
    mesh = next(mesh for mesh in meshes if mesh.visual.material.baseColorTexture is not None)
    geom = next(g for g in geoms if int(model.geom_matid[g]) in textured)
    number = int(model.geom_dataid[geom])
    begin = int(model.mesh_texcoordadr[number])
    wanted = model.mesh_texcoord[begin : begin + int(model.mesh_texcoordnum[number])]
    # trimesh counts v from the lower edge of an image, MuJoCo from the upper one.
    upright = mesh.visual.uv * (1.0, -1.0) + (0.0, 1.0)
    assert np.allclose([upright.min(axis=0), upright.max(axis=0)], [wanted.min(axis=0), wanted.max(axis=0)], atol=1e-5)
