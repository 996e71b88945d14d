"""Environments of their own for tests of packages that cannot share one with this project, made once for each lock."""

from __future__ import annotations

import fcntl
import hashlib
import importlib.metadata
import importlib.util
import os
import subprocess
import sys
import sysconfig
from collections.abc import Sequence
from pathlib import Path

import platformdirs
import pytest

ROOT = Path(__file__).resolve().parents[1]
INSTALL_LIMIT_S = 1200


def locked_python(
    name: str,
    *,
    shared: bool = False,
    check: str = "pass",
    modules: dict[str, str] | None = None,
    built: Sequence[str] = (),
) -> Path:
    """Return the Python of an environment with the packages of ``requirements/NAME.lock``; skip without them.

    Args:
        name: Name of the lock.
        shared: Whether the other packages of ``dev.lock`` come from this environment; those of the lock win.
        check: Code that must run there.
        modules: Further modules: their code by name.
        built: Packages that are built from source, with tools of the lock.
    """
    lock = (ROOT / "requirements" / f"{name}.lock").read_text(encoding="utf-8")
    here = sysconfig.get_path("purelib") if shared else ""
    made_from = "\n".join((sys.version, here, check, repr(modules), repr(built), lock))
    digest = hashlib.sha256(made_from.encode()).hexdigest()[:16]
    home = Path(platformdirs.user_cache_dir("betterbench")) / "environments" / f"{name}-{digest}"
    home.parent.mkdir(parents=True, exist_ok=True)
    with home.with_suffix(".lock").open("w") as handle:
        fcntl.flock(handle, fcntl.LOCK_EX)  # test processes run side by side
        if not (home / "complete").exists():
            _fill(name, home, here, check, modules=modules or {}, built=built)
    return home / "bin" / "python"


def _fill(name: str, home: Path, here: str, check: str, *, modules: dict[str, str], built: Sequence[str]) -> None:
    spec = importlib.util.spec_from_file_location("setup_environment", ROOT / "tools" / "setup_environment.py")
    assert spec is not None
    assert spec.loader is not None
    tool = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(tool)
    env, python = tool.uv_environment(os.environ), home / "bin" / "python"
    lock = ROOT / "requirements" / f"{name}.lock"
    wheels = sorted(set(tool.entries_of(lock.read_text(encoding="utf-8"))) - set(built)) if built else [":all:"]
    install = ["pip", "install", "--require-hashes", "--no-deps", "--build-constraints", str(lock)]
    install += [word for package in wheels for word in ("--only-binary", package)]
    purelib = "import sysconfig; print(sysconfig.get_path('purelib'))"

    def run(*words: str | Path) -> str:
        done = subprocess.run(words, env=env, check=True, capture_output=True, text=True, timeout=INSTALL_LIMIT_S)
        return done.stdout.strip()

    try:
        uv = tool.find_uv(env)
        run(uv, "venv", "--clear", "--python", sys.executable, home)
        run(uv, *install, "--python", python, "-r", lock)
        packages = Path(run(python, "-c", purelib))
        if here:  # after the packages of the environment itself, so that its own versions win
            shown = home / "shared"
            _link_packages(set(tool.entries_of((ROOT / "requirements" / "dev.lock").read_text("utf-8"))), here, shown)
            (packages / "zz_betterbench.pth").write_text(f"{shown}\n", encoding="utf-8")
        for module, code in modules.items():
            (packages / f"{module}.py").write_text(code, encoding="utf-8")
        run(python, "-c", check)
    except (tool.SetupError, OSError, subprocess.SubprocessError) as error:
        last = (getattr(error, "stderr", "") or str(error)).strip().splitlines()[-1:]
        pytest.skip(f"no environment of {lock.name} could be made here: {' '.join(last)}")
    (home / "complete").touch()


def _link_packages(names: set[str], here: str, into: Path) -> None:
    """Link packages into a folder, without those of extras: LeRobot uses any Transformers that it finds."""
    into.mkdir()
    for name in sorted(names):
        try:
            files = importlib.metadata.distribution(name).files or []
        except importlib.metadata.PackageNotFoundError:
            continue  # a package of another platform
        for top in sorted({file.parts[0] for file in files} - {"..", "__pycache__"}):
            if not top.endswith(".pth") and not (into / top).exists():
                (into / top).symlink_to(Path(here) / top)
