"""Extras: each has a lock that serves it, messages name the command that works here, and no other text has another."""

from __future__ import annotations

import importlib.util
import os
import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.version import Version
from tests.looping import each

from betterbench import installation
from betterbench.cli.checks import run_checks
from betterbench.errors import MissingDependencyError, UnknownNameError
from betterbench.installation import EXTRAS, extra_command, missing_extra, package_command, requirements_of

ROOT = Path(__file__).resolve().parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
OFFERED = sorted(name for name in PROJECT["optional-dependencies"] if name != "dev")
INSTALL_LIMIT_S = 3600


@pytest.fixture(scope="module")
def tool():
    spec = importlib.util.spec_from_file_location("setup_environment", ROOT / "tools" / "setup_environment.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def pins(tool, text, python):
    """The versions that a list of packages pins for Linux on x86-64 and a version of Python."""
    found = {}
    for entries in tool.entries_of(text).values():
        for entry in entries:
            pin = Requirement(entry.partition("\\")[0].strip())
            where = {
                "python_version": python, "python_full_version": f"{python}.7", "sys_platform": "linux",
                "platform_machine": "x86_64", "implementation_name": "cpython", "platform_system": "Linux",
            }  # fmt: skip
            if pin.marker is None or pin.marker.evaluate(where):
                (version,) = pin.specifier
                assert pin.name not in found, f"{pin.name} is pinned twice"
                found[pin.name] = Version(version.version)
    return found


def test_the_helper_knows_every_extra_of_the_package(tool):
    assert sorted(EXTRAS) == OFFERED
    assert sorted(tool.extra_names()) == OFFERED


@each("python", ["3.11", "3.12", "3.13"])
@each("extra", OFFERED)
def test_a_lock_serves_every_extra_beside_the_developers_packages(tool, extra, python):
    requirements = [Requirement(text) for text in PROJECT["optional-dependencies"][extra]]
    for text in tool.package_lists("dev", (extra,)):
        pinned = pins(tool, text, python)
        for requirement in requirements:
            if requirement.marker is None or requirement.marker.evaluate({"python_version": python}):
                assert requirement.specifier.contains(pinned[requirement.name.lower()]), requirement
        for text_of_core in PROJECT["dependencies"]:
            core = Requirement(text_of_core)
            assert core.specifier.contains(pinned[core.name]), core


def test_extras_that_share_a_package_agree_on_it(tool):
    for python in ("3.11", "3.12"):
        (text,) = tool.package_lists("dev", tuple(OFFERED))
        pinned = pins(tool, text, python)
        for extra in OFFERED:
            for requirement in map(Requirement, PROJECT["optional-dependencies"][extra]):
                if requirement.marker is None or requirement.marker.evaluate({"python_version": python}):
                    assert requirement.specifier.contains(pinned[requirement.name.lower()]), (python, requirement)
        assert str(pinned["torch"]).startswith("2.10")  # as LeRobot bounds it
        assert not any(name.endswith("-cu13") for name in pinned)


def test_without_a_graphics_card_the_build_for_the_processor_comes_first(tool, monkeypatch, tmp_path):
    monkeypatch.setattr(tool, "NVIDIA_DEVICES", (tmp_path / "none",))
    small, whole = (pins(tool, text, "3.11") for text in tool.package_lists("dev", ("train",)))
    assert (str(small["torch"]), str(whole["torch"])) == ("2.13.0+cpu", "2.13.0")
    assert not any(name.startswith("nvidia-") for name in small)
    assert any(name.startswith("nvidia-") for name in whole)
    (tmp_path / "none").touch()
    assert len(tool.package_lists("dev", ("train",))) == 1
    assert len(tool.package_lists("dev", ("view",))) == 1


@pytest.fixture
def environment(tool, tmp_path, monkeypatch):
    """An environment of the set-up whose packages are not really installed; gives the lists that would be."""
    asked = []
    monkeypatch.setattr(tool, "VENV", tmp_path)
    monkeypatch.setattr(tool, "VENV_PYTHON", Path(sys.executable))
    monkeypatch.setattr(tool, "STAMP", tmp_path / "stamp")
    monkeypatch.setattr(tool, "EXTRAS_NOTE", tmp_path / "extras")
    monkeypatch.setattr(tool, "find_uv", lambda _: Path("uv"))
    site = tmp_path / "lib" / "python3" / "site-packages"
    (site / "betterbench_calibration-0.1.0.dist-info").mkdir(parents=True)

    def run(command, **_):
        words = list(map(str, command))
        if "-r" in words:
            asked.append(Path(words[words.index("-r") + 1]).read_text(encoding="utf-8"))
        return subprocess.CompletedProcess(words, 0, stdout="")

    monkeypatch.setattr(tool, "run", run)
    return asked


def test_the_environment_keeps_its_extras(tool, environment):
    tool.fill("dev", tool.chosen_extras("train"))
    assert tool.is_filled("dev", tool.chosen_extras(""))
    assert tool.is_filled("dev", tool.chosen_extras("train"))
    extras = tool.chosen_extras("view,  wandb")
    assert extras == ("train", "view", "wandb")
    assert not tool.is_filled("dev", extras)
    tool.fill("dev", extras)
    assert tool.is_filled("dev", tool.chosen_extras(""))
    assert not tool.is_filled("runtime", ("wandb",))
    for name in ("torch", "safetensors", "rerun-sdk", "wandb", "mujoco"):
        assert f"\n{name}==" in environment[-1]
    with pytest.raises(tool.SetupError, match=r"no extra 'trian'. The extras are: .*train"):
        tool.chosen_extras("trian")


def test_an_index_without_the_build_for_the_processor_is_no_obstacle(tool, environment, monkeypatch):
    monkeypatch.setattr(tool, "NVIDIA_DEVICES", ())
    tried, accepting = [], tool.run

    def run(command, **options):
        done = accepting(command, **options)
        if "-r" in done.args:
            tried.append("--torch-backend" in done.args)
            done.returncode = int("+cpu" in environment[-1])
        return done

    monkeypatch.setattr(tool, "run", run)
    tool.fill("dev", ("train",))
    assert tried == [False, True, False]
    assert "nvidia-cublas==" in environment[-1]


# ---------------------------------------------------------------------------------------------- the command in messages


def installed_as(monkeypatch, tmp_path, *, clone=False, pip=False, uv=False, ensurepip=False, url=None):
    """Pretend another kind of installation."""
    there = {"pip": pip, "ensurepip": ensurepip}
    real = installation._is_there
    monkeypatch.setattr(installation, "_is_there", lambda m: there[m] if m in there else real(m))
    monkeypatch.setattr(shutil, "which", lambda name, *_: "/usr/bin/uv" if name == "uv" and uv else None)
    monkeypatch.setattr(installation, "_uv", lambda: "uv" if uv else None)
    monkeypatch.setattr(installation, "clone_folder", lambda: tmp_path if clone else None)
    monkeypatch.setattr(installation, "_wheel", lambda: url)
    monkeypatch.setattr(sys, "executable", "/opt/my env/bin/python")


@pytest.mark.parametrize(
    ("kind", "command"),
    [
        ({"pip": True}, "'/opt/my env/bin/python' -m pip install 'rerun-sdk>=0.41'"),
        ({"pip": True, "url": Path("/w/b-1.whl")}, "'/opt/my env/bin/python' -m pip install '/w/b-1.whl[view]'"),
        ({"uv": True}, "uv pip install --python '/opt/my env/bin/python' 'rerun-sdk>=0.41'"),
        ({"uv": True, "pip": True}, "'/opt/my env/bin/python' -m pip install 'rerun-sdk>=0.41'"),
        (
            {"ensurepip": True},
            "'/opt/my env/bin/python' -m ensurepip && '/opt/my env/bin/python' -m pip install 'rerun-sdk>=0.41'",
        ),
        ({}, "uv pip install --python '/opt/my env/bin/python' 'rerun-sdk>=0.41' (this Python has no pip; install"),
        ({"clone": True, "uv": True}, "uv pip install --python '/opt/my env/bin/python' --editable '"),
    ],
)
def test_the_command_is_that_of_this_installation(monkeypatch, tmp_path, kind, command):
    installed_as(monkeypatch, tmp_path, **kind)
    assert extra_command("view").startswith(command)
    assert extra_command("view") in str(missing_extra("Rerun is missing", "view"))


def test_a_clone_installs_from_its_locks(monkeypatch, tmp_path):
    clone = tmp_path / "my clone"
    (clone / ".venv").mkdir(parents=True)
    monkeypatch.setattr(installation, "clone_folder", lambda: clone)
    monkeypatch.setattr(sys, "prefix", str(clone / ".venv"))
    assert extra_command("train") == f"make -C '{clone}' setup EXTRAS=train"
    monkeypatch.chdir(clone)
    assert extra_command("train") == "make setup EXTRAS=train"


def test_this_installation_is_a_clone():
    assert installation.clone_folder() == ROOT


@each("extra", OFFERED)
def test_what_an_extra_asks_for_is_read_from_the_installed_package(extra):
    own = {"python_version": f"{sys.version_info.major}.{sys.version_info.minor}"}
    wanted = [Requirement(text) for text in PROJECT["optional-dependencies"][extra]]
    expected = {str(r).partition(";")[0].strip() for r in wanted if r.marker is None or r.marker.evaluate(own)}
    assert {str(Requirement(text)) for text in requirements_of(extra)} == expected


def test_an_unknown_extra_is_a_mistake_of_ours():
    with pytest.raises(UnknownNameError, match="train"):
        extra_command("trian")


def test_packages_of_others_are_installed_by_what_is_here():
    assert re.search(r"pip install .*'lerobot\[feetech\]'$", package_command("lerobot[feetech]"))
    assert "/other/python" in package_command("x", python="/other/python")


def test_the_doctor_names_every_extra_with_its_command(monkeypatch):
    monkeypatch.setattr("betterbench.cli.checks.CHECKS", {})
    monkeypatch.setattr(installation, "_is_there", lambda module: module == "viser")
    found = {check.name: check for check in run_checks()}
    for extra in OFFERED:
        check = found[f"extra {extra}"]
        assert check.works
        assert (check.cure == extra_command(extra)) == (extra != "teleop"), check


# What is written for people: sources without the helper itself, documentation, and what the build runs.
TEXTS = [
    *(ROOT / "src").rglob("*.py"),
    *(ROOT / "src").rglob("*.jinja"),
    *(ROOT / "docs").rglob("*.md"),
    *(ROOT / "tools").glob("*.py"),
    *(ROOT / "packages").rglob("*.py"),
    *(ROOT / name for name in ("README.md", "CONTRIBUTING.md", "Dockerfile")),
]


def test_no_other_text_says_how_an_extra_is_installed():
    dead = re.compile(r"""pip install[^\n]*(betterbench\[|\[feetech\])|['"]betterbench\[[a-z]""")
    for file in TEXTS:
        found = dead.search(file.read_text(encoding="utf-8"))
        assert not found, f"{file}: {found and found.group()}"


def test_every_missing_package_is_said_by_the_helper():
    """An error about a missing package that names no command, or spells one, is a cure that nobody tries."""
    for file in (ROOT / "src" / "betterbench").rglob("*.py"):
        text = file.read_text(encoding="utf-8")
        if file.name == "installation.py":
            continue
        assert "-m pip install" not in text, file
        assert not re.search(r"[Rr]un:? (uv )?pip install", text), file
    assert issubclass(type(missing_extra("x", "view")), MissingDependencyError)


@pytest.mark.parametrize(("file", "words"), [("docs", "make setup EXTRAS=")])
def test_the_documentation_says_the_word_of_make_for_every_extra(file, words):
    text = "".join(page.read_text(encoding="utf-8") for page in (ROOT / file).glob("*.md"))
    named = {name for found in re.findall(rf'{words}(?:"([^"]*)"|([a-z-]+))', text) for name in " ".join(found).split()}
    assert named >= set(OFFERED) - {"docs"}
    assert named <= set(OFFERED)


@pytest.mark.slow
@pytest.mark.network
@pytest.mark.parametrize("extra", OFFERED)
def test_the_command_installs_the_extra(tmp_path_factory, extra):
    """In a copy of the clone: an environment of its own, which takes one extra after the other and keeps them."""
    clone = tmp_path_factory.getbasetemp() / "clone"
    if not clone.exists():
        listed = subprocess.check_output(["git", "-C", ROOT, "ls-files"], text=True)  # noqa: S607
        for name in listed.splitlines():
            if name.partition("/")[0] in ("src", "requirements", "tools", name):
                (clone / name).parent.mkdir(parents=True, exist_ok=True)
                shutil.copy(ROOT / name, clone / name)
    python = clone / ".venv" / "bin" / "python"
    words = ["make", "-C", clone, "setup", f"EXTRAS={extra}"]
    done = subprocess.run(words, check=False, capture_output=True, text=True, timeout=INSTALL_LIMIT_S)
    assert done.returncode == 0, done.stderr[-2000:]
    code = "from betterbench.installation import EXTRAS; import importlib, sys\n"
    code += "for name in sys.argv[1:]:\n    for module in EXTRAS[name].modules: importlib.import_module(module)\n"
    installed = (clone / ".venv" / "betterbench-extras").read_text(encoding="utf-8").split()
    assert extra in installed
    shown = subprocess.run([python, "-c", code, *installed], check=False, capture_output=True, text=True)
    assert shown.returncode == 0, shown.stderr[-2000:]


@pytest.mark.slow
@pytest.mark.network
def test_a_wheel_without_a_clone_installs_an_extra_by_the_command_that_it_prints(tool, tmp_path):
    env = {**tool.uv_environment(os.environ), "HOME": str(tmp_path)}
    uv = str(tool.find_uv(env))
    place = tmp_path / "my env"
    python = str(place / "bin" / "python")
    subprocess.run([uv, "build", "--wheel", "-q", "--out-dir", tmp_path / "dist", ROOT], env=env, check=True)
    (wheel,) = (tmp_path / "dist").glob("*.whl")
    subprocess.run([uv, "venv", "-q", "--python", sys.executable, place], env=env, check=True)
    install = [uv, "pip", "install", "-q", "--python", python]
    subprocess.run([*install, "--no-deps", "-r", ROOT / "requirements" / "runtime.lock"], env=env, check=True)
    subprocess.run([*install, "--no-deps", wheel], env=env, check=True)
    env["PATH"] = f"{Path(uv).parent}{os.pathsep}{env['PATH']}"
    ask = "from betterbench.installation import extra_command; print(extra_command('tensorboard'))"
    for _ in range(2):  # with the wheel, and after it is gone
        command = subprocess.check_output([python, "-c", ask], env=env, cwd=tmp_path, text=True).strip()
        assert ("[tensorboard]" in command) == wheel.exists()
        subprocess.run(command, shell=True, env=env, cwd=tmp_path, check=True)  # noqa: S602 - as a person pastes it
        subprocess.run([python, "-c", "import tensorboardX"], check=True, cwd=tmp_path)
        subprocess.run([uv, "pip", "uninstall", "-q", "--python", python, "tensorboardX"], env=env, check=True)
        wheel.unlink(missing_ok=True)
