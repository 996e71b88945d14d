"""Renderings of the twin's arm and table with the printed sheet on it, seen by a front camera at a known pose."""

import functools
import math
import re
import xml.etree.ElementTree as ET

import mujoco
import numpy as np
from PIL import Image, ImageDraw

from betterbench.real.sheet.drawing import svg
from betterbench.real.sheet.layout import SHEET
from betterbench.real.sheet.pages import sheet_pages
from betterbench.sim.robots.so101 import SO101, build_so101
from betterbench.sim.robots.spec import CameraMount
from betterbench.sim.scenes.rendering import Renderer
from betterbench.sim.scenes.rooms import ROOMS, with_cloth
from betterbench.sim.scenes.stage import QUALITIES, add_mounted_camera, stage_spec

SVG = "{http://www.w3.org/2000/svg}"
PX_PER_MM = 4.0
SIZE = (640, 480)


def filled_rectangles(text):
    """Return (x, y, width, height, gray 0 to 255) of the filled rectangles of an SVG in millimeters, in order."""
    root = ET.fromstring(text)  # noqa: S314 - our own
    found = []
    for element in root.iter(f"{SVG}rect"):
        color = element.get("fill", "none")
        if re.fullmatch(r"#[0-9a-f]{6}", color) and element.get("x") is not None:
            box = [float(element.get(name)) for name in ("x", "y", "width", "height")]
            found.append((*box, int(color[1:3], 16)))
    return found


def picture_of(page, *, px_per_mm=PX_PER_MM):
    """Return a picture of a page's filled rectangles, read back from its SVG."""
    image = Image.new("L", (round(page.width * px_per_mm), round(page.height * px_per_mm)), 255)
    draw = ImageDraw.Draw(image)
    for x, y, width, height, gray in filled_rectangles(svg(page)):
        box = [round(v * px_per_mm) for v in (x, y, x + width, y + height)]
        if box[2] > box[0] and box[3] > box[1]:
            draw.rectangle((box[0], box[1], box[2] - 1, box[3] - 1), fill=gray)
    return np.asarray(image)


@functools.cache
def sheet_picture():
    """Return a picture of the whole sheet without its margin. Tests that change it copy it."""
    (page,) = sheet_pages("whole")
    left, top, width, height = (round(v * PX_PER_MM) for v in page.clip)
    picture = picture_of(page)[top : top + height, left : left + width]
    picture.setflags(write=False)
    return picture


def rendered(mount, *, picture=None, scale=1.0, folded=False, size=SIZE):
    """Return the image of a front camera: table, arm and sheet.

    ``scale`` is that of the printed sheet about the origin, and ``picture`` another one than the sheet.
    """
    if picture is None and (scale, folded, size) == (1.0, False, SIZE):
        return image_from(mount, *scene_of_sheet())
    model, data, renderer = scene_with(sheet_picture() if picture is None else picture, scale, folded, size)
    try:
        return image_from(mount, model, data, renderer)
    finally:
        renderer.close()


def image_from(mount, model, data, renderer):
    """Move the front camera of a scene, and return its image."""
    alone = mujoco.MjSpec()
    add_mounted_camera(alone.worldbody, "front", mount)
    alone = alone.compile()
    seen = mujoco.MjData(alone)
    mujoco.mj_forward(alone, seen)
    camera = data.camera("front")  # a forward pass does not compute the pose of a camera in the world again
    camera.xpos, camera.xmat = seen.cam_xpos[0], seen.cam_xmat[0]
    model.camera("front").fovy = alone.cam_fovy[0]
    return renderer.render(data, "front").rgb.copy()


@functools.cache
def scene_of_sheet():
    """Return the model, data and renderer of the scene with the sheet, which is uploaded once for many cameras."""
    return scene_with(sheet_picture(), 1.0, False, SIZE)


def scene_with(picture, scale, folded, size):
    """Return the model, data and renderer of a scene with a picture on the table."""
    spec = stage_spec(QUALITIES["standard"], room=with_cloth(ROOMS[0], "blue"))
    spec.worldbody.add_frame().attach_body(build_so101().body("base"), "robot/", "")
    pixels = np.repeat(np.ascontiguousarray(picture)[..., None], 3, axis=2)
    texture = spec.add_texture(
        name="sheet", type=mujoco.mjtTexture.mjTEXTURE_2D, width=pixels.shape[1], height=pixels.shape[0], nchannel=3
    )
    texture.data = pixels.tobytes()
    paper = spec.add_material(name="sheet", specular=0.05, shininess=0.1)
    textures = list(paper.textures)
    textures[int(mujoco.mjtTextureRole.mjTEXROLE_RGB)] = "sheet"
    paper.textures = textures
    x1, x2, y1, y2 = (0.001 * scale * v for v in (SHEET.x_low, SHEET.x_high, SHEET.y_low, SHEET.y_high))
    mesh = spec.add_mesh(name="sheet")
    corners = [(x2, y2), (x2, y1), (x1, y1), (x1, y2)]  # as in the picture: from the top left, clockwise
    mesh.uservert = [v for z in (0.0, -0.002) for x, y in corners for v in (x, y, z)]
    mesh.usertexcoord = [v for _ in range(2) for u, w in ((0, 0), (1, 0), (1, 1), (0, 1)) for v in (u, w)]
    mesh.userface = [0, 2, 1, 0, 3, 2, 4, 5, 6, 4, 6, 7]
    mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL
    spec.worldbody.add_geom(
        type=mujoco.mjtGeom.mjGEOM_MESH,
        meshname="sheet",
        material="sheet",
        pos=(0, 0, 0.0005),
        contype=0,
        conaffinity=0,
    )
    spec.visual.global_.offwidth, spec.visual.global_.offheight = size
    model = spec.compile()
    data = mujoco.MjData(model)
    posture = (0.0, -1.7, 1.6, 1.2, 0.0) if folded else SO101.home_joints
    for name, angle in zip(SO101.arm_joints, posture, strict=True):
        data.joint(f"robot/{name}").qpos[0] = angle
    mujoco.mj_forward(model, data)
    return model, data, Renderer(model, width=size[0], height=size[1], quality=QUALITIES["standard"])


def mount_at(move_cm=(0.0, 0.0, 0.0), *, tilt=0.0, pan=0.0, roll=0.0, fovy_deg=52.0):
    """Return the twin's front camera, moved [cm] and turned [degree]: tilt up, pan right, roll clockwise."""
    from betterbench.real.sheet.camera_pose import twin_camera

    twin = twin_camera()
    position = twin.position_m + 0.01 * np.array(move_cm)
    axes = twin.axes
    for angle, axis in ((tilt, 0), (pan, 1), (roll, 2)):
        c, s = math.cos(math.radians(angle)), math.sin(math.radians(angle))
        i, j = (axis + 1) % 3, (axis + 2) % 3
        turn = np.eye(3)
        turn[i, i] = turn[j, j] = c
        turn[j, i], turn[i, j] = s, -s
        axes = axes @ turn
    _, y, z = axes.T
    return CameraMount(tuple(position), tuple(position + z), tuple(-y), fovy_deg)
