"""EGL devices: which of them processes are spread over, and what a wrong variable says."""

import json
import os
import subprocess
import sys

import pytest

from betterbench.errors import GraphicsError
from betterbench.sim.graphics import devices, gl_backend
from betterbench.sim.graphics.devices import EglDevice, alike, drawing_devices, next_device_variables, take_device

A100, T4, SOFT = ("NVIDIA", "A100", "4.6"), ("NVIDIA", "T4", "4.6"), ("Mesa", "llvmpipe", "4.5")


@pytest.fixture
def four(monkeypatch):
    """A machine with two pairs of graphics cards and the software renderer."""
    monkeypatch.setenv("MUJOCO_GL", "egl")
    for name in ("MUJOCO_EGL_DEVICE_ID", "BETTERBENCH_EGL_DEVICES", "CUDA_VISIBLE_DEVICES", "EGL_VISIBLE_DEVICES"):
        monkeypatch.delenv(name, raising=False)
    there = (
        EglDevice(0, A100, 1, "11111111-0000-0000-0000-000000000000"),
        EglDevice(1, A100, 0, "22222222-0000-0000-0000-000000000000"),
        EglDevice(3, T4, 2),
        EglDevice(4, T4, 3),
        EglDevice(5, SOFT),
    )
    monkeypatch.setattr(devices, "egl_devices", lambda: there)
    monkeypatch.setattr(devices, "device_count", lambda: 6)
    monkeypatch.setattr(devices, "_started", iter(range(100)))
    return there


def test_processes_are_spread_over_the_devices_that_draw_as_the_first_one_does(four):
    assert drawing_devices() == (0, 1)
    given = [next_device_variables() for _ in range(3)]
    assert [g["MUJOCO_EGL_DEVICE_ID"] for g in given] == ["0", "1", "0"]
    assert [g["EGL_VISIBLE_DEVICES"] for g in given] == ["0", "1", "0"]
    assert given[1]["BETTERBENCH_EGL_DEVICES"] == "1,0"


def test_a_worker_begins_with_its_own_device_and_hands_the_others_on(four, monkeypatch):
    kept = {n: os.environ.get(n) for n in ("MUJOCO_EGL_DEVICE_ID", "BETTERBENCH_EGL_DEVICES", "EGL_VISIBLE_DEVICES")}
    try:
        take_device(1)
        assert os.environ["MUJOCO_EGL_DEVICE_ID"] == "1"
        assert [next_device_variables()["MUJOCO_EGL_DEVICE_ID"] for _ in range(3)] == ["1", "0", "1"]
    finally:
        for name, value in kept.items():
            os.environ.pop(name, None)
            if value is not None:
                os.environ[name] = value


def test_a_device_that_the_user_names_is_that_of_all(four, monkeypatch):
    monkeypatch.setenv("MUJOCO_EGL_DEVICE_ID", "4")
    assert {next_device_variables()["MUJOCO_EGL_DEVICE_ID"] for _ in range(5)} == {"4"}


@pytest.mark.parametrize(
    ("visible", "numbers"),
    [
        ("1", (0,)),
        ("0,1", (0, 1)),
        ("3,2", (3, 4)),
        ("GPU-22222222", (1,)),
        ("gpu-22222222-0000-0000-0000-000000000000,GPU-1", (0, 1)),
        ("", (0, 1)),
        ("7", (0, 1)),
        ("MIG-77", (0, 1)),
        ("NoDevFiles", (0, 1)),
    ],
)
def test_the_cards_of_the_job_are_taken_where_they_can_be_told(four, visible, numbers):
    assert alike(four, {"CUDA_VISIBLE_DEVICES": visible}) == numbers


@pytest.mark.parametrize("backend", ["osmesa", "glfw", "off"])
def test_another_back_end_has_no_devices(four, monkeypatch, backend):
    monkeypatch.setenv("MUJOCO_GL", backend)
    monkeypatch.setenv("MUJOCO_EGL_DEVICE_ID", "nonsense")
    assert drawing_devices() == ()
    assert next_device_variables() == {}


@pytest.mark.parametrize(
    ("chosen", "count", "said"),
    [
        ("7", 1, "_ID: it is 7, and this machine has one EGL device, number 0. Unset it, or set it to 0."),
        ("-1", 3, "it is -1, and EGL has the devices 0 to 2 here. Unset it, or set it to a number from 0 to 2."),
        ("", 1, "MUJOCO_EGL_DEVICE_ID: it is empty; this machine has one EGL device"),
        ("GPU-5ebe9f43", 2, "'GPU-5ebe9f43' is not the number of an EGL device; EGL has the devices 0 to 1 here."),
        ("0,1", 2, "'0,1' is not the number of an EGL device"),
    ],
)  # fmt: skip
def test_a_wrong_device_is_named_with_what_to_set(four, monkeypatch, chosen, count, said):
    monkeypatch.setattr(devices, "device_count", lambda: count)
    monkeypatch.setenv("MUJOCO_EGL_DEVICE_ID", chosen)
    with pytest.raises(GraphicsError) as caught:
        drawing_devices()
    assert said in str(caught.value)
    assert "apt-get" not in str(caught.value)
    take_device(0)  # a run that draws nothing goes on
    assert os.environ["MUJOCO_EGL_DEVICE_ID"] == chosen


LISTED = "from betterbench.sim.graphics.devices import egl_devices, drawing_devices as d; import json; "
LISTED += "print(json.dumps([[e.number, *e.draws] for e in egl_devices()] + [d()]))"


@pytest.mark.skipif(gl_backend() != "egl", reason="EGL is not installed")
def test_two_devices_of_egl_itself_are_found_and_both_are_used(two_renderers, tmp_path):
    environment = {k: v for k, v in os.environ.items() if not k.startswith(("MUJOCO_EGL", "BETTERBENCH_EGL"))}
    done = subprocess.run(
        [sys.executable, "-c", LISTED], env={**environment, **two_renderers}, check=True, capture_output=True, text=True
    )
    first, second, numbers = json.loads(done.stdout)
    assert (first[0], second[0], numbers) == (0, 1, [0, 1])
    assert first[1:] == second[1:]
    assert first[2]
