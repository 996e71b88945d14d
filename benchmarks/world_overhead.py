"""Processor time per step and per reset that a run in LIBERO adds to LIBERO's own loop, over both processes.

``python benchmarks/world_overhead.py [--steps N]`` after `better worlds install libero`. Each step is taken once, and
the time inside LIBERO's own calls is subtracted, so that the load of the machine does not matter.
"""

from __future__ import annotations

import argparse
import gc
import time
from pathlib import Path

import numpy as np

from betterbench.episodes import Observer
from betterbench.episodes.description import TrialContext, describe
from betterbench.episodes.episode import append_row
from betterbench.evaluation.planning.world_plan import make_world_plan
from betterbench.interface import observation_spec
from betterbench.interface.actions import EE_DELTA
from betterbench.records import RecordBuilder
from betterbench.sim.worlds import ProcessScene, WorldProcesses, world_named
from betterbench.sim.worlds.installation import start_code

TARGET = 0.05
"""Largest additional time of a step, as a share of LIBERO's own time."""


Times = tuple[float, float]
"""LIBERO's own time and all time [s]."""


def measure(scene: TimedScene, observer: Observer | None, steps: int) -> tuple[Times, Times]:
    """Return LIBERO's own time and all time, of the reset and of one step [s]."""
    gc.freeze()  # as an episode does
    scene.reset()  # starts the process and makes the environment, as the first trial of a task does
    before = scene.said
    scene.close(well=True)
    mine, here = time.process_time(), scene.reset()
    tracker = scene.tracker()
    builder = RecordBuilder(describe(scene, tracker, TrialContext(policy="bench")))
    append_row(builder, scene, here, tracker.update(here), action=None, applied=None)
    first = scene.said
    mine = time.process_time() - mine
    raw, everything = (first - before).tolist()
    reset = (raw, everything + mine)
    actions = np.random.default_rng(0).uniform(-0.3, 0.3, (steps, 7))
    mine = time.process_time()
    for action in actions:
        scene.draw_next(wanted=observer is not None)
        applied = scene.step(action)
        state = scene.state()
        append_row(builder, scene, state, tracker.update(state), action=action, applied=applied)
        if observer is not None:
            observer.observe(scene, state)
    last, mine = scene.said, time.process_time() - mine
    raw, everything = (last - first).tolist()
    return reset, (raw / steps, (everything + mine) / steps)


class TimedScene(ProcessScene):
    """A scene that returns the times of its process."""

    @property
    def said(self) -> np.ndarray:
        """LIBERO's own time and all time of the process so far, (2,) [s]."""
        return self._arrays["times"]


def main() -> None:
    """Print a row for each kind of observation."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--steps", type=int, default=60)
    parser.add_argument("--suite", default="libero_object")
    steps, suite = parser.parse_args().steps, parser.parse_args().suite
    python = str(world_named("libero").installation.folder / "bin" / "python")
    folder = str(Path(__file__).resolve().parent)
    command = (python, "-c", f"import sys; sys.path.append({folder!r})\n{start_code('libero_timed')}")
    plan = make_world_plan("noop", suite=suite, tasks=["0"], trials=1, command=command)
    for name, images in (("two images of 256 px at every step", True), ("no images", False)):
        processes = WorldProcesses(command)
        scene = TimedScene(
            plan.world,
            processes,
            task=f"{suite}-00",
            condition="base",
            seed=0,
            action_space=EE_DELTA,
            images=images,
        )
        observer = Observer(observation_spec("default")) if images else None
        reset, step = measure(scene, observer, steps)
        for what, (raw, everything) in (("reset", reset), ("step", step)):
            more = everything / raw - 1.0
            mark = "" if what == "reset" or more <= TARGET else f"  above {100 * TARGET:.0f} %"
            times = f"{1e3 * raw:.1f} ms, with us {1e3 * everything:.1f} ms, {100 * more:+.1f} %"
            print(f"{suite}, {name}: {what} {times}{mark}")
        scene.close(well=True)
        processes.close()


if __name__ == "__main__":
    main()
