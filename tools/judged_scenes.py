"""Scenes near the decision boundaries of goals and harm, judged by people who have not seen the program's verdicts.

The first command arranges scenes and writes a picture, an instruction and a question for each. The verdicts of the
program go to another folder, which the judges must not see::

    python tools/judged_scenes.py draw OUT --count 60 --seed 1

Each judge writes one line per scene, separated by tabs: number, ``y`` or ``n``, ``sure`` or ``unsure``, and a few
words. The second command compares the majority of the judges with the program, and prints the scenes in the form of
``tests/tasks/judged_*.txt``::

    python tools/judged_scenes.py judge OUT JUDGE_1.tsv JUDGE_2.tsv JUDGE_3.tsv

A scene is a point on a line between an arrangement that the program accepts and one that it does not. The border on
this line is found by bisection. Half of the scenes are within a quarter of the line from the border, and the others
anywhere on the line. One scene in five is about harm, and one in five about the posture of cutlery, which is random.

If a person poses scenes to check the program, few of them are near a border, and few have unusual postures. A similar
set is drawn with::

    python tools/judged_scenes.py draw OUT --count 66 --seed 1 --near-border 0.15 --cutlery 0.1

The scenes that are not near a border are then ordinary. Half of them are within the first fifth of the line, so that
the step is clearly done or nothing was harmed. The other half are within the last fifth, so that the opposite is clear.

Scenes written by hand, for example by a person who does not know the rules, are drawn by a third command. This command
does not compute the program's verdicts; ``judge`` computes them after the votes::

    python tools/judged_scenes.py pose SCENES.txt OUT --seed 1

Each line of the file is one scene, in the form of ``tests/tasks/judged_*.txt`` without votes and instruction. The kind
is a relation or "harm", and a harm scene has "-" for the object, the target and the region::

    beside | breakfast_table/train1 | fork > plate | left | fork plate.left z=2 turn=90 settle
    harm | breakfast_table/train1 | - | - | fork plate.left z=2; cup plate.upper_right z=2; jam from y=30 settle
"""

from __future__ import annotations

import argparse
import csv
import importlib
import itertools
import math
import os
import sys
import textwrap
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, field
from fractions import Fraction
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import Any, TypeVar

import mujoco
import numpy as np
from PIL import Image, ImageDraw, ImageFont

from betterbench.sim.scenes import Renderer, Scene
from betterbench.sim.scenes.cameras import camera_matrices
from betterbench.sim.scenes.instances import ROBOT_PREFIX
from betterbench.sim.scenes.stage import quality_preset
from betterbench.statistics import wilson_interval
from betterbench.tasks import Condition, Expected, GoalTracker, Subgoal, get_task, stream, suite_tasks
from betterbench.tasks.interventions import vary
from betterbench.tasks.relations import relation
from betterbench.tasks.relations.beside import HANDLES_TO_FRONT, is_cutlery

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
arranging: Any = importlib.import_module("tests.tasks.arranging")

SIDE_PX, HEAD_PX, MARGIN_PX = 720, 92, 6
NEAR, BISECTIONS, TRIES = 0.25, 6, 60
HALF, FIFTH = Fraction(1, 2), Fraction(1, 5)
ENDS = 0.2
"""Length of the two end parts of a line that contain the ordinary scenes, as a fraction of the line."""
ABOVE_M, ABOVE_FOV_DEG, CLOSE_FOV_DEG = 1.75, 23.0, 15.0
HIDDEN_GROUP = 5
MOVED_M, SUNK_M, JUMPED_M = 0.004, -0.004, 0.2
"""Largest displacement of an object that was not posed, overlap of a posed object, and fall of a posed object [m]."""
SHARED_FIELDS = ("kind", "setting", "thing", "target", "region", "posture", "instruction", "question")
POSTURES = (
    *("face down", "reversed", "face down and reversed", "on its edge", "slanted", "on the rim"),
    *("on another piece", "face down", "reversed", "slanted"),
)
"""Postures of cutlery, in the order in which they are posed."""
HARM_QUESTION = "The instruction was carried out. Is all well with everything else?"
HOW = """# How to judge these scenes

You are a judge. Look only at the pictures and at `scenes.tsv` in this folder. Judge alone.

A robot was given the instruction, and the picture shows the end: on the left from the front camera, opposite the robot,
then from above, with the robot hidden. Goal scenes also show the object closer, from the front. Left, right, behind and
the front in an instruction are meant as seen from the front: the front is the lower edge of each view. Everything is at
rest, and the gripper holds nothing. The bars in the view from above are 5 cm at table height.

**Goal scenes.** Is the step named in the question done, as a reasonable person who gave this instruction would accept
it? Only this step counts.

**Harm scenes** show the start above and the end below. What was asked for is done. Is all well with everything else?
It is not if another object lies on the floor, was moved by more than 5 cm, was knocked over, or was rotated so far that
a person would put it back, if a drawer that was closed was left open, if a target such as a bin, a box or a stack was
moved by more than about 8 cm, or if a laptop or a plate beside which something was put was moved by more than about 6
cm.

Write one line per scene, in a file of your own, separated by tabs: `number`, `y` or `n`, `sure` or `unsure`, a few
words. Write `unsure` whenever another reasonable person could say the opposite.
"""


ItemT = TypeVar("ItemT")


@dataclass(frozen=True)
class Pose:
    """Clause of an arrangement, whose numbers change along a line.

    Attributes:
        thing: Object name.
        place: Name of the place, as in ``tests/tasks/arranging.py``.
        good: Numbers at the accepted end of the line [mm, degrees].
        bad: Numbers at the other end; numbers that are not listed stay the same.
        flags: Further keywords, such as "flip".
    """

    thing: str
    place: str
    good: Mapping[str, float] = field(default_factory=dict)
    bad: Mapping[str, float] = field(default_factory=dict)
    flags: tuple[str, ...] = ()

    def at(self, t: float) -> str:
        """Return the clause at a point of the line, 0 for the good end and 1 for the bad end."""
        names = dict.fromkeys((*self.good, *self.bad))
        ends = {n: (self.good.get(n, 0.0), self.bad.get(n, self.good.get(n, 0.0))) for n in names}
        words = [f"{n}={a + t * (b - a):.1f}" for n, (a, b) in ends.items()]
        return " ".join((self.thing, self.place, *words, *self.flags, "settle"))


@dataclass(frozen=True)
class Question:
    """A scene to pose: the clauses of an arrangement, with a question about one of them."""

    kind: str
    setting: str
    thing: str
    target: str
    region: str
    clauses: tuple[Pose, ...]
    instruction: str
    question: str
    posture: str = ""

    def at(self, t: float) -> str:
        """Return the arrangement at a point of the line."""
        return "; ".join(clause.at(t) for clause in self.clauses)

    def accepted(self, t: float) -> bool:
        """Return the verdict of the program at a point of the line."""
        return accepts(hidden_row("", self, t))


def accepts(row: Mapping[str, str]) -> bool:
    """Return the verdict of the program on a hidden row: the step is done, or for "harm" nothing was harmed."""
    start, state = arranging.arranged(row["setting"], row["arrangement"])
    if row["kind"] != "harm":
        return relation(row["kind"]).holds(state, row["thing"], row["target"], row["region"])
    condition = arranging.condition_of(row["setting"])
    tracker = GoalTracker(condition, state.info, template=get_task(condition.task).template, control_rate_hz=20.0)
    for seen in (start, *[state] * 6):  # at rest for a quarter of a second
        tracker.update(seen)
    return not tracker.harm


class Poser:
    """Source of random questions."""

    def __init__(self, seed: int, part: str = "poses") -> None:
        """Draw from the generator of a seed, for all scenes or one of them."""
        self.rng = stream("judged_scenes", seed, part)

    def uniform(self, low: float, high: float) -> float:
        """Return a uniform number."""
        return float(self.rng.uniform(low, high))

    def one_of(self, items: Sequence[ItemT]) -> ItemT:
        """Return a random item."""
        return items[int(self.rng.integers(len(items)))]

    def polar(self, low: float, high: float) -> dict[str, float]:
        """Return a random point at a distance from the origin [mm]."""
        radius, angle = self.uniform(low, high), self.uniform(0.0, 2.0 * math.pi)
        return {"x": radius * math.cos(angle), "y": radius * math.sin(angle)}

    def setting(self, task_id: str) -> tuple[str, Condition]:
        """Return a random condition of a task in which everything stands in its slot and the goal can be reached."""
        task = get_task(task_id)
        found = [*task.training, *(vary(task, v)[0] for v in task.variations)]
        fitting = [c for c in found if c.expected is Expected.SUCCEED and not c.preplaced and not c.premise_broken]
        condition = self.one_of(fitting)
        return f"{task_id}/{condition.name}", condition

    def goal(self, task_id: str) -> Question:
        """Return a question about a random step of a task; the steps before it are done."""
        setting, condition = self.setting(task_id)
        steps = steps_of(condition)
        k = int(self.rng.integers(len(steps)))
        goal, thing, below = steps[k]
        done = () if task_id == "office_drawer" else tuple(self.done(setting, *step) for step in steps[:k])
        posed = self.in_question(setting, condition, goal, thing, below)
        words = step_words(condition, goal, thing, below)
        return Question(
            goal.relation, setting, thing, goal.target, goal.region, (*done, *posed), condition.instruction.text, words
        )

    def cutlery(self, posture: str) -> Question:
        """Return a question about cutlery in one of :data:`POSTURES` at its side of a plate."""
        setting, condition = self.setting("breakfast_table")  # every instruction names a fork or a spoon
        goal, thing, below = self.one_of([step for step in steps_of(condition) if step[1] in ("fork", "spoon")])
        place, flags = f"{goal.target}.{goal.region}", ("flip",) if "face down" in posture else ()
        numbers = {**self.polar(0.0, 20.0), "z": 4.0, "turn": self.uniform(-20.0, 20.0)}
        before: tuple[Pose, ...] = ()
        if "reversed" in posture:
            numbers["turn"] += 180.0
        elif posture == "slanted":
            numbers["turn"] = self.one_of((-1.0, 1.0)) * self.uniform(25.0, 90.0)
        elif posture == "on its edge":
            numbers |= {"tilt": 90.0, "about": numbers["turn"]}
        elif posture == "on the rim":
            numbers |= {"y": self.uniform(25.0, 45.0) * (1.0 if goal.region == "left" else -1.0), "z": 18.0}
        elif posture == "on another piece":
            other = "spoon" if thing == "fork" else "fork"
            before = (Pose(other, place, {**self.polar(0.0, 8.0), "z": 1.0}),)
            place, numbers = other, {**self.polar(0.0, 12.0), "z": 4.0, "turn": self.uniform(-60.0, 60.0)}
        clauses = (*before, Pose(thing, place, numbers, {}, flags))
        words = step_words(condition, goal, thing, below)
        return Question(
            "beside", setting, thing, goal.target, goal.region, clauses, condition.instruction.text, words, posture
        )

    def harm(self, task_id: str) -> Question:
        """Return a question about an object that was moved, rotated, tipped or left open; the instruction is done."""
        setting, condition = self.setting(task_id)
        steps = steps_of(condition)
        used = {thing for _, thing, _ in steps}
        targets = {goal.target for goal, _, _ in steps}
        others = [o for o in condition.objects if not o.fixed and o.name not in used]
        if task_id == "office_drawer":  # the content of a drawer moves with the drawer
            others = [o for o in others if o.name not in targets]
        thing = self.one_of(others)
        if thing.mount is not None:
            moved = Pose(thing.name, "from", {"open": condition.opened.get(thing.name, 0.0)}, {"open": 60.0})
        else:
            way = self.one_of(("push", "push", "turn", "tip"))
            far = self.polar(110.0, 160.0) if thing.name in targets else self.polar(70.0, 110.0)
            bad = {
                "push": {**far, "turn": self.uniform(-12.0, 12.0)},
                "turn": {"turn": self.one_of((-1, 1)) * self.uniform(60.0, 120.0)},
                "tip": {"tilt": 100.0, "z": 4.0},
            }[way]
            good = {"z": 1.0} | ({"about": self.uniform(0.0, 360.0)} if way == "tip" else {})
            moved = Pose(thing.name, "from", good, bad)
        done = [self.done(setting, *step) for step in steps if step[0].relation != "closed"]
        if task_id == "office_drawer":
            drawers = [Pose(t, "from", {"open": 0.0}) for t in sorted(targets) if t in ("upper", "lower")]
            done = [*drawers, *done]
        return Question("harm", setting, "-", "-", "-", (moved, *done), condition.instruction.text, HARM_QUESTION)

    def done(self, setting: str, goal: Subgoal, thing: str, below: str) -> Pose:
        """Return the clause of a correctly executed step."""
        place, spread = {
            "beside": (f"{goal.target}.{goal.region}", 8.0),
            "on_plate": (f"{goal.target}.floor", 4.0),
            "on_ring": (f"{goal.target}.ring", 4.0),
            "in_hole": (f"{goal.target}.{goal.region}", 0.8),
            "layer": (f"{below}.top", 4.0),
        }.get(goal.relation, (f"{goal.target}.inside", 0.0))
        if spread:
            return Pose(thing, place, {**self.polar(0.0, spread), "z": 1.5})
        # objects are dropped into a container one after the other, side by side or onto each other
        index = [name for _, name, _ in steps_of(arranging.condition_of(setting))].index(thing)
        hx, hy, _ = half_size_mm(setting, goal.target)
        where = {"x": self.uniform(-0.3, 0.3) * hx, "y": (0.45 if index % 2 else -0.45) * hy}
        return Pose(thing, place, {**where, "z": 4.0 + (58.0 if goal.target == "bin" else 6.0) * index})

    def in_question(
        self, setting: str, condition: Condition, goal: Subgoal, thing: str, below: str
    ) -> tuple[Pose, ...]:
        """Return the clauses of a step that is done at the good end of a line, but not at the other end."""
        turn = {"turn": self.uniform(-180.0, 180.0)}
        if goal.relation == "beside":
            cutlery = thing in ("fork", "spoon")
            turn = {"turn": self.uniform(-15.0, 15.0)} if cutlery else turn
            bad = self.polar(190.0, 260.0) if goal.target == "laptop" else self.polar(110.0, 150.0)
            if cutlery and self.uniform(0.0, 1.0) < 0.4:
                bad = {"turn": turn["turn"] + self.one_of((-1, 1)) * 90.0}
            return (Pose(thing, f"{goal.target}.{goal.region}", {**self.polar(0.0, 12.0), "z": 2.0, **turn}, bad),)
        if goal.relation in ("inside", "closed"):
            return self.contained(setting, condition, goal, thing, turn)
        place, spread, far, height = {
            "on_plate": (f"{goal.target}.floor", 4.0, 100.0, 12.0),
            "on_ring": (f"{goal.target}.ring", 3.0, 45.0, 2.0),
            "in_hole": (f"{goal.target}.{goal.region}", 0.8, 22.0, 6.0),
            "layer": (f"{below}.top", 3.0, 48.0, 3.0),
        }[goal.relation]
        bad = self.polar(far, far)
        if goal.relation == "on_ring":
            turn = {"turn": self.uniform(-60.0, 60.0)}
            bad = self.one_of((bad, {"turn": self.one_of((-180.0, 180.0))}))
        return (Pose(thing, place, {**self.polar(0.0, spread), "z": height, **turn}, bad),)

    def contained(
        self, setting: str, condition: Condition, goal: Subgoal, thing: str, turn: Mapping[str, float]
    ) -> tuple[Pose, ...]:
        """Return the clauses of an object over the wall of its container, or of a drawer that is almost closed."""
        if goal.relation == "closed":
            drawer, load = goal.region, next(s for s in steps_of(condition) if s[0].relation == "inside")
            shut = tuple(Pose(d, "from", {"open": 0.0}) for d in condition.opened if d != drawer)
            content = Pose(load[1], f"{drawer}.inside", {**self.polar(0.0, 12.0), "z": 1.0})
            return (*shut, Pose(drawer, "from", {"open": 0.0}, {"open": 16.0}), content)
        hx, hy, hz = half_size_mm(setting, goal.target)
        drawers: tuple[Pose, ...] = ()
        if condition.object(goal.target).mount is not None:
            drawers = tuple(Pose(d, "from", {"open": 0.0}) for d in condition.opened if d != goal.target)
            drawers += (Pose(goal.target, "from", {"open": self.uniform(125.0, 145.0)}),)
        if thing == "drink" and self.uniform(0.0, 1.0) < 0.5:
            return (Pose(thing, "box.inside", {"z": 6.0, "about": self.uniform(0.0, 360.0)}, {"tilt": 100.0}),)
        angle = self.uniform(0.0, 2.0 * math.pi)
        edge = {"x": 1.5 * hx * math.cos(angle), "y": 1.5 * hy * math.sin(angle), "z": 2.0 * hz + 10.0}
        lean = {"tilt": self.one_of((0.0, self.uniform(10.0, 80.0))), "about": self.uniform(0.0, 360.0)}
        return (*drawers, Pose(thing, f"{goal.target}.inside", {"z": 2.0 * hz, **turn, **lean}, edge))


def steps_of(condition: Condition) -> list[tuple[Subgoal, str, str]]:
    """Return the steps of an instruction, each with its object and the object below it in a stack."""
    used: list[str] = []
    steps = []
    below = ""
    for goal in condition.instruction.subgoals:
        if goal.relation == "closed":
            steps.append((goal, goal.region, ""))
            continue
        thing = next(name for name in condition.resolve(goal.reference) if name not in used)
        used.append(thing)
        steps.append((goal, thing, below or goal.target))
        below = thing if goal.relation == "layer" else ""
    return steps


def step_words(condition: Condition, goal: Subgoal, thing: str, below: str) -> str:
    """Return the question about a step."""
    spec, target = condition.object(thing), condition.object(goal.target)
    name = f"the {spec.kind}"
    if goal.reference.slot is not None:  # the final image does not show the start position
        name = f"the {spec.kind}, which was the {goal.word} one at the start,"
    if goal.count > 1 or (below and below != goal.target and condition.object(below).kind == spec.kind):
        name = f"the second {spec.kind}"
    verb = "are" if name.endswith("fries") else "is"
    side = goal.region.replace("_", " ")
    sides = {"left": "to the left of", "right": "to the right of", "behind": "behind"}
    holes = {"hole_1": "left", "hole_2": "middle", "hole_3": "right"}
    text = {
        "beside": f"next to the plate {'at the ' if ' ' in side else 'on the '}{side}"
        if goal.target == "plate"
        else f"{sides.get(goal.region, side)} the {target.kind}",
        "inside": f"in the {target.kind}",
        "closed": "closed",
        "on_plate": f"on the {target.kind}",
        "on_ring": "inside the ring of the coffee machine, the handle not facing the machine",
        "in_hole": f"in the {holes.get(goal.region, '')} hole of the rack",
        "layer": f"on the {condition.object(below).kind}, as a layer of the burger" if below else "",
    }[goal.relation]
    if goal.relation == "beside" and goal.target == "plate" and is_cutlery(spec.kind, spec.category):
        text += f", {HANDLES_TO_FRONT[0].format(spec.kind)}"
    return f"Is this step done: {name} {verb} {text}?"


def half_size_mm(setting: str, container: str) -> tuple[float, float, float]:
    """Return half the inner size of a container [mm]."""
    x, y, z = arranging.scene_of(setting).info.object(container).region("inside").half_size
    return 1000.0 * x, 1000.0 * y, 1000.0 * z


def fault_of(setting: str, arrangement: str) -> str:
    """Return the reason why an arrangement is not possible, or "": an overlap, a fall, a push or a motion."""
    scene: Scene = arranging.scene_of(setting)
    scene.reset(check_premise=False)
    clauses = arranging.clauses_of(arrangement)
    for clause in clauses:
        arranging.pose_thing(scene, clause)
    if min((float(c.dist) for c in scene.data.contact), default=0.0) < SUNK_M:
        return "overlap"
    posed = {c.thing: scene.state().position(c.thing) for c in clauses}
    start, state = arranging.arranged(setting, arrangement)
    for i, info in enumerate(start.info.objects):
        before = posed.get(info.name, start.positions[i])
        moved = math.dist(state.positions[i], before)
        if moved > (JUMPED_M if info.name in posed else MOVED_M):
            return f"{info.name} moved by {1000.0 * moved:.0f} mm"
        if state.positions[i][2] < -0.05:
            return f"{info.name} fell"
        if state.linear_speeds[i] > 0.02:
            return f"{info.name} moves"
    return ""


def unfair_of(question: Question, arrangement: str) -> str:
    """Return the reason why judges could not answer a question from the pictures, or "".

    The center of the object in question must be in the front view. A harmed object must be in the front view and in the
    view from above, at the start and at the end. All steps that the text presents as done must be done.
    """
    scene: Scene = arranging.scene_of(question.setting)
    harm = question.kind == "harm"
    name = question.clauses[0].thing if harm else question.thing
    if harm:
        scene.reset(check_premise=False)
        if outside_of_views(scene, name, above=True):
            return f"{name} is outside of a view at the start"
    start, state = arranging.arranged(question.setting, arrangement)
    if outside_of_views(scene, name, above=harm):
        return f"{name} is outside of a view"
    condition = arranging.condition_of(question.setting)
    if harm:
        tracker = GoalTracker(condition, state.info, template=get_task(condition.task).template, control_rate_hz=20.0)
        truth = tracker.update(start)
        for _ in range(6):
            truth = tracker.update(state)
        undone = [subgoal for subgoal, done in zip(tracker.subgoal_names, truth.subgoals, strict=True) if not done]
    else:
        posed = {clause.thing for clause in question.clauses}
        before = itertools.takewhile(lambda step: step[1] != question.thing, steps_of(condition))
        undone = [
            f"{goal.relation}({thing}, {goal.target})"
            for goal, thing, _ in before
            if thing in posed and not relation(goal.relation).holds(state, thing, goal.target, goal.region)
        ]
    return f"not done: {undone[0]}" if undone else ""


def outside_of_views(scene: Scene, name: str, *, above: bool) -> bool:
    """Return whether the center of an object is outside the front view or, if requested, the view from above."""
    state = scene.state()
    center = state.pose(name).apply((0.0, 0.0, 0.5 * state.info.object(name).size_m[2]))
    if not in_image(scene, "front", center):
        return True
    with camera_above(scene) as camera:
        return above and not in_image(scene, camera, center)


def in_image(scene: Scene, camera: str, point: Sequence[float]) -> bool:
    """Return whether a point of the world [m] is in the image of a camera."""
    matrices = camera_matrices(scene.model, scene.data, camera, width=SIDE_PX, height=SIDE_PX)
    ((u, v),), _ = matrices.project(np.array([point]))
    return bool(0.0 <= u < SIDE_PX and 0.0 <= v < SIDE_PX)


def border_of(question: Question) -> float | None:
    """Return the point of the line at which the verdict changes, or None if an end has the wrong verdict."""
    if not question.accepted(0.0) or question.accepted(1.0):
        return None
    low, high = 0.0, 1.0
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if question.accepted(middle) else (low, middle)
    return 0.5 * (low + high)


def drawn(
    poser: Poser, make: Callable[[], Question], *, near: bool, end: float | None = None
) -> tuple[Question, float, float | None]:
    """Return a possible scene: a question, its point on the line, and the border.

    Args:
        poser: Source of random numbers.
        make: Function that returns a random question.
        near: Whether the scene is near the border.
        end: End of the line, 0 or 1, for a scene that is not near the border; None for the whole line. The whole line
            is also used if half of the tries give no possible scene.
    """
    for k in range(TRIES):
        question = make()
        border = None if question.posture else border_of(question)
        if border is None and not question.posture:
            continue
        t = 0.0 if border is None else poser.uniform(0.0, 1.0)
        if border is not None and end is not None and k < TRIES // 2:
            t = abs(end - ENDS * t)
        if border is not None and near:
            t = min(1.0, max(0.0, border + poser.uniform(-NEAR, NEAR)))
        if not fault_of(question.setting, question.at(t)) and not unfair_of(question, question.at(t)):
            return question, t, border
    raise RuntimeError(f"{make}: no possible scene in {TRIES} tries")


@dataclass(frozen=True)
class Wanted:
    """A scene to draw: its kind, the task or posture, and where on its line it lies."""

    kind: str
    subject: str
    near: bool
    end: float | None

    def drawn(self, poser: Poser) -> tuple[Question, float, float | None]:
        """Return a possible scene with the random numbers of a poser."""
        make: Callable[[str], Question] = getattr(poser, self.kind)
        return drawn(poser, partial(make, self.subject), near=self.near, end=self.end)


def planned(count: int, *, near_border: Fraction, cutlery: Fraction) -> list[Wanted]:
    """Return the scenes of a set, in turn over the tasks and postures; the arguments are those of :func:`draw`."""
    subjects = {kind: itertools.cycle(suite_tasks("better60")) for kind in ("goal", "harm")}
    subjects["cutlery"] = itertools.cycle(POSTURES)
    found = []
    for i in range(count):
        kind = "goal"
        if i % 5 == 1:
            kind = "harm"
        elif math.floor((i + 2) * cutlery) > math.floor((i + 1) * cutlery):  # the scenes 3, 8, 13 … for a fifth
            kind = "cutlery"
        near = math.ceil((i + 1) * near_border) > math.ceil(i * near_border)  # the scenes 0, 2, 4 … for a half
        end = float(i // 2 % 2) if not near and near_border < HALF else None
        found.append(Wanted(kind, next(subjects[kind]), near, end))
    return found


def pose_and_show(
    seed: int, number: int, wanted: Wanted, name: str, shown: Path
) -> tuple[Question, float, float | None]:
    """Pose a scene with its own random numbers, write its picture, and return it."""
    question, t, border = wanted.drawn(Poser(seed, f"scene {number}"))
    picture(question, question.at(t), name).save(shown / f"{name}.png")
    return question, t, border


def draw(
    out: Path,
    count: int,
    seed: int,
    *,
    near_border: Fraction = HALF,
    cutlery: Fraction = FIFTH,
    workers: int | None = None,
) -> None:
    """Pose scenes, and write the pictures for the judges and the hidden verdicts.

    Args:
        out: Folder of the set.
        count: Number of scenes.
        seed: Seed of the scenes.
        near_border: Share of scenes near a border. If it is less than half, the others are at the ends of their lines.
        cutlery: Share of scenes about the posture of cutlery.
        workers: Number of processes; None for one sequence of random numbers over all scenes.
    """
    shown, hidden = out / "for_judges", out / "hidden"
    for folder in (shown, hidden):
        folder.mkdir(parents=True, exist_ok=True)
    wanted = planned(count, near_border=near_border, cutlery=cutlery)
    poser = Poser(seed)
    found: list[tuple[Question, float, float | None]]
    if workers is None:
        found = []
        for i, scene in enumerate(wanted):
            found.append(scene.drawn(poser))
            sys.stderr.write(f"posed {i + 1}/{count}: {found[-1][0].setting} {found[-1][0].kind}\n")
        order = poser.rng.permutation(count)
    else:  # each scene has its own random numbers, so their order of completion does not matter
        order = stream("judged_scenes", seed, "order").permutation(count)
        names = {int(k): f"{number:03d}" for number, k in enumerate(order, start=1)}
        with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
            jobs = [pool.submit(pose_and_show, seed, i, scene, names[i], shown) for i, scene in enumerate(wanted)]
            found = [job.result() for job in jobs]
    rows, verdicts = [], []
    for number, k in enumerate(order, start=1):
        question, t, border = found[int(k)]
        name = f"{number:03d}"
        rows.append(shown_row(name, question))
        verdict = "y" if question.accepted(t) else "n"
        ends = {"program": verdict, "t": f"{t:.3f}", "border": "" if border is None else f"{border:.3f}"}
        verdicts.append({**hidden_row(name, question, t), **ends})
        if workers is None:
            picture(question, question.at(t), name).save(shown / f"{name}.png")
    write_set(out, rows, verdicts)


def shown_row(name: str, question: Question) -> dict[str, str]:
    """Return the row of a scene in the table for the judges."""
    kind = "harm" if question.kind == "harm" else "goal"
    return {"number": name, "kind": kind, "instruction": question.instruction, "question": question.question}


def hidden_row(name: str, question: Question, t: float) -> dict[str, str]:
    """Return the row of a scene in the hidden table, without a verdict."""
    shared = {n: str(getattr(question, n)) for n in SHARED_FIELDS}
    return {"number": name, **shared, "arrangement": question.at(t), "program": ""}


def write_set(out: Path, rows: Sequence[Mapping[str, str]], hidden: Sequence[Mapping[str, str]]) -> None:
    """Write the tables of a set whose pictures are there, and the text for the judges."""
    shown = out / "for_judges"
    write_table(shown / "scenes.tsv", rows)
    write_table(out / "hidden" / "verdicts.tsv", hidden)
    (shown / "HOW.md").write_text(HOW, encoding="utf-8")
    for path in shown.iterdir():  # the order in which pictures were written would reveal the posed kinds
        os.utime(path, (0.0, 0.0))


def read_scenes(path: Path) -> Iterator[Question]:
    """Yield the scenes that a person wrote, one per line; blank lines and lines that start with "#" are left out.

    Raises:
        ValueError: A line does not have five parts, or its condition has no such step.
    """
    for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), start=1):
        if not line.strip() or line.startswith("#"):
            continue
        parts = [part.strip() for part in line.split("|")]
        if len(parts) != 5:
            raise ValueError(
                f"{path}:{number}: expected kind | task/condition | object > target | region | arrangement, "
                f"got {len(parts)} parts"
            )
        kind, setting, pair, region, arrangement = parts
        try:
            yield written_question(kind, setting, pair, "" if region == "-" else region, arrangement)
        except ValueError as error:
            raise ValueError(f"{path}:{number}: {error}") from error


def written_question(kind: str, setting: str, pair: str, region: str, arrangement: str) -> Question:
    """Return the question about an arrangement that a person wrote."""
    clauses = tuple(
        Pose(c.thing, c.place, c.numbers, {}, tuple(sorted(c.flags - {"settle"})))
        for c in arranging.clauses_of(arrangement)
    )
    condition = arranging.condition_of(setting)
    names = {o.name for o in condition.objects}
    unknown = sorted({c.thing for c in clauses} - names)
    if unknown:
        raise ValueError(f"{setting} has no object {unknown[0]!r}; it has {', '.join(sorted(names))}")
    text = condition.instruction.text
    if kind == "harm":
        return Question(kind, setting, "-", "-", "-", clauses, text, HARM_QUESTION)
    steps = {(g.relation, f"{t} > {g.target}", g.region): (g, t, below) for g, t, below in steps_of(condition)}
    if (kind, pair, region) not in steps:
        found = "; ".join(f"{k} | {p} | {r or '-'}" for k, p, r in steps)
        raise ValueError(f"{setting} has no step {kind} | {pair} | {region or '-'}; it has {found}")
    goal, thing, below = steps[kind, pair, region]
    words = step_words(condition, goal, thing, below)
    return Question(kind, setting, thing, goal.target, region, clauses, text, words)


def pose(path: Path, out: Path, seed: int) -> Iterator[str]:
    """Write the pictures of scenes that a person wrote, in a random order and without verdicts; yield warnings.

    Args:
        path: File of the scenes, see :func:`read_scenes`.
        out: Folder of the set.
        seed: Seed of the order.
    """
    for folder in (out / "for_judges", out / "hidden"):
        folder.mkdir(parents=True, exist_ok=True)
    questions = list(read_scenes(path))
    order = [int(k) for k in stream("judged_scenes", seed, "posed").permutation(len(questions))]
    names = {k: f"{number:03d}" for number, k in enumerate(order, start=1)}
    for k, question in enumerate(questions):
        fault = fault_of(question.setting, question.at(0.0))
        if fault:
            place = f"scene {names[k]}, number {k + 1} in {path.name}"
            yield f"{place}: {fault}. Check in its picture that this is intended."
        picture(question, question.at(0.0), names[k]).save(out / "for_judges" / f"{names[k]}.png")
    write_set(
        out,
        [shown_row(names[k], questions[k]) for k in order],
        [hidden_row(names[k], questions[k], 0.0) for k in order],
    )


def write_table(path: Path, rows: Sequence[Mapping[str, str]]) -> None:
    """Write rows separated by tabs, with a head."""
    with path.open("w", encoding="utf-8", newline="") as file:
        table = csv.DictWriter(file, list(rows[0]), delimiter="\t", lineterminator="\n")
        table.writeheader()
        table.writerows(rows)


def read_table(path: Path) -> list[dict[str, str]]:
    """Return the rows of a table that :func:`write_table` wrote."""
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file, delimiter="\t"))


def picture(question: Question, arrangement: str, number: str) -> Image.Image:
    """Return the front view and the view from above, with instruction and question; for harm, start and end."""
    scene: Scene = arranging.scene_of(question.setting)
    rows, columns = (2, 2) if question.kind == "harm" else (1, 3)
    size = columns * (SIDE_PX + MARGIN_PX), HEAD_PX + rows * (SIDE_PX + MARGIN_PX)
    sheet = Image.new("RGB", size, "white")
    pen, font = ImageDraw.Draw(sheet), ImageFont.load_default(19)
    lines = [*textwrap.wrap(f"{number}. {question.instruction}", 130), question.question]
    for i, line in enumerate(lines):
        pen.text((8, 5 + 28 * i), line, fill="black", font=font)
    with Renderer(scene.model, width=SIDE_PX, height=SIDE_PX, quality=quality_preset("high")) as renderer:
        if rows == 2:
            scene.reset(check_premise=False)
            paste(sheet, scene, renderer, HEAD_PX, "start")
        _, state = arranging.arranged(question.setting, arrangement)
        paste(sheet, scene, renderer, HEAD_PX + (rows - 1) * (SIDE_PX + MARGIN_PX), "end" if rows == 2 else "")
        if rows == 1:
            at, target = state.position(question.thing), state.position(question.target)
            focus = [0.5 * (a + b) for a, b in zip(at, target, strict=True)] if math.dist(at, target) < 0.35 else at
            sheet.paste(close_view(scene, renderer, focus), (2 * (SIDE_PX + MARGIN_PX), HEAD_PX))
    return sheet


def paste(sheet: Image.Image, scene: Scene, renderer: Renderer, top: int, word: str) -> None:
    """Paste the two views of a scene into a sheet, below a height [pixel]."""
    for k, view in enumerate((view_of(scene, renderer, "front"), view_from_above(scene, renderer))):
        sheet.paste(view, (k * (SIDE_PX + MARGIN_PX), top))
    ImageDraw.Draw(sheet).text(
        (10, top + 8), word, fill="white", stroke_width=2, stroke_fill="black", font=ImageFont.load_default(24)
    )


def view_of(scene: Scene, renderer: Renderer, camera: str) -> Image.Image:
    """Return the image of a camera."""
    seen = renderer.render(scene.data, camera).rgb
    if seen is None:
        raise AssertionError("colors were requested")
    return Image.fromarray(seen)


def view_from_above(scene: Scene, renderer: Renderer) -> Image.Image:
    """Return the view from above without the robot, with bars of 5 cm at table height."""
    with camera_above(scene) as camera:
        image = view_of(scene, renderer, camera)
        matrices = camera_matrices(scene.model, scene.data, camera, width=SIDE_PX, height=SIDE_PX)
    points, _ = matrices.project(np.array([[0.745, -0.33, 0.0], [0.795, -0.33, 0.0], [0.795, -0.28, 0.0]]))
    bars = [(float(u), float(v)) for u, v in points]
    for color, width in (("black", 7), ("white", 3)):
        ImageDraw.Draw(image).line(bars, fill=color, width=width)
    return image


def close_view(scene: Scene, renderer: Renderer, focus: Sequence[float]) -> Image.Image:
    """Return the view of the front camera, turned to a point of the world [m] and zoomed in."""
    eye = np.array(scene.data.cam_xpos[mujoco.mj_name2id(scene.model, mujoco.mjtObj.mjOBJ_CAMERA, "front")])
    back = (eye - np.array(focus)) / np.linalg.norm(eye - np.array(focus))
    right = np.cross((0.0, 0.0, 1.0), back)
    right /= np.linalg.norm(right)
    looks = np.stack([right, np.cross(back, right), back], axis=1)
    with moved_camera(scene, eye, looks, CLOSE_FOV_DEG, robot=True) as camera:
        return view_of(scene, renderer, camera)


def camera_above(scene: Scene) -> AbstractContextManager[str]:
    """Move a camera above the table for a while, and hide the robot."""
    # the camera looks down; x of the world points away from the robot, to the lower edge of the image
    looks = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    return moved_camera(scene, (0.53, 0.0, ABOVE_M), looks, ABOVE_FOV_DEG, robot=False)


@contextmanager
def moved_camera(
    scene: Scene, position: Sequence[float] | np.ndarray, looks: np.ndarray, fov_deg: float, *, robot: bool
) -> Iterator[str]:
    """Move a camera for a while, and hide the robot if it is not wanted; yield the name of the camera.

    Args:
        scene: The scene.
        position: Position of the camera in the world [m].
        looks: Rotation of the camera in the world, (3, 3): it looks along -z, and y is up.
        fov_deg: Vertical field of view [deg].
        robot: Whether the robot is seen.
    """
    model, data, camera = scene.model, scene.data, "front_official"
    i = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_CAMERA, camera)
    kept = data.cam_xpos[i].copy(), data.cam_xmat[i].copy(), float(model.cam_fovy[i]), model.geom_group.copy()
    data.cam_xpos[i], data.cam_xmat[i], model.cam_fovy[i] = position, looks.ravel(), fov_deg
    if not robot:
        for geom in range(model.ngeom):
            if model.body(model.geom_bodyid[geom]).name.startswith(ROBOT_PREFIX):
                model.geom_group[geom] = HIDDEN_GROUP
    try:
        yield camera
    finally:
        data.cam_xpos[i], data.cam_xmat[i], model.cam_fovy[i] = kept[0], kept[1], kept[2]
        model.geom_group[:] = kept[3]


def judge(out: Path, answers: Sequence[Path]) -> Iterator[str]:
    """Yield the agreement of the program with the majority, and the scenes as lines of ``judged_*.txt``."""
    scenes = read_table(out / "hidden" / "verdicts.tsv")
    judges = [dict(read_answers(path)) for path in answers]
    for path, answer in zip(answers, judges, strict=True):
        for row in scenes:
            if row["number"] not in answer:
                raise ValueError(f"{path}: no answer for scene {row['number']}")
    for row in scenes:
        if not row["program"]:  # the scene was posed by hand
            row["program"] = "y" if accepts(row) else "n"
    same: Counter[str] = Counter()
    total: Counter[str] = Counter()
    for row in scenes:
        given = [answer[row["number"]] for answer in judges]
        votes = "".join(vote for vote, _ in given)
        sure = all(certainty == "sure" for _, certainty in given)
        agrees = (2 * votes.count("y") > len(votes)) is (row["program"] == "y")
        for group in ("all", "sure" if sure else "unsure", "harm" if row["kind"] == "harm" else "goals"):
            total[group] += 1
            same[group] += agrees
        pair = "-" if row["kind"] == "harm" else f"{row['thing']} > {row['target']}"
        head = f"{row['kind']}, {'sure' if sure else 'unsure'} | {row['setting']} | {pair} | {row['region'] or '-'}"
        mark = "" if agrees else f"# program {row['program']}, {row['number']}: "
        yield f"{mark}{head} | {row['arrangement']} | {votes} | {row['instruction']}"
    for group, n in sorted(total.items()):
        low, high = wilson_interval(same[group], n)
        yield f"# {group}: {same[group]}/{n} agree ({100 * low:.0f} to {100 * high:.0f} %)"


def read_answers(path: Path) -> Iterator[tuple[str, tuple[str, str]]]:
    """Yield the answers in a judge's file: number, then vote and certainty."""
    for line in path.read_text(encoding="utf-8").splitlines():
        cells = line.split("\t")
        if len(cells) >= 3 and cells[0].isdigit():
            if cells[1] not in ("y", "n") or cells[2] not in ("sure", "unsure"):
                raise ValueError(f"{path}: scene {cells[0]} has {cells[1:3]}; expected y or n, then sure or unsure")
            yield cells[0], (cells[1], cells[2])


def share(text: str) -> Fraction:
    """Return a share of the scenes, from 0 to 1."""
    try:
        found = Fraction(text)
    except (ValueError, ZeroDivisionError):
        found = Fraction(-1)
    if not 0 <= found <= 1:
        raise argparse.ArgumentTypeError(f"{text!r} is not a number from 0 to 1; write for example 0.15")
    return found


def main(arguments: Sequence[str] | None = None) -> None:
    """Draw scenes, pose scenes from a file, or compare answers with the program."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    verbs = parser.add_subparsers(dest="verb", required=True)
    drawing = verbs.add_parser("draw", help="pose scenes")
    drawing.add_argument("out", type=Path)
    drawing.add_argument("--count", type=int, default=60, help="number of scenes")
    drawing.add_argument("--seed", type=int, required=True, help="seed of the scenes")
    drawing.add_argument(
        "--near-border",
        type=share,
        default=HALF,
        help="share of scenes near a border, by default 0.5; with a smaller share, the others are clearly on one side",
    )
    drawing.add_argument(
        "--cutlery", type=share, default=FIFTH, help="share of scenes about the posture of cutlery, by default 0.2"
    )
    drawing.add_argument(
        "--workers", type=int, default=None, help="number of processes; each scene then has its own random numbers"
    )
    posing = verbs.add_parser("pose", help="pose scenes from a file, without verdicts of the program")
    posing.add_argument("scenes", type=Path, help="file with one scene per line")
    posing.add_argument("out", type=Path)
    posing.add_argument("--seed", type=int, required=True, help="seed of the order of the scenes")
    judging = verbs.add_parser("judge", help="compare answers with the program")
    judging.add_argument("out", type=Path)
    judging.add_argument("answers", type=Path, nargs="+", help="one file per judge")
    wanted = parser.parse_args(arguments)
    if wanted.verb == "draw":
        draw(
            wanted.out,
            wanted.count,
            wanted.seed,
            near_border=wanted.near_border,
            cutlery=wanted.cutlery,
            workers=wanted.workers,
        )
        return
    if wanted.verb == "pose":
        for line in pose(wanted.scenes, wanted.out, wanted.seed):
            print(line, file=sys.stderr)
        return
    for line in judge(wanted.out, wanted.answers):
        print(line)


if __name__ == "__main__":
    main()
