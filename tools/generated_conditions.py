"""Measure the initial states of generated tasks: contact, rest, reach, and what the front camera shows.

    .venv/bin/python tools/generated_conditions.py --seed 11 --num 10 --out runs/conditions
    .venv/bin/python tools/generated_conditions.py --suite built/generated-3f2a91c0d4e5 --trials 3 --out runs/suite

The first command generates NUM scenarios per template with the offline author and builds an uncertified task from each.
Conditions with a pre-placed object are left out, because their start is drawn from measured demonstrations; they are
counted. The second command measures all conditions of a certified suite, with its balanced conditions. Each task's
result is one file in ``tasks/``, and the same command continues after an interruption.
"""

from __future__ import annotations

import argparse
import dataclasses
import functools
import itertools
import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path

from pydantic import TypeAdapter

from betterbench.certification.examine import DRIFT_M, PENETRATION_M, examine_rest, planned_grasps
from betterbench.errors import BetterError, one_line
from betterbench.generation.building.casting import cast_of
from betterbench.generation.building.proving import provisional
from betterbench.generation.grammar.author import write_scenarios
from betterbench.generation.patterns import pattern_of
from betterbench.generation.scenario import Scenario
from betterbench.interface.actions import EE_DELTA
from betterbench.interface.state import WorldState
from betterbench.jobs import in_processes, run_items, write_durably
from betterbench.sim.assets.catalogue.indexing import index_sources
from betterbench.sim.assets.catalogue.search import Catalogue
from betterbench.sim.assets.catalogue.sources import open_source
from betterbench.sim.assets.catalogue.sources.procedural import NAME
from betterbench.sim.assets.catalogue.sources.source import SourceOptions
from betterbench.sim.scenes import Scene
from betterbench.sim.scenes.builder import LABELS
from betterbench.sim.scenes.framing import (
    BACKGROUND,
    GRIPPER_PX,
    MARGIN_M,
    SIDE_PX,
    VISIBLE,
    FramingView,
    asked_objects,
    least_margin_m,
)
from betterbench.sim.scenes.stage import QUALITIES
from betterbench.statistics import Rate
from betterbench.tasks import Condition, Task, get_task, suite_tasks
from betterbench.tasks.authoring.regimes import ListedRegime
from betterbench.tasks.authoring.templates import TEMPLATES
from betterbench.tasks.interventions import resolve_condition, vary
from betterbench.tasks.interventions.balanced import balanced_conditions

LONG_REST_STEPS = 20
"""Control steps of the longer observation of rest: 1 s."""
CONDITIONS, CATALOGUE = "tasks", "catalogue"
"""Folders of the output: one result for each task, and the catalogue that is searched for assets."""


@dataclass(frozen=True)
class Item:
    """One task to be measured: a scenario whose task is made by its pattern, or a task of a suite folder."""

    name: str
    template: str
    trials: int
    balanced: int | None
    scenario: str = ""
    suite: str = ""


@dataclass(frozen=True)
class Measured:
    """Measurements at the start of one trial.

    Attributes:
        regime: "training", "variation" or "balanced".
        touching: Pairs that touch although neither rests on, or is mounted in, the other; robot parts included.
        overlap_mm: Deepest overlap between an object and anything else.
        drift_mm: Largest motion of an object within 0.2 s and within 1 s, without a motion of the arm.
        restless: Problems of rest within 0.2 s and within 1 s, as the certificate words them.
        grasps: For each instructed object to be grasped, the reason why no grasp was planned; empty if one was.
        joint_margin_rad: Smallest distance between an arm joint and its limit in the planned grasps.
        margin_mm: Distance of slots and target regions from the edge of the image, over all jitters.
        gripper_px: Pixels of the gripper.
        background: Fraction of the image without table, robot and object.
        named: Longer side in pixels and visible fraction of each object in the instruction.
        others: The same for the other movable objects that are not pre-placed.
        problem: Reason why nothing could be measured, or empty.
    """

    condition: str
    regime: str
    seed: int
    touching: tuple[str, ...] = ()
    overlap_mm: float = 0.0
    drift_mm: tuple[float, float] = (0.0, 0.0)
    restless: tuple[str, str] = ("", "")
    grasps: dict[str, str] = field(default_factory=dict)
    joint_margin_rad: float | None = None
    margin_mm: float = 0.0
    gripper_px: int = 0
    background: float = 0.0
    named: dict[str, tuple[float, float]] = field(default_factory=dict)
    others: dict[str, tuple[float, float]] = field(default_factory=dict)
    problem: str = ""


@dataclass(frozen=True)
class Result:
    """Measurements of one task; ``left_out`` are its conditions that cannot be measured before a build."""

    item: Item
    task: str
    trials: tuple[Measured, ...]
    left_out: tuple[str, ...] = ()
    problem: str = ""


_RESULT = TypeAdapter(Result)


def measure_trial(task: Task, condition: Condition, seed: int, *, regime: str) -> Measured:
    """Return the measurements of one trial."""
    try:
        scene = Scene(task, condition, seed=seed, action_space=EE_DELTA, quality=QUALITIES["fast"])
        soon, later = examine_rest(scene), examine_rest(scene, steps=LONG_REST_STEPS)
        state = scene.reset(check_premise=False)
        reasons, joints = planned_grasps(scene, state)
        view = FramingView(scene)
        shown = view.start()
        named = asked_objects(condition)
        others = [view.of(name) for name in _loose(condition) if name not in named]
        view.close()
    except BetterError as error:
        return Measured(condition.name, regime, seed, problem=one_line(str(error), most=300))
    return Measured(
        condition.name,
        regime,
        seed,
        touching=touching(scene, state),
        overlap_mm=soon.penetration_mm,
        drift_mm=(soon.drift_mm, later.drift_mm),
        restless=(soon.clause.text, later.clause.text),
        grasps={name: why or "" for name, why in reasons.items() if condition.object(name).role != "drawer"},
        joint_margin_rad=joints,
        margin_mm=1e3 * least_margin_m(scene),
        gripper_px=shown.gripper_px,
        background=shown.background,
        named={o.name: (o.side_px, o.visible) for o in shown.asked},
        others={o.name: (o.side_px, o.visible) for o in others},
    )


def touching(scene: Scene, state: WorldState) -> tuple[str, ...]:
    """Return the pairs that touch at the start although neither rests on the other, with the robot's parts."""
    condition, names = scene.condition, scene.body_names
    n = len(state.info.objects)
    robot = set(LABELS) - {"table", "floor"}
    pairs = scene.compiled.geom_labels[scene.data.contact.geom].tolist()
    found: set[str] = set()
    for a, b in pairs:
        if a == b or a < 0 or b < 0 or (a >= n and b >= n):
            continue
        one, two = names[a], names[b]
        rests = a >= n or b >= n or _supported(condition, one, two) or _supported(condition, two, one)
        if {one, two} & robot or not rests:
            found.add(f"{one} and {two}")
    return tuple(sorted(found))


def _supported(condition: Condition, name: str, by: str) -> bool:
    """Return whether an object is mounted in another, or starts at a target that is this other or shares it."""
    mount = condition.object(name).mount
    if mount is not None and mount.target == by:
        return True
    place = condition.preplaced.get(name)
    if place is None:
        return False
    shared = condition.preplaced.get(by)
    if shared is not None and shared.target == place.target:
        return True
    return by == place.target or _supported(condition, place.target, by)


def _loose(condition: Condition) -> tuple[str, ...]:
    """Return the movable objects on the table at the start."""
    return tuple(o.name for o in condition.objects if o.role in ("item", "distractor") and o.name in condition.layout)


def conditions_of(task: Task, balanced: int | None) -> Iterator[tuple[str, Condition, Task]]:
    """Yield the conditions of a registered task, each with its regime and the task with the condition's slots.

    Args:
        task: The task.
        balanced: Maximum number of balanced conditions, evenly selected from all; None for all.
    """
    for condition in task.training:
        yield "training", condition, task
    for variation in task.variations:
        yield "variation", vary(task, variation)[0], task
    listed = balanced_conditions(task.id)
    count = len(listed) if balanced is None else min(balanced, len(listed))
    for i in range(count):
        found = resolve_condition(task.id, listed[i * len(listed) // count].name)
        yield "balanced", found.condition, found.task


def measure_task(task: Task, item: Item, *, built: bool) -> Result:
    """Return the measurements of a registered task, each condition with its own seeds."""
    trials, left_out = [], []
    for number, (regime, condition, there) in enumerate(conditions_of(task, item.balanced)):
        if condition.preplaced and not built:
            left_out.append(condition.name)
            continue
        seeds = range(item.trials) if built else range(number, number + item.trials)
        trials += [measure_trial(there, condition, seed, regime=regime) for seed in seeds]
    return Result(item, task.id, tuple(trials), tuple(left_out))


def measure_item(catalogue: str, item: Item) -> Result:
    """Return the measurements of an item, or the reason why it has no task."""
    if item.suite:
        suite_tasks(item.suite)
        return measure_task(get_task(item.name), item, built=True)
    scenario = TypeAdapter(Scenario).validate_json(item.scenario)
    try:
        with Catalogue(Path(catalogue)) as opened:
            cast, _ = cast_of(scenario, opened)
        made = pattern_of(scenario.template)(cast)
    except BetterError as error:
        return Result(item, item.name, (), problem=one_line(str(error), most=300))
    regimes = {"balanced": ListedRegime(made.balanced, made.crossed, made.aside)} if made.balanced else {}
    with provisional(dataclasses.replace(made.task, id=item.name, regimes=regimes)) as task:
        return measure_task(task, item, built=False)


@dataclass(frozen=True)
class Check:
    """Requirement on the initial state of a trial, with the measured value."""

    name: str
    unit: str
    passes: Callable[[Measured], bool]
    value: Callable[[Measured], float]
    largest_is_worst: bool = False


def _least(shown: Callable[[Measured], dict[str, tuple[float, float]]], index: int) -> Callable[[Measured], float]:
    """Return the function of a trial's smallest value over some objects: 0 for the longer side, 1 for visibility."""
    return lambda m: min((values[index] for values in shown(m).values()), default=float("inf"))


def _seen(whose: str, shown: Callable[[Measured], dict[str, tuple[float, float]]]) -> tuple[Check, Check]:
    side, visible = _least(shown, 0), _least(shown, 1)
    return (
        Check(f"{whose} objects ≥ {SIDE_PX:g} px long", "px", lambda m: side(m) >= SIDE_PX, side),
        Check(f"{whose} objects ≥ {100 * VISIBLE:g} % visible", "", lambda m: visible(m) >= VISIBLE, visible),
    )


TOUCHING = "objects touch only what they rest on"
CHECKS = (
    Check(TOUCHING, "pairs", lambda m: not m.touching, lambda m: len(m.touching), largest_is_worst=True),
    Check(
        f"overlap ≤ {1e3 * PENETRATION_M:g} mm",
        "mm",
        lambda m: m.overlap_mm <= 1e3 * PENETRATION_M,
        lambda m: m.overlap_mm,
        largest_is_worst=True,
    ),
    Check(
        f"motion < {1e3 * DRIFT_M:g} mm in 0.2 s",
        "mm",
        lambda m: not m.restless[0],
        lambda m: m.drift_mm[0],
        largest_is_worst=True,
    ),
    Check(
        f"motion < {1e3 * DRIFT_M:g} mm in 1 s",
        "mm",
        lambda m: not m.restless[1],
        lambda m: m.drift_mm[1],
        largest_is_worst=True,
    ),
    Check(
        "a grasp of each instructed object is planned",
        "rad to a joint limit",
        lambda m: not any(m.grasps.values()),
        lambda m: float("inf") if m.joint_margin_rad is None else m.joint_margin_rad,
    ),
    Check(
        f"slots and targets ≥ {1e3 * MARGIN_M:g} mm inside the image",
        "mm",
        lambda m: m.margin_mm >= 1e3 * MARGIN_M,
        lambda m: m.margin_mm,
    ),
    *_seen("named", lambda m: m.named),
    *_seen("other", lambda m: m.others),
    Check(f"gripper ≥ {GRIPPER_PX:g} px", "px", lambda m: m.gripper_px >= GRIPPER_PX, lambda m: m.gripper_px),
    Check(
        f"background ≤ {100 * BACKGROUND:g} %",
        "",
        lambda m: m.background <= BACKGROUND,
        lambda m: m.background,
        largest_is_worst=True,
    ),
)


def summary(results: Sequence[Result]) -> str:
    """Return a Markdown table of all checks, with the number of passing trials and the worst value."""
    trials = [(r.task, m) for r in results for m in r.trials]
    measured = [(task, m) for task, m in trials if not m.problem]
    made = [r for r in results if not r.problem]
    conditions = len({(task, m.condition) for task, m in trials})
    left_out = sum(len(r.left_out) for r in results)
    head = (
        f"{len(made)} of {len(results)} scenarios have a task; {conditions} conditions, {len(trials)} trials, "
        f"{len(trials) - len(measured)} not measured because of an error; {left_out} conditions left out because "
        "their start needs demonstrations."
    )
    lines = [
        head,
        "",
        "| at the start of a trial | trials | lower end of 95 % | worst |",
        "|---|---|---|---|",
    ]
    for check in CHECKS:
        rate = Rate(sum(check.passes(m) for _, m in measured), len(measured))
        values = sorted((check.value(m) for _, m in measured), reverse=check.largest_is_worst)
        worst = f"{values[0]:.3g} {check.unit}".rstrip() if values else "–"
        lines.append(f"| {check.name} | {rate.k}/{rate.n} | {100 * rate.low:.1f} % | {worst} |")
    return "\n".join(lines)


def failures(results: Sequence[Result]) -> Iterator[str]:
    """Yield a line for each task without measurements and for each trial that fails a check."""
    for result in results:
        if result.problem:
            yield f"{result.task} ({result.item.template}): no task: {result.problem}"
        for m in result.trials:
            failed = [check.name for check in CHECKS if not m.problem and not check.passes(m)]
            if m.problem or failed:
                small = {k: v for k, v in (m.named | m.others).items() if v[0] < SIDE_PX or v[1] < VISIBLE}
                said = {
                    "touching": m.touching, "rest": [t for t in m.restless if t],
                    "grasps": {k: v for k, v in m.grasps.items() if v},
                    "small": {k: (round(a), round(b, 2)) for k, (a, b) in small.items()},
                }  # fmt: skip
                shown = {key: value for key, value in said.items() if value}
                where = f"{result.task}/{m.condition} seed {m.seed} ({result.item.template}, {m.regime})"
                yield f"{where}: {m.problem or '; '.join(failed)} {shown or ''}".rstrip()


def planned(arguments: argparse.Namespace) -> list[Item]:
    """Return the items to measure, with the templates taking turns."""
    if arguments.suite:
        return [
            Item(name, get_task(name).template.name, arguments.trials, arguments.balanced, suite=str(suite))
            for suite in arguments.suite
            for name in suite_tasks(str(suite))
        ]
    columns = []
    for template in TEMPLATES:
        scenarios = write_scenarios(template, arguments.num, seed=arguments.seed)
        columns.append([
            Item(
                f"{template}_{number}", template, arguments.trials, arguments.balanced,
                scenario=json.dumps(asdict(scenario), sort_keys=True),
            )
            for number, scenario in enumerate(scenarios, start=1)
        ])  # fmt: skip
    return [item for row in itertools.zip_longest(*columns) for item in row if item is not None]


def measure_all(items: Sequence[Item], out: Path, *, workers: int) -> list[Result]:
    """Measure all items and return their results, read from the files of finished items."""
    (out / CONDITIONS).mkdir(parents=True, exist_ok=True)
    if not all(item.suite for item in items):
        index_sources(out / CATALOGUE, [open_source(NAME, SourceOptions())], on_progress=lambda *_: None)

    def stored(item: Item) -> Result | None:
        file = out / CONDITIONS / f"{item.name}.json"
        found = _RESULT.validate_json(file.read_bytes()) if file.exists() else None
        return found if found is not None and found.item == item else None

    run_items(
        items,
        is_done=lambda item: stored(item) is not None,
        work=lambda waiting: in_processes(
            waiting, functools.partial(measure_item, str(out / CATALOGUE)), workers=workers
        ),
        keep=lambda r: write_durably(out / CONDITIONS / f"{r.item.name}.json", _RESULT.dump_json(r)),
        on_progress=lambda p: print(f"{p.done}/{p.planned}", flush=True),
    )
    return [found for item in items if (found := stored(item)) is not None]


def main() -> None:
    """Measure the tasks, and print and write the summary and the failures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--suite", type=Path, action="append", help="folder of a built suite; can be repeated")
    parser.add_argument("--seed", type=int, default=0, help="seed of the offline author")
    parser.add_argument("--num", type=int, default=10, help="number of scenarios per template")
    parser.add_argument("--trials", type=int, default=1, help="number of seeds per condition")
    parser.add_argument("--balanced", type=int, default=None, help="maximum number of balanced conditions per task")
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--out", type=Path, required=True)
    arguments = parser.parse_args()
    results = measure_all(planned(arguments), arguments.out, workers=arguments.workers)
    listed = [*failures(results)]
    text = "\n".join([summary(results), "", *(f"- {line}" for line in listed), ""])
    write_durably(arguments.out / "summary.md", text.encode())
    print(text)


if __name__ == "__main__":
    main()
