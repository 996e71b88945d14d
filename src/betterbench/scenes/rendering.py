"""Images of a scene: color, depth and instance masks from MuJoCo's classic off-screen renderer.

How passes are spent. A *color pass* draws lights, textures and shadows into the multisampled buffer. A *geometry pass*
draws every visible shape in a flat color that encodes its number into the plain buffer, one sample at each pixel's
center, and gives depth and masks together; no id is ever blended with its neighbor. Color with depth takes one pass
where that gives the same depth (no multisampling, nothing transparent), otherwise two. So depth and masks never depend
on the quality.

All images are upright: row 0 is the top. Every returned array belongs to the caller.

Contexts. A process holds one OpenGL context, made on first use and shared by all renderers of that process; each
:class:`Renderer` keeps its own meshes, textures and buffers in it. Rendering belongs to the thread that made the first
renderer, and worker processes must be started with the ``spawn`` method: a forked copy of a context is refused.
"""

from __future__ import annotations

import atexit
import ctypes
import ctypes.util
import functools
import importlib
import logging
import math
import os
import threading
import weakref
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from types import TracebackType
from typing import Any, Protocol, Self, cast

import mujoco
import numpy as np

from betterbench.errors import InvalidInputError, MissingDependencyError, UnknownNameError
from betterbench.geometry import Pose, Quaternion, normalize
from betterbench.scenes.culling import Culling
from betterbench.scenes.stage import Quality

logger = logging.getLogger(__name__)

NO_BODY = -1
"""Value of a mask where the image shows no body: the sky."""

INSTALL_HINT = "apt-get install -y --no-install-recommends libegl1 libgl1"
"""The line that brings an OpenGL back end to a Debian or Ubuntu machine, with or without a graphics card."""

_MAX_SIZE = 4096
_OFF_VALUES = ("disable", "disabled", "off", "false", "0")
# Room for everything that a scene draws besides its geoms; nothing is drawn besides them, so a small margin is enough.
_SPARE_GEOMS = 16
_SKY = int(mujoco.mjtRndFlag.mjRND_SKYBOX)
_EVERYTHING = int(mujoco.mjtCatBit.mjCAT_ALL)
# The smallest font that MuJoCo offers: no text is ever drawn, and a larger one takes longer to upload.
_FONT_SCALE = 50


class _GLContext(Protocol):
    """What the classes of ``mujoco.egl``, ``mujoco.osmesa`` and ``mujoco.glfw`` have in common."""

    def make_current(self) -> None: ...

    def free(self) -> None: ...


@dataclass(frozen=True, slots=True, eq=False)
class Images:
    """One view of a scene; what was not asked for is None.

    Attributes:
        rgb: (height, width, 3) uint8 colors.
        depth: (height, width) float32 distances along the optical axis, not along the ray [m], infinite where nothing
            was hit. A point at depth ``d`` in pixel (u, v) is ``CameraMatrices.unproject`` of it.
        masks: (height, width) int32 numbers of bodies; ``Renderer.body_names`` tells their names. 0 is the world itself
            (the floor), -1 is the sky.
    """

    rgb: np.ndarray | None
    depth: np.ndarray | None
    masks: np.ndarray | None


@dataclass(frozen=True, slots=True, eq=False)
class CameraMatrices:
    """A pinhole camera in the conventions of OpenCV.

    The camera frame has x to the right of the image, y down and z forward along the optical axis. Pixel (u, v) counts
    columns from the left and rows from the top, and whole numbers are the centers of pixels: the image spans u from
    -0.5 to width - 0.5.

    Attributes:
        K: (3, 3) intrinsic matrix [pixel].
        T_world_camera: Pose of the camera frame in the world.
        width: Image width [pixel].
        height: Image height [pixel].
    """

    K: np.ndarray
    T_world_camera: Pose
    width: int
    height: int

    def project(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Project points into the image.

        Args:
            points: (n, 3) points in the world frame [m].

        Returns:
            (n, 2) float64 pixels (u, v), which may lie outside the image, and (n,) depths along the optical axis
            [m]. A point that is not in front of the camera has a depth of at most 0 and the pixel (nan, nan).

        Raises:
            InvalidInputError: If the points have another shape.
        """
        array = np.asarray(points, dtype=np.float64)
        if array.ndim != 2 or array.shape[1] != 3:
            raise InvalidInputError("points", f"has shape {array.shape}", "Give an array of shape (n, 3)")
        R_world_camera = _rotation_matrix(self.T_world_camera.quaternion)
        local = (array - np.asarray(self.T_world_camera.position)) @ R_world_camera
        depth = local[:, 2]
        pixels = np.full((len(array), 2), np.nan)
        seen = depth > 0.0
        scaled = local[seen] @ self.K.T
        pixels[seen] = scaled[:, :2] / scaled[:, 2:]
        return pixels, depth

    def unproject(self, depth: np.ndarray) -> np.ndarray:
        """Return the points that a depth image shows.

        Args:
            depth: (height, width) distances along the optical axis [m].

        Returns:
            (height, width, 3) float64 points in the world frame [m]; not finite where the depth is infinite.

        Raises:
            InvalidInputError: If the image has another size.
        """
        if depth.shape != (self.height, self.width):
            raise InvalidInputError("depth", f"has shape {depth.shape}", f"Give {(self.height, self.width)}")
        v, u = np.mgrid[0 : self.height, 0 : self.width].astype(np.float64)
        x, y = (u - self.K[0, 2]) / self.K[0, 0], (v - self.K[1, 2]) / self.K[1, 1]
        rays = np.stack([x, y, np.ones_like(x)], axis=-1) @ _rotation_matrix(self.T_world_camera.quaternion).T
        seen = np.isfinite(depth)[..., None]
        origin = np.asarray(self.T_world_camera.position)
        return np.where(seen, rays * np.where(seen, depth[..., None], 1.0) + origin, np.inf)


class Renderer:
    """Draws views of one model. It may be used as a context manager; :meth:`close` frees its buffers.

    Creating one uploads the model's meshes and textures (5 to 50 ms here; the first in a process also makes the OpenGL
    context, 0.1 to 0.3 s), so it is worth keeping as long as its model.

    Args:
        model: Compiled model. Poses, colors and materials may change between images; meshes and textures may not.
        width: Default image width [pixel].
        height: Default image height [pixel].
        quality: What the images are made with, whatever the model's own visual settings say.

    Raises:
        MissingDependencyError: If no off-screen OpenGL works here.
        InvalidInputError: If the size is out of range, or the process or thread may not render.
    """

    def __init__(self, model: mujoco.MjModel, *, width: int = 256, height: int = 256, quality: Quality) -> None:
        """Upload the model."""
        _check_size(width, height)
        self.model, self.width, self.height, self.quality = model, width, height, quality
        self._buffer_size = (width, height)
        self._context: mujoco.MjrContext | None = None
        _make_current()
        self._context = _upload(model, quality, width, height)
        self._plain_fbo = (int(self._context.offFBO_r), 0)
        self._color_fbo = (int(self._context.offFBO), int(self._context.offSamples))
        if quality.samples and not self._color_fbo[1]:
            logger.warning(
                "this OpenGL has no multisampled buffers: images of quality %r are not smoothed", quality.name
            )

        self._scene = mujoco.MjvScene(model, maxgeom=model.ngeom + _SPARE_GEOMS)
        self._culling = Culling(model, self._scene)
        self._camera = mujoco.MjvCamera()
        self._camera.type = mujoco.mjtCamera.mjCAMERA_FIXED
        self._option = _visible_things()
        self._camera_ids = {model.camera(number).name: number for number in range(model.ncam)}
        self.body_names: tuple[str, ...] = tuple(model.body(number).name for number in range(model.nbody))
        """Names of the bodies by the number that masks hold."""
        self._body_of_segment: dict[bytes, np.ndarray] = {}
        extent = float(model.stat.extent)
        self._near_m, self._far_m = float(model.vis.map.znear) * extent, float(model.vis.map.zfar) * extent
        self._pixels: dict[tuple[int, int], tuple[mujoco.MjrRect, np.ndarray, np.ndarray]] = {}
        self._bound = False
        self._geometry: bool | None = None  # the pass that flags and buffer are set up for
        _RENDERERS.add(self)

    def __enter__(self) -> Self:
        """Return the renderer itself."""
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
        """Draw one view.

        Args:
            data: State to show; positions must be up to date (``mj_forward`` or a step).
            camera: Name of a camera of the model.
            rgb: True to get colors.
            depth: True to get distances.
            masks: True to get body numbers.
            width: Image width [pixel]; the renderer's own unless given.
            height: Image height [pixel]; the renderer's own unless given.

        Returns:
            The images that were asked for.

        Raises:
            UnknownNameError: If the model has no such camera.
            InvalidInputError: If the size is out of range, the renderer is closed, or another thread or a forked
                process uses it.
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
        """Draw several views of one state, which takes a little less time than one after the other.

        Args:
            data: State to show; positions must be up to date (``mj_forward`` or a step).
            views: Camera, image width and image height [pixel] of each.
            rgb: True to get colors.
            depth: True to get distances.
            masks: True to get body numbers.

        Returns:
            The images that were asked for, in the order of ``views``.

        Raises:
            UnknownNameError: If the model has no such camera.
            InvalidInputError: If a size is out of range, the renderer is closed, or another thread or a forked process
                uses it.
        """
        if self._context is None:
            raise InvalidInputError("renderer", "it is closed", "Create a new Renderer")
        _make_current()
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
            if not _CONTEXT.from_top:
                rgb_out = rgb_out[::-1].copy()
        if geometry_pass:
            self._draw(context, view, geometry=True)
            mujoco.mjr_readPixels(colors if masks else None, distances if depth else None, view, context)
            if masks:
                masks_out = self._bodies(colors)
        return Images(rgb_out, self._meters(distances) if depth else None, masks_out)

    def close(self) -> None:
        """Free the buffers; the renderer cannot be used afterward. Closing twice does nothing."""
        context, self._context = self._context, None
        if context is None:
            return
        _RENDERERS.discard(self)
        if _CONTEXT.pid == os.getpid() and _CONTEXT.gl is not None:
            _CONTEXT.gl.make_current()
            context.offFBO, context.offSamples = self._color_fbo
            context.free()

    def _fit(self, context: mujoco.MjrContext, columns: int, rows: int) -> None:
        """Make the buffers large enough for a image of the given size [pixel]."""
        if columns > self._buffer_size[0] or rows > self._buffer_size[1]:
            _check_size(columns, rows)
            self._buffer_size = (max(columns, self._buffer_size[0]), max(rows, self._buffer_size[1]))
            context.offFBO, context.offSamples = self._color_fbo
            mujoco.mjr_resizeOffscreen(*self._buffer_size, context)
            self._plain_fbo = (int(context.offFBO_r), 0)
            self._color_fbo = (int(context.offFBO), int(context.offSamples))
            self._geometry = None
        elif columns < 1 or rows < 1:
            _check_size(columns, rows)

    def _buffers(self, columns: int, rows: int) -> tuple[mujoco.MjrRect, np.ndarray, np.ndarray]:
        """Return the part of the buffer, and the reused arrays that its pixels are read into: colors, raw depths."""
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
        """Draw the scene: either in color, with or without the sky, or as geometry (see the module's text)."""
        if geometry is not self._geometry:
            self._prepare(context, geometry=geometry)
            self._bound = False
        self._scene.flags[_SKY] = sky
        if not self._bound:  # somebody else may have drawn since the last views
            mujoco.mjr_restoreBuffer(context)
            self._bound = True
        mujoco.mjr_render(view, self._scene, context)

    def _prepare(self, context: mujoco.MjrContext, *, geometry: bool) -> None:
        """Set the flags and choose the buffer of a pass."""
        flags, flag = self._scene.flags, mujoco.mjtRndFlag
        flags[:] = 0
        flags[flag.mjRND_CULL_FACE] = 1
        if geometry:
            flags[flag.mjRND_SEGMENT] = flags[flag.mjRND_IDCOLOR] = 1
        else:
            flags[flag.mjRND_SHADOW] = int(self.quality.shadows)
        # MuJoCo draws into and reads from offFBO; the buffer it resolves samples into is a complete one of its own.
        context.offFBO, context.offSamples = self._plain_fbo if geometry and self._color_fbo[1] else self._color_fbo
        self._geometry = geometry

    def _has_transparency(self) -> bool:
        """Return True if something may be see-through: the color pass leaves such things out of the depth."""
        for alpha in (self.model.geom_rgba[:, 3], self.model.mat_rgba[:, 3]):
            if bool(((alpha > 0.0) & (alpha < 1.0)).any()):
                return True
        return False

    def _bodies(self, colors: np.ndarray) -> np.ndarray:
        """Return the body number of each pixel of a geometry pass, turned upright.

        Args:
            colors: (height, width, 3) uint8 segment numbers plus one, low byte first, as they were read.

        Returns:
            (height, width) int32 body numbers.
        """
        upright = _upright(colors)
        segments = upright[:, :, 0].astype(np.int32)
        if self._scene.ngeom >= 0xFF:
            segments |= upright[:, :, 1].astype(np.int32) << 8
            segments |= upright[:, :, 2].astype(np.int32) << 16
        return np.asarray(self._segment_table()[segments])

    def _segment_table(self) -> np.ndarray:
        """Return the (n,) int32 body number by segment number plus one; entry 0 is the background.

        MuJoCo numbers the geoms that it draws in the order of the model and leaves out the invisible ones, so that the
        table depends on nothing but which geoms have an opacity of zero.
        """
        model = self.model
        key = (model.geom_rgba[:, 3] > 0.0).tobytes() + (model.mat_rgba[:, 3] > 0.0).tobytes()
        key += model.geom_matid.tobytes()
        table = self._body_of_segment.get(key)
        if table is None:
            table = np.full(self._scene.ngeom + 1, NO_BODY, np.int32)
            geom_type = int(mujoco.mjtObj.mjOBJ_GEOM)
            for geom in self._scene.geoms[: self._scene.ngeom]:
                if int(geom.objtype) == geom_type and geom.segid >= 0:
                    table[geom.segid + 1] = model.geom_bodyid[geom.objid]
            self._body_of_segment = {key: table}
        return table

    def _meters(self, raw: np.ndarray) -> np.ndarray:
        """Return upright distances along the optical axis [m] from raw depths.

        Args:
            raw: (height, width) float32 values of the reversed depth buffer, 1 at the near and 0 at the far plane,
                as they were read.

        Returns:
            (height, width) float32 distances, infinite where nothing was drawn.
        """
        near, far = self._near_m, self._far_m
        upright = _upright(raw)
        distances: np.ndarray = np.multiply(upright, np.float32(far - near))
        distances += np.float32(near)
        np.divide(np.float32(near * far), distances, out=distances)
        distances[upright <= 0.0] = np.inf
        return distances


def camera_matrices(
    model: mujoco.MjModel, data: mujoco.MjData, camera: str, *, width: int = 256, height: int = 256
) -> CameraMatrices:
    """Return intrinsics and pose of a camera, as they are in a state.

    Args:
        model: Compiled model.
        data: State with positions up to date.
        camera: Name of a camera of the model.
        width: Image width [pixel].
        height: Image height [pixel].

    Returns:
        The camera in the conventions of OpenCV.

    Raises:
        UnknownNameError: If the model has no such camera.
        InvalidInputError: If the size is out of range.
    """
    _check_size(width, height)
    number = int(mujoco.mj_name2id(model, int(mujoco.mjtObj.mjOBJ_CAMERA), camera))
    if number < 0:
        raise UnknownNameError("camera", camera, (model.camera(other).name for other in range(model.ncam)))
    focal = 0.5 * height / math.tan(0.5 * math.radians(float(model.cam_fovy[number])))
    K = np.array([[focal, 0.0, 0.5 * (width - 1)], [0.0, focal, 0.5 * (height - 1)], [0.0, 0.0, 1.0]])
    # MuJoCo's camera looks along its -z with y up; OpenCV's looks along z with y down: half a turn about x.
    R_world_camera = data.cam_xmat[number].reshape(3, 3) * np.array([1.0, -1.0, -1.0])
    quaternion = np.empty(4)
    mujoco.mju_mat2Quat(quaternion, np.ascontiguousarray(R_world_camera).ravel())
    x, y, z = (float(value) for value in data.cam_xpos[number])
    return CameraMatrices(K, Pose((x, y, z), normalize(quaternion.tolist())), width, height)


@functools.cache
def gl_backend() -> str | None:
    """Return the off-screen OpenGL back end that images are made with: "egl", "osmesa" or "glfw".

    The environment variable ``MUJOCO_GL`` decides if it names one of the three; "glfw" needs a display. Otherwise EGL
    is preferred, which also finds graphics cards. Only the presence of libraries is looked at;
    :func:`renderer_fingerprint` tries them.

    Returns:
        The name, or None if rendering is switched off or no library is installed.
    """
    asked = os.environ.get("MUJOCO_GL", "").strip().lower()
    if asked in {"egl", "osmesa", "glfw"}:
        return asked
    if asked in _OFF_VALUES:
        return None
    # PyOpenGL takes the functions of OpenGL from one of these beside EGL's own library.
    if _loads("libEGL.so.1") and any(_loads(name) for name in ("libOpenGL.so.0", "libGL.so.1", "libGLESv2.so.2")):
        return "egl"
    if _loads("libOSMesa.so.8") or _loads(ctypes.util.find_library("OSMesa")):
        return "osmesa"
    return None


def renderer_fingerprint() -> dict[str, str]:
    """Return what decides about pixels besides the scene: images of two machines are equal if this is.

    Returns:
        ``backend``, ``vendor``, ``renderer`` and ``version`` of OpenGL, and ``mujoco``'s version.

    Raises:
        MissingDependencyError: If no off-screen OpenGL works here.
    """
    _make_current()
    gl = importlib.import_module("OpenGL.GL")
    names = {"vendor": gl.GL_VENDOR, "renderer": gl.GL_RENDERER, "version": gl.GL_VERSION}
    strings = {key: cast("bytes", gl.glGetString(name)).decode("utf-8", "replace") for key, name in names.items()}
    return {"backend": gl_backend() or "", **strings, "mujoco": mujoco.__version__}


@dataclass(slots=True)
class _ProcessContext:
    """The OpenGL context of this process, and who may use it."""

    gl: _GLContext | None = None
    pid: int = 0
    thread: int = 0
    handle: int | None = None
    query: Callable[[], int | None] | None = None
    from_top: bool = False


_CONTEXT = _ProcessContext()
_RENDERERS: weakref.WeakSet[Renderer] = weakref.WeakSet()


def _make_current() -> None:
    """Make this process's OpenGL context current, creating it on first use."""
    known = _CONTEXT.query
    if known is not None and _CONTEXT.thread == threading.get_ident() and _CONTEXT.pid == os.getpid():
        # Asking EGL which context is current takes 1 us, making one current 50 us: 1 % of a image of the fast preset.
        if known() != _CONTEXT.handle and _CONTEXT.gl is not None:
            _CONTEXT.gl.make_current()
        return
    if _CONTEXT.gl is None:
        _CONTEXT.gl = _create_context()
        _CONTEXT.from_top = _read_from_top(wanted=True)
        _CONTEXT.pid, _CONTEXT.thread = os.getpid(), threading.get_ident()
        atexit.register(_free_all)
    if os.getpid() != _CONTEXT.pid:
        raise InvalidInputError(
            "worker process", "it was forked from a process that had rendered", "Start workers with the 'spawn' method"
        )
    if threading.get_ident() != _CONTEXT.thread:
        raise InvalidInputError(
            "renderer", "it is used by another thread than the first renderer of this process", "Render in one thread"
        )
    _CONTEXT.gl.make_current()
    if gl_backend() == "egl":
        _CONTEXT.query = _egl_current_context()
        _CONTEXT.handle = _CONTEXT.query()


@functools.cache
def _egl_current_context() -> Callable[[], int | None]:
    """Return EGL's own function; PyOpenGL's wrapper of it is slower than what it saves."""
    function = ctypes.CDLL("libEGL.so.1").eglGetCurrentContext
    function.restype = ctypes.c_void_p
    function.argtypes = ()
    current: Callable[[], int | None] = function
    return current


def _create_context() -> _GLContext:
    """Create an OpenGL context with the chosen back end.

    Raises:
        MissingDependencyError: If there is none, or it does not work.
    """
    backend = gl_backend()
    if backend is None:
        raise MissingDependencyError(
            f"No off-screen OpenGL: MUJOCO_GL is {os.environ.get('MUJOCO_GL', '')!r} and neither EGL nor OSMesa can be "
            f"used. Run: {INSTALL_HINT}"
        )
    # Threads of Mesa's software renderer gain nothing at these sizes and take cores from other workers.
    os.environ.setdefault("LP_NUM_THREADS", "0")
    # A context's size is that of a window, which nothing is drawn into.
    try:
        context = cast("_GLContext", importlib.import_module(f"mujoco.{backend}").GLContext(16, 16))
        context.make_current()
    except _context_errors() as error:
        raise MissingDependencyError(
            f"The OpenGL back end {backend!r} does not work here ({error}). Run: {INSTALL_HINT}"
        ) from error
    return context


_PACK_INVERT_MESA = 0x8758
"""Setting of the OpenGL extension MESA_pack_invert: pixels are read with the top row first."""


def _read_from_top(*, wanted: bool) -> bool:
    """Choose whether pixels are read with the top row first, which saves turning each image, and tell what is so.

    Mesa can do that; with another OpenGL rows are always read from the bottom, and images are turned afterward.
    """
    gl = importlib.import_module("OpenGL.GL")
    names = {gl.glGetStringi(gl.GL_EXTENSIONS, i) for i in range(int(gl.glGetIntegerv(gl.GL_NUM_EXTENSIONS)))}
    if b"GL_MESA_pack_invert" not in names:
        return False
    gl.glPixelStorei(_PACK_INVERT_MESA, int(wanted))
    return wanted


def _upright(pixels: np.ndarray) -> np.ndarray:
    """Return pixels as they were read, top row first."""
    return pixels if _CONTEXT.from_top else pixels[::-1]


def _context_errors() -> tuple[type[Exception], ...]:
    """Return what the creation of a context raises where libraries or devices are missing."""
    known: tuple[type[Exception], ...] = (ImportError, AttributeError, RuntimeError, OSError)
    try:
        return (*known, importlib.import_module("OpenGL.error").Error)
    except (ImportError, AttributeError):
        return known


def _free_all() -> None:
    """Free renderers and context before the interpreter takes OpenGL away from them."""
    for renderer in list(_RENDERERS):
        renderer.close()
    if _CONTEXT.gl is not None and _CONTEXT.pid == os.getpid():
        _CONTEXT.gl.free()
        _CONTEXT.gl = _CONTEXT.handle = _CONTEXT.query = None
        _CONTEXT.from_top = False


def _loads(library: str | None) -> bool:
    """Return True if a shared library can be loaded."""
    if library is None:
        return False
    try:
        ctypes.CDLL(library)
    except OSError:
        return False
    return True


def _upload(model: mujoco.MjModel, quality: Quality, width: int, height: int) -> mujoco.MjrContext:
    """Upload a model with buffers of the given size [pixel] and quality, leaving the model as it was."""
    visual = model.vis
    kept = (visual.global_.offwidth, visual.global_.offheight, visual.quality.offsamples, visual.quality.shadowsize)
    try:
        visual.global_.offwidth, visual.global_.offheight = width, height
        visual.quality.offsamples, visual.quality.shadowsize = quality.samples, quality.shadow_map_size
        context = mujoco.MjrContext(model, _FONT_SCALE)
    finally:
        visual.global_.offwidth, visual.global_.offheight, visual.quality.offsamples, visual.quality.shadowsize = kept
    mujoco.mjr_setBuffer(int(mujoco.mjtFramebuffer.mjFB_OFFSCREEN), context)
    if context.currentBuffer != int(mujoco.mjtFramebuffer.mjFB_OFFSCREEN):
        context.free()
        raise MissingDependencyError(f"This OpenGL has no off-screen buffers. Run: {INSTALL_HINT}")
    # Raw depths that are 1 near and 0 far keep the full precision of 32-bit floats at a distance.
    context.readDepthMap = int(mujoco.mjtDepthMap.mjDEPTH_ZEROFAR)
    return context


def _visible_things() -> mujoco.MjvOption:
    """Return drawing options that show shapes of the visible groups 0 to 2 and no marks, sites or contacts."""
    option = mujoco.MjvOption()
    option.flags[:] = 0
    option.flags[mujoco.mjtVisFlag.mjVIS_TEXTURE] = 1
    option.flags[mujoco.mjtVisFlag.mjVIS_STATIC] = 1
    option.geomgroup[:] = (1, 1, 1, 0, 0, 0)
    option.sitegroup[:] = 0
    return option


def _check_size(width: int, height: int) -> None:
    """Raise an InvalidInputError unless both sides [pixel] are in range."""
    if not (1 <= width <= _MAX_SIZE and 1 <= height <= _MAX_SIZE):
        raise InvalidInputError("image size", f"{width} x {height} pixels", f"Use 1 to {_MAX_SIZE} pixels a side")


def _rotation_matrix(quaternion: Quaternion | Sequence[float]) -> np.ndarray:
    """Return the (3, 3) rotation matrix of a unit quaternion (w, x, y, z)."""
    matrix: np.ndarray[Any, np.dtype[np.float64]] = np.empty(9)
    mujoco.mju_quat2Mat(matrix, np.asarray(quaternion, dtype=np.float64))
    return matrix.reshape(3, 3)
