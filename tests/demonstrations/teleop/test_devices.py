"""Devices of the machine, read from files as the kernel writes them."""

from __future__ import annotations

import os
import time

import pytest

from betterbench.demonstrations.teleop.controls import Controls
from betterbench.demonstrations.teleop.devices import EV_ABS, EV_KEY, EV_REL, EVENT, Device, DeviceThread, find_devices
from betterbench.errors import InvalidInputError


def described(about, name, vendor, product, key_words):
    (about / "id").mkdir(parents=True)
    (about / "capabilities").mkdir()
    (about / "name").write_text(f"{name}\n")
    (about / "id" / "vendor").write_text(f"{vendor:04x}\n")
    (about / "id" / "product").write_text(f"{product:04x}\n")
    (about / "capabilities" / "key").write_text(key_words + "\n")


def test_gamepads_and_space_mice_are_found_and_nothing_else(tmp_path):
    described(
        tmp_path / "event0" / "device",
        "AT keyboard",
        0x0001,
        0x0001,
        "402000000 3803078f800d001 feffffdfffefffff fffffffffffffffe",
    )
    described(tmp_path / "event1" / "device", "Xbox pad", 0x045E, 0x028E, "7cdb000000000000 0 0 0 0")
    described(tmp_path / "event2" / "device", "SpaceMouse Compact", 0x256F, 0xC635, "3 0 0 0 0")
    described(tmp_path / "event3" / "device", "SpaceNavigator", 0x046D, 0xC626, "3 0 0 0 0")
    described(tmp_path / "event4" / "device", "Logitech mouse", 0x046D, 0xC077, "70000 0 0 0 0")
    (tmp_path / "event5").mkdir()
    found = [(d.name, d.kind, str(d.path)) for d in find_devices(tmp_path)]
    assert found == [
        ("Xbox pad", "gamepad", "/dev/input/event1"),
        ("SpaceMouse Compact", "SpaceMouse", "/dev/input/event2"),
        ("SpaceNavigator", "SpaceMouse", "/dev/input/event3"),
    ]
    assert find_devices(tmp_path / "nowhere") == ()


class Plugged:
    """A device that is a pipe."""

    def __init__(self, folder, kind):
        path = folder / "event0"
        os.mkfifo(path)
        self.controls = Controls()
        self.thread = DeviceThread(Device(path, "it", kind), self.controls)
        self.file = os.open(path, os.O_WRONLY)

    def report(self, *events):
        os.write(self.file, b"".join(EVENT.pack(0, 0, *event) for event in events))

    def until(self, wanted):
        for _ in range(400):
            asked = self.controls.take(time.monotonic())
            if wanted(asked):
                return asked
            time.sleep(0.005)
        raise AssertionError("it did not answer")


@pytest.fixture
def plugged(tmp_path):
    made = []

    def plug(kind):
        made.append(Plugged(tmp_path, kind))
        return made[0]

    yield plug
    for device in made:
        device.thread.close()


def test_a_space_mouse_pushes_and_taps(plugged):
    mouse = plugged("SpaceMouse")
    mouse.report((EV_REL, 1, -350), (EV_REL, 5, 175))  # away, and half a turn to the right
    assert mouse.until(lambda a: any(a.push)).push == pytest.approx((1.0, 0, 0, 0, 0, -0.432), abs=0.01)
    mouse.until(lambda a: not any(a.push))  # its springs report nothing more
    mouse.report((EV_KEY, 0x100, 1), (EV_KEY, 0x100, 0), (EV_KEY, 0x101, 1))
    assert mouse.until(lambda a: a.taps).taps == ("gripper", "undo")
    os.close(mouse.file)


def test_a_gamepad_is_held_until_it_reports_something_else(plugged):
    pad = plugged("gamepad")
    pad.report((EV_ABS, 1, -32767), (EV_ABS, 5, 255))
    assert pad.until(lambda a: any(a.push)).push == pytest.approx((1.0, 0, 1.0, 0, 0, 0), abs=0.01)
    time.sleep(0.3)
    assert any(pad.controls.take(time.monotonic()).push)
    pad.report((EV_ABS, 1, 0), (EV_ABS, 5, 0))
    pad.until(lambda a: not any(a.push))
    os.close(pad.file)


def test_a_device_that_is_unplugged_lets_go_and_is_told(plugged):
    pad = plugged("gamepad")
    pad.report((EV_ABS, 0, 32767))
    pad.until(lambda a: any(a.push))
    os.close(pad.file)
    pad.until(lambda a: not any(a.push))
    assert any("it was unplugged" in line for line in pad.controls.take_problems())


def test_a_device_that_cannot_be_opened_is_named(tmp_path):
    with pytest.raises(InvalidInputError, match=r"event7.*--devices none"):
        DeviceThread(Device(tmp_path / "event7", "it", "gamepad"), Controls())
