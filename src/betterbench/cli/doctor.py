"""``better doctor``: what works here, with the cure for what does not; and how a policy is spoken to."""

from __future__ import annotations

import importlib.metadata
import os
import platform
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from betterbench import __version__
from betterbench.cli.console import OUT, print_json, print_table, say
from betterbench.cli.evaluate import default_folder
from betterbench.errors import BetterError
from betterbench.evaluation import Convention, PreflightCheck, named_trial, probe_encoder, run_preflight
from betterbench.evaluation.preflight.view import numbers_text, preflight_view
from betterbench.interface.actions import EE_DELTA
from betterbench.report.preflight_sheet import write_preflight_sheet
from betterbench.robots import robot_names
from betterbench.scenes import Renderer, Scene, gl_backend, renderer_fingerprint
from betterbench.tasks import all_tasks, get_task


@dataclass(frozen=True, slots=True)
class Check:
    """One thing that was tried.

    Attributes:
        name: What.
        works: Whether it works.
        detail: What was found.
        cure: What to do if it does not work.
    """

    name: str
    works: bool
    detail: str
    cure: str = ""


def doctor(
    *,
    policy: str | None = None,
    task: str = "fast_food",
    condition: str | None = None,
    seed: int = 0,
    action_space: str | None = None,
    observation: str = "default",
    quality: str = "standard",
    out: Path | None = None,
    json: bool = False,
) -> None:
    """Try everything that a run needs, and say how to mend what does not work. Exits with status 2 if something fails.

    With --policy: do the handshake, show the policy one observation, ask for one answer, measure how long it takes, and
    draw a image of exactly what the policy is shown and of what it does.

    Example: better doctor --policy openpi://localhost:8000?preset=openpi_libero

    Args:
        policy: Address of a policy to try instead (see better list policies).
        task: Task whose start the policy is shown.
        condition: Its condition; the first training condition if not given.
        seed: Its seed.
        action_space: Action space of the run to come; the policy's own if not given.
        observation: Observation preset of the run to come: default, official or state_only.
        quality: Render preset: fast, standard or high.
        out: PNG file to write; doctor-POLICY.png if not given.
        json: Print one JSON document instead of a table.
    """
    if policy is not None:
        trial = named_trial(task, condition, seed)
        found = run_preflight(
            policy,
            trial,
            action_space_name=action_space,
            observation=observation,
            quality=quality,
            on_conventions=None if json else _show_conventions,
        )
        out = write_preflight_sheet(preflight_view(found), out or Path(f"doctor-{default_folder(policy)}.png"))
        _show_consultation(found, json=json)
        say(f"wrote {out}")
        return
    findings = [_try(name, check) for name, check in CHECKS.items()]
    if json:
        print_json([{"name": f.name, "works": f.works, "detail": f.detail, "cure": f.cure} for f in findings])
    else:
        print_table(["", "what", "found"], [["ok" if f.works else "NO", f.name, f.detail] for f in findings])
        for finding in findings:
            if not finding.works:
                OUT.print(f"\n{finding.name}: {finding.cure}", markup=False)
    broken = [f.name for f in findings if not f.works]
    if broken:
        raise BetterError(f"{', '.join(broken)}: not working here. The cure stands above.")


def _show_conventions(conventions: tuple[Convention, ...]) -> None:
    """Print what both sides declare, before they are compared."""
    rows = [
        [c.name, "differs" if c.differs else "same" if c.ours and c.theirs else "", c.ours or "-", c.theirs or "-"]
        for c in conventions
    ]
    print_table(["convention", "", "this side", "the policy"], rows)


def _show_consultation(found: PreflightCheck, *, json: bool) -> None:
    if json:
        print_json(found.to_json())
        return
    first = numbers_text(found.actions[0])
    assumed = found.info.metadata.get("assumed")
    rows = [
        *([["assumed", assumed]] if assumed else []),
        ["prompt", found.prompt],
        *[[f"image {s.key}", s.note] for s in found.shown],
        *[[f"state {key}", numbers_text(values)] for key, values in found.state],
        ["answer", f"{len(found.actions)} x {found.actions.shape[1]} in {found.info.action_space}; first: {first}"],
        *(
            [["out of range", f"{found.clipped} of {len(found.actions)} actions: clipped in a run"]]
            * bool(found.clipped)
        ),
        ["first request", f"{1000 * found.first_s:.1f} ms"],
        ["next requests", f"{1000 * found.p50_s:.1f} ms median, {1000 * found.max_s:.1f} ms at most"],
    ]
    OUT.print()
    print_table(["asked", "found"], rows)


def _try(name: str, check: Callable[[], str]) -> Check:
    try:
        return Check(name, True, check())
    except BetterError as error:
        return Check(name, False, "does not work", str(error))
    except Exception as error:  # noqa: BLE001 - a doctor reports whatever is broken
        return Check(name, False, f"{type(error).__name__}", f"{error}. Run `make setup` again.")


def _versions() -> str:
    names = ("mujoco", "numpy", "mink", "pyarrow", "gymnasium")
    listed = ", ".join(f"{name} {importlib.metadata.version(name)}" for name in names)
    return f"betterbench {__version__}, Python {platform.python_version()}, {listed}"


def _machine() -> str:
    return f"{platform.platform()}, {os.cpu_count()} processors"


def _tasks() -> str:
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
            "The image is empty. Install another OpenGL: apt-get install -y libosmesa6, MUJOCO_GL=osmesa."
        )
    return f"{gl_backend()}, {renderer_fingerprint().get('renderer', '?')}, {rate:.0f} frames per second at 256 x 256"


def _video() -> str:
    return probe_encoder()


def _scene() -> Scene:
    task = get_task("morning_coffee")
    return Scene(task, task.training[0], seed=0, action_space=EE_DELTA)


CHECKS: dict[str, Callable[[], str]] = {
    "versions": _versions,
    "machine": _machine,
    "suite": _tasks,
    "physics": _physics,
    "rendering": _rendering,
    "video": _video,
}
