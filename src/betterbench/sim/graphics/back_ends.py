"""Choice of the OpenGL back end for images, and a check for its libraries.

Source: MuJoCo 3.17 ``rendering/classic/gl_context.py`` for the values of ``MUJOCO_GL``.
"""

from __future__ import annotations

import ctypes
import ctypes.util
import functools
import os

INSTALL_HINT = "apt-get install -y --no-install-recommends libegl1 libgl1"
"""Command that installs an OpenGL back end on a Debian or Ubuntu machine, with or without a graphics card."""

OSMESA_HINT = "apt-get install -y --no-install-recommends libosmesa6"
"""Command that installs OSMesa, which renders in software only."""

OFF = ("disable", "disabled", "off", "false", "0")
BACK_ENDS = ("egl", "osmesa", "glfw")
KNOWN = (*BACK_ENDS, "glx", *OFF, "enable", "enabled", "on", "true", "1", "")
PLATFORMS = ("egl", "osmesa")
"""Back ends whose functions PyOpenGL loads from the platform of the same name."""


def gl_backend() -> str | None:
    """Return the off-screen OpenGL back end for images ("egl", "osmesa", "glfw"), or None if there is none.

    The environment variable ``MUJOCO_GL`` decides if it names one of the three. "glfw" needs a display. Otherwise EGL
    is preferred, which also finds graphics cards. Only the presence of the libraries is checked.
    :func:`betterbench.sim.scenes.renderer_fingerprint` tests them.
    """
    asked = asked_back_end()
    if asked in BACK_ENDS:
        return asked
    if asked in OFF:
        return None
    return next((name for name in PLATFORMS if has_library(name)), None)


def asked_back_end() -> str:
    """Return the back end named by ``MUJOCO_GL``, as MuJoCo reads it, or an empty string if none."""
    return os.environ.get("MUJOCO_GL", "").strip().lower()


def has_library(backend: str) -> bool:
    """Return whether the libraries of a back end can be loaded."""
    if backend == "egl":
        # PyOpenGL loads the OpenGL functions from one of these, in addition to EGL's own library.
        return _loads("libEGL.so.1") and any(
            _loads(name) for name in ("libOpenGL.so.0", "libGL.so.1", "libGLESv2.so.2")
        )
    return _loads("libOSMesa.so.8") or _loads(ctypes.util.find_library("OSMesa"))


@functools.cache
def _loads(library: str | None) -> bool:
    """Return True if a shared library can be loaded."""
    if library is None:
        return False
    try:
        ctypes.CDLL(library)
    except OSError:
        return False
    return True
