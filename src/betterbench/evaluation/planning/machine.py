"""Description of this machine, read from system files without running other programs."""

from __future__ import annotations

import contextlib
import email
import importlib.metadata
import os
import platform
import re
from collections.abc import Sequence
from functools import cache
from pathlib import Path

from betterbench.errors import BetterError
from betterbench.sim.scenes import renderer_fingerprint

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]*")
_REVISION = re.compile(r"[0-9a-f]{40,64}")
_MAX_FILE_BYTES = 1 << 20
_DISTRIBUTION = "betterbench"
_LEFT_OUT = "dev"  # extra with test tools and linters, which do not affect results


def describe_machine() -> dict[str, object]:
    """Return a description of this machine's CPU, memory and GPUs.

    Values that cannot be determined are "unknown", 0 or an empty list.
    """
    model = re.search(r"^model name\s*:\s*(.+)$", _read(Path("/proc/cpuinfo")), re.MULTILINE)
    return {
        "architecture": platform.machine(),
        "cpu": model.group(1).strip() if model else platform.processor() or "unknown",
        "processors": os.cpu_count() or 0,
        "memory_gb": _memory_gb(),
        "graphics_cards": list(_graphics_cards()),
    }


def describe_renderer() -> dict[str, str]:
    """Return the fingerprint of the renderer, or the reason rendering does not work.

    The function creates the OpenGL context of the process, so it must be called in the thread that will render.
    """
    try:
        return renderer_fingerprint()
    except BetterError as error:
        return {"problem": str(error)}


@cache
def package_lock() -> tuple[str, ...]:
    """Return the installed packages that betterbench may use, with their versions ("numpy==2.3.1"), sorted by name.

    The result is cached, because reading the metadata of about a hundred packages takes 30 ms.
    """
    found: dict[str, str] = {}
    waiting = [_DISTRIBUTION]
    while waiting:
        name = _normal(waiting.pop())
        if name in found:
            continue
        try:
            distribution = importlib.metadata.distribution(name)
        except importlib.metadata.PackageNotFoundError:
            continue
        found[name], requirements = _version_and_requirements(distribution)
        waiting += _required(requirements, extras=name == _DISTRIBUTION)
    return tuple(sorted(f"{name}=={version}" for name, version in found.items()))


def source_revision(folder: Path) -> str | None:
    """Return the git revision of the repository that contains a folder, or None if there is no repository."""
    for parent in (folder, *folder.parents):
        link = parent / ".git"
        if link.exists():
            home = link
            if link.is_file():  # a worktree or a submodule has a file that names the git directory
                home = parent / _read(link).removeprefix("gitdir:").strip()
            return _head(home)
    return None


def _head(home: Path) -> str | None:
    shared = home / _read(home / "commondir").strip()
    head = _read(home / "HEAD").strip()
    if head.startswith("ref:"):
        name = head.removeprefix("ref:").strip()
        if ".." in name or name.startswith("/"):
            return None
        loose = _read(home / name).strip() or _read(shared / name).strip()
        packed = re.search(rf"^([0-9a-f]{{40,64}}) {re.escape(name)}$", _read(shared / "packed-refs"), re.MULTILINE)
        head = loose or (packed.group(1) if packed else "")
    return head if _REVISION.fullmatch(head) else None


def _version_and_requirements(distribution: importlib.metadata.Distribution) -> tuple[str, Sequence[str]]:
    """Return the version of an installed package, and its requirements as it states them.

    Only the head of its metadata is parsed, and only once. The standard library parses all of it, with the page that
    describes the package, for each of the two.
    """
    text = distribution.read_text("METADATA")
    if text is None:  # an old form of metadata, in several files
        return distribution.version, distribution.requires or ()
    head = email.message_from_string(text.partition("\n\n")[0])
    return head["Version"], head.get_all("Requires-Dist", [])


def _required(requirements: Sequence[str], *, extras: bool) -> list[str]:
    """Return the names of the packages in a list of requirements.

    If ``extras`` is True, the requirements of extras are included, except those of the developer extra.
    """
    names = []
    for requirement in requirements:
        found = _NAME.match(requirement)
        _, _, marker = requirement.partition(";")
        optional = "extra" in marker
        if found and (not optional or (extras and f"'{_LEFT_OUT}'" not in marker.replace('"', "'"))):
            names.append(found.group())
    return names


def _normal(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()


def _memory_gb() -> float:
    try:
        return round(os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") / 1e9, 1)
    except (ValueError, OSError):
        return 0.0


def _graphics_cards() -> list[str]:
    """Return the models of the GPUs, as reported by NVIDIA's and other drivers."""
    cards = []
    for file in sorted(Path("/proc/driver/nvidia/gpus").glob("*/information")):
        model = re.search(r"^Model:\s*(.+)$", _read(file), re.MULTILINE)
        cards.append(model.group(1).strip() if model else "NVIDIA")
    driver = re.search(r"Kernel Module\s+(?:for \S+\s+)?([\d.]+)", _read(Path("/proc/driver/nvidia/version")))
    if cards and driver:
        cards = [f"{card}, driver {driver.group(1)}" for card in cards]
    for file in sorted(Path("/sys/class/drm").glob("card*/device/product_name")):
        cards += [text] if (text := _read(file).strip()) else []
    return cards


def _read(file: Path) -> str:
    """Return the beginning of a text file, or an empty string if the file cannot be read."""
    with contextlib.suppress(OSError), file.open("rb") as stream:
        return stream.read(_MAX_FILE_BYTES).decode("utf-8", "replace")
    return ""
