"""The tests that need torch, in an environment with the packages of ``requirements/train.lock``, made once beside the
developers' own: whatever else they import comes from there by a path file.
"""

from __future__ import annotations

import fcntl
import hashlib
import importlib.util
import os
import re
import subprocess
import sys
import sysconfig
from pathlib import Path

import platformdirs
import pytest

HERE = Path(__file__).parent
ROOT = HERE.parents[2]
LOCK = ROOT / "requirements" / "train.lock"
INSTALL_LIMIT_S, TEST_LIMIT_S = 1200, 3600
TESTS = ROOT / "tests"
NEED_TORCH = {
    HERE / "test_acting.py", HERE / "test_claims.py", HERE / "test_loop.py", HERE / "test_own_answers.py",
    HERE / "test_own_learner.py", HERE / "test_row_in_torch.py", HERE / "test_seals.py",
    TESTS / "vlm" / "models" / "test_intern_vl.py",
}  # fmt: skip


@pytest.fixture(scope="session")
def train_python():
    """The Python of the environment; made once for each lock."""
    digest = hashlib.sha256(f"{sys.version}{sys.prefix}{LOCK.read_text(encoding='utf-8')}".encode()).hexdigest()[:16]
    home = Path(platformdirs.user_cache_dir("betterbench")) / "environments" / f"train-{digest}"
    home.parent.mkdir(parents=True, exist_ok=True)
    with home.with_suffix(".lock").open("w") as handle:
        fcntl.flock(handle, fcntl.LOCK_EX)  # test processes run side by side
        if not (home / "complete").exists():
            fill(home)
    return home / "bin" / "python"


def fill(home: Path) -> None:
    """Makes the environment, or skips the test where that is not possible."""
    spec = importlib.util.spec_from_file_location("setup_environment", ROOT / "tools" / "setup_environment.py")
    tool = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(tool)
    env, python = tool.uv_environment(os.environ), home / "bin" / "python"
    install = ["pip", "install", "--require-hashes", "--no-deps", "--only-binary", ":all:"]
    try:
        uv = tool.find_uv(env)
        for step in (["venv", "--clear", "--python", sys.executable, home], [*install, "--python", python, "-r", LOCK]):
            subprocess.run([uv, *step], env=env, check=True, capture_output=True, text=True, timeout=INSTALL_LIMIT_S)
        packages = Path(
            subprocess.check_output(
                [python, "-c", "import sysconfig; print(sysconfig.get_path('purelib'))"], text=True
            ).strip()
        )
        # After those of the environment itself, so that its own versions win.
        (packages / "zz_betterbench.pth").write_text(f"{sysconfig.get_path('purelib')}\n", encoding="utf-8")
        subprocess.run([python, "-c", "import torch"], env=env, check=True, capture_output=True, text=True)
    except (tool.SetupError, OSError, subprocess.SubprocessError) as error:
        last = (getattr(error, "stderr", "") or str(error)).strip().splitlines()[-1:]
        pytest.skip(f"no environment for better train could be made here: {' '.join(last)}")
    (home / "complete").touch()


@pytest.mark.slow
def test_in_torch(train_python):
    env = {**os.environ, "PYTHONPATH": str(ROOT / "src"), "OMP_NUM_THREADS": "1"}
    words = ["-m", "pytest", "-q", "-rs", "-p", "no:cacheprovider", "-m", "not gpu and not network"]
    done = subprocess.run(
        [train_python, *words, *sorted(map(str, NEED_TORCH))],
        check=False, capture_output=True, text=True, timeout=TEST_LIMIT_S, cwd=ROOT, env=env,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout[-4000:] + done.stderr[-2000:]
    assert re.search(r"\d\d passed", done.stdout)
    assert "skipped" not in done.stdout


def test_no_file_that_needs_torch_is_left_out():
    imports = re.compile(r"^import torch$", re.MULTILINE)
    files = [*HERE.glob("test_*.py"), *(TESTS / "vlm").rglob("test_*.py")]
    assert {file for file in files if imports.search(file.read_text())} == NEED_TORCH
