"""OpenGL context of this process: its back end, its thread, and how pixels are read.

A process has one context, which is created when it is first needed and shared by all renderers. Only the thread of the
first renderer may render. Worker processes must be started with the ``spawn`` method, because a forked copy of a
context does not work and is rejected.
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
"""Remedy to suggest if OpenGL does not work and no environment variable is known to be the cause."""


_SPAWN = (
    "Start workers with the 'spawn' method. For Gymnasium's vector environments, use gymnasium.make_vec(..., "
    "vectorization_mode='async', vector_kwargs={'context': 'spawn'})"
)


class _GLContext(Protocol):
    """Common interface of the contexts in ``mujoco.egl``, ``mujoco.osmesa`` and ``mujoco.glfw``."""

    def make_current(self) -> None: ...

    def free(self) -> None: ...


class Closable(Protocol):
    """Object that holds buffers in the OpenGL context until it is closed."""

    def close(self) -> None:
        """Free the buffers."""


def renderer_fingerprint() -> dict[str, str]:
    """Return the properties of OpenGL and MuJoCo that determine, together with the scene, the pixels of an image.

    On two machines with equal properties, images are equal. The properties are OpenGL's ``backend``, ``vendor``,
    ``renderer`` and ``version``, and the version of ``mujoco``. Raises MissingDependencyError if off-screen OpenGL does
    not work on this machine.
    """
    make_current()
    text = _gl_function("glGetString", ctypes.c_char_p, ctypes.c_uint)
    names = {"vendor": _VENDOR, "renderer": _RENDERER, "version": _VERSION}
    strings = {key: (text(name) or b"").decode("utf-8", "replace") for key, name in names.items()}
    return {"backend": gl_backend() or "", **strings, "mujoco": mujoco.__version__}


@dataclass(slots=True)
class _ProcessContext:
    """OpenGL context of this process, with the ids of the process and the thread that may use it."""

    gl: _GLContext | None = None
    pid: int = 0
    thread: int = 0
    handle: int | None = None
    query: Callable[[], int | None] | None = None
    from_top: bool = False


CONTEXT = _ProcessContext()
"""OpenGL context of this process."""
RENDERERS: weakref.WeakSet[Closable] = weakref.WeakSet()
"""Objects with buffers in the context. They are closed before the context is freed when the process exits."""


def make_current() -> None:
    """Make the OpenGL context of this process current. The first call also creates the context."""
    known = CONTEXT.query
    if known is not None and CONTEXT.thread == threading.get_ident() and CONTEXT.pid == os.getpid():
        # Querying EGL for the current context takes 1 us. Making a context current takes 50 us, which is 1 % of the
        # time for an image in the fast preset.
        if known() != CONTEXT.handle and CONTEXT.gl is not None:
            CONTEXT.gl.make_current()
        return
    if CONTEXT.gl is None:
        CONTEXT.gl = _create_context()
        CONTEXT.from_top = read_from_top(wanted=True)
        CONTEXT.pid, CONTEXT.thread = os.getpid(), threading.get_ident()
        atexit.register(_free_all)
    if os.getpid() != CONTEXT.pid:
        raise InvalidInputError("worker process", "was forked from a process that had already rendered images", _SPAWN)
    if threading.get_ident() != CONTEXT.thread:
        raise InvalidInputError(
            "renderer",
            "is used in a different thread than the first renderer of this process",
            "Render all images in one thread",
        )
    CONTEXT.gl.make_current()
    if gl_backend() == "egl":
        CONTEXT.query = _egl_current_context()
        CONTEXT.handle = CONTEXT.query()


@functools.cache
def _egl_current_context() -> Callable[[], int | None]:
    """Return EGL's function ``eglGetCurrentContext``.

    It bypasses PyOpenGL's wrapper, which would take more time than the query saves.
    """
    function = ctypes.CDLL("libEGL.so.1").eglGetCurrentContext
    function.restype = ctypes.c_void_p
    function.argtypes = ()
    current: Callable[[], int | None] = function
    return current


def _create_context() -> _GLContext:
    """Create an OpenGL context with the selected back end. Raises MissingDependencyError if this does not work."""
    backend = require_drawing()
    # At these image sizes, Mesa's software renderer gains nothing from threads, which would take cores from workers.
    os.environ.setdefault("LP_NUM_THREADS", "0")
    # The arguments are the size of the context's window, which is never used.
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
"""Setting of the OpenGL extension MESA_pack_invert that makes OpenGL read pixels starting with the top row."""


def _gl_function(name: str, result: type[ctypes.c_char_p] | None, *arguments: object) -> Callable[..., bytes | None]:
    """Return a function of OpenGL. Importing it from ``OpenGL.GL`` would take 50 ms of CPU time."""
    platform = importlib.import_module("OpenGL.platform").PLATFORM
    function: Callable[..., bytes | None] = platform.constructFunction(
        name, platform.GL, resultType=result, argTypes=arguments
    )
    return function


def read_from_top(*, wanted: bool) -> bool:
    """Try to make OpenGL read pixels starting with the top row, and return whether this works.

    If it works, images do not have to be flipped. Mesa supports this. Other OpenGL libraries always read from the
    bottom row, so images are flipped afterward.
    """
    count = ctypes.c_int()
    _gl_function("glGetIntegerv", None, ctypes.c_uint, ctypes.c_void_p)(_NUM_EXTENSIONS, ctypes.byref(count))
    name = _gl_function("glGetStringi", ctypes.c_char_p, ctypes.c_uint, ctypes.c_uint)
    if b"GL_MESA_pack_invert" not in {name(_EXTENSIONS, number) for number in range(count.value)}:
        return False
    _gl_function("glPixelStorei", None, ctypes.c_uint, ctypes.c_int)(_PACK_INVERT_MESA, int(wanted))
    return wanted


def as_upright(pixels: np.ndarray) -> np.ndarray:
    """Return the pixels with the top row first. They are flipped if OpenGL has read them from the bottom row."""
    return pixels if CONTEXT.from_top else pixels[::-1]


def _context_errors() -> tuple[type[Exception], ...]:
    """Return the exceptions that creating a context can raise if libraries or devices are missing."""
    known: tuple[type[Exception], ...] = (ImportError, AttributeError, RuntimeError, OSError)
    try:
        return (*known, importlib.import_module("OpenGL.error").Error)
    except (ImportError, AttributeError):
        return known


def _free_all() -> None:
    """Free the renderers and the context. This must happen before the interpreter unloads OpenGL."""
    for renderer in list(RENDERERS):
        renderer.close()
    if CONTEXT.gl is not None and CONTEXT.pid == os.getpid():
        CONTEXT.gl.free()
        CONTEXT.gl = CONTEXT.handle = CONTEXT.query = None
        CONTEXT.from_top = False
