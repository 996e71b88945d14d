#!/usr/bin/env python3
"""Makes the project's environment from a bare ``python3``: uv, the hash-pinned packages in ``.venv``, the GL library.

Needs the standard library only, so that ``make test`` and ``make demo`` work on a fresh machine. A stamp in ``.venv``
    contains a digest of the installed locks, so a second call returns immediately. The package index, certificates and
    proxy come from pip's usual configuration (environment and files), which uv does not read by itself; none of it is
    written anywhere.

Examples:
    python3 tools/setup_environment.py              everything `make test` needs
    python3 tools/setup_environment.py --no-gl      without the graphics library (formatting, linting, types)
    python3 tools/setup_environment.py --lock runtime   without developer tools
    python3 tools/setup_environment.py --extras "train lerobot"   also with these extras, which later calls keep
    python3 tools/setup_environment.py --relock     write requirements/*.lock anew
"""

from __future__ import annotations

import argparse
import configparser
import contextlib
import fcntl
import hashlib
import math
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
VENV = ROOT / ".venv"
VENV_PYTHON = VENV / "bin" / "python"
UV_HOME = ROOT / ".uv"
LOCKS = ROOT / "requirements"
CALIBRATION = ROOT / "packages" / "betterbench-calibration"
"""Folder of the separate distribution with tools for maintainers, which is also installed in a clone."""
BOOTSTRAP_LOCK = LOCKS / "bootstrap.lock"
STAMP = VENV / "betterbench-setup.stamp"
GL_STAMP = VENV / "mujoco-gl"
EXTRAS_NOTE = VENV / "betterbench-extras"
"""Names of the extras that ``.venv`` holds, one per line, so that later calls keep them."""

OLDEST_PYTHON = (3, 11)
# The oldest uv version with which this script was tried; older versions have no `uv venv --clear`.
OLDEST_UV = (0, 8, 0)
GL_PACKAGES = ("libegl1", "libgl1")

# uv options for one list of packages, and builds that the main index does not have: torch for the processor of x86-64
# Linux (torch-2.13.0+cpu-cp311-cp311-manylinux_2_28_x86_64.whl). The macOS and Linux ARM builds are on the main index.
LOCK_OPTIONS = dict.fromkeys(("lerobot-feetech", "train", "world-libero-plus"), ("--no-deps",))
_TORCH = {"torch": ("+cpu", "6746dbcbeb526eb61330b76b41ff1b4eb848951103a892eeb080dfa2b264667b")}
LOCAL_BUILDS = {"lerobot-feetech": _TORCH, "train": _TORCH}
# Overridden requirements of extras, for packages that are not used here. LeRobot 0.4 draws with an old Rerun
# version, which would remove the extra `view` from .venv, and listens to the keyboard with pynput, which must be
# compiled; both are used only by its own record and view commands.
OVERRIDES = {"lerobot": ("rerun-sdk>=0.41", "pynput ; python_version < '3'")}
# Required packages of extras that are not installed: only the encoder's weight files are read, without the package for
# which they were made, which requires a database and pandas.
LEFT_OUT = {"assets": ("pyduck-janitor",)}
# Packages with which an extra is resolved, so that a user gets the versions used in the tests.
COMPANIONS = {"train": ("torch==2.13.0",), "being-h": ("torch==2.13.0",), "vlm": ("torch==2.13.0",)}
# Packages that only PyTorch's GPU build needs.
FOR_GRAPHICS_CARDS = re.compile(r"nvidia-|cuda-|triton$")
NVIDIA_DEVICES = (Path("/proc/driver/nvidia/version"), Path("/dev/nvidiactl"), Path("/dev/nvhost-gpu"))
ON_X86_LINUX = "sys_platform == 'linux' and platform_machine == 'x86_64'"
ELSEWHERE = "sys_platform != 'linux' or platform_machine != 'x86_64'"

# Asks a GL back end for an off-screen display, as MuJoCo will: a loader library without a driver fails here and not in
# the middle of a run. This runs in a separate process, because broken drivers crash. The numbers are from the headers:
# EGL_PLATFORM_DEVICE_EXT = 0x313F (Khronos registry), OSMESA_RGBA = GL_RGBA = 0x1908 (Mesa, OpenGL).
PROBES = {
    "egl": """
import ctypes
egl = ctypes.CDLL("libEGL.so.1")
try:
    ctypes.CDLL("libOpenGL.so.0")
except OSError:
    ctypes.CDLL("libGL.so.1")
egl.eglGetProcAddress.restype = ctypes.c_void_p
egl.eglGetProcAddress.argtypes = [ctypes.c_char_p]
query_address = egl.eglGetProcAddress(b"eglQueryDevicesEXT")
display_address = egl.eglGetProcAddress(b"eglGetPlatformDisplayEXT")
if not query_address or not display_address:
    raise SystemExit(1)
query = ctypes.CFUNCTYPE(ctypes.c_uint, ctypes.c_int, ctypes.c_void_p, ctypes.c_void_p)(query_address)
get_display = ctypes.CFUNCTYPE(ctypes.c_void_p, ctypes.c_int, ctypes.c_void_p, ctypes.c_void_p)(display_address)
devices, count = (ctypes.c_void_p * 16)(), ctypes.c_int()
if not query(16, devices, ctypes.byref(count)):
    raise SystemExit(1)
egl.eglInitialize.argtypes = [ctypes.c_void_p] * 3
for device in devices[: count.value]:
    display = get_display(0x313F, device, None)
    if display and egl.eglInitialize(display, None, None):
        raise SystemExit(0)
raise SystemExit(1)
""",
    "osmesa": """
import ctypes, ctypes.util
name = ctypes.util.find_library("OSMesa") or "libOSMesa.so.8"
osmesa = ctypes.CDLL(name)
osmesa.OSMesaCreateContext.restype = ctypes.c_void_p
osmesa.OSMesaCreateContext.argtypes = [ctypes.c_uint, ctypes.c_void_p]
raise SystemExit(0 if osmesa.OSMesaCreateContext(0x1908, None) else 1)
""",
}


# Workload for timing an interpreter: plain floats, tuples and dictionaries, as between two physics steps.
SMALL_WORK = """
import bz2, ctypes, lzma, multiprocessing, os, sqlite3, ssl, sys, time, zlib
def work():
    total, rows = 0.0, [(i * 0.5, i * 0.25, 1.0) for i in range(400)]
    for x, y, z in rows * 40:
        names = {"x": x, "y": y}
        total += names["x"] * z - names["y"] * y if x > y else abs(x)
    return total
def seconds():
    began = time.perf_counter()
    work()
    return time.perf_counter() - began
print(sys.executable)
print(sys.implementation.name, *sys.version_info[:2], os.uname().machine)
print(min(seconds() for _ in range(12)))
"""
CLEARLY = 0.9
"""Another build is clearly faster if it takes at most this share of this interpreter's time."""
TIMINGS = 5
"""Number of timings per interpreter; the shortest time counts."""


class SetupError(Exception):
    """The setup cannot continue; the message says what to run."""


def say(message: str) -> None:
    """Shows one short line of progress on stderr."""
    print(f"[setup] {message}", file=sys.stderr, flush=True)


def run(
    command: Sequence[str | Path], *, env: Mapping[str, str] | None = None, quiet: bool = False
) -> subprocess.CompletedProcess[str]:
    """Runs a command without a shell and never raises for its exit status.

    Args:
        command: Program and arguments.
        env: The program's environment; None for this process's own.
        quiet: Keep the output, both streams in ``stdout``, instead of showing it.
    """
    words = [str(word) for word in command]
    stdout, stderr = (subprocess.PIPE, subprocess.STDOUT) if quiet else (sys.stderr, None)
    try:
        return subprocess.run(words, env=env, check=False, text=True, stdout=stdout, stderr=stderr)
    except FileNotFoundError:
        return subprocess.CompletedProcess(words, 127, stdout=f"{words[0]}: not found")


# ------------------------------------------------------------------------------------------- pip's configuration


def pip_settings(environ: Mapping[str, str]) -> dict[str, str]:
    """Reads pip's configuration the way pip does: global, user, then site file, PIP_CONFIG_FILE, then PIP_* variables.

    The long option names have no dashes in front ("extra-index-url"); later sources win.
    """
    home = Path(environ.get("HOME", "~")).expanduser()
    chosen = environ.get("PIP_CONFIG_FILE")
    files = [Path(folder) / "pip" / "pip.conf" for folder in environ.get("XDG_CONFIG_DIRS", "/etc/xdg").split(":")]
    files += [Path("/etc/pip.conf"), home / ".pip" / "pip.conf"]
    files.append(Path(environ.get("XDG_CONFIG_HOME", home / ".config")) / "pip" / "pip.conf")
    files.append(Path(sys.prefix) / "pip.conf")
    if chosen == os.devnull:
        files = []
    elif chosen:
        files.append(Path(chosen))
    settings: dict[str, str] = {}
    for file in files:
        parser = configparser.RawConfigParser()
        try:
            parser.read(file, encoding="utf-8")
        except (configparser.Error, OSError) as error:
            raise SetupError(f"{file}: pip's configuration cannot be read ({error}). Correct or remove it.") from error
        for section in ("global", "install"):
            if parser.has_section(section):
                settings.update({key.replace("_", "-"): value for key, value in parser.items(section)})
    for name, value in environ.items():
        if name.startswith("PIP_") and value:
            settings[name[4:].lower().replace("_", "-")] = value
    return settings


def uv_environment(environ: Mapping[str, str], *, main_index_only: bool = False) -> dict[str, str]:
    """Returns the environment for uv and its pip, with pip's configuration; a UV_* variable that is set is kept.

    Args:
        environ: The process environment.
        main_index_only: Leave additional indexes and wheel folders out: a lock is made from the main index alone, where
            each release has the files for every platform.
    """
    settings = pip_settings(environ)
    env = dict(environ)

    def offer(variable: str, value: str | None, *, separator: str = " ") -> None:
        if value and value.split():
            env.setdefault(variable, separator.join(value.split()))

    offer("UV_DEFAULT_INDEX", None if "UV_INDEX_URL" in environ else settings.get("index-url"))
    if not main_index_only:
        offer("UV_INDEX", None if "UV_EXTRA_INDEX_URL" in environ else settings.get("extra-index-url"))
        offer("UV_FIND_LINKS", settings.get("find-links"), separator=",")
        # pip treats all indexes equally; the hashes reject files that are not in the lock.
        env.setdefault("UV_INDEX_STRATEGY", "unsafe-best-match")
    offer("UV_INSECURE_HOST", settings.get("trusted-host"))
    offer("UV_HTTP_TIMEOUT", settings.get("default-timeout") or settings.get("timeout"))
    offer("SSL_CERT_FILE", settings.get("cert"))
    for proxy in ("HTTPS_PROXY", "HTTP_PROXY"):
        if proxy.lower() not in environ:
            offer(proxy, settings.get("proxy"))
    env.setdefault("UV_PYTHON_DOWNLOADS", "never")
    # uv must use .venv, even if another environment is active.
    for name in ("VIRTUAL_ENV", "CONDA_PREFIX", "PYTHONPATH", "PYTHONHOME"):
        env.pop(name, None)
    return env


# ---------------------------------------------------------------------------------------------- system packages


def administrator() -> list[str] | None:
    """Returns words to put before apt-get (none for root), or None if that is not possible or not wanted."""
    if os.environ.get("BETTER_NO_APT") or not shutil.which("apt-get"):
        return None
    if os.geteuid() == 0:
        return []
    if shutil.which("sudo") and run(["sudo", "-n", "true"], quiet=True).returncode == 0:
        return ["sudo", "-n"]
    return None


def apt_line(packages: Sequence[str]) -> str:
    """Returns the shell command that installs Debian packages."""
    sudo = "" if os.geteuid() == 0 else "sudo "
    return f"{sudo}apt-get update && {sudo}apt-get install -y --no-install-recommends {' '.join(packages)}"


def apt_install(packages: Sequence[str]) -> bool:
    """Installs Debian packages where that is allowed, and tells whether apt-get ran and succeeded."""
    prefix = administrator()
    if prefix is None:
        return False
    say(f"installing {' '.join(packages)} with apt-get")
    # `env` because sudo drops the variables of its caller.
    apt = [*prefix, "env", "DEBIAN_FRONTEND=noninteractive", "apt-get", "-q"]
    for step in (["update"], ["install", "-y", "--no-install-recommends", *packages]):
        done = run([*apt, *step], quiet=True)
        if done.returncode != 0:
            say("apt-get failed: " + " / ".join(done.stdout.strip().splitlines()[-3:]))
            return False
    return True


def working_gl() -> str | None:
    """Returns a working off-screen GL back end ("egl" or "osmesa"), or None."""
    for name, probe in PROBES.items():
        with contextlib.suppress(subprocess.TimeoutExpired):
            tried = subprocess.run([sys.executable, "-c", probe], check=False, capture_output=True, timeout=60)
            if tried.returncode == 0:
                return name
    return None


def ensure_gl() -> None:
    """Makes sure that MuJoCo can render, and stores the back end for the Makefile.

    Raises:
        SetupError: No back end works and none could be installed.
    """
    if os.environ.get("MUJOCO_GL") or GL_STAMP.exists():
        return
    backend = working_gl() if sys.platform.startswith("linux") else "glfw"
    if backend is None and apt_install(GL_PACKAGES):
        backend = working_gl()
    if backend is None:
        raise SetupError(
            "No off-screen OpenGL (EGL or OSMesa) was found, and MuJoCo needs it to draw. Run\n"
            f"    {apt_line(GL_PACKAGES)}\n"
            "and then the same command again, or set MUJOCO_GL yourself to skip this check."
        )
    GL_STAMP.write_text(backend, encoding="ascii")
    say(f"rendering with {backend}")


# ------------------------------------------------------------------------------------------------------------ uv


def uv_works(uv: Path | str) -> bool:
    """Tells whether a uv runs and is new enough."""
    shown = run([uv, "--version"], quiet=True)
    version = re.search(r"(\d+)\.(\d+)\.(\d+)", shown.stdout or "")
    return shown.returncode == 0 and version is not None and tuple(map(int, version.groups())) >= OLDEST_UV


def venv_with_pip(folder: Path) -> bool:
    """Makes a virtual environment with the standard library and tells whether it has pip.

    Debian's python3 cannot do that without its venv package.
    """
    shutil.rmtree(folder, ignore_errors=True)
    made = run([sys.executable, "-m", "venv", folder], quiet=True)
    return (
        made.returncode == 0 and run([folder / "bin" / "python", "-m", "pip", "--version"], quiet=True).returncode == 0
    )


def find_uv(env: Mapping[str, str]) -> Path:
    """Finds uv on the path or in the project, or installs it from the package index into the project.

    Raises:
        SetupError: This Python has neither venv nor pip, and they could not be installed, or the installation failed.
    """
    on_path = shutil.which("uv")
    local = (UV_HOME / "bin" / "uv", UV_HOME / "target" / "bin" / "uv")
    for candidate in (*([Path(on_path)] if on_path else []), *local):
        if candidate.exists() and uv_works(candidate):
            return candidate
    say("installing uv into .uv")
    install: list[str | Path] = [
        "install",
        "--quiet",
        "--disable-pip-version-check",
        "--require-hashes",
        "--no-deps",
        "-r",
        BOOTSTRAP_LOCK,
    ]
    venv_package = f"python{sys.version_info.major}.{sys.version_info.minor}-venv"
    if venv_with_pip(UV_HOME):
        command: list[str | Path] = [UV_HOME / "bin" / "python", "-m", "pip", *install]
    elif run([sys.executable, "-m", "pip", "--version"], quiet=True).returncode == 0:
        command = [sys.executable, "-m", "pip", *install, "--target", UV_HOME / "target", "--upgrade"]
    elif apt_install([venv_package]) and venv_with_pip(UV_HOME):
        command = [UV_HOME / "bin" / "python", "-m", "pip", *install]
    else:
        shutil.rmtree(UV_HOME, ignore_errors=True)
        raise SetupError(
            f"This Python ({sys.executable}) has neither venv nor pip. Run\n"
            f"    {apt_line([venv_package])}\n"
            "(or put uv on the PATH) and then the same command again."
        )
    done = run(command, env=env, quiet=True)
    for candidate in local:
        if done.returncode == 0 and candidate.exists() and uv_works(candidate):
            return candidate
    raise SetupError(
        f"uv could not be installed:\n{(done.stdout or '').strip()}\n"
        "Check the network and pip's configuration (index, certificate, proxy), or put uv on the PATH."
    )


# -------------------------------------------------------------------------------------------------- environment


def extra_names() -> tuple[str, ...]:
    """Returns the names of the extras that pyproject.toml offers, without the developers' extra."""
    text = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    table = text.partition("[project.optional-dependencies]\n")[2].partition("\n[")[0]
    return tuple(name for name in re.findall(r"^([a-z][a-z0-9-]*) = \[", table, flags=re.MULTILINE) if name != "dev")


def chosen_extras(words: str) -> tuple[str, ...]:
    """Returns the requested extras and the extras that ``.venv`` already contains, by name.

    Args:
        words: Names between spaces or commas.

    Raises:
        SetupError: If no such extra exists.
    """
    known = extra_names()
    asked = [name.lower().replace("_", "-") for name in re.split(r"[\s,]+", words) if name]
    for name in asked:
        if name not in known:
            raise SetupError(f"there is no extra {name!r}. The extras are: {', '.join(known)}.")
    noted = EXTRAS_NOTE.read_text(encoding="utf-8").split() if EXTRAS_NOTE.exists() else []
    return tuple(sorted({*asked, *(name for name in noted if name in known)}))


def extra_lock(extra: str) -> Path:
    """Returns the lock with the packages that an extra needs in addition to ``runtime.lock``."""
    return LOCKS / f"extra-{extra}.lock"


def fingerprint(lock: str, extras: Sequence[str] = ()) -> str:
    """Returns the stamp of ``.venv``: the name of the lock and a digest of everything that determines its content.

    Args:
        lock: "dev" or "runtime".
        extras: Names of the extras.
    """
    digest = hashlib.sha256(f"{ROOT}\n{lock}\n{' '.join(extras)}\n".encode())
    locks = [LOCKS / f"{lock}.lock", *map(extra_lock, extras)]
    for file in (*locks, BOOTSTRAP_LOCK, ROOT / "pyproject.toml", CALIBRATION / "pyproject.toml", Path(__file__)):
        digest.update(file.read_bytes())
    return f"{lock} {digest.hexdigest()}\n"


def is_filled(lock: str, extras: Sequence[str] = ()) -> bool:
    """Tells whether ``.venv`` already contains what a lock and some extras require.

    The developers' environment includes the runtime.

    Args:
        lock: "dev" or "runtime".
        extras: Names of all extras that ``.venv`` should contain.
    """
    if not STAMP.exists() or not VENV_PYTHON.exists():
        return False
    if not any(VENV.glob("lib/python*/site-packages/betterbench_calibration-*.dist-info")):
        return False  # the package was removed by hand; error messages recommend `make setup` in this case
    accepted = {fingerprint(lock, extras), fingerprint("dev", extras)}
    return STAMP.read_text(encoding="ascii") in accepted


def entries_of(lock: str) -> dict[str, list[str]]:
    """Returns a lock's entries by package; a package that differs between platforms has several.

    Args:
        lock: Its text.
    """
    entries: dict[str, list[str]] = {}
    for entry in re.split(r"\n(?=[a-z0-9])", lock.strip()):
        if entry:
            entries.setdefault(entry.partition("==")[0], []).append(entry.strip())
    return entries


def merged(locks: Sequence[str]) -> str:
    """Returns one list of packages from several locks; if two of them pin a package, the later lock wins.

    Args:
        locks: Their texts; each was resolved to be compatible with the first.
    """
    entries: dict[str, list[str]] = {}
    for lock in locks:
        entries.update(entries_of(lock))
    return "".join(f"{entry}\n" for name in sorted(entries) for entry in entries[name])


def package_lists(lock: str, extras: Sequence[str]) -> list[str]:
    """Returns the lists of packages that may be installed, the best one first.

    On a machine without an NVIDIA card, this is PyTorch's CPU build, which is a tenth of the size; not every package
    index has it. The last list is from the main index alone. The extra that bounds PyTorch decides its version for all.

    Args:
        lock: "dev" or "runtime".
        extras: Names of the extras.
    """
    base = LOCKS / f"{lock}.lock"
    build = LOCAL_BUILDS["train"]["torch"]
    tested = versions_of(entries_of((LOCKS / "train.lock").read_text(encoding="utf-8"))["torch"]) - {""}
    texts = {extra: extra_lock(extra).read_text(encoding="utf-8") for extra in extras}
    torch = {extra: versions_of(entries_of(text).get("torch", [])) for extra, text in texts.items()}
    usual = [extra for extra in extras if torch[extra] and torch[extra] <= tested]  # the version with both builds
    bounding = [extra for extra in extras if torch[extra] and extra not in usual]
    ordered = sorted(extras, key=bounding.count)
    small = {**texts, **{extra: for_processor(texts[extra], *build) for extra in usual}}
    begin = base.read_text(encoding="utf-8")
    if bounding:
        return [merged([begin, *(small[extra] for extra in ordered)])]
    whole = merged([begin, *texts.values()])
    has_card = any(device.exists() for device in NVIDIA_DEVICES)
    return [whole] if has_card or not usual else [merged([begin, *small.values()]), whole]


def for_processor(lock: str, local: str, digest: str) -> str:
    """Returns the text of a lock with PyTorch's CPU build and without the GPU libraries.

    Args:
        lock: The text.
        local: Suffix that the build adds to the version.
        digest: SHA-256 of its file.
    """
    entries = entries_of(lock)
    kept = (entry for name in entries if not FOR_GRAPHICS_CARDS.match(name) for entry in entries[name])
    return with_local_build("".join(f"{entry}\n" for entry in kept), "torch", local, digest)


def measured(python: Path | str) -> tuple[str, float] | None:
    """Returns an interpreter's executable and its time for a small workload [s], or None if it does not match.

    A match is a CPython with this minor version and machine type that has the standard library parts which some
    distributions package separately.
    """
    try:
        told = subprocess.run([str(python), "-I", "-c", SMALL_WORK], check=True, capture_output=True, timeout=20)
        executable, kind, seconds = told.stdout.decode().splitlines()
        same = kind == " ".join([sys.implementation.name, *map(str, sys.version_info[:2]), os.uname().machine])
        return (executable, float(seconds)) if same else None
    except (OSError, ValueError, subprocess.SubprocessError):
        return None


def chosen_python(*, named: bool, places: Sequence[Path] | None = None) -> str:
    """Returns the interpreter for ``.venv``: this one, or another build of the same version that is clearly faster.

    pyenv builds Python without optimizations by default, and such a build takes a third to a half longer.
    Distributions, uv and conda build with them. Not every build says how it was made, so they are timed.

    Args:
        named: Whether the user chose this interpreter.
        places: Folders to search; if None, the PATH folders and /usr/bin.
    """
    name = f"python{sys.version_info.major}.{sys.version_info.minor}"
    folders = [Path(folder) for folder in os.get_exec_path()] + [Path("/usr/bin")] if places is None else places
    others = dict.fromkeys((folder / name).resolve() for folder in folders if os.access(folder / name, os.X_OK))
    others.pop(Path(sys.executable).resolve(), None)
    if named or not others:
        return sys.executable
    least: dict[str, float] = {}
    for _ in range(TIMINGS):  # in turn, because the pace of a shared machine changes from moment to moment
        for python in [sys.executable, *map(str, others)]:
            executable, seconds = measured(python) or ("", math.inf)
            least[executable] = min(seconds, least.get(executable, math.inf))
    own = least.get(sys.executable, 0.0)
    fastest = min(least, key=lambda executable: least[executable])
    if least[fastest] > CLEARLY * own:
        return sys.executable
    faster = own / least[fastest]
    say(f"{fastest} is {faster:.1f} times as fast as {sys.executable} and is used (choose another with PYTHON=...)")
    return fastest


def fill(lock: str, extras: Sequence[str] = (), *, named: bool = False) -> None:
    """Makes ``.venv`` if it is missing and installs the locked packages and this clone's packages (editable) into it.

    Packages that someone added by hand stay; ``make distclean setup`` gives exactly the packages in the lock.

    Args:
        lock: "dev" or "runtime".
        extras: Names of all extras that ``.venv`` should contain.
        named: Whether ``.venv`` must use exactly this interpreter.

    Raises:
        SetupError: uv failed; its own message is shown above.
    """
    started = time.monotonic()
    env = uv_environment(os.environ)
    uv = find_uv(env)
    if run([VENV_PYTHON, "-c", "import sys; sys.exit(sys.version_info < (3, 11))"], quiet=True).returncode != 0:
        python = chosen_python(named=named)
        told = run([python, "-c", "import sys; print(sys.version.split()[0])"], quiet=True).stdout.strip()
        say(f"creating .venv with Python {told}")
        require([uv, "venv", "--quiet", "--clear", "--python", python, VENV], env=env)
    STAMP.unlink(missing_ok=True)
    install: list[str | Path] = [uv, "pip", "install", "--quiet", "--python", VENV_PYTHON]
    listed = ", ".join([f"requirements/{lock}.lock", *(f"extra-{extra}.lock" for extra in extras)])
    size = "a few hundred MB the first time" + ("; PyTorch for graphics cards has a few GB" if extras else "")
    say(f"installing {listed} into .venv ({size})")
    install_locked([*install, "--require-hashes", "--no-deps", "--only-binary", ":all:"], lock, extras, env=env)
    editable = [word for project in (ROOT, CALIBRATION) for word in ("--editable", project)]
    require([*install, "--no-deps", "--build-constraints", BOOTSTRAP_LOCK, *editable], env=env)
    EXTRAS_NOTE.write_text("".join(f"{extra}\n" for extra in extras), encoding="utf-8")
    STAMP.write_text(fingerprint(lock, extras), encoding="ascii")
    say(f"environment ready in {time.monotonic() - started:.0f} s")


def require(command: Sequence[str | Path], *, env: Mapping[str, str]) -> None:
    """Runs a command of uv.

    Args:
        command: Program and arguments.
        env: Environment of the program.

    Raises:
        SetupError: It failed; its own message is shown above.
    """
    if run(command, env=env).returncode != 0:
        raise SetupError(
            f"`{' '.join(str(word) for word in command[:3])}` failed; its message is shown above. "
            "Check the network and pip's configuration, then run the same command again."
        )


def install_locked(install: Sequence[str | Path], lock: str, extras: Sequence[str], *, env: Mapping[str, str]) -> None:
    """Installs the first list of packages that is available.

    Args:
        install: The command without the list.
        lock: "dev" or "runtime".
        extras: Names of the extras.
        env: Environment of uv.

    Raises:
        SetupError: The last list could not be installed either.
    """
    *small, whole = package_lists(lock, extras)
    wanted = VENV / "betterbench-packages.txt"
    try:
        for packages in small:
            wanted.write_text(packages, encoding="utf-8")
            # First from the indexes for which pip is configured, then from PyTorch's own index, which uv knows.
            for source in ((), ("--torch-backend", "cpu")):
                if run([*install, *source, "-r", wanted], env=env, quiet=True).returncode == 0:
                    return
            say("PyTorch's CPU build is not available here: installing the build that also supports GPUs")
        wanted.write_text(whole, encoding="utf-8")
        require([*install, "-r", wanted], env=env)
    finally:
        wanted.unlink(missing_ok=True)


def with_local_build(lock: str, package: str, local: str, digest: str) -> str:
    """Returns the text of a lock in which x86-64 Linux gets another build of the same release.

    Args:
        lock: The text.
        package: Name of the package.
        local: Suffix that the build adds to the version ("+cpu").
        digest: SHA-256 of its file.

    Raises:
        SetupError: The lock does not contain the package.
    """
    found = re.search(rf"^{re.escape(package)}==[^ ;\\\n]+", lock, flags=re.MULTILINE)
    if found is None:
        raise SetupError(f"the lock does not contain {package}")
    pinned = found.group()
    entry = f"{pinned} ; {ELSEWHERE}"
    added = f"{pinned}{local} ; {ON_X86_LINUX} \\\n    --hash=sha256:{digest}\n"
    return lock[: found.start()] + added + entry + lock[found.end() :]


def relock(*, upgrade: bool) -> None:
    """Writes the locks again, for every platform and Python version, with hashes and without host names.

    Args:
        upgrade: Whether to use the newest versions instead of keeping locked versions that still fit.

    Raises:
        SetupError: uv failed, or a lock names a host or a path.
    """
    env = uv_environment(os.environ, main_index_only=True)
    uv = find_uv(env)
    common: list[str | Path] = [uv, "pip", "compile", "--quiet", "--universal", "--generate-hashes"]
    common += ["--fork-strategy", "fewest", "--no-header", "--no-annotate", "--python-version", "3.11"]
    common += ["--no-emit-index-url", "--no-emit-find-links", *(["--upgrade"] if upgrade else [])]
    project = ROOT / "pyproject.toml"
    runtime, dev = LOCKS / "runtime.lock", LOCKS / "dev.lock"

    def resolve(lock: Path, words: Sequence[str | Path]) -> None:
        if run([*common, *words, "--output-file", lock], env=env).returncode != 0:
            raise SetupError(f"uv could not resolve {lock.name}; its message is shown above.")

    steps: dict[Path, list[str | Path]] = {
        # The extras that tests need are resolved first, so that users get the tested versions.
        dev: [project, "--extra", "dev"],
        runtime: [project, "--constraints", dev],
        # Environments made by tests and benchmarks for packages that cannot share one with this project.
        **{file.with_suffix(".lock"): [file] for file in sorted(LOCKS.glob("*.in"))},
    }
    for lock, words in steps.items():
        say(f"resolving {lock.relative_to(ROOT)}")
        resolve(lock, [*LOCK_OPTIONS.get(lock.stem, ()), *words])
        for package, (local, digest) in LOCAL_BUILDS.get(lock.stem, {}).items():
            text = with_local_build(lock.read_text(encoding="utf-8"), package, local, digest)
            lock.write_text(text, encoding="utf-8")
    for extra in extra_names():
        say(f"resolving {extra_lock(extra).relative_to(ROOT)}")
        with tempfile.TemporaryDirectory(prefix="betterbench-lock-") as folder:
            extra_lock(extra).write_text(locked_extra(extra, Path(folder), resolve), encoding="utf-8")
    for lock in (*steps, *map(extra_lock, extra_names())):
        leak = re.search(r"^.*(://| @ |^-).*$", lock.read_text(encoding="utf-8"), flags=re.MULTILINE)
        if leak:
            raise SetupError(f"{lock.relative_to(ROOT)} names a host, a path or an option: {leak.group().strip()[:60]}")


def locked_extra(extra: str, folder: Path, resolve: Callable[[Path, Sequence[str | Path]], None]) -> str:
    """Returns the text of an extra's lock: packages missing from ``runtime.lock`` or needed in another version.

    It is resolved together with the developers' packages, so that both fit into one environment.

    Args:
        extra: Its name.
        folder: Folder for temporary files.
        resolve: Writes a lock from the words of uv.
    """
    project, dev = ROOT / "pyproject.toml", LOCKS / "dev.lock"
    together, alone_lock = folder / "together.lock", folder / "alone.lock"
    further, overrides = folder / "companions.in", folder / "overrides.txt"
    further.write_text("\n".join(COMPANIONS.get(extra, ())), encoding="utf-8")
    never = (f"{name} ; python_version < '3'" for name in LEFT_OUT.get(extra, ()))
    overrides.write_text("\n".join([*OVERRIDES.get(extra, ()), *never]), encoding="utf-8")
    shutil.copy(dev, together)  # versions that still fit are kept
    words: list[str | Path] = [project, "--extra", extra, "--constraints", further, "--overrides", overrides]
    # The extra that bounds the versions of the others must be compatible with all of them.
    others = extra_names() if extra in OVERRIDES else ()
    resolve(together, [*words, "--extra", "dev", *(word for other in others for word in ("--extra", other))])
    resolve(alone_lock, [*words, "--constraints", together])
    needed = entries_of(alone_lock.read_text(encoding="utf-8")).keys()
    found = entries_of(together.read_text(encoding="utf-8"))
    known = entries_of((LOCKS / "runtime.lock").read_text(encoding="utf-8"))
    developers = entries_of(dev.read_text(encoding="utf-8"))
    for name in developers.keys() - needed:
        if versions_of(developers[name]) != versions_of(found.get(name, [])):
            raise SetupError(f"the extra {extra} changes the developers' {name}, which it does not need itself")
    kept = sorted(name for name in needed if versions_of(found[name]) != versions_of(known.get(name, [])))
    return "".join(f"{entry}\n" for name in kept for entry in found[name])


def versions_of(entries: Sequence[str]) -> set[str]:
    """Returns the versions that entries of one package pin.

    Args:
        entries: As in a lock.
    """
    return {re.split(r"[ ;\\\n]", entry.partition("==")[2], maxsplit=1)[0] for entry in entries}


@contextlib.contextmanager
def alone() -> Iterator[None]:
    """Allows one setup at a time in this clone; a second one waits, and then has nothing left to do.

    Yields:
        Nothing.
    """
    with (ROOT / ".setup.lock").open("w") as handle:
        fcntl.flock(handle, fcntl.LOCK_EX)
        yield


def main() -> int:
    """Runs the setup; returns 0, or 2 if the user must do something first."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument(
        "--lock", choices=("dev", "runtime"), default="dev", help="which packages (default: %(default)s)"
    )
    parser.add_argument("--extras", default="", metavar="NAMES", help='further extras for .venv: "train lerobot"')
    parser.add_argument("--no-gl", action="store_true", help="do not install the graphics library")
    parser.add_argument("--relock", action="store_true", help="write requirements/*.lock again and stop")
    parser.add_argument("--upgrade", action="store_true", help="with --relock: use the newest versions")
    parser.add_argument("--this-python", action="store_true", help="use this Python and no other build for .venv")
    options = parser.parse_args()
    if sys.version_info < OLDEST_PYTHON:
        wanted = ".".join(map(str, OLDEST_PYTHON))
        say(f"Python {wanted} or newer is required, but {sys.executable} is {sys.version.split()[0]}.")
        say("Choose another one: make PYTHON=python3.12 test")
        return 2
    try:
        with alone():
            if options.relock:
                relock(upgrade=options.upgrade)
                return 0
            extras = chosen_extras(options.extras)
            if not is_filled(options.lock, extras):
                fill(options.lock, extras, named=options.this_python)
            if not options.no_gl:
                ensure_gl()
    except SetupError as error:
        say(str(error))
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
