"""Rendering setup of this machine: OpenGL back end, devices and environment variables.

``back_ends`` chooses the back end. ``devices`` finds the EGL devices and distributes processes over them. ``probe`` is
the program that examines each device. ``checks`` reports problems in the environment. This package does not import a
simulator, so all workers and all other simulator processes choose the same back end.
"""

from betterbench.sim.graphics.back_ends import INSTALL_HINT, gl_backend
from betterbench.sim.graphics.checks import no_window, require_drawing, require_engine
from betterbench.sim.graphics.devices import drawing_devices, next_device_variables, take_device

__all__ = [
    "INSTALL_HINT",
    "drawing_devices",
    "gl_backend",
    "next_device_variables",
    "no_window",
    "require_drawing",
    "require_engine",
    "take_device",
]
