"""Rendering set-up of this machine's processes: the OpenGL back end, its devices, and their environment variables.

``back_ends`` chooses the back end, ``devices`` finds the EGL devices and spreads processes over them, ``probe`` is the
program that looks at each device, and ``checks`` names what is wrong in the environment. No simulator is imported here,
so that the process of another simulator and a worker of ours get the same answer.
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
