"""Checks of this machine for ``better doctor``.

Each check imports the simulator on its own, so that an import error is reported as a failed check.
"""

from __future__ import annotations

import importlib.metadata
import os
import platform
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from betterbench.errors import BetterError
from betterbench.installation import EXTRAS, better_command, extra_command
from betterbench.interface.actions import EE_DELTA
from betterbench.tasks import all_tasks, get_task
from betterbench.version import __version__

if TYPE_CHECKING:
    from betterbench.sim.scenes import Scene


@dataclass(frozen=True, slots=True)
class Check:
    """Result of one check: the finding and a remedy if the check failed, or the command for a missing extra."""

    name: str
    works: bool
    detail: str
    cure: str = ""


def run_checks() -> list[Check]:
    """Run all checks of this machine and return their results."""
    return [*(_try(name, check) for name, check in CHECKS.items()), *_extras(), *_worlds()]


def _try(name: str, check: Callable[[], str]) -> Check:
    try:
        return Check(name, True, check())
    except BetterError as error:
        return Check(name, False, "does not work", str(error))
    except Exception as error:  # noqa: BLE001 - a doctor reports whatever is broken
        return Check(name, False, f"{type(error).__name__}", f"{error}. Run `make setup` again.")


def _extras() -> list[Check]:
    """Return one result per optional extra of the package. A missing extra does not count as a failure."""
    return [
        Check(
            f"extra {name}",
            True,
            f"{'' if extra.is_installed else 'not '}installed: {extra.use}",
            "" if extra.is_installed else extra_command(name),
        )
        for name, extra in EXTRAS.items()
    ]


def _worlds() -> list[Check]:
    """Return one result per external simulator ("world"). A missing simulator does not count as a failure."""
    try:
        from betterbench.sim.worlds import all_worlds
    except BetterError as error:  # MuJoCo, which the registry imports, rejects a wrong MUJOCO_GL
        return [Check("worlds", False, "cannot be listed", str(error))]
    return [
        Check(
            f"world {found.name}",
            True,
            f"installed: {found.summary}"
            if found.is_installed
            else f"not installed: {better_command()} worlds install {found.name}",
        )
        for found in (world.installation for world in all_worlds())
        if found is not None
    ]


def _versions() -> str:
    names = ("mujoco", "numpy", "mink", "pyarrow", "gymnasium")
    listed = ", ".join(f"{name} {importlib.metadata.version(name)}" for name in names)
    return f"betterbench {__version__}, Python {platform.python_version()}, {listed}"


def _machine() -> str:
    return f"{platform.platform()}, {os.cpu_count()} processors"


def _tasks() -> str:
    from betterbench.sim.robots import robot_names

    tasks = all_tasks()
    return f"{len(tasks)} tasks, {sum(len(t.variations) for t in tasks)} variations, robots: {', '.join(robot_names())}"


def _physics() -> str:
    scene = _scene()
    began = time.perf_counter()
    steps = 100
    for _ in range(steps):
        scene.step(np.zeros(7))
        scene.state()
    return f"{steps / (time.perf_counter() - began):.0f} control steps per second (20 are real time)"


def _rendering() -> str:
    from betterbench.sim.scenes import Renderer, gl_backend, renderer_fingerprint

    scene = _scene()
    with Renderer(scene.model, quality=scene.quality) as renderer:
        view = renderer.render(scene.data, "front")
        began = time.perf_counter()
        frames = 10
        for _ in range(frames):
            renderer.render(scene.data, "front")
        rate = frames / (time.perf_counter() - began)
    if view.rgb is None or view.rgb.std() < 5.0:
        raise BetterError(
            "The image is empty. Install another OpenGL library with apt-get install -y libosmesa6, "
            "and set MUJOCO_GL=osmesa."
        )
    return f"{gl_backend()}, {renderer_fingerprint().get('renderer', '?')}, {rate:.0f} frames per second at 256 x 256"


def _scene() -> Scene:
    from betterbench.sim.scenes import Scene

    task = get_task("morning_coffee")
    return Scene(task, task.training[0], seed=0, action_space=EE_DELTA)


def _video() -> str:
    from betterbench.evaluation import probe_encoder

    return probe_encoder()


CHECKS: dict[str, Callable[[], str]] = {
    "versions": _versions,
    "machine": _machine,
    "suite": _tasks,
    "physics": _physics,
    "rendering": _rendering,
    "video": _video,
}
