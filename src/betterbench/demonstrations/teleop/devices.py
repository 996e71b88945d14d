"""Gamepads and SpaceMice that are connected to the machine on which betterbench runs.

If the operator uses another computer, the devices connected to it are read by the browser page. This module implements
the Linux input protocol (``linux/input.h``: 24-byte events) and its gamepad specification, so no library is needed.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import select
import struct
import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from betterbench.browser.keys import NO_PUSH
from betterbench.demonstrations.teleop.controls import Controls, Tap
from betterbench.errors import InvalidInputError, system_error_text

DeviceKind = Literal["gamepad", "SpaceMouse"]

EVENT = struct.Struct("llHHi")
"""Layout of an input event: seconds, microseconds, type, code, value."""
EV_KEY, EV_REL, EV_ABS = 1, 2, 3
SPACE_MOUSE_RANGE, GAMEPAD_RANGE = 350, 32767
"""Maximum deflection of the axes, used if the kernel does not report it."""
RENEW_S = 0.1
"""Period at which an unchanged deflection is sent again [s], because the kernel only reports changes."""
SPRUNG_S = 0.15
"""Time without an event after which a relative axis counts as released [s]."""

_SPACE_MOUSE_VENDORS = {0x256F}
_OLD_SPACE_MOUSE = (0x046D, range(0xC603, 0xC62C))  # 3Dconnexion devices with the vendor id of Logitech
_GAMEPAD_KEY = 0x130  # BTN_SOUTH

_SPACE_MOUSE_AXES = {0: (1, -1.0), 1: (0, -1.0), 2: (2, -1.0), 3: (3, 1.0), 4: (4, -1.0), 5: (5, -1.0)}
_GAMEPAD_AXES = {0: (1, -1.0), 1: (0, -1.0), 2: (2, -1.0), 3: (5, -1.0), 4: (4, -1.0), 5: (2, 1.0), 16: (3, 1.0)}
"""Component and sign of the motion that each axis causes. The triggers of a gamepad (2 and 5) rest at their minimum."""
_TRIGGERS = (2, 5)
_SPACE_MOUSE_KEYS: dict[int, Tap] = {0x100: "gripper", 0x101: "undo"}
_GAMEPAD_KEYS: dict[int, Tap] = {0x130: "gripper", 0x131: "undo", 0x13B: "save"}


@dataclass(frozen=True, slots=True)
class Device:
    """Input device that can be read: its device file, name and kind."""

    path: Path
    name: str
    kind: DeviceKind


def find_devices(root: Path = Path("/sys/class/input")) -> tuple[Device, ...]:
    """Find the gamepads and SpaceMice that are connected to this machine, in the kernel's list of input devices."""
    found = []
    for entry in sorted(root.glob("event*")):
        about = entry / "device"
        try:
            name = (about / "name").read_text().strip()
            vendor, product = (int((about / "id" / part).read_text(), 16) for part in ("vendor", "product"))
            keys = (about / "capabilities" / "key").read_text().split()
        except (OSError, ValueError):
            continue
        path = Path("/dev/input") / entry.name
        if vendor in _SPACE_MOUSE_VENDORS or (vendor == _OLD_SPACE_MOUSE[0] and product in _OLD_SPACE_MOUSE[1]):
            found.append(Device(path, name, "SpaceMouse"))
        elif _has_key(keys, _GAMEPAD_KEY):
            found.append(Device(path, name, "gamepad"))
    return tuple(found)


def _has_key(words: Sequence[str], key: int) -> bool:
    """Return whether a device has the given key.

    Args:
        words: Bits of all keys as the kernel reports them: 64-bit hexadecimal words, the most significant word first.
        key: Key code.
    """
    index = len(words) - 1 - key // 64
    return index >= 0 and bool(int(words[index], 16) >> (key % 64) & 1)


class DeviceThread:
    """Thread that passes the input of one device to the controls until the thread is closed or the device is unplugged.

    Raises InvalidInputError if the device cannot be opened.
    """

    def __init__(self, device: Device, controls: Controls) -> None:
        """Open the device and start reading."""
        self._device, self._controls = device, controls
        try:
            self._file = os.open(device.path, os.O_RDONLY | os.O_NONBLOCK)
        except OSError as problem:
            cure = "Join the group with read access (usually input), or pass --devices none"
            raise InvalidInputError(str(device.path), problem.strerror or str(problem), cure) from problem
        self._is_over = threading.Event()
        self._values = list(NO_PUSH)
        self._triggers = dict.fromkeys(_TRIGGERS, 0.0)
        self._is_sprung = False
        self._thread = threading.Thread(target=self._run, name=f"teleop {device.kind}", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Stop reading."""
        self._is_over.set()
        self._thread.join(timeout=0.3)
        with contextlib.suppress(OSError):
            os.close(self._file)

    def _run(self) -> None:
        reported_s = 0.0
        try:
            while not self._is_over.is_set():
                ready, _, _ = select.select([self._file], [], [], RENEW_S)
                now = time.monotonic()
                if ready:
                    data = self._read()
                    reported_s = now
                    for _, _, kind, code, value in EVENT.iter_unpack(data[: len(data) // EVENT.size * EVENT.size]):
                        self._take(kind, code, value)
                elif self._is_sprung and now - reported_s > SPRUNG_S:
                    self._values = list(NO_PUSH)
                self._controls.pushed(self._device.name, self._values, now)
        except OSError as problem:
            if not self._is_over.is_set():
                self._controls.pushed(self._device.name, NO_PUSH, time.monotonic())
                self._controls.complain(f"{self._device.name}: {problem.strerror or system_error_text(problem)}")

    def _read(self) -> bytes:
        """Return the events that are available. Raise OSError if the device was unplugged."""
        data = os.read(self._file, 64 * EVENT.size)
        if not data:
            raise OSError(None, "it was unplugged")
        return data

    def _take(self, kind: int, code: int, value: int) -> None:
        is_pad = self._device.kind == "gamepad"
        if kind == EV_KEY and value == 1:
            tap = (_GAMEPAD_KEYS if is_pad else _SPACE_MOUSE_KEYS).get(code)
            if tap is not None:
                self._controls.tapped(None, tap)
        axes = _GAMEPAD_AXES if is_pad else _SPACE_MOUSE_AXES
        if kind not in (EV_REL, EV_ABS) or code not in axes:
            return
        self._is_sprung = kind == EV_REL
        component, sign = axes[code]
        low, high = self._range(code, is_pad=is_pad) if kind == EV_ABS else (-SPACE_MOUSE_RANGE, SPACE_MOUSE_RANGE)
        if is_pad and code in _TRIGGERS:
            self._triggers[code] = (value - low) / (high - low)
            self._values[component] = self._triggers[5] - self._triggers[2]
            return
        share = 2.0 * (value - low) / (high - low) - 1.0
        self._values[component] = sign * max(-1.0, min(1.0, share))

    def _range(self, code: int, *, is_pad: bool) -> tuple[int, int]:
        """Return the minimum and the maximum value of an absolute axis (EVIOCGABS).

        If the kernel does not report them, return default values.
        """
        asked = bytearray(24)
        request = (2 << 30) | (len(asked) << 16) | (ord("E") << 8) | (0x40 + code)
        with contextlib.suppress(OSError):
            fcntl.ioctl(self._file, request, asked)
            _, low, high, _, _, _ = struct.unpack("6i", asked)
            if high > low:
                return int(low), int(high)
        most = GAMEPAD_RANGE if is_pad else SPACE_MOUSE_RANGE
        return (0, 255) if is_pad and code in _TRIGGERS else (-most, most)
