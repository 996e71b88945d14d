"""The package by which LeRobot finds our tasks: its name, its versions, its wheel, and the real LeRobot with it."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tomllib
import zipfile
from email import message_from_bytes
from pathlib import Path

import pytest

import betterbench

ROOT = Path(__file__).parents[2]
PACKAGE = ROOT / "packages" / "lerobot_env_betterbench"

sys.path[:0] = [str(ROOT / "tools"), str(ROOT / "tests" / "policies")]
from torch_environment import run_in_torch  # noqa: E402

import check_wheel  # noqa: E402
import setup_environment  # noqa: E402

DISCOVER = """
from lerobot.envs.configs import EnvConfig
from lerobot.utils.import_utils import register_third_party_plugins

before = set(EnvConfig.get_known_choices())
register_third_party_plugins()
print(*sorted(set(EnvConfig.get_known_choices()) - before))
"""


def test_its_versions_are_those_of_betterbench():
    project = tomllib.loads((PACKAGE / "pyproject.toml").read_text())["project"]
    assert project["version"] == betterbench.__version__
    assert f"betterbench=={betterbench.__version__}" in project["dependencies"]
    assert (PACKAGE / "LICENSE").read_bytes() == (ROOT / "LICENSE").read_bytes()


@pytest.fixture(scope="module")
def wheels(tmp_path_factory):
    """All wheels of the project, built as ``make wheel`` builds them."""
    env = setup_environment.uv_environment(os.environ)
    try:
        uv = setup_environment.find_uv(env)
        folder = tmp_path_factory.mktemp("dist")
        return (
            uv,
            env,
            [check_wheel.build(uv, folder / name, env, source) for name, source in check_wheel.SOURCES.items()],
        )
    except (setup_environment.SetupError, check_wheel.CheckError) as error:
        pytest.skip(f"no wheel can be built here: {error}")


@pytest.mark.slow
def test_the_wheel_has_the_name_that_lerobot_looks_for(wheels):
    (wheel,) = (path for path in wheels[2] if path.name.startswith("lerobot_env_"))
    with zipfile.ZipFile(wheel) as archive:
        names = archive.namelist()
        metadata = message_from_bytes(archive.read(next(n for n in names if n.endswith("METADATA"))))
    # LeRobot imports the module that is called like the distribution, if that begins with "lerobot_env_".
    assert metadata["Name"] == "lerobot_env_betterbench"
    assert f"{metadata['Name']}/__init__.py" in names
    assert {name.partition("/")[0] for name in names} == {
        "lerobot_env_betterbench",
        f"lerobot_env_betterbench-{betterbench.__version__}.dist-info",
    }


@pytest.fixture(scope="module")
def packages(wheels, tmp_path_factory):
    """A folder with the wheels installed, for a Python that has LeRobot 0.6 or newer."""
    python = os.environ.get("BETTER_LEROBOT_PYTHON")
    if python is None:
        pytest.skip("BETTER_LEROBOT_PYTHON names no Python with LeRobot 0.6, which needs Python 3.12")
    asked = "from importlib.metadata import version; print(version('lerobot'))"
    version = subprocess.run([python, "-c", asked], check=True, capture_output=True, text=True).stdout
    if tuple(map(int, version.split(".")[:2])) < (0, 6):
        pytest.skip(f"LeRobot {version.strip()} looks for no packages of environments")
    uv, env, built = wheels
    folder = tmp_path_factory.mktemp("packages")
    check_wheel.call(
        [uv, "pip", "install", "--quiet", "--no-deps", "--python", python, "--target", folder, *built], env=env
    )
    return folder


@pytest.mark.slow
def test_lerobot_finds_it_without_being_told(packages):
    done = run_in_torch("-c", DISCOVER, packages=packages)
    assert done.returncode == 0, done.stderr[-4000:]
    assert done.stdout.split() == ["betterbench"]


@pytest.mark.slow
def test_the_name_with_hyphens_would_not_be_found(packages, tmp_path):
    hyphens = tmp_path / "other"
    hyphens.mkdir()
    for path in packages.iterdir():
        if path.name.startswith("lerobot_env_betterbench-"):
            info = hyphens / path.name
            info.mkdir()
            text = (
                (path / "METADATA")
                .read_text()
                .replace("Name: lerobot_env_betterbench", "Name: lerobot-env-betterbench")
            )
            (info / "METADATA").write_text(text)
        else:
            (hyphens / path.name).symlink_to(path)
    done = run_in_torch("-c", DISCOVER, packages=hyphens)
    assert done.returncode == 0, done.stderr[-4000:]
    assert done.stdout.split() == []


@pytest.mark.slow
@pytest.mark.render
@pytest.mark.physics
def test_lerobot_eval_evaluates_our_tasks(packages, tmp_path):
    drive = Path(__file__).with_name("lerobot_drive.py")
    done = run_in_torch(str(drive), "installed", str(tmp_path), timeout_s=900.0, packages=packages)
    assert done.returncode == 0, done.stderr[-4000:]
    info = json.loads((tmp_path / "out" / "eval_info.json").read_text())
    # The policy never moves: T1 has the mug under the machine already, train1 has not.
    assert {name: (g["pc_success"], g["n_episodes"]) for name, g in info["per_group"].items()} == {
        "morning_coffee-T1": (100.0, 1),
        "morning_coffee-train1": (0.0, 1),
    }
