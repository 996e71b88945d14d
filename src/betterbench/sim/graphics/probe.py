"""Program that examines every EGL device and prints the capabilities of all devices as one JSON list.

It runs in a separate process, so that a driver crash ends only this process, and no displays of unused devices stay
open. The file is run as a script and imports only the standard library.

Sources: the Khronos registry for EGL_EXT_device_enumeration, EGL_EXT_platform_device, EGL_NV_device_cuda and
EGL_EXT_device_persistent_id, and for the constants in this file.
"""

from __future__ import annotations

import contextlib
import ctypes
import json
import sys
import uuid
from typing import Any

MOST_DEVICES = 10
"""Maximum number of devices that MuJoCo considers (``mujoco/egl/egl_ext.py``)."""

_PLATFORM_DEVICE, _CUDA_DEVICE, _DEVICE_UUID, _OPENGL_API, _VERSION = 0x313F, 0x323A, 0x335C, 0x30A2, 0x3054
_CONFIG = (0x3033, 0x0001, 0x3040, 0x0008, 0x3025, 24, 0x3038)  # pixel buffer, OpenGL, 24-bit depth
_GL_VENDOR, _GL_RENDERER, _GL_VERSION = 0x1F00, 0x1F01, 0x1F02


class _Egl:
    """Access to EGL's functions by name."""

    def __init__(self) -> None:
        self._library = ctypes.CDLL("libEGL.so.1")
        self._library.eglGetProcAddress.restype = ctypes.c_void_p
        self._library.eglGetProcAddress.argtypes = (ctypes.c_char_p,)

    def __call__(self, name: str, result: Any, *arguments: Any) -> Any:  # noqa: ANN401 - types of ctypes
        """Return the function with the given name. Raises AttributeError if EGL does not have it."""
        place = self._library.eglGetProcAddress(name.encode())
        if not place:
            raise AttributeError(name)
        return ctypes.CFUNCTYPE(result, *arguments)(place)


def devices() -> list[int]:
    """Return the handles of the EGL devices in the order of their indices. Empty if there is no EGL."""
    try:
        query = _Egl()("eglQueryDevicesEXT", ctypes.c_uint, ctypes.c_int, ctypes.c_void_p, ctypes.c_void_p)
    except (OSError, AttributeError):
        return []
    handles, count = (ctypes.c_void_p * MOST_DEVICES)(), ctypes.c_int()
    if not query(MOST_DEVICES, handles, ctypes.byref(count)):
        return []
    return [int(handle or 0) for handle in handles[: count.value]]


def draws_with(handle: int) -> dict[str, Any]:
    """Return the "vendor", "renderer" and "version" of a device's OpenGL, and the device's CUDA number and UUID.

    The result is empty if no OpenGL context can be created on the device, for example because the job is not allowed to
    use the graphics card.
    """
    egl, pointer, integer = _Egl(), ctypes.c_void_p, ctypes.c_int
    display = egl("eglGetPlatformDisplayEXT", pointer, ctypes.c_uint, pointer, pointer)(_PLATFORM_DEVICE, handle, None)
    if not display or not egl("eglInitialize", ctypes.c_uint, pointer, pointer, pointer)(display, None, None):
        return {}
    egl("eglBindAPI", ctypes.c_uint, ctypes.c_uint)(_OPENGL_API)
    config, count = pointer(), integer()
    choose = egl("eglChooseConfig", ctypes.c_uint, pointer, pointer, pointer, integer, pointer)
    wanted = (integer * len(_CONFIG))(*_CONFIG)
    choose(display, wanted, ctypes.byref(config), 1, ctypes.byref(count))
    context = count.value and egl("eglCreateContext", pointer, pointer, pointer, pointer, pointer)(
        display, config, None, None
    )
    current = egl("eglMakeCurrent", ctypes.c_uint, pointer, pointer, pointer, pointer)
    if not context or not current(display, None, None, context):
        return {}
    text = egl("glGetString", ctypes.c_char_p, ctypes.c_uint)
    names = {"vendor": _GL_VENDOR, "renderer": _GL_RENDERER, "version": _GL_VERSION}
    found: dict[str, Any] = {key: (text(name) or b"").decode("utf-8", "replace") for key, name in names.items()}
    current(display, None, None, None)
    egl("eglTerminate", ctypes.c_uint, pointer)(display)
    return {**found, **_card(egl, handle)}


def _card(egl: _Egl, handle: int) -> dict[str, Any]:
    """Return the CUDA number and the UUID of a device, if its driver reports them."""
    found: dict[str, Any] = {}
    with contextlib.suppress(AttributeError):
        number = ctypes.c_ssize_t()
        query = egl("eglQueryDeviceAttribEXT", ctypes.c_uint, ctypes.c_void_p, ctypes.c_int, ctypes.c_void_p)
        if query(handle, _CUDA_DEVICE, ctypes.byref(number)):
            found["cuda"] = number.value
    with contextlib.suppress(AttributeError):
        raw, size = ctypes.create_string_buffer(16), ctypes.c_int()
        binary = egl(
            "eglQueryDeviceBinaryEXT",
            *(ctypes.c_uint, ctypes.c_void_p, ctypes.c_int, ctypes.c_int, ctypes.c_void_p, ctypes.c_void_p),
        )
        if binary(handle, _DEVICE_UUID, len(raw), raw, ctypes.byref(size)) and size.value == len(raw):
            found["uuid"] = str(uuid.UUID(bytes=raw.raw))
    return found


if __name__ == "__main__":
    sys.stdout.write(json.dumps([draws_with(handle) for handle in devices()]))
