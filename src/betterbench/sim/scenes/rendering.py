"""Images of a scene from MuJoCo's classic off-screen renderer: color, depth and body masks.

A *color pass* renders lights, textures and shadows into the multisampled buffer. A *geometry pass* renders every
visible shape into the plain buffer, in a flat color that encodes the index of the shape. One sample is taken at the
center of each pixel, so indices are never blended with those of neighboring pixels. The geometry pass gives both depth
and masks. Without multisampling and transparency, the color pass gives the same depth, so one pass is enough for color
with depth. Otherwise, two passes are needed. Depth and masks therefore never depend on the render quality.

All images are upright, i.e. row 0 is the top. Every returned array belongs to the caller.
"""

from __future__ import annotations

import logging
import os
from collections import OrderedDict
from collections.abc import Sequence
from dataclasses import dataclass
from types import TracebackType
from typing import Self

import mujoco
import numpy as np

from betterbench.errors import InvalidInputError, MissingDependencyError, UnknownNameError
from betterbench.sim.scenes.cameras import check_size
from betterbench.sim.scenes.culling import Culling
from betterbench.sim.scenes.gl_context import CONTEXT, CURE, RENDERERS, as_upright, make_current
from betterbench.sim.scenes.stage import Quality

logger = logging.getLogger(__name__)

NO_BODY = -1
"""Value of a mask at pixels that show the sky instead of a body."""

# Capacity for scene elements other than geoms. There are none, so a small margin is enough.
_SPARE_GEOMS = 16
_HIDDEN_GROUP = 3  # this group and all later groups are never shown
_ALONE_GROUP = 5
"""Geom group that is normally invisible. Geoms are moved to it when they are rendered alone."""
_SKY = int(mujoco.mjtRndFlag.mjRND_SKYBOX)
_EVERYTHING = int(mujoco.mjtCatBit.mjCAT_ALL)
# This is MuJoCo's smallest font. No text is drawn, and a larger font would take longer to upload.
_FONT_SCALE = 50


@dataclass(frozen=True, slots=True, eq=False)
class Images:
    """Images of one view of a scene. An image that was not requested is None.

    Attributes:
        rgb: Colors (height, width, 3) uint8.
        depth: Distances along the optical axis (height, width) float32 [m], infinite where the ray hits nothing.
            ``CameraMatrices.unproject`` converts them to points.
        masks: Body ids (height, width) int32, with 0 for the world itself (the floor) and -1 for the sky.
            ``Renderer.body_names`` contains the names of the bodies.
    """

    rgb: np.ndarray | None
    depth: np.ndarray | None
    masks: np.ndarray | None


class Renderer:
    """Renderer of one model.

    Its buffers are freed by :meth:`close`, or on exit if the renderer is used as a context manager.

    Creating a renderer uploads the meshes and textures of the model, which takes 5 to 50 ms. The first renderer of a
    process also creates the OpenGL context, which takes 0.1 to 0.3 s. Keep a renderer for as long as its model is used.
    Poses, colors and materials may change between images, but meshes and textures must not change. The quality preset
    overrides the visual settings that are stored in the model.

    Raises:
        MissingDependencyError: If off-screen OpenGL does not work on this machine.
        InvalidInputError: If the size is out of range, or if this process or thread is not allowed to render (see
            :mod:`betterbench.sim.scenes.gl_context`).
    """

    def __init__(self, model: mujoco.MjModel, *, width: int = 256, height: int = 256, quality: Quality) -> None:
        """Upload the model to OpenGL."""
        check_size(width, height)
        self.model, self.width, self.height, self.quality = model, width, height, quality
        self._buffer_size = (width, height)
        self._context: mujoco.MjrContext | None = None
        make_current()
        self._context = _upload(model, quality, width, height)
        self._plain_fbo = (int(self._context.offFBO_r), 0)
        self._color_fbo = (int(self._context.offFBO), int(self._context.offSamples))
        if quality.samples and not self._color_fbo[1]:
            logger.warning(
                "OpenGL has no multisampled buffers here, so images with quality %r are not antialiased", quality.name
            )

        self._scene = mujoco.MjvScene(model, maxgeom=model.ngeom + _SPARE_GEOMS)
        self._culling = Culling(model, self._scene)
        self._camera = mujoco.MjvCamera()
        self._camera.type = mujoco.mjtCamera.mjCAMERA_FIXED
        self._option = _visible_groups()
        self._alone: tuple[mujoco.MjvScene, mujoco.MjvOption] | None = None
        self._camera_ids = {model.camera(number).name: number for number in range(model.ncam)}
        self.body_names: tuple[str, ...] = tuple(model.body(number).name for number in range(model.nbody))
        """Names of the bodies, in the order of their ids in masks."""
        self._body_of_segment: dict[bytes, np.ndarray] = {}
        extent = float(model.stat.extent)
        self._near_m, self._far_m = float(model.vis.map.znear) * extent, float(model.vis.map.zfar) * extent
        self._pixels: dict[tuple[int, int], tuple[mujoco.MjrRect, np.ndarray, np.ndarray]] = {}
        self._bound = False
        self._geometry: bool | None = None  # True if the geometry pass is set up, False if the color pass is, else None
        RENDERERS.add(self)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Free the buffers."""
        self.close()

    @property
    def cameras(self) -> tuple[str, ...]:
        """Names of the model's cameras."""
        return tuple(self._camera_ids)

    def render(
        self,
        data: mujoco.MjData,
        camera: str,
        *,
        rgb: bool = True,
        depth: bool = False,
        masks: bool = False,
        width: int | None = None,
        height: int | None = None,
    ) -> Images:
        """Render one view by calling :meth:`render_views` for it.

        By default, the image has the width and height of the renderer [pixel].
        """
        view = (camera, width or self.width, height or self.height)
        return self.render_views(data, (view,), rgb=rgb, depth=depth, masks=masks)[0]

    def render_views(
        self,
        data: mujoco.MjData,
        views: Sequence[tuple[str, int, int]],
        *,
        rgb: bool = True,
        depth: bool = False,
        masks: bool = False,
    ) -> list[Images]:
        """Render several views of one state. This is slightly faster than a separate call for each view.

        Each view consists of a camera name, an image width and an image height [pixel]. The positions in ``data`` must
        be up to date (``mj_forward`` or a step).

        Raises:
            UnknownNameError: If the model does not have the camera.
            InvalidInputError: If a size is out of range, the renderer is closed, or it is used in a different thread or
                in a forked process.
        """
        if self._context is None:
            raise InvalidInputError("renderer", "is closed", "Create a new Renderer")
        make_current()
        self._bound = False
        return [self._view(self._context, data, *view, rgb=rgb, depth=depth, masks=masks) for view in views]

    def _view(
        self,
        context: mujoco.MjrContext,
        data: mujoco.MjData,
        camera: str,
        columns: int,
        rows: int,
        *,
        rgb: bool,
        depth: bool,
        masks: bool,
    ) -> Images:
        self._fit(context, columns, rows)
        try:
            number = self._camera_ids[camera]
        except KeyError:
            raise UnknownNameError("camera", camera, self._camera_ids) from None
        self._camera.fixedcamid = number
        mujoco.mjv_updateScene(self.model, data, self._option, None, self._camera, _EVERYTHING, self._scene)
        sky = self._culling.cull(data, number, columns / rows, geoms=not (rgb and self.quality.shadows))
        view, colors, distances = self._buffers(columns, rows)
        geometry_pass = masks or (depth and not (rgb and self._color_fbo[1] == 0 and not self._has_transparency()))

        rgb_out: np.ndarray | None = None
        masks_out: np.ndarray | None = None
        if rgb:
            self._draw(context, view, geometry=False, sky=sky)
            rgb_out = np.empty((rows, columns, 3), np.uint8)
            mujoco.mjr_readPixels(rgb_out, distances if depth and not geometry_pass else None, view, context)
            if not CONTEXT.from_top:
                rgb_out = rgb_out[::-1].copy()
        if geometry_pass:
            if rgb and self.quality.shadows:
                self._culling.cull(data, number, columns / rows, geoms=True)  # the following passes have no shadows
            self._draw(context, view, geometry=True)
            mujoco.mjr_readPixels(colors if masks else None, distances if depth else None, view, context)
            if masks:
                masks_out = self._bodies(colors)
        return Images(rgb_out, self._meters(distances) if depth else None, masks_out)

    def draw_alone(
        self, data: mujoco.MjData, camera: str, bodies: Sequence[int], *, width: int, height: int
    ) -> np.ndarray:
        """Return the mask that :meth:`render` would give if only the visible geoms of the given bodies existed.

        The mask is a (height, width) int32 array. Raises the same errors as :meth:`render_views`.
        """
        if self._context is None:
            raise InvalidInputError("renderer", "is closed", "Create a new Renderer")
        make_current()
        self._bound = False
        self._fit(self._context, width, height)
        if camera not in self._camera_ids:
            raise UnknownNameError("camera", camera, self._camera_ids)
        self._camera.fixedcamid = self._camera_ids[camera]
        if self._alone is None:
            option = _visible_groups()
            option.geomgroup[:] = 0
            option.geomgroup[_ALONE_GROUP] = 1
            self._alone = mujoco.MjvScene(self.model, maxgeom=self.model.ngeom + _SPARE_GEOMS), option
        scene, option = self._alone
        groups = self.model.geom_group
        kept = groups.copy()
        try:
            shown = np.isin(self.model.geom_bodyid, bodies) & (kept < _HIDDEN_GROUP)
            groups[:] = np.where(shown, _ALONE_GROUP, 0)
            mujoco.mjv_updateScene(self.model, data, option, None, self._camera, _EVERYTHING, scene)
        finally:
            groups[:] = kept
        if self._geometry is not True:
            self._prepare(self._context, geometry=True)
        scene.flags[:] = self._scene.flags
        scene.flags[_SKY] = 0
        view, colors, _ = self._buffers(width, height)
        mujoco.mjr_restoreBuffer(self._context)
        mujoco.mjr_render(view, scene, self._context)
        mujoco.mjr_readPixels(colors, None, view, self._context)
        return np.asarray(self._bodies_of(scene)[_segments(colors, scene.ngeom)])

    def close(self) -> None:
        """Free the buffers. The renderer cannot be used afterward. Closing it again does nothing."""
        context, self._context = self._context, None
        if context is None:
            return
        RENDERERS.discard(self)
        if CONTEXT.pid == os.getpid() and CONTEXT.gl is not None:
            CONTEXT.gl.make_current()
            context.offFBO, context.offSamples = self._color_fbo
            context.free()

    def _fit(self, context: mujoco.MjrContext, columns: int, rows: int) -> None:
        """Enlarge the buffers if necessary so that an image of the given size [pixel] fits."""
        if columns > self._buffer_size[0] or rows > self._buffer_size[1]:
            check_size(columns, rows)
            self._buffer_size = (max(columns, self._buffer_size[0]), max(rows, self._buffer_size[1]))
            context.offFBO, context.offSamples = self._color_fbo
            mujoco.mjr_resizeOffscreen(*self._buffer_size, context)
            self._plain_fbo = (int(context.offFBO_r), 0)
            self._color_fbo = (int(context.offFBO), int(context.offSamples))
            self._geometry = None
        elif columns < 1 or rows < 1:
            check_size(columns, rows)

    def _buffers(self, columns: int, rows: int) -> tuple[mujoco.MjrRect, np.ndarray, np.ndarray]:
        """Return the part of the pixel buffer for the image, and arrays for the image's colors and raw depths.

        The next image overwrites the arrays.
        """
        buffers = self._pixels.get((columns, rows))
        if buffers is None:
            buffers = (
                mujoco.MjrRect(0, 0, columns, rows),
                np.empty((rows, columns, 3), np.uint8),
                np.empty((rows, columns), np.float32),
            )
            self._pixels[(columns, rows)] = buffers
        return buffers

    def _draw(self, context: mujoco.MjrContext, view: mujoco.MjrRect, *, geometry: bool, sky: bool = False) -> None:
        """Render the scene either in color, with or without the sky, or as geometry (see the module docstring)."""
        if geometry is not self._geometry:
            self._prepare(context, geometry=geometry)
            self._bound = False
        self._scene.flags[_SKY] = sky
        if not self._bound:  # another renderer may have been used since the last views
            mujoco.mjr_restoreBuffer(context)
            self._bound = True
        mujoco.mjr_render(view, self._scene, context)

    def _prepare(self, context: mujoco.MjrContext, *, geometry: bool) -> None:
        """Set the render flags and select the buffer for a color or a geometry pass."""
        flags, flag = self._scene.flags, mujoco.mjtRndFlag
        flags[:] = 0
        flags[flag.mjRND_CULL_FACE] = 1
        if geometry:
            flags[flag.mjRND_SEGMENT] = flags[flag.mjRND_IDCOLOR] = 1
        else:
            flags[flag.mjRND_SHADOW] = int(self.quality.shadows)
        # MuJoCo renders into offFBO and reads from it. The buffer for resolved samples is also a full framebuffer.
        context.offFBO, context.offSamples = self._plain_fbo if geometry and self._color_fbo[1] else self._color_fbo
        self._geometry = geometry

    def _has_transparency(self) -> bool:
        """Return whether any part of the model may be transparent.

        The color pass does not write transparent parts to the depth buffer.
        """
        for alpha in (self.model.geom_rgba[:, 3], self.model.mat_rgba[:, 3]):
            if bool(((alpha > 0.0) & (alpha < 1.0)).any()):
                return True
        return False

    def _bodies(self, colors: np.ndarray) -> np.ndarray:
        """Convert the colors of a geometry pass to upright body ids, (height, width) int32."""
        return np.asarray(self._segment_table()[_segments(colors, self._scene.ngeom)])

    def _segment_table(self) -> np.ndarray:
        """Return a table (n,) int32 that maps a segment index plus one to a body id. Entry 0 is the background.

        MuJoCo numbers the rendered geoms in the order of the model and skips invisible geoms. The table therefore
        depends only on which geoms are invisible, i.e. have an opacity of zero.
        """
        model = self.model
        key = (model.geom_rgba[:, 3] > 0.0).tobytes() + (model.mat_rgba[:, 3] > 0.0).tobytes()
        key += model.geom_matid.tobytes()
        table = self._body_of_segment.get(key)
        if table is None:
            table = self._bodies_of(self._scene)
            self._body_of_segment = {key: table}
        return table

    def _bodies_of(self, scene: mujoco.MjvScene) -> np.ndarray:
        """Return the table (n,) int32 that maps segment indices plus one to body ids, given the rendered geoms."""
        table = np.full(scene.ngeom + 1, NO_BODY, np.int32)
        geom_type = int(mujoco.mjtObj.mjOBJ_GEOM)
        for geom in scene.geoms[: scene.ngeom]:
            if int(geom.objtype) == geom_type and geom.segid >= 0:
                table[geom.segid + 1] = self.model.geom_bodyid[geom.objid]
        return table

    def _meters(self, raw: np.ndarray) -> np.ndarray:
        """Convert a depth buffer (1 near, 0 far) to distances along the optical axis [m], with the top row first."""
        near, far = self._near_m, self._far_m
        upright = as_upright(raw)
        distances: np.ndarray = np.multiply(upright, np.float32(far - near))
        distances += np.float32(near)
        np.divide(np.float32(near * far), distances, out=distances)
        distances[upright <= 0.0] = np.inf
        return distances


def _segments(colors: np.ndarray, geoms: int) -> np.ndarray:
    """Decode the colors of a geometry pass with ``geoms`` geoms.

    Return an upright image (height, width) that contains, for each pixel, the segment index plus one.
    """
    upright = as_upright(colors)
    segments = upright[:, :, 0].astype(np.int32)
    if geoms >= 0xFF:
        segments |= upright[:, :, 1].astype(np.int32) << 8
        segments |= upright[:, :, 2].astype(np.int32) << 16
    return segments


def _upload(model: mujoco.MjModel, quality: Quality, width: int, height: int) -> mujoco.MjrContext:
    """Upload a model to OpenGL, with buffers of the given size [pixel] and quality. The model itself is not changed."""
    visual = model.vis
    kept = (visual.global_.offwidth, visual.global_.offheight, visual.quality.offsamples, visual.quality.shadowsize)
    try:
        visual.global_.offwidth, visual.global_.offheight = width, height
        visual.quality.offsamples, visual.quality.shadowsize = quality.samples, quality.shadow_map_size
        context = mujoco.MjrContext(model, _FONT_SCALE)
    except mujoco.FatalError as error:
        raise MissingDependencyError(f"OpenGL does not work here: {error}. {CURE}") from error
    finally:
        visual.global_.offwidth, visual.global_.offheight, visual.quality.offsamples, visual.quality.shadowsize = kept
    mujoco.mjr_setBuffer(int(mujoco.mjtFramebuffer.mjFB_OFFSCREEN), context)
    if context.currentBuffer != int(mujoco.mjtFramebuffer.mjFB_OFFSCREEN):
        context.free()
        raise MissingDependencyError(f"This OpenGL has no off-screen buffers. {CURE}")
    # Raw depths with 1 near and 0 far keep the full precision of 32-bit floats at a distance.
    context.readDepthMap = int(mujoco.mjtDepthMap.mjDEPTH_ZEROFAR)
    return context


def _visible_groups() -> mujoco.MjvOption:
    """Return rendering options that show only the geom groups 0 to 2, but no marks, sites or contacts."""
    option = mujoco.MjvOption()
    option.flags[:] = 0
    option.flags[mujoco.mjtVisFlag.mjVIS_TEXTURE] = 1
    option.flags[mujoco.mjtVisFlag.mjVIS_STATIC] = 1
    option.geomgroup[:] = (1, 1, 1, 0, 0, 0)
    option.sitegroup[:] = 0
    return option


class Renderers:
    """Cache of renderers for the most recently used models, because creating a renderer takes tens of milliseconds."""

    def __init__(self, most: int) -> None:
        """Create an empty cache. ``most`` is the maximum number of renderers, one per model."""
        self._most = max(1, most)
        self._kept: OrderedDict[str, Renderer] = OrderedDict()

    def of(self, key: str, model: mujoco.MjModel, *, width: int, height: int, quality: Quality) -> Renderer:
        """Return the renderer of a model that is identified by ``key``.

        ``width`` and ``height`` are the largest image size that the renderer needs.
        """
        if key in self._kept:
            self._kept.move_to_end(key)
            return self._kept[key]
        while len(self._kept) >= self._most:
            self._kept.popitem(last=False)[1].close()
        renderer = self._kept[key] = Renderer(model, width=width, height=height, quality=quality)
        return renderer

    def close(self) -> None:
        """Free all renderers."""
        while self._kept:
            self._kept.popitem()[1].close()
