"""Environment variables for a simulator's process. Variables of the user that would affect the simulator are left out.

robosuite 1.4.0 interprets ``CUDA_VISIBLE_DEVICES`` as the index of an EGL device and asserts that it contains
``MUJOCO_EGL_DEVICE_ID`` (``utils/binding_utils.py``, ``renderers/context/egl_context.py``). Under SLURM, these two
requirements contradict each other. Python's own variables would change which packages the simulator imports, and thus
its results.
"""

from __future__ import annotations

import os
from collections.abc import Mapping

from betterbench.sim.graphics import gl_backend, next_device_variables

_LEFT_OUT = (
    *("CUDA_", "NVIDIA_VISIBLE_DEVICES", "GPU_DEVICE_ORDINAL", "HIP_VISIBLE_DEVICES", "ROCR_VISIBLE_DEVICES"),
    *("MUJOCO_", "PYOPENGL_", "EGL_VISIBLE_DEVICES", "EGL_DEVICE_ID", "DISPLAY", "WAYLAND_DISPLAY"),
    *("PYTHON", "VIRTUAL_ENV", "CONDA_", "LIBERO_", "ROBOSUITE_", "NUMBA_", "HYDRA_"),
)
"""Prefixes of the variables that are not passed on to a simulator."""

_OWN = {"PYTHONDONTWRITEBYTECODE": "1", "PYTHONNOUSERSITE": "1", "PYTHONUTF8": "1"}
_NO_HOME = "/nonexistent"


def python_environment(given: Mapping[str, str]) -> dict[str, str]:
    """Return the environment variables, except those that would make a different Python load this Python's packages."""
    names = ("PYTHON", "VIRTUAL_ENV", "CONDA_PREFIX", "PIP_USER", "PIP_TARGET", "PIP_PREFIX", "PIP_REQUIRE_VIRTUALENV")
    return {name: value for name, value in given.items() if not name.startswith(names)}


def simulator_environment() -> dict[str, str]:
    """Return the environment variables for the next simulator process.

    If there are several EGL devices, the processes get them in turn. If ``MUJOCO_EGL_DEVICE_ID`` is set, all processes
    get that device.

    Raises:
        GraphicsError: If ``MUJOCO_EGL_DEVICE_ID`` does not name a device.
    """
    kept = {name: value for name, value in os.environ.items() if not name.startswith(_LEFT_OUT)}
    # robosuite renders only with EGL or OSMesa, independently of our own renderer
    backend = "osmesa" if gl_backend() == "osmesa" else "egl"
    devices = next_device_variables() if backend == "egl" else {}
    # Some libraries read the home directory when they are imported. This fails if the system has no name for the user's
    # id.
    return {"HOME": _NO_HOME, **kept, **_OWN, "MUJOCO_GL": backend, **devices}
