"""Choice of the OpenGL back end that renders images. This module also checks whether its libraries are installed.

Source: MuJoCo 3.17 ``rendering/classic/gl_context.py`` for the values of ``MUJOCO_GL``.
"""

from __future__ import annotations

import ctypes
import ctypes.util
import functools
import os

INSTALL_HINT = "apt-get install -y --no-install-recommends libegl1 libgl1"
"""Command that installs an OpenGL back end on Debian or Ubuntu, with or without a graphics card."""

OSMESA_HINT = "apt-get install -y --no-install-recommends libosmesa6"
"""Command that installs OSMesa, which renders only in software."""

OFF = ("disable", "disabled", "off", "false", "0")
BACK_ENDS = ("egl", "osmesa", "glfw")
KNOWN = (*BACK_ENDS, "glx", *OFF, "enable", "enabled", "on", "true", "1", "")
PLATFORMS = ("egl", "osmesa")
"""Back ends for which PyOpenGL must load its functions from the platform with the same name."""


def gl_backend() -> str | None:
    """Return the off-screen OpenGL back end that renders images ("egl", "osmesa", "glfw"), or None if there is none.

    If the environment variable ``MUJOCO_GL`` names one of these three back ends, this back end is returned ("glfw"
    needs a display). If it names none of them, EGL is preferred, because EGL also finds graphics cards. This function
    only checks that the libraries are present. :func:`betterbench.sim.scenes.renderer_fingerprint` tests whether they
    work.
    """
    asked = asked_back_end()
    if asked in BACK_ENDS:
        return asked
    if asked in OFF:
        return None
    return next((name for name in PLATFORMS if has_library(name)), None)


def asked_back_end() -> str:
    """Return the back end that ``MUJOCO_GL`` names, interpreted in the same way as in MuJoCo.

    Return an empty string if the variable is not set.
    """
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
    if library is None:
        return False
    try:
        ctypes.CDLL(library)
    except OSError:
        return False
    return True
