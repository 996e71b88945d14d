"""The set-up script reads pip's configuration as pip does, and the repository names no package index."""

from __future__ import annotations

import importlib.util
import os
import re
import sys
from pathlib import Path
from types import ModuleType

import pytest
from tests.looping import each

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def setup_environment() -> ModuleType:
    spec = importlib.util.spec_from_file_location("setup_environment", ROOT / "tools" / "setup_environment.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture
def environ(tmp_path: Path) -> dict[str, str]:
    """An environment without the pip configuration of the person who runs the tests."""
    return {"HOME": str(tmp_path), "XDG_CONFIG_DIRS": str(tmp_path / "xdg"), "PATH": os.defpath}


def write(file: Path, text: str) -> Path:
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(text, encoding="utf-8")
    return file


def test_later_sources_of_pip_configuration_win(
    setup_environment: ModuleType, environ: dict[str, str], tmp_path: Path
) -> None:
    write(tmp_path / ".config/pip/pip.conf", "[global]\nindex-url = https://user.invalid/simple\ntimeout = 7\n")
    assert setup_environment.pip_settings(environ)["index-url"] == "https://user.invalid/simple"
    chosen = write(tmp_path / "chosen.conf", "[global]\nindex_url = https://chosen.invalid/simple\n")
    environ["PIP_CONFIG_FILE"] = str(chosen)
    settings = setup_environment.pip_settings(environ)
    assert (settings["index-url"], settings["timeout"]) == ("https://chosen.invalid/simple", "7")
    environ["PIP_INDEX_URL"] = "https://variable.invalid/simple"
    assert setup_environment.pip_settings(environ)["index-url"] == "https://variable.invalid/simple"


def test_devnull_switches_every_file_off(
    setup_environment: ModuleType, environ: dict[str, str], tmp_path: Path
) -> None:
    write(tmp_path / ".pip/pip.conf", "[global]\nindex-url = https://user.invalid/simple\n")
    environ["PIP_CONFIG_FILE"] = os.devnull
    assert setup_environment.pip_settings(environ) == {"config-file": os.devnull}


def test_uv_gets_every_index_certificate_and_proxy(setup_environment: ModuleType, environ: dict[str, str]) -> None:
    environ |= {
        "PIP_CONFIG_FILE": os.devnull,
        "PIP_INDEX_URL": "https://main.invalid/simple",
        "PIP_EXTRA_INDEX_URL": "https://a.invalid/simple\n  https://b.invalid/simple",
        "PIP_FIND_LINKS": "/wheels/a /wheels/b",
        "PIP_CERT": "/etc/ssl/certs/own.crt",
        "PIP_PROXY": "http://proxy.invalid:3128",
        "PIP_TRUSTED_HOST": "main.invalid",
    }
    env = setup_environment.uv_environment(environ)
    assert env["UV_DEFAULT_INDEX"] == "https://main.invalid/simple"
    assert env["UV_INDEX"] == "https://a.invalid/simple https://b.invalid/simple"
    assert env["UV_FIND_LINKS"] == "/wheels/a,/wheels/b"
    assert env["SSL_CERT_FILE"] == "/etc/ssl/certs/own.crt"
    assert env["HTTPS_PROXY"] == env["HTTP_PROXY"] == "http://proxy.invalid:3128"
    assert env["UV_INSECURE_HOST"] == "main.invalid"
    locking = setup_environment.uv_environment(environ, main_index_only=True)
    assert locking["UV_DEFAULT_INDEX"] == "https://main.invalid/simple"
    assert not {"UV_INDEX", "UV_FIND_LINKS"} & locking.keys()


def test_what_the_caller_set_for_uv_stays(setup_environment: ModuleType, environ: dict[str, str]) -> None:
    environ |= {
        "PIP_CONFIG_FILE": os.devnull,
        "PIP_INDEX_URL": "https://pip.invalid/simple",
        "UV_DEFAULT_INDEX": "https://uv.invalid/simple",
        "VIRTUAL_ENV": "/somewhere/else",
    }
    env = setup_environment.uv_environment(environ)
    assert env["UV_DEFAULT_INDEX"] == "https://uv.invalid/simple"
    assert "VIRTUAL_ENV" not in env


def test_a_broken_pip_configuration_is_one_clear_error(
    setup_environment: ModuleType, environ: dict[str, str], tmp_path: Path
) -> None:
    environ["PIP_CONFIG_FILE"] = str(write(tmp_path / "broken.conf", "index-url = no section\n"))
    with pytest.raises(setup_environment.SetupError, match=r"broken\.conf: pip's configuration cannot be read"):
        setup_environment.pip_settings(environ)


def test_the_stamp_follows_the_lock(
    setup_environment: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("dev", "runtime", "bootstrap"):
        write(tmp_path / f"{name}.lock", name)
    monkeypatch.setattr(setup_environment, "LOCKS", tmp_path)
    monkeypatch.setattr(setup_environment, "BOOTSTRAP_LOCK", tmp_path / "bootstrap.lock")
    monkeypatch.setattr(setup_environment, "STAMP", tmp_path / "stamp")
    monkeypatch.setattr(setup_environment, "VENV_PYTHON", Path(sys.executable))
    assert not setup_environment.is_filled("dev")
    write(tmp_path / "stamp", setup_environment.fingerprint("dev"))
    assert setup_environment.is_filled("dev")
    assert setup_environment.is_filled("runtime")
    write(tmp_path / "dev.lock", "dev, changed")
    assert not setup_environment.is_filled("dev")


def test_a_newer_uv_than_the_oldest_is_accepted(setup_environment: ModuleType, tmp_path: Path) -> None:
    def fake(version: str) -> Path:
        uv = write(tmp_path / version / "uv", f"#!/bin/sh\necho 'uv {version}'\n")
        uv.chmod(0o755)
        return uv

    assert setup_environment.uv_works(fake("0.10.0"))
    assert not setup_environment.uv_works(fake("0.7.22"))
    assert not setup_environment.uv_works(tmp_path / "missing" / "uv")


@each("lock", sorted((ROOT / "requirements").glob("*.lock")), name=lambda lock: lock.name)
def test_locks_pin_every_package_with_a_hash_and_name_no_host(lock: Path) -> None:
    text = lock.read_text(encoding="utf-8")
    assert not re.search(r"://| @ |^-", text, flags=re.MULTILINE)
    entries = re.split(r"\n(?=[a-z0-9])", text.strip())
    assert len(entries) > (
        0 if lock.name.startswith(("extra-", "world-libero-plus.")) else 5
    )  # beside others, or alone
    for entry in entries:
        assert re.match(r"[a-z0-9._-]+==[^ ]+", entry), entry
        assert "--hash=sha256:" in entry, entry


def test_the_developers_lock_agrees_with_the_runtime_lock() -> None:
    def pins(name: str) -> set[str]:
        text = (ROOT / "requirements" / f"{name}.lock").read_text(encoding="utf-8")
        return set(re.findall(r"^([a-z0-9._-]+==[^ ]+)", text, flags=re.MULTILINE))

    assert pins("runtime") <= pins("dev")


def test_another_build_takes_the_place_of_a_release_on_one_platform(setup_environment: ModuleType) -> None:
    lock = "sympy==1.0 \\\n    --hash=sha256:a\ntorch==2.0 \\\n    --hash=sha256:b\n"
    assert setup_environment.with_local_build(lock, "torch", "+cpu", "c") == (
        "sympy==1.0 \\\n    --hash=sha256:a\n"
        "torch==2.0+cpu ; sys_platform == 'linux' and platform_machine == 'x86_64' \\\n    --hash=sha256:c\n"
        "torch==2.0 ; sys_platform != 'linux' or platform_machine != 'x86_64' \\\n    --hash=sha256:b\n"
    )
    with pytest.raises(setup_environment.SetupError, match="jax"):
        setup_environment.with_local_build(lock, "jax", "+cpu", "c")


def test_each_other_build_stands_in_its_lock(setup_environment: ModuleType) -> None:
    for name, builds in setup_environment.LOCAL_BUILDS.items():
        text = (ROOT / "requirements" / f"{name}.lock").read_text(encoding="utf-8")
        for package, (local, digest) in builds.items():
            assert re.search(rf"^{package}==[^ ]+{re.escape(local)} ;.*\n *--hash=sha256:{digest}$", text, re.MULTILINE)


def interpreter(folder: Path, seconds: float, *, said: str | None = None) -> Path:
    """Write a program that says of itself what an interpreter of this version says, and return its path."""
    program = folder / f"python{sys.version_info.major}.{sys.version_info.minor}"
    folder.mkdir()
    kind = f"cpython {sys.version_info.major} {sys.version_info.minor} {os.uname().machine}"
    program.write_text(f"#!/bin/sh\necho {program}\necho {said or kind}\necho {seconds}\n")
    program.chmod(0o755)
    return program


@pytest.mark.parametrize(
    ("seconds", "said", "taken"),
    [
        (0.6, None, True),
        (0.95, None, False),  # no more than noise
        (1.4, None, False),
        (0.6, f"cpython {sys.version_info.major} 99 {os.uname().machine}", False),
        (0.6, f"pypy {sys.version_info.major} {sys.version_info.minor} {os.uname().machine}", False),
        (0.6, "No module named sqlite3", False),
    ],
)
def test_another_build_of_the_same_python_is_taken_if_it_is_clearly_faster(
    setup_environment: ModuleType,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    *,
    seconds: float,
    said: str | None,
    taken: bool,
) -> None:
    this = interpreter(tmp_path / "this", 1.0)
    other = interpreter(tmp_path / "other", seconds, said=said)
    broken = tmp_path / "broken"
    broken.mkdir()
    (broken / other.name).write_text("no program")
    (broken / other.name).chmod(0o755)
    monkeypatch.setattr(sys, "executable", str(this))
    places = [tmp_path / "nowhere", broken, this.parent, other.parent]
    assert setup_environment.chosen_python(named=False, places=places) == str(other if taken else this)
    assert setup_environment.chosen_python(named=True, places=places) == str(this)
    assert setup_environment.chosen_python(named=False, places=[broken, this.parent]) == str(this)


def test_the_fastest_of_several_builds_is_taken(
    setup_environment: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    names = {"this": 1.0, "fast": 0.7, "fastest": 0.5, "slow": 2.0}
    builds = {name: interpreter(tmp_path / name, seconds) for name, seconds in names.items()}
    monkeypatch.setattr(sys, "executable", str(builds["this"]))
    places = [build.parent for build in builds.values()]
    assert setup_environment.chosen_python(named=False, places=places) == str(builds["fastest"])


def test_this_python_is_measured_and_has_all_parts_of_its_library(setup_environment: ModuleType) -> None:
    executable, seconds = setup_environment.measured(sys.executable)
    assert executable == sys.executable
    assert 0.0 < seconds < 5.0
