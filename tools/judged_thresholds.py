"""Thresholds of goals and harm that agree best with the blind judges, and their cross-validation.

    python tools/judged_thresholds.py
    python tools/judged_thresholds.py --scenes side_close

For each rule, the script measures its quantity in all judged scenes (``tests/tasks/judged_*.txt``) in which this rule
alone decides. It prints the threshold in use with its wrong scenes, and the interval of thresholds with the fewest
wrong scenes. For cross-validation, it also prints the wrong scenes if the threshold for each set is fitted to the other
sets. ``--scenes`` lists the scenes of one rule instead. Scenes of which all three judges are sure have weight 2. The
scenes of ``judged_blind.txt``, which had a single judge, have weight 1/3.
"""

from __future__ import annotations

import argparse
import importlib
import math
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from betterbench.geometry import horizontal_distance, tilt_of, yaw_of
from betterbench.interface.state import WorldState
from betterbench.tasks import THRESHOLDS
from betterbench.tasks.judging.harm import anchors, bystanders, mere_targets, way_of_ends, way_of_outermost
from betterbench.tasks.judging.targets import asked_by
from betterbench.tasks.relations.beside import is_laid
from betterbench.tasks.relations.loose import middle
from betterbench.tasks.relations.placing import foot

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
judged: Any = importlib.import_module("tests.tasks.test_judged_blind")
arranging: Any = importlib.import_module("tests.tasks.arranging")

SETS = {
    "blind": judged.SAID,
    "held_out": judged.HELD_OUT,
    "by_chance": judged.BY_CHANCE,
    "harm": judged.HARM,
    "again": judged.AGAIN,
    "third": judged.THIRD,
    "fourth": judged.FOURTH,
    "fifth": judged.FIFTH,
    "sixth": judged.SIXTH,
    "seventh": judged.SEVENTH,
    "eighth": judged.EIGHTH,
}
UPRIGHT, FLAT = math.radians(5.0), math.radians(10.0)


@dataclass(frozen=True)
class Judged:
    """A judged scene with its states.

    Attributes:
        set: Name of the set.
        scene: The line of the file.
        start: State at reset.
        state: State that was judged.
    """

    set: str
    scene: Any
    start: WorldState
    state: WorldState

    @property
    def thing(self) -> str:
        """Name of the object. For harm, it is the first object moved from its start, or else the first posed object."""
        pair: str = self.scene.pair
        if pair != "-":
            return pair.split(" > ", maxsplit=1)[0]
        clauses = arranging.clauses_of(self.scene.arrangement)
        moved = (c for c in clauses if c.place == "from" and "open" not in c.numbers)
        return str(next(moved, clauses[0]).thing)

    @property
    def target(self) -> str:
        """Name of the target of a goal."""
        return str(self.scene.pair.split(" > ")[1])

    @property
    def tilt(self) -> float:
        """Tilt of the object [rad]."""
        return tilt_of(self.state.quaternion(self.thing))

    @property
    def turn(self) -> float:
        """Rotation of the object about the vertical, relative to the target [rad]."""
        turn = yaw_of(self.state.quaternion(self.thing)) - yaw_of(self.state.quaternion(self.target))
        return abs(math.remainder(turn, 2.0 * math.pi))

    @property
    def moved(self) -> float:
        """Distance of the object from its start [m]."""
        return math.dist(middle(self.start, self.thing), middle(self.state, self.thing))

    @property
    def ends(self) -> float:
        """Displacement of the object's ends by rotation [m]."""
        before, after = (s.quaternion(self.thing) for s in (self.start, self.state))
        return way_of_ends(self.state.info.object(self.thing), before, after)

    @property
    def outermost(self) -> float:
        """Displacement of the object's outermost point [m]."""
        return way_of_outermost(
            self.state.info.object(self.thing), self.start.pose(self.thing), self.state.pose(self.thing)
        )

    def offset(self, region: str) -> float:
        """Return the horizontal distance of the object's foot from a region of the target [m]."""
        there = self.state.pose(self.target).apply(self.state.info.object(self.target).region(region).position)
        return horizontal_distance(foot(self.state, self.thing), there)

    def beside(self) -> tuple[float, float, float, float] | None:
        """Return an upright object's distances from the named side, past its ends and from a round edge, and its angle.

        The lengths are in meters, the angle from right to behind in radians. None if the object is not upright on the
        table, or if its handle points elsewhere.
        """
        thing, anchor = (self.state.info.object(name) for name in (self.thing, self.target))
        if self.tilt > UPRIGHT or not self.state.touching(self.thing, "table"):
            return None
        if is_laid(thing, anchor) and self.turn > judged_limit("side_turn"):
            return None
        x, y, _ = self.state.pose(self.target).inverse().apply(foot(self.state, self.thing))
        half_x, half_y = 0.5 * anchor.size_m[0], 0.5 * anchor.size_m[1]
        away, past = {
            "left": (-y - half_y, abs(x) - half_x),
            "right": (y - half_y, abs(x) - half_x),
            "behind": (-x - half_x, abs(y) - half_y),
            "upper_right": (y - half_y, 0.0),
        }[self.scene.region]
        return away, past, math.hypot(x, y) - half_x, math.atan2(-x, y)


def judged_limit(name: str) -> float:
    """Return the threshold in use."""
    return THRESHOLDS.to_json()[name]


def side(scene: Judged, *, of: str, upper_right: bool = False) -> tuple[float, float, float, float] | None:
    """Return the distances and the angle of a scene of "beside" at a laptop or a plate, or None for another scene."""
    kind, region = scene.scene.kind.split(",")[0], scene.scene.region
    if kind != "beside" or scene.target != of or (region == "upper_right") is not upper_right:
        return None
    return scene.beside()


def side_reach(scene: Judged) -> float | None:
    """Distance of objects that are level with a laptop."""
    found = side(scene, of="laptop")
    if found is None or found[0] < judged_limit("side_least"):
        return None
    return found[0] if found[1] <= min(judged_limit("side_beyond"), found[0]) else None


def side_beyond(scene: Judged) -> float | None:
    """Distance past the ends of a laptop."""
    found = side(scene, of="laptop")
    return None if found is None or found[0] < judged_limit("side_least") or found[1] > found[0] else found[1]


def side_close(scene: Judged) -> float | None:
    """Distance of objects to the left and right of a plate."""
    found = side(scene, of="plate")
    if found is None or found[2] < judged_limit("side_close_least"):
        return None
    across = math.atan2(abs(math.sin(found[3])), abs(math.cos(found[3])))
    return found[0] if across < judged_limit("side_diagonal_from") else None


def side_diagonal_to(scene: Judged) -> float | None:
    """Angle of objects at the upper right of a plate, beyond the diagonal."""
    found = side(scene, of="plate", upper_right=True)
    if found is None or found[3] < math.radians(45.0) or found[0] > judged_limit("side_close"):
        return None
    return found[3] if judged_limit("side_close_least") <= found[2] <= judged_limit("side_close_diagonal") else None


def side_close_diagonal(scene: Judged) -> float | None:
    """Distance of objects at the upper right of a plate."""
    found = side(scene, of="plate", upper_right=True)
    if found is None or found[0] > judged_limit("side_close"):
        return None
    return found[2] if judged_limit("side_diagonal_from") <= found[3] <= judged_limit("side_diagonal_to") else None


def plate_offset(scene: Judged) -> float | None:
    """Offset of plates that are not upside down, on or over another plate."""
    if not scene.scene.kind.startswith("on_plate") or scene.tilt > 9.0 * UPRIGHT or scene.offset("floor") > 0.11:
        return None
    return scene.offset("floor")


def ring_radius(scene: Judged) -> float | None:
    """Offset of mugs whose handle does not face the coffee machine."""
    kind = scene.scene.kind
    return scene.offset("ring") if kind.startswith("on_ring") and scene.tilt <= UPRIGHT and scene.turn < 2.1 else None


def layer_offset(scene: Judged) -> float | None:
    """Offset of flat layers."""
    if not scene.scene.kind.startswith("layer") or min(scene.tilt, math.pi - scene.tilt) > FLAT:
        return None
    offset = horizontal_distance(foot(scene.state, scene.thing), scene.state.position(scene.target))
    return offset if offset < 0.06 and scene.scene.arrangement.count("flip") == 0 else None


def harm(scene: Judged, *, target: bool) -> bool:
    """Return whether a scene is about an upright object on the table that was posed where it started."""
    if not scene.scene.kind.startswith("harm") or scene.tilt > 9.0 * UPRIGHT:
        return False
    clauses = arranging.clauses_of(scene.scene.arrangement)
    if next(c for c in clauses if c.thing == scene.thing).place != "from":
        return False
    asked = asked_by(arranging.condition_of(scene.scene.setting))
    names = mere_targets(asked, scene.state.info) if target else bystanders(asked, scene.state.info)
    return scene.thing in names and scene.state.position(scene.thing)[2] > -0.05


def pushed_limit(scene: Judged, *, target: bool) -> str:
    """Return the name of the limit of an object's displacement."""
    if not target:
        return "displaced"
    condition = arranging.condition_of(scene.scene.setting)
    return "anchor_moved" if scene.thing in anchors(asked_by(condition)) else "target_moved"


def is_pushed_and_turned(scene: Judged, *, target: bool) -> bool:
    """Return whether only the outermost point of an object is beyond its limit."""
    within = scene.moved <= judged_limit(pushed_limit(scene, target=target)) and scene.ends <= judged_limit("turned")
    return not target and within and scene.outermost > judged_limit("outermost_moved")


def pushed(scene: Judged, limit: str) -> float | None:
    """Return the displacement of an object if this limit alone decides the scene, otherwise None."""
    target = limit != "displaced"
    if not harm(scene, target=target) or scene.ends > judged_limit("turned"):
        return None
    if pushed_limit(scene, target=target) != limit or is_pushed_and_turned(scene, target=target):
        return None
    return scene.moved


def displaced(scene: Judged) -> float | None:
    """Displacement of other objects."""
    return pushed(scene, "displaced")


def target_moved(scene: Judged) -> float | None:
    """Displacement of targets that objects are put into or on."""
    return pushed(scene, "target_moved")


def anchor_moved(scene: Judged) -> float | None:
    """Displacement of targets that objects are put beside."""
    return pushed(scene, "anchor_moved")


def outermost_moved(scene: Judged) -> float | None:
    """Displacement of the outermost point of other objects."""
    if not harm(scene, target=False) or scene.ends > judged_limit("turned"):
        return None
    return scene.outermost or None if scene.moved <= judged_limit("displaced") else None


def turned(scene: Judged) -> float | None:
    """Displacement of the ends of rotated objects."""
    for target in (False, True):
        if not harm(scene, target=target) or scene.moved > judged_limit(pushed_limit(scene, target=target)):
            continue
        return None if is_pushed_and_turned(scene, target=target) else scene.ends or None
    return None


RULES: dict[str, Callable[[Judged], float | None]] = {
    rule.__name__: rule
    for rule in (
        *(side_reach, side_beyond, side_close, side_diagonal_to, side_close_diagonal, plate_offset, ring_radius),
        *(layer_offset, displaced, target_moved, anchor_moved, turned, outermost_moved),
    )
}


class Point(NamedTuple):
    """A scene of a rule: its set, quantity, whether it was accepted, and its weight."""

    set: str
    value: float
    accepted: bool
    weight: float


def weight_of(scene: Judged) -> float:
    """Return the weight of a judged scene."""
    if scene.set == "blind":
        return 1.0 / 3.0
    return 2.0 if scene.scene.kind.endswith(", sure") else 1.0


def best_interval(points: Sequence[Point]) -> tuple[float, float]:
    """Return the widest interval of thresholds with the smallest weight of wrong scenes; it may be unbounded."""
    values = sorted({point.value for point in points})
    gaps = list(zip((-math.inf, *values), (*values, math.inf), strict=True))
    costs = [sum(p.weight for p in points if (p.value <= low) is not p.accepted) for low, _ in gaps]
    least = min(costs) + 1e-9
    widest = [gap for gap, cost in zip(gaps, costs, strict=True) if cost <= least]
    return max(widest, key=lambda gap: gap[1] - gap[0])


def middle_of(interval: tuple[float, float]) -> float:
    """Return a threshold in an interval: the middle, or the end that is finite."""
    low, high = interval
    return high if math.isinf(low) else math.inf if math.isinf(high) else 0.5 * (low + high)


def wrong(points: Sequence[Point], limit: float) -> int:
    """Return the number of scenes that a threshold judges wrongly."""
    return sum((p.value <= limit) is not p.accepted for p in points)


def wrong_in_other_sets(points: Sequence[Point]) -> int:
    """Return the number of wrong scenes if the threshold of each set is fitted to the other sets."""
    total = 0
    for name in dict.fromkeys(point.set for point in points):
        others = [p for p in points if p.set != name]
        if others:
            total += wrong([p for p in points if p.set == name], middle_of(best_interval(others)))
    return total


def all_scenes() -> Iterator[Judged]:
    """Yield all judged scenes with their states."""
    for name, scenes in SETS.items():
        for scene in scenes:
            start, state = arranging.arranged(scene.setting, scene.arrangement)
            yield Judged(name, scene, start, state)


def shown(name: str, value: float) -> str:
    """Return a value in degrees or millimeters."""
    return f"{math.degrees(value):.1f} deg" if name == "side_diagonal_to" else f"{1000.0 * value:.1f} mm"


def main(arguments: Sequence[str] | None = None) -> None:
    """Print all rules, or the scenes of one rule."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--scenes", choices=tuple(RULES), help="list the scenes of this rule")
    chosen = parser.parse_args(arguments).scenes
    points: dict[str, list[Point]] = {name: [] for name in RULES}
    lines: list[tuple[float, str]] = []
    for scene in all_scenes():
        for name, rule in RULES.items():
            if (value := rule(scene)) is None:
                continue
            points[name].append(Point(scene.set, value, scene.scene.accepted, weight_of(scene)))
            if name == chosen:
                told = f"{scene.set} | {scene.scene.kind} | {scene.scene.setting} | {scene.scene.pair} | "
                lines.append((value, f"{shown(name, value)} | {scene.scene.votes} | {told}{scene.scene.arrangement}"))
    for _, line in sorted(lines):
        print(line)
    for name, found in points.items():
        if chosen not in (None, name):
            continue
        low, high = best_interval(found)
        print(
            f"{name}: {shown(name, judged_limit(name))}, {wrong(found, judged_limit(name))} of {len(found)} wrong; "
            f"best from {shown(name, low)} to {shown(name, high)}, {wrong(found, middle_of((low, high)))} wrong; "
            f"fitted to the other sets, {wrong_in_other_sets(found)} wrong"
        )


if __name__ == "__main__":
    main()
