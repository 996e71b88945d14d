"""OpenGL context of this process: back end, thread, and reading of pixels.

A process has one context, made at first use and shared by all its renderers. Only the first renderer's thread may
render. Worker processes must be started with the ``spawn`` method, because a forked copy of a context is rejected.
"""

from __future__ import annotations

import atexit
import ctypes
import functools
import importlib
import os
import threading
import weakref
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol, cast

import mujoco
import numpy as np

from betterbench.errors import InvalidInputError, MissingDependencyError
from betterbench.sim.graphics import INSTALL_HINT, gl_backend, no_window, require_drawing

CURE = f"Unset MUJOCO_GL, MUJOCO_EGL_DEVICE_ID and PYOPENGL_PLATFORM if they are set, or run: {INSTALL_HINT}"
"""Remedy if OpenGL does not work and no variable is known to be the cause."""


_SPAWN = (
    "Start workers with the 'spawn' method. For Gymnasium's vector environments, use gymnasium.make_vec(..., "
    "vectorization_mode='async', vector_kwargs={'context': 'spawn'})"
)


class _GLContext(Protocol):
    """Common interface of the contexts in ``mujoco.egl``, ``mujoco.osmesa`` and ``mujoco.glfw``."""

    def make_current(self) -> None: ...

    def free(self) -> None: ...


class Closable(Protocol):
    """Object that holds buffers in the context until it is closed."""

    def close(self) -> None:
        """Free the buffers."""


def renderer_fingerprint() -> dict[str, str]:
    """Return the properties that determine pixels in addition to the scene.

    Two machines that agree render equal images.

    It has OpenGL's ``backend``, ``vendor``, ``renderer`` and ``version``, and ``mujoco``'s version. Raises
    MissingDependencyError if no off-screen OpenGL works here.
    """
    make_current()
    text = _gl_function("glGetString", ctypes.c_char_p, ctypes.c_uint)
    names = {"vendor": _VENDOR, "renderer": _RENDERER, "version": _VERSION}
    strings = {key: (text(name) or b"").decode("utf-8", "replace") for key, name in names.items()}
    return {"backend": gl_backend() or "", **strings, "mujoco": mujoco.__version__}


@dataclass(slots=True)
class _ProcessContext:
    """The OpenGL context of this process, with the process and the thread that may use it."""

    gl: _GLContext | None = None
    pid: int = 0
    thread: int = 0
    handle: int | None = None
    query: Callable[[], int | None] | None = None
    from_top: bool = False


CONTEXT = _ProcessContext()
"""The context of this process."""
RENDERERS: weakref.WeakSet[Closable] = weakref.WeakSet()
"""Objects with buffers in the context. They are closed before the context is freed at exit."""


def make_current() -> None:
    """Make this process's OpenGL context current, creating it on first use."""
    known = CONTEXT.query
    if known is not None and CONTEXT.thread == threading.get_ident() and CONTEXT.pid == os.getpid():
        # Querying EGL for the current context takes 1 us, making a context current takes 50 us: 1 % of an image in the
        # fast preset.
        if known() != CONTEXT.handle and CONTEXT.gl is not None:
            CONTEXT.gl.make_current()
        return
    if CONTEXT.gl is None:
        CONTEXT.gl = _create_context()
        CONTEXT.from_top = read_from_top(wanted=True)
        CONTEXT.pid, CONTEXT.thread = os.getpid(), threading.get_ident()
        atexit.register(_free_all)
    if os.getpid() != CONTEXT.pid:
        raise InvalidInputError("worker process", "was forked from a process that had already rendered", _SPAWN)
    if threading.get_ident() != CONTEXT.thread:
        raise InvalidInputError(
            "renderer", "is used in a thread other than that of the first renderer", "Render in one thread"
        )
    CONTEXT.gl.make_current()
    if gl_backend() == "egl":
        CONTEXT.query = _egl_current_context()
        CONTEXT.handle = CONTEXT.query()


@functools.cache
def _egl_current_context() -> Callable[[], int | None]:
    """Return EGL's own function. PyOpenGL's wrapper is slower than the time it would save."""
    function = ctypes.CDLL("libEGL.so.1").eglGetCurrentContext
    function.restype = ctypes.c_void_p
    function.argtypes = ()
    current: Callable[[], int | None] = function
    return current


def _create_context() -> _GLContext:
    """Create an OpenGL context with the chosen back end, or raise a MissingDependencyError."""
    backend = require_drawing()
    # threads of Mesa's software renderer gain nothing at these sizes and would take cores from other workers
    os.environ.setdefault("LP_NUM_THREADS", "0")
    # The size of a context is that of a window, which is not used.
    try:
        context = cast("_GLContext", importlib.import_module(f"mujoco.{backend}").GLContext(16, 16))
        context.make_current()
        if backend == "glfw" and not importlib.import_module("glfw").get_current_context():
            raise no_window()
    except _context_errors() as error:
        raise MissingDependencyError(f"The OpenGL back end {backend!r} does not work here ({error}). {CURE}") from error
    return context


_VENDOR, _RENDERER, _VERSION, _EXTENSIONS, _NUM_EXTENSIONS = 0x1F00, 0x1F01, 0x1F02, 0x1F03, 0x821D
_PACK_INVERT_MESA = 0x8758
"""Setting of the OpenGL extension MESA_pack_invert: pixels are read with the top row first."""


def _gl_function(name: str, result: type[ctypes.c_char_p] | None, *arguments: object) -> Callable[..., bytes | None]:
    """Return a function of OpenGL. Importing it from ``OpenGL.GL`` would take 50 ms of CPU time."""
    platform = importlib.import_module("OpenGL.platform").PLATFORM
    function: Callable[..., bytes | None] = platform.constructFunction(
        name, platform.GL, resultType=result, argTypes=arguments
    )
    return function


def read_from_top(*, wanted: bool) -> bool:
    """Try to read pixels with the top row first, so that images need not be flipped. Return whether this works.

    Mesa supports this. With another OpenGL, rows are always read from the bottom, and images are flipped afterward.
    """
    count = ctypes.c_int()
    _gl_function("glGetIntegerv", None, ctypes.c_uint, ctypes.c_void_p)(_NUM_EXTENSIONS, ctypes.byref(count))
    name = _gl_function("glGetStringi", ctypes.c_char_p, ctypes.c_uint, ctypes.c_uint)
    if b"GL_MESA_pack_invert" not in {name(_EXTENSIONS, number) for number in range(count.value)}:
        return False
    _gl_function("glPixelStorei", None, ctypes.c_uint, ctypes.c_int)(_PACK_INVERT_MESA, int(wanted))
    return wanted


def as_upright(pixels: np.ndarray) -> np.ndarray:
    """Return the pixels with the top row first."""
    return pixels if CONTEXT.from_top else pixels[::-1]


def _context_errors() -> tuple[type[Exception], ...]:
    """Return the exceptions of a failed context creation if libraries or devices are missing."""
    known: tuple[type[Exception], ...] = (ImportError, AttributeError, RuntimeError, OSError)
    try:
        return (*known, importlib.import_module("OpenGL.error").Error)
    except (ImportError, AttributeError):
        return known


def _free_all() -> None:
    """Free renderers and context before the interpreter unloads OpenGL."""
    for renderer in list(RENDERERS):
        renderer.close()
    if CONTEXT.gl is not None and CONTEXT.pid == os.getpid():
        CONTEXT.gl.free()
        CONTEXT.gl = CONTEXT.handle = CONTEXT.query = None
        CONTEXT.from_top = False
