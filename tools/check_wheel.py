"""Build the wheels, install betterbench's in a clean environment, and run `better demo` there from an empty folder.

The environment has the locked packages and nothing from this clone; its caches are empty, so that a first user's
waiting time is part of the check. The other wheel, with which LeRobot finds our tasks, is built and its content
checked; running it requires LeRobot (tests/episodes/test_lerobot_plugin.py).

Examples:
    python tools/check_wheel.py                 all wheels into dist/, with one trial per variation
    python tools/check_wheel.py --trials 4      as many trials as `better demo` by default
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
import time
import tomllib
import zipfile
from collections.abc import Mapping, Sequence
from pathlib import Path

import setup_environment

ROOT = Path(__file__).resolve().parent.parent
LOCKS = ROOT / "requirements"
SOURCES = {
    "betterbench": ROOT,
    "betterbench_calibration": ROOT / "packages" / "betterbench-calibration",
    "lerobot_env_betterbench": ROOT / "packages" / "lerobot_env_betterbench",
}
"""This repository's projects: the folder of each, by the package name that its wheel contains."""


class CheckError(Exception):
    """Fault of a wheel, described by the message."""


def call(command: Sequence[str | Path], *, env: Mapping[str, str], cwd: Path = ROOT) -> str:
    """Run a command and return its standard output.

    Raises:
        CheckError: If the command fails; the message ends with the command's output.
    """
    words = [str(word) for word in command]
    done = subprocess.run(words, env=env, cwd=cwd, check=False, capture_output=True, text=True)
    if done.returncode != 0:
        raise CheckError(f"`{' '.join(words[:4])}` failed with {done.returncode}:\n{done.stderr[-3000:]}")
    return done.stdout


def build(uv: Path, out: Path, env: Mapping[str, str], source: Path) -> Path:
    """Build a project's wheel with the locked back end and return its path; older wheels in the folder are deleted."""
    locked: list[str | Path] = ["--build-constraints", LOCKS / "bootstrap.lock", "--require-hashes"]
    with tempfile.TemporaryDirectory(prefix="betterbench-wheel-") as folder:
        call([uv, "build", "--quiet", "--wheel", "--out-dir", folder, *locked, source], env=env)
        (wheel,) = Path(folder).glob("*.whl")
        out.mkdir(parents=True, exist_ok=True)
        for older in out.glob(f"{wheel.name.partition('-')[0]}-*.whl"):
            older.unlink()
        return Path(shutil.copy(wheel, out))


def added(source: Path) -> list[str]:
    """Return the files that a project's wheel takes from outside its src folder, with their paths in the wheel."""
    form = tomllib.loads((source / "pyproject.toml").read_text(encoding="utf-8"))
    wheel = form.get("tool", {}).get("hatch", {}).get("build", {}).get("targets", {}).get("wheel", {})
    return [f"src/{place}" for place in wheel.get("force-include", {}).values()]


def content_problem(wheel: Path, tracked: Sequence[str]) -> str:
    """Describe the differences between the package in a wheel and its tracked source files; empty if there are none."""
    with zipfile.ZipFile(wheel) as archive:
        packed = {name for name in archive.namelist() if ".dist-info/" not in name}
    wanted = {name.partition("src/")[2] for name in tracked}
    lacking, more = sorted(wanted - packed), sorted(packed - wanted)
    words = [f"{wheel.name} lacks {', '.join(lacking[:5])}"] if lacking else []
    return " and ".join(
        [*words, *([f"{wheel.name} contains {', '.join(more[:5])}, which git does not track"] if more else [])]
    )


def try_out(uv: Path, wheel: Path, env: Mapping[str, str], *, trials: int) -> None:
    """Install a wheel in a clean environment and run its commands from an empty folder.

    Raises:
        CheckError: If a command fails or leaves no report.
    """
    with tempfile.TemporaryDirectory(prefix="betterbench-wheel-") as folder:
        home = Path(folder)
        python, better, work = home / "venv" / "bin" / "python", home / "venv" / "bin" / "better", home / "work"
        work.mkdir()
        install: list[str | Path] = [uv, "pip", "install", "--quiet", "--no-deps", "--python", python]
        call([uv, "venv", "--quiet", "--python", sys.executable, home / "venv"], env=env)
        call([*install, "--require-hashes", "--only-binary", ":all:", "-r", LOCKS / "runtime.lock"], env=env)
        call([*install, wheel], env=env)
        kept = ("PATH", "LANG", "MUJOCO_GL", "LD_LIBRARY_PATH")
        clean = {name: os.environ[name] for name in kept if name in os.environ} | {"HOME": str(home)}
        clean |= {"LP_NUM_THREADS": "0", "OMP_NUM_THREADS": "1"}
        print(call([better, "--version"], env=clean, cwd=work).strip())
        began = time.monotonic()
        told = call([better, "demo", "--out", "demo", "--trials", str(trials)], env=clean, cwd=work)
        report = work / "demo" / "report" / "index.html"
        if not report.is_file():
            raise CheckError(f"better demo has not written {report.relative_to(work)}. Its output:\n{told}")
        size = report.stat().st_size / 1e6
        print(f"better demo: {time.monotonic() - began:.0f} s, a report of {size:.1f} MB")


def main() -> int:
    """Build and check the wheels; return 0, or 1 if one does not work."""
    parser = argparse.ArgumentParser(description="Build the wheel and try it in a clean environment.")
    parser.add_argument("--out", type=Path, default=ROOT / "dist", help="folder of the wheel")
    parser.add_argument("--trials", type=int, default=1, help="trials per variation of the demo; 0 to leave it out")
    options = parser.parse_args()
    env = setup_environment.uv_environment(os.environ)
    try:
        uv = setup_environment.find_uv(env)
        wheels = {name: build(uv, options.out.resolve(), env, source) for name, source in SOURCES.items()}
        for name, wheel in wheels.items():
            tracked = call(["git", "ls-files", SOURCES[name] / "src" / name], env=env).split() + added(SOURCES[name])
            problem = content_problem(wheel, tracked)
            if problem:
                print(problem, file=sys.stderr)
                return 1
            print(f"{wheel.name}: {len(tracked)} files, {wheel.stat().st_size / 1e6:.3f} MB")
        if options.trials:
            try_out(uv, wheels["betterbench"], env, trials=options.trials)
    except (CheckError, setup_environment.SetupError) as error:
        print(error, file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
