"""EGL devices of this machine, and the distribution of processes over them.

Processes are distributed only over devices that render identically, so that an image does not depend on the process
that rendered it. Devices render identically if they have the same OpenGL vendor, renderer and version. Only devices
that agree with the first working device are used. A process passes the list of devices to its child processes. The list
for each child begins with the device that the child has to use.
"""

from __future__ import annotations

import contextlib
import functools
import itertools
import json
import os
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from betterbench.errors import GraphicsError, one_line
from betterbench.sim.graphics import probe
from betterbench.sim.graphics.back_ends import gl_backend

DEVICE_VARIABLE = "MUJOCO_EGL_DEVICE_ID"
"""Environment variable with the index of the EGL device for MuJoCo and robosuite."""

HANDED_DOWN = "BETTERBENCH_EGL_DEVICES"
"""Environment variable that a process sets for each child process. It lists device indices, starting with the device
that the child has to use."""

_BULLET_VARIABLE = "EGL_VISIBLE_DEVICES"
"""Environment variable with the index of the EGL device for PyBullet, which CALVIN uses."""

_PROBE_LIMIT_S = 60.0

_started = itertools.count()


@dataclass(frozen=True, slots=True)
class EglDevice:
    """EGL device on which an OpenGL context can be created.

    Attributes:
        number: Index in EGL's list of devices.
        draws: Vendor, renderer and version of the device's OpenGL.
        cuda: Index of the graphics card in CUDA, in the driver's own order, or None if it is unknown.
        uuid: UUID of the graphics card, or an empty string if it is unknown.
    """

    number: int
    draws: tuple[str, str, str]
    cuda: int | None = None
    uuid: str = ""


@functools.cache
def device_count() -> int:
    """Return the number of devices that EGL lists, or 0 if EGL is missing or cannot list devices."""
    return len(probe.devices())


@functools.cache
def egl_devices() -> tuple[EglDevice, ...]:
    """Return the working devices in EGL's order.

    If the machine has only one device, the device is returned without being examined.
    """
    if device_count() <= 1:
        return tuple(EglDevice(number, ("", "", "")) for number in range(device_count()))
    # Without the CUDA environment variables, CUDA numbers the devices as the driver does.
    hidden = ("CUDA_VISIBLE_DEVICES", DEVICE_VARIABLE)
    environment = {name: value for name, value in os.environ.items() if name not in hidden}
    try:
        done = subprocess.run(  # noqa: S603 - our own file
            [sys.executable, "-I", str(Path(probe.__file__))],
            capture_output=True,
            timeout=_PROBE_LIMIT_S,
            check=True,
            env=environment,
        )
        found = json.loads(done.stdout)
    except (OSError, subprocess.SubprocessError, ValueError):
        return ()
    return tuple(
        EglDevice(number, (said["vendor"], said["renderer"], said["version"]), said.get("cuda"), said.get("uuid", ""))
        for number, said in enumerate(found)
        if said
    )


def drawing_devices() -> tuple[int, ...]:
    """Return the indices of the devices to use for child processes. The result is empty if EGL is not used.

    If ``MUJOCO_EGL_DEVICE_ID`` names a device, only that device is returned.

    Raises:
        GraphicsError: If ``MUJOCO_EGL_DEVICE_ID`` does not name a device.
    """
    if gl_backend() != "egl":
        return ()
    handed = _numbers(os.environ.get(HANDED_DOWN, ""))
    if handed:
        return handed
    chosen = require_device()
    return alike(egl_devices(), os.environ) if chosen is None else (chosen,)


def require_device() -> int | None:
    """Return the device index in ``MUJOCO_EGL_DEVICE_ID``, or None if the variable is not set.

    Raises GraphicsError if the index is invalid.
    """
    chosen = os.environ.get(DEVICE_VARIABLE)
    if chosen is None:
        return None
    problem = device_problem(chosen, device_count())
    if problem is not None:
        raise problem
    return int(chosen) if chosen.strip().isdecimal() else None


def alike(devices: Sequence[EglDevice], environment: Mapping[str, str]) -> tuple[int, ...]:
    """Return the indices of the devices that render identically to the first one.

    If ``CUDA_VISIBLE_DEVICES`` names some of their graphics cards, by index or UUID, only these cards are used, because
    the other cards belong to other jobs.
    """
    if not devices:
        return ()
    named = [part.strip() for part in environment.get("CUDA_VISIBLE_DEVICES", "").split(",") if part.strip()]
    own = [device for device in devices if any(_is_card(device, name) for name in named)] or list(devices)
    return tuple(device.number for device in own if device.draws == own[0].draws)


def next_device_variables() -> dict[str, str]:
    """Return the environment variables that assign a device to the next child process.

    The result is empty if no device is used.
    """
    return device_variables(next(_started))


def take_device(turn: int) -> None:
    """Assign a device to this process, given its index among the processes. Call this before anything is rendered.

    If an environment variable that selects the device is invalid, the error is raised only when the first image is
    rendered, because many runs render no images.
    """
    with contextlib.suppress(GraphicsError):
        os.environ.update(device_variables(turn))


def device_variables(turn: int) -> dict[str, str]:
    """Return the environment variables that assign a device to a process, given its index among the processes."""
    devices = drawing_devices()
    if not devices:
        return {}
    first = turn % len(devices)
    ordered = [str(number) for number in (*devices[first:], *devices[:first])]
    return {DEVICE_VARIABLE: ordered[0], _BULLET_VARIABLE: ordered[0], HANDED_DOWN: ",".join(ordered)}


def device_problem(chosen: str, count: int) -> GraphicsError | None:
    """Return the error for an invalid ``MUJOCO_EGL_DEVICE_ID``, or None if it is valid.

    ``count`` is the number of devices.
    """
    if count == 0:
        return None
    last = count - 1
    cure = "Unset it, or set it to 0" if last == 0 else f"Unset it, or set it to a number from 0 to {last}"
    there = "this machine has one EGL device, number 0" if last == 0 else f"EGL has the devices 0 to {last} here"
    try:
        number = int(chosen)
    except ValueError:
        said = f"{one_line(chosen, most=60)!r} is not the number of an EGL device" if chosen.strip() else "it is empty"
        return GraphicsError(f"{DEVICE_VARIABLE}: {said}; {there}. {cure}.")
    if not 0 <= number <= last:
        return GraphicsError(f"{DEVICE_VARIABLE}: it is {number}, and {there}. {cure}.")
    return None


def _is_card(device: EglDevice, name: str) -> bool:
    """Return whether an entry of ``CUDA_VISIBLE_DEVICES`` names a device, by number or by the start of its UUID."""
    if name.isdecimal():
        return device.cuda == int(name)
    start = name.lower().removeprefix("gpu-")
    return bool(start) and device.uuid.startswith(start)


def _numbers(text: str) -> tuple[int, ...]:
    parts = text.split(",")
    return tuple(map(int, parts)) if all(part.isdecimal() for part in parts) else ()
