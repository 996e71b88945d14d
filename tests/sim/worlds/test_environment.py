"""The environment of a simulator's process, which is made here and not the user's."""

import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from betterbench.errors import GraphicsError
from betterbench.evaluation import evaluate
from betterbench.evaluation.planning.world_plan import make_world_plan
from betterbench.sim.graphics import devices
from betterbench.sim.graphics.devices import EglDevice
from betterbench.sim.worlds.environment import python_environment, simulator_environment
from betterbench.sim.worlds.installation import start_code

CARD = "GPU-5ebe9f43-ac33-420d-1628-8a0dd6a1ffc6"
SLURM = [
    {"CUDA_VISIBLE_DEVICES": "3"},
    {"CUDA_VISIBLE_DEVICES": ""},
    {"CUDA_VISIBLE_DEVICES": CARD, "CUDA_DEVICE_ORDER": "PCI_BUS_ID"},
    {"CUDA_VISIBLE_DEVICES": "3", "MUJOCO_EGL_DEVICE_ID": "0"},
    {"NVIDIA_VISIBLE_DEVICES": "none", "ROCR_VISIBLE_DEVICES": "1"},
    {"PYTHONHOME": "/nowhere", "PYTHONPATH": "/nowhere", "PYTHONOPTIMIZE": "2", "VIRTUAL_ENV": "/nowhere"},
    {"ROBOSUITE_PATH": "/nowhere", "LIBERO_CONFIG_PATH": "/nowhere", "DISPLAY": ":99", "PYOPENGL_PLATFORM": "osmesa"},
]
"""Variables of the user's that broke a simulator, or could."""


@pytest.fixture
def one_device(monkeypatch):
    for name in ("MUJOCO_EGL_DEVICE_ID", "BETTERBENCH_EGL_DEVICES", "EGL_VISIBLE_DEVICES"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("MUJOCO_GL", "egl")
    monkeypatch.setattr(devices, "device_count", lambda: 1)
    monkeypatch.setattr(devices, "egl_devices", lambda: (EglDevice(0, ("", "", "")),))


@pytest.mark.parametrize("given", SLURM, ids="-".join)
def test_a_simulator_gets_no_variable_that_is_for_another_program(one_device, monkeypatch, given):
    for name, value in given.items():
        monkeypatch.setenv(name, value)
    made = simulator_environment()
    assert (made["MUJOCO_GL"], made["MUJOCO_EGL_DEVICE_ID"], made["EGL_VISIBLE_DEVICES"]) == ("egl", "0", "0")
    assert not made.keys() & (given.keys() - {"MUJOCO_EGL_DEVICE_ID"})
    assert made["PATH"] == os.environ["PATH"]


def test_a_user_without_a_home_gets_one_that_holds_nothing(one_device, monkeypatch):
    monkeypatch.delenv("HOME")
    assert simulator_environment()["HOME"] == "/nonexistent"


@pytest.mark.parametrize("backend", ["glfw", "off", "", "egl"])
def test_a_simulator_draws_with_egl_unless_osmesa_is_chosen(one_device, monkeypatch, backend):
    monkeypatch.setenv("MUJOCO_GL", backend)
    assert simulator_environment()["MUJOCO_GL"] == "egl"
    monkeypatch.setenv("MUJOCO_GL", "osmesa")
    made = simulator_environment()
    assert made["MUJOCO_GL"] == "osmesa"
    assert "MUJOCO_EGL_DEVICE_ID" not in made


def test_simulators_are_spread_over_devices_and_a_wrong_one_is_named(one_device, monkeypatch):
    several = tuple(EglDevice(number, ("NVIDIA", "A100", "4.6")) for number in range(3))
    monkeypatch.setattr(devices, "egl_devices", lambda: several)
    monkeypatch.setattr(devices, "device_count", lambda: 3)
    monkeypatch.setattr(devices, "_started", iter(range(9)))
    assert [simulator_environment()["MUJOCO_EGL_DEVICE_ID"] for _ in range(4)] == ["0", "1", "2", "0"]
    monkeypatch.setenv("MUJOCO_EGL_DEVICE_ID", "2")
    assert [simulator_environment()["MUJOCO_EGL_DEVICE_ID"] for _ in range(2)] == ["2", "2"]
    monkeypatch.setenv("MUJOCO_EGL_DEVICE_ID", "3")
    with pytest.raises(GraphicsError, match="EGL has the devices 0 to 2 here"):
        simulator_environment()


def test_results_do_not_depend_on_the_devices(one_device, fake_command, tmp_path, monkeypatch):
    plan = make_world_plan("noop", suite="libero_object", command=fake_command, tasks=["3"], trials=2)
    plan = replace(plan, world=replace(plan.world, protocol=replace(plan.world.protocol, steps={"libero_object": 12})))

    def records(name):
        run = evaluate(plan, tmp_path / name, workers=1, envs=2)
        return {p.relative_to(run.path): p.read_bytes() for p in sorted(run.path.glob("records/**/*.parquet"))}

    alone = records("one device")
    several = tuple(EglDevice(number, ("NVIDIA", "A100", "4.6")) for number in range(2))
    monkeypatch.setattr(devices, "egl_devices", lambda: several)
    monkeypatch.setenv("CUDA_VISIBLE_DEVICES", "3")
    assert len(alone) == 2
    assert records("several devices") == alone


def test_pip_gets_no_variable_that_leads_out_of_the_environment():
    given = {"PIP_USER": "1", "PIP_INDEX_URL": "x", "PYTHONHOME": "/nowhere", "VIRTUAL_ENV": "/nowhere", "PATH": "p"}
    assert python_environment(given) == {"PIP_INDEX_URL": "x", "PATH": "p"}


ROBOSUITE = {
    "robosuite/__init__.py": "from robosuite.utils.log_utils import LOGGER\nfrom robosuite import macros\n",
    "robosuite/macros.py": "CONSOLE_LOGGING_LEVEL = 'WARN'\nFILE_LOGGING_LEVEL = 'DEBUG'\nCACHE_NUMBA = True\n",
    "robosuite/utils/__init__.py": "",
    "robosuite/utils/log_utils.py": (
        "import logging\nimport robosuite.macros as macros\nLOGGER = logging.getLogger('robosuite')\n"
        "if macros.FILE_LOGGING_LEVEL is not None:\n    LOGGER.addHandler(logging.FileHandler({log!r}))\n"
    ),
}
"""The way by which robosuite 1.4.0 opens its log file when it is imported."""


def test_the_log_file_of_another_user_is_not_opened(tmp_path):
    """A folder stands for the file: neither can be opened by this user, whoever runs the test."""
    log = tmp_path / "robosuite.log"
    log.mkdir()
    for name, text in ROBOSUITE.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text.replace("{log!r}", repr(str(log))))
    plain = subprocess.run([sys.executable, "-c", "import robosuite"], cwd=tmp_path, check=False, capture_output=True)
    assert b"robosuite.log" in plain.stderr
    begin = start_code("betterbench.sim.worlds.libero.simulator").replace(
        "import main\nmain()", "import set_robosuite_macros"
    )
    code = f"{begin}set_robosuite_macros()\nimport robosuite\nassert robosuite.macros.FILE_LOGGING_LEVEL is None"
    subprocess.run([sys.executable, "-c", code], cwd=tmp_path, check=True, capture_output=True)
    assert Path(log).is_dir()
