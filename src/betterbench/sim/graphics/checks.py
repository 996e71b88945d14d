"""Checks of the environment variables that select the OpenGL back end. Each problem is reported with a remedy.

Sources: MuJoCo 3.17 ``mujoco/egl`` and ``mujoco/osmesa`` for ``PYOPENGL_PLATFORM`` and ``MUJOCO_EGL_DEVICE_ID``.
"""

from __future__ import annotations

import os

from betterbench.errors import GraphicsError, MissingDependencyError, one_line
from betterbench.sim.graphics.back_ends import (
    BACK_ENDS,
    INSTALL_HINT,
    KNOWN,
    OFF,
    OSMESA_HINT,
    PLATFORMS,
    asked_back_end,
    gl_backend,
    has_library,
)
from betterbench.sim.graphics.devices import require_device


def require_engine() -> None:
    """Check the variables that MuJoCo reads when it is imported, because MuJoCo's own error does not name a remedy.

    Raises:
        GraphicsError: If a variable has an invalid value.
        MissingDependencyError: If the back end in ``MUJOCO_GL`` is not installed.
    """
    asked = asked_back_end()
    if asked not in KNOWN:
        raise _wrong(
            "MUJOCO_GL",
            f"{one_line(asked, most=40)!r} is not a supported OpenGL back end (known: {', '.join(BACK_ENDS)})",
            f"Unset it, or set it to {_working()}",
        )
    if asked not in PLATFORMS:
        return
    if not has_library(asked):
        raise MissingDependencyError(
            f"MUJOCO_GL is {asked!r}, but its library cannot be loaded. {_cure_of_missing(asked)}"
        )
    _require_platform(asked)


def require_drawing() -> str:
    """Return the back end that renders images, after checking the variables it depends on.

    Raises:
        GraphicsError: If a variable has an invalid value.
        MissingDependencyError: If no back end is available.
    """
    require_engine()
    backend = gl_backend()
    if backend is None and asked_back_end() in OFF:
        raise _wrong("MUJOCO_GL", f"{asked_back_end()!r} disables rendering", f"Unset it, or set it to {_working()}")
    if backend is None:
        raise MissingDependencyError(
            f"No off-screen OpenGL: neither EGL nor OSMesa can be loaded on this machine. Run: {INSTALL_HINT}"
        )
    if backend == "glfw" and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise _wrong(
            "MUJOCO_GL",
            "'glfw' needs a window, but DISPLAY does not name a display",
            f"Unset it, or set it to {_working()}",
        )
    if backend in PLATFORMS:
        _require_platform(backend)
    if backend == "egl":
        require_device()
    return backend


def no_window() -> GraphicsError:
    """Return the error to raise if no window can be opened on the display."""
    display = one_line(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY") or "", most=60)
    problem = f"'glfw' needs a window, but none can be opened on the display {display!r}"
    return _wrong("MUJOCO_GL", problem, f"Unset it, or set it to {_working()}")


def _wrong(variable: str, problem: str, cure: str) -> GraphicsError:
    return GraphicsError(f"{variable}: {problem}. {cure}.")


def _require_platform(backend: str) -> None:
    """Check that ``PYOPENGL_PLATFORM`` does not make PyOpenGL load its functions from a different platform."""
    platform = os.environ.get("PYOPENGL_PLATFORM", "")
    if platform and platform.lower() != backend:
        chosen = "from MUJOCO_GL" if asked_back_end() == backend else "the back end found here"
        raise _wrong(
            "PYOPENGL_PLATFORM",
            f"it is {one_line(platform, most=40)!r}, but images are rendered with {backend!r}, {chosen}",
            f"Unset it, or set it to {backend}",
        )


def _working() -> str:
    """Return a description of the back ends that can be loaded on this machine, for messages.

    If there are none, describe the back ends that could be installed.
    """
    found = [name for name in PLATFORMS if has_library(name)]
    return " or ".join(found or PLATFORMS)


def _cure_of_missing(backend: str) -> str:
    other = [name for name in PLATFORMS if name != backend and has_library(name)]
    run = f"run: {INSTALL_HINT if backend == 'egl' else OSMESA_HINT}"
    return f"Unset it, to use {other[0]!r}, or {run}" if other else run[0].upper() + run[1:]
