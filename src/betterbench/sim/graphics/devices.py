"""EGL devices on this machine, and distribution of processes over the devices.

Processes are distributed over devices that render identically, so that an image does not depend on the process that
rendered it. These devices have the same OpenGL vendor, renderer and version as the first working device. A process
passes the list to its child processes. The list for each child begins with the device of this child.
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
"""Environment variable with the number of the EGL device for MuJoCo and robosuite."""

HANDED_DOWN = "BETTERBENCH_EGL_DEVICES"
"""Device numbers for a process and its children, with its own device first. The parent process sets it."""

_BULLET_VARIABLE = "EGL_VISIBLE_DEVICES"
"""The same variable for PyBullet, which CALVIN uses."""

_PROBE_LIMIT_S = 60.0

_started = itertools.count()


@dataclass(frozen=True, slots=True)
class EglDevice:
    """One EGL device on which an OpenGL context can be made.

    Attributes:
        number: Its index in EGL's list.
        draws: OpenGL's vendor, renderer and version.
        cuda: CUDA's number of the graphics card, in the driver's own order, or None if unknown.
        uuid: UUID of the graphics card. It is empty if unknown.
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
    """Return the working devices in EGL's order. On a machine with one device, its renderer is not examined."""
    if device_count() <= 1:
        return tuple(EglDevice(number, ("", "", "")) for number in range(device_count()))
    # Without the CUDA environment variables, CUDA's device numbers are the driver's.
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
    """Return the device numbers for processes started here, or an empty tuple if EGL is not used.

    A device named in ``MUJOCO_EGL_DEVICE_ID`` is the only one.

    Raises:
        GraphicsError: If that variable does not name a device.
    """
    if gl_backend() != "egl":
        return ()
    handed = _numbers(os.environ.get(HANDED_DOWN, ""))
    if handed:
        return handed
    chosen = require_device()
    return alike(egl_devices(), os.environ) if chosen is None else (chosen,)


def require_device() -> int | None:
    """Return the device in ``MUJOCO_EGL_DEVICE_ID``, None if it is not set. Raises GraphicsError if it is invalid."""
    chosen = os.environ.get(DEVICE_VARIABLE)
    if chosen is None:
        return None
    problem = device_problem(chosen, device_count())
    if problem is not None:
        raise problem
    return int(chosen) if chosen.strip().isdecimal() else None


def alike(devices: Sequence[EglDevice], environment: Mapping[str, str]) -> tuple[int, ...]:
    """Return the numbers of the devices that render like the first one.

    If ``CUDA_VISIBLE_DEVICES`` names some of their graphics cards, by number or UUID, only these are used, because the
    others belong to other jobs.
    """
    if not devices:
        return ()
    named = [part.strip() for part in environment.get("CUDA_VISIBLE_DEVICES", "").split(",") if part.strip()]
    own = [device for device in devices if any(_is_card(device, name) for name in named)] or list(devices)
    return tuple(device.number for device in own if device.draws == own[0].draws)


def next_device_variables() -> dict[str, str]:
    """Return the variables that assign a device to the next process started here, or an empty dict without devices."""
    return device_variables(next(_started))


def take_device(turn: int) -> None:
    """Assign a device to this process by its index among the processes. Call this before anything is rendered.

    An invalid variable is reported only at the first image, because a run may not render any images.
    """
    with contextlib.suppress(GraphicsError):
        os.environ.update(device_variables(turn))


def device_variables(turn: int) -> dict[str, str]:
    """Return the variables that assign a device to a process, by its index among the processes started here."""
    devices = drawing_devices()
    if not devices:
        return {}
    first = turn % len(devices)
    ordered = [str(number) for number in (*devices[first:], *devices[:first])]
    return {DEVICE_VARIABLE: ordered[0], _BULLET_VARIABLE: ordered[0], HANDED_DOWN: ",".join(ordered)}


def device_problem(chosen: str, count: int) -> GraphicsError | None:
    """Return the error for a wrong ``MUJOCO_EGL_DEVICE_ID`` among ``count`` devices, or None if it is right."""
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
    """Return whether an entry in ``CUDA_VISIBLE_DEVICES`` names a device by a number or the beginning of a UUID."""
    if name.isdecimal():
        return device.cuda == int(name)
    start = name.lower().removeprefix("gpu-")
    return bool(start) and device.uuid.startswith(start)


def _numbers(text: str) -> tuple[int, ...]:
    parts = text.split(",")
    return tuple(map(int, parts)) if all(part.isdecimal() for part in parts) else ()
