"""The rows of the speed table. Each measures one requirement, mostly as a ratio of two times in the same run."""

from __future__ import annotations

import importlib
import itertools
import multiprocessing
import os
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from functools import partial
from multiprocessing.connection import Connection
from pathlib import Path

import numpy as np

from betterbench.demonstrations.making.amplifier import AmplifierSettings
from betterbench.demonstrations.making.attempt import LASTING_STEPS, amplify_attempt, collect_attempt
from betterbench.demonstrations.making.production import scene_of
from betterbench.demonstrations.making.sources import Library, demonstrated_source
from betterbench.demonstrations.making.starts import FIRST_AMPLIFIED_SEED, Start, planned_starts
from betterbench.diagnosis import diagnose_run
from betterbench.episodes import Observer, append_row, describe
from betterbench.evaluation import Plan, Progress, evaluate, make_plan
from betterbench.interface import observation_spec
from betterbench.policies.batching import MAX_BATCH
from betterbench.records import JournalEntry, Record, RecordBuilder, RunFolder
from betterbench.records.modalities.columns import MAX_CHUNK_ROWS
from betterbench.records.parquet import record_bytes
from betterbench.sim.scenes import Scene
from betterbench.sim.scenes.stage import QUALITIES
from betterbench.tasks import GoalTracker, all_tasks
from betterbench.tasks.randomness import FIRST_DEMONSTRATION_SEED
from catalogue_search import catalogue_row
from dummy import dummy_gr00t_server, dummy_server
from figures import Figure, spread
from materializing import blocks_of
from pacing import (
    BLOCK,
    CONTEXT,
    HEAVIEST,
    PICTURE_BLOCK,
    PICTURE_TASK,
    PICTURE_TASKS,
    PacedMind,
    RawPhysics,
    RawViews,
    Rehearsal,
    SleeplessEpisode,
    play,
    rehearse,
)
from peer_rows import PeerRows
from static_asking import static_row
from training_speed import training_row

TASKS = (PICTURE_TASK, "morning_coffee", HEAVIEST)
"""Tasks of the rows without cameras: a typical one, the one with the fastest physics, and the one with the slowest."""

RECORDS = 1200
"""Number of trials of a full run: sixty variations with twenty seeds."""

LATENCIES_S = (0.03, 0.1, 0.3)
"""Times that the dummy policy servers take to answer with a chunk of eight actions [s]."""

MANY = 256
"""Number of simultaneous requests that is never reached."""

WORKERS = 2
"""Workers of the row that measures a run against a policy server."""


def step_row(*, quick: bool) -> Iterator[Figure]:
    """Compare the loop without cameras with only the physics of the same motion."""
    for task in TASKS:
        rehearsal = rehearse(task, QUALITIES["fast"])
        raw = RawPhysics(rehearsal)
        ratios, own, physics, policies = [], [], [], []
        for _ in range(2 if quick else 21):
            policy = play(rehearsal, raw, every=BLOCK, limit=len(rehearsal.actions), observer=None)
            policies.append(policy)
            ratios.append(sum(policy.own_s) / sum(policy.reference_s))
            own += [1e3 * s / BLOCK for s in policy.own_s]
            physics += [1e3 * s / BLOCK for s in policy.reference_s]
        note = f"{spread(own)} / {spread(physics)} ms, {len(rehearsal.actions)} steps an episode"
        yield Figure("step", f"step without cameras / physics, {task}", tuple(ratios), "x", "<=", 1.25, note)
        # Other work on the machine can only add time, so the least time of each block over the repetitions is nearest
        # to the time on an idle core.
        least = [sum(map(min, zip(*blocks, strict=True))) for blocks in _columns(policies)]
        yield Figure("step", f"the same, least time of each block, {task}", (least[0] / least[1],), "x")


def sleep_row(*, quick: bool) -> Iterator[Figure]:
    """Compare the loop without cameras with the same loop in a scene in which no object sleeps."""
    for task in TASKS:
        rehearsal = rehearse(task, QUALITIES["fast"])
        sleepless = SleeplessEpisode(rehearsal)
        ratios, own, theirs = [], [], []
        for _ in range(2 if quick else 5):
            policy = play(rehearsal, sleepless, every=BLOCK, limit=len(rehearsal.actions), observer=None)
            ratios.append(sum(policy.reference_s) / sum(policy.own_s))
            own += [1e3 * s / BLOCK for s in policy.own_s]
            theirs += [1e3 * s / BLOCK for s in policy.reference_s]
        yield Figure(
            "sleep",
            f"step in a world without sleep / ours, {task}",
            tuple(ratios),
            "x",
            ">=",
            2.8,
            f"{spread(theirs)} / {spread(own)} ms",
        )


def _columns(policies: list[PacedMind]) -> tuple[list[list[float]], list[list[float]]]:
    """Return the seconds of each block by repetition, of the loop and of the reference."""
    return [m.own_s for m in policies], [m.reference_s for m in policies]


def pixels_row(*, quick: bool) -> Iterator[Figure]:
    """Compare the loop with two cameras with only the physics and the rendering of the same views."""
    spec = observation_spec("default")
    for task, quality in itertools.product(PICTURE_TASKS, (QUALITIES["fast"], QUALITIES["standard"])):
        rehearsal = rehearse(task, quality)
        scene = rehearsal.scene
        observer, views = Observer(spec), RawViews(scene.model, quality, [c.name for c in spec.cameras])
        try:
            _check_same_images(scene, observer, views)
            raw = RawPhysics(rehearsal, views=views)
            ratios, own, bare = [], [], []
            for _ in range(2 if quick else 4):
                policy = play(rehearsal, raw, every=PICTURE_BLOCK, limit=80 if quick else 160, observer=observer)
                ratios.append(sum(policy.own_s) / sum(policy.reference_s))
                own += [1e3 * s / PICTURE_BLOCK for s in policy.own_s]
                bare += [1e3 * s / PICTURE_BLOCK for s in policy.reference_s]
        finally:
            views.close()
            observer.close()
        text = f"step with two cameras / (physics + render), {task}, {quality.name}"
        yield Figure("pixels", text, tuple(ratios), "x", "<=", 1.05, f"{spread(own)} / {spread(bare)} ms")


def _check_same_images(scene: Scene, observer: Observer, views: RawViews) -> None:
    """Check that both sides draw the same pixels, so that their times may be compared.

    Raises:
        ValueError: If they do not.
    """
    seen = observer.observe(scene, scene.reset())
    views.draw(scene.data)
    for (name, image), pixels in zip(seen.images.items(), views.pixels, strict=True):
        # Whether rows are read from the top or the bottom depends on the process's OpenGL context.
        if not (np.array_equal(image, pixels) or np.array_equal(image, pixels[::-1])):
            raise ValueError(f"the bare rendering of camera {name!r} gives another image")


def record_row(*, quick: bool) -> Iterator[Figure]:
    """Measure the cost of recording (appending, finishing and encoding) as a share of the loop without cameras.

    The share is one of processor time, because other work on the machine would lengthen the loop's wall time and so
    reduce the share.
    """
    for task_name in TASKS:
        rehearsal = rehearse(task_name, QUALITIES["fast"])
        scene, task = rehearsal.scene, rehearsal.scene.task
        shares, rates, appends = [], [], []
        for _ in range(2 if quick else 5):
            tracker = GoalTracker(
                scene.condition, scene.info, template=task.template, control_rate_hz=scene.control_rate_hz
            )
            builder = RecordBuilder(describe(scene, tracker, CONTEXT))
            state = scene.reset()
            loop = recording = 0.0
            action = applied = None
            for step in range(len(rehearsal.actions) + 1):
                began = time.process_time()
                if step:
                    action = rehearsal.actions[step - 1]
                    applied = scene.step(action)
                    state = scene.state()
                truth = tracker.update(state)
                stepped = time.process_time()
                append_row(builder, scene, state, truth, action=action, applied=applied)
                ended = time.process_time()
                loop += ended - began
                recording += ended - stepped
            appends.append(1e6 * recording / len(builder))
            began = time.process_time()
            encoded = record_bytes(builder.finish(termination="success", success=True))
            finishing = time.process_time() - began
            shares.append(100.0 * (recording + finishing) / (loop + finishing))
            seconds = len(rehearsal.actions) / scene.control_rate_hz
            rates.append(len(encoded) / 1e3 / seconds)
        note = f"append {spread(appends)} us a step; finishing and encoding shared out over the steps"
        yield Figure("record", f"recording, share of a step, {task_name}", tuple(shares), "%", "<=", 5.0, note)
        yield Figure("record", f"record per episode second, {task_name}", tuple(rates), "kB/s", "<=", 60.0)


def workers_row(*, quick: bool) -> Iterator[Figure]:
    """Compare two worker processes with one on the same plan."""
    ratios, notes = [], []
    for _ in range(1 if quick else 2):
        busy = {}
        for workers in (1, 2):
            busy[workers] = _busy_seconds(workers, trials=1 if quick else 6)
        ratios.append(busy[1] / busy[2])
        notes.append(f"{busy[1]:.1f} s / {busy[2]:.1f} s")
    load = " ".join(f"{value:.1f}" for value in os.getloadavg()[:2])
    note = f"{'; '.join(notes)} from a worker's first trial to its last, its start left out; load {load}"
    yield Figure("workers", "one worker / two workers, fast_food, expert", tuple(ratios), "x", ">=", 1.8, note)


def _busy_seconds(workers: int, *, trials: int) -> float:
    """Return the mean time that a worker took from the start of its first trial to the end of its last trial [s].

    The run has its own process, so that no cache has been filled before.
    """
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe(duplex=False)
    process = context.Process(target=_evaluate_timed, args=(workers, trials, theirs))
    process.start()
    theirs.close()
    try:
        events: list[tuple[float, float, float]] = ours.recv()
    finally:
        process.join()
    by_worker: dict[float, list[tuple[float, float]]] = defaultdict(list)
    for ended, took, worker in events:
        by_worker[worker].append((ended - took, ended))
    return float(np.mean([spans[-1][1] - spans[0][0] for spans in by_worker.values()]))


def _evaluate_timed(workers: int, trials: int, answer: Connection) -> None:
    """Run the plan and send (end, duration, worker) of each trial; this is the main function of the process."""
    events: list[tuple[float, float, float]] = []

    def note(progress: Progress) -> None:
        if progress.last is not None:
            wall = progress.last.wall
            events.append((time.perf_counter(), wall["total_s"], wall["worker"]))

    plan = make_plan("expert", tasks=[PICTURE_TASK], trials=trials, observation="state_only", quality="fast")
    with tempfile.TemporaryDirectory() as folder:
        evaluate(plan, Path(folder) / "run", workers=workers, on_progress=note)
    answer.send(events)
    answer.close()


@dataclass(frozen=True, slots=True)
class _PolicyCase:
    """A server and the settings of the run against it.

    Attributes:
        text: The case in a few words.
        latency_s: Time of an answer [s].
        serve: Makes the server.
        at_once: Number of requests that it answers simultaneously; a number that is never reached means no limit.
        trials: Number of trials of the variation; the training conditions get the same number.
        observation: Observation preset.
    """

    text: str
    latency_s: float
    serve: Callable[[], AbstractContextManager[str]]
    at_once: int
    trials: int = 72
    observation: str = "default"


def _policy_cases() -> Iterator[_PolicyCase]:
    for s in LATENCIES_S:
        yield _PolicyCase(f"openpi, {1e3 * s:.0f} ms", s, partial(dummy_server, s, concurrency=MANY), MANY)
        yield _PolicyCase(f"gr00t, {1e3 * s:.0f} ms", s, partial(dummy_gr00t_server, s), MAX_BATCH)
    one = partial(dummy_server, LATENCIES_S[1], concurrency=1)
    yield _PolicyCase("openpi, 100 ms, one at a time", LATENCIES_S[1], one, 1, 8, "state_only")


def policy_row(*, quick: bool) -> Iterator[Figure]:
    """Compare a run against a policy server that takes its time with what that time, or the simulation, alone takes."""
    for case in _policy_cases():
        with case.serve() as address:
            plan = make_plan(
                address,
                tasks=["morning_coffee"],
                variations=["T1"],
                trials=case.trials // (3 if quick else 1),
                observation=case.observation,
                quality="fast",
            )
            entries, wall = _timed_entries(plan, workers=WORKERS)
        asked = [e.wall["policy_answers"] for e in entries]
        # The questions of one trial follow each other, however many the server answers at once.
        policy = case.latency_s * max(sum(asked) / case.at_once, *asked)
        simulation = sum(e.wall[part] for e in entries for part in _SIMULATION) / WORKERS
        envs = sorted({e.wall["worker"]: round(e.wall["envs"]) for e in entries}.values())
        note = (
            f"{len(entries)} trials with {WORKERS} workers of {' and '.join(map(str, envs))} environments: {wall:.1f} "
            f"s; policy {policy:.1f} s, simulation {simulation:.1f} s; load {os.getloadavg()[0]:.1f}"
        )
        label = f"run / max(policy, simulation), {case.text}"
        yield Figure("policy", label, (wall / max(policy, simulation),), "x", "<=", 1.15, note)


_SIMULATION = ("simulation_s", "observe_s", "setup_s", "write_s")
"""Figures of the journal whose sum is what a worker simulates and draws."""


def _timed_entries(plan: Plan, *, workers: int) -> tuple[list[JournalEntry], float]:
    """Run a plan; return its journal, and the time from the begin of its first trial to the end of its last [s]."""
    ended: list[tuple[JournalEntry, float]] = []

    def note(progress: Progress) -> None:
        if progress.last is not None:
            ended.append((progress.last, time.perf_counter()))

    with tempfile.TemporaryDirectory() as folder:
        evaluate(plan, Path(folder) / "run", workers=workers, on_progress=note)
    wall = max(end for _, end in ended) - min(end - entry.wall["total_s"] for entry, end in ended)
    return [entry for entry, _ in ended], wall


def diagnosis_row(*, quick: bool) -> Iterator[Figure]:
    """Measure diagnosis and report of a full run, made by giving the records of a small one many seeds."""
    number = 240 if quick else RECORDS
    plan = make_plan(
        "zoo:lexical",
        tasks=TASKS[:2],
        variations=("L1", "R1", "T1"),
        trials=1,
        observation="state_only",
        quality="fast",
    )
    with tempfile.TemporaryDirectory() as scratch:
        small = evaluate(plan, Path(scratch) / "small", workers=2)
        copies = number // len(plan.trials)
        large_plan = replace(
            plan, trials=tuple(replace(t, seed=t.seed + 1000 * c) for c in range(copies) for t in plan.trials)
        )
        large = RunFolder.start(Path(scratch) / "large", large_plan.to_json())
        with large.journal() as journal:
            for record in small.records():
                m = record.metadata
                for copy in range(copies):
                    seed = m.seed + 1000 * copy
                    large.write_record(replace(record, metadata=replace(m, seed=seed)))
                    journal.append(JournalEntry(m.task, m.condition, m.variation, seed))
        began = time.perf_counter()
        diagnosis = diagnose_run(large)
        diagnosed = time.perf_counter() - began
        count = len(diagnosis.trials)
        try:
            write_report = importlib.import_module("betterbench.report").write_report
        except (ImportError, AttributeError) as error:
            note = f"diagnosis alone {diagnosed:.1f} s for {count} records; no report: {error}"
            yield Figure("diagnosis", "diagnosis + report", (), "s", "<=", 30.0, note)
            return
        write_report([diagnosis], Path(scratch) / "report")
        total = time.perf_counter() - began
    note = f"{count} records; diagnosis {diagnosed:.1f} s"
    scaled = total * RECORDS / count
    if count != RECORDS:
        note += f", scaled to {RECORDS} from {total:.1f} s"
    yield Figure("diagnosis", f"diagnosis + report of {RECORDS} records", (scaled,), "s", "<=", 30.0, note)


def materialize_row(*, quick: bool) -> Iterator[Figure]:
    """Compare materializing two views with MuJoCo's own drawing of the same colors, depth and segmentation."""
    for task, quality in itertools.product(PICTURE_TASKS, (QUALITIES["fast"], QUALITIES["standard"])):
        blocks = list(blocks_of(task, quality, quick=quick))
        ms = 1e3 / MAX_CHUNK_ROWS
        note = f"{spread([ms * b.own_s for b in blocks])} / {spread([ms * b.raw_s for b in blocks])} ms a row"
        text = f"raw passes / all modalities, two cameras, {task}, {quality.name}"
        yield Figure("materialize", text, tuple(b.raw_s / b.own_s for b in blocks), "x", ">=", 0.9, note)
        # Two processes work at the same time. With an idle core for each, the wall time would be the slower one's.
        ratios = tuple(b.raw_cpu_s / max(b.drawing_cpu_s, b.writing_cpu_s) for b in blocks)
        note = f"drawing {spread([ms * b.drawing_cpu_s for b in blocks])}, writing "
        note += f"{spread([ms * b.writing_cpu_s for b in blocks])}, raw {spread([ms * b.raw_cpu_s for b in blocks])} ms"
        yield Figure("materialize", "the same, processor time of the slower process", ratios, "x", note=note)


def amplify_row(*, quick: bool) -> Iterator[Figure]:
    """Compare attempts at amplified demonstrations, at each training condition of all tasks, with their bare physics.

    The steps in which an attempt shows that its goal lasts are on no record, and count on both sides.
    """
    rounds = 1 if quick else 5
    total_own, total_physics = [0.0] * rounds, [0.0] * rounds
    by_task: list[Figure] = []
    for task in all_tasks():
        starts = planned_starts(task, 1, first_seed=FIRST_DEMONSTRATION_SEED)
        library = Library([demonstrated_source(_collected(start)) for start in starts])
        planned = planned_starts(task, 1, first_seed=FIRST_AMPLIFIED_SEED)
        amplify_attempt(scene_of(planned[0].trial, "fast"), 0, library, AmplifierSettings())  # fills every cache
        ratios, own, physics = [], [], []
        for i in range(rounds):
            own_s, physics_s, steps = 0.0, 0.0, 0
            for start in planned:
                scene = scene_of(start.trial, "fast")
                began = time.process_time()
                attempt = amplify_attempt(scene, 0, library, AmplifierSettings())
                own_s += time.process_time() - began
                steps += attempt.record.n_steps + LASTING_STEPS
                raw = RawPhysics(Rehearsal(scene, attempt.record), clock=time.process_time)
                physics_s += raw(0, attempt.record.n_steps) + raw.go_on(LASTING_STEPS)
            total_own[i] += own_s
            total_physics[i] += physics_s
            ratios.append(own_s / physics_s)
            own.append(1e3 * own_s / steps)
            physics.append(1e3 * physics_s / steps)
        note = f"{spread(own)} / {spread(physics)} ms of processor time a step"
        by_task.append(Figure("amplify", f"the same, {task.id}", tuple(ratios), "x", note=note))
    ratios = [own / physics for own, physics in zip(total_own, total_physics, strict=True)]
    yield Figure("amplify", "attempts at demonstrations / physics, ten tasks", tuple(ratios), "x", "<=", 1.3)
    yield from by_task


def _collected(start: Start) -> Record:
    """Return a demonstration to amplify."""
    scene = scene_of(start.trial, "fast")
    attempts = (collect_attempt(scene, number) for number in range(4))
    return next(attempt.record for attempt in attempts if attempt.note.accepted)


def rows(peer: PeerRows) -> dict[str, Callable[..., Iterator[Figure]]]:
    """Return all rows by name, in the order of the table."""
    return {
        "step": step_row,
        "sleep": sleep_row,
        "pixels": pixels_row,
        "peer-rgb": peer.colors,
        "peer-all": peer.everything,
        "libero-rgb": peer.libero,
        "reset": peer.reset,
        "record": record_row,
        "workers": workers_row,
        "policy": policy_row,
        "diagnosis": diagnosis_row,
        "amplify": amplify_row,
        "materialize": materialize_row,
        "train": training_row,
        "assets": catalogue_row,
        "static": static_row,
    }
