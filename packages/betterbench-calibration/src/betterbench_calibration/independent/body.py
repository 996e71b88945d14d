"""Building blocks for the scripts of habits: correct execution of subgoals, and parts of faulty behavior."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

from betterbench.geometry import Pose, Vector, from_axis_angle, horizontal_distance
from betterbench.interface.state import WorldState
from betterbench.sim.scenes import Scene
from betterbench.tasks import Expected, Subgoal, stream
from betterbench.tasks.relations import relation
from betterbench.tasks.relations.closed import drawer_to_move, opening_m
from betterbench_calibration.independent.controller import Actions, Arm
from betterbench_calibration.independent.events import DISPLACED_M, in_gripper
from betterbench_calibration.independent.manner import Manner
from betterbench_calibration.independent.occasion import Occasion
from betterbench_calibration.independent.room import height_of
from betterbench_calibration.independent.routines import FULL_OPENING_M, Routines
from betterbench_calibration.independent.truth import Ledger, StatedTruth

DRAWN_OUT_M = 0.15
FALLEN_M = -0.02
CHECK_S = 0.4
DIRECTIONS = tuple(math.pi * i / 8 for i in range(16))


class Body:
    """Arm, routines, trial context and ground truth of one episode, which the script of a habit uses."""

    def __init__(self, scene: Scene, situation: Occasion, manner: Manner, name: str, truth: StatedTruth) -> None:
        """Prepare an episode in a scene that has been reset. ``truth`` is the stated true label."""
        self.situation = situation
        self.rng = stream(situation.task.id, scene.seed, f"independent:{name}")
        self.arm = Arm(manner, stream(situation.task.id, scene.seed, f"independent noise:{name}"), scene.state())
        self.do = Routines(self.arm, {p.spec.name: p.asset for p in scene.placements})
        self.ledger = Ledger(truth)
        self.taken: set[str] = set()

    @property
    def state(self) -> WorldState:
        """Latest state."""
        return self.arm.state

    # --- correct behavior

    def solve(self) -> Actions[None]:
        """Execute all steps in order, repeat a step after a miss, then go home and stay there."""
        yield from self.work(self.situation.goals)
        yield from self.rest()

    def rest(self) -> Actions[None]:
        """Go home and stay there."""
        yield from self.arm.go_home()
        yield from self.arm.stay()

    def work(self, goals: tuple[Subgoal, ...]) -> Actions[None]:
        """Execute the subgoals in order. Repeat each until it is reached or cannot be reached any more."""
        if self.situation.condition.expected is not Expected.SUCCEED:
            return
        for goal in goals:
            tries = 0
            while not self.situation.done(self.state, goal) and not self.ledger.lasting:
                yield from self.serve(goal, avoid=tries % 3)
                tries += 1

    def serve(self, goal: Subgoal, *, avoid: int = 0) -> Actions[None]:
        """Attempt a subgoal once. The ``avoid`` best grasps are skipped."""
        if not relation(goal.relation).carried:
            drawer = self.situation.condition.resolve(goal.reference)[0]
            yield from self.move_drawer(drawer, out=False)
            return
        yield from self.clear_the_way(goal)
        things = self.situation.candidates(self.state, goal)
        if not things:
            self.ledger.mishap(goal.name, "no object is left to bring", for_good=True)
            return
        name = min(things, key=self._far)
        if (yield from self.take(name, avoid=avoid)):
            yield from self.bring(name, goal)

    def _far(self, name: str) -> float:
        x, y, _ = self.state.pose(name).position
        ex, ey, _ = self.state.ee_pose.position
        return (x - ex) ** 2 + (y - ey) ** 2

    def clear_the_way(self, goal: Subgoal) -> Actions[None]:
        """Open or close drawers until the target of a subgoal is accessible."""
        for _ in range(4):
            move = drawer_to_move(self.situation.condition, self.state, goal.target)
            if move is None:
                return
            yield from self.move_drawer(move[0], out=move[1])

    def move_drawer(self, name: str, *, out: bool) -> Actions[None]:
        """Open or close a drawer."""
        spec = self.situation.condition.object(name)
        opening = DRAWN_OUT_M if out else 0.0
        yield from self.do.slide_drawer(name, opening, travel_m=opening_m(self.state, spec))
        reached = opening_m(self.state, spec)
        if abs(reached - opening) > (0.02 if out else 0.004):
            self.ledger.mishap(name, "the drawer did not move with the gripper")
        else:
            self.ledger.made_good(name)

    def take(self, name: str, *, avoid: int = 0) -> Actions[bool]:
        """Pick an object, and record a mishap or its correction. Return whether the object is in the gripper."""
        yield from self.do.pick(name, avoid=avoid)
        return self.note_hold(name)

    def note_hold(self, name: str) -> bool:
        """Return whether an object is in the gripper, and record a mishap if it is not."""
        if in_gripper(self.state) == name:
            self.taken.add(name)
            self.ledger.made_good(name)
            return True
        self._note_failed(name, "the gripper closed without the object")
        return False

    def bring(self, name: str, goal: Subgoal, *, as_if_at: Pose | None = None) -> Actions[bool]:
        """Put the held object at the target of a subgoal. Return whether the subgoal's relation then holds.

        If ``as_if_at`` is given, the object is placed as if the target had that pose.
        """
        goals = relation(goal.relation).place_goals(self.state, name, goal.target, goal.region)
        if as_if_at is not None:
            move = as_if_at @ self.state.pose(goal.target).inverse()
            goals = tuple(replace(g, pose=move @ g.pose) for g in goals)
        place = self.do.choose_goal(name, goals, ignore=self._standing_room(goal))
        yield from self.do.put(name, place, ignore=self._standing_room(goal))
        yield from self.arm.wait(CHECK_S)
        if any(lost == name for _, lost in self.arm.log.lost):
            self._note_failed(name, "the object left the gripper, which did not open")
        if relation(goal.relation).holds(self.state, name, goal.target, goal.region):
            self.ledger.made_good(name)
            return True
        self._note_failed(name, "the object was released but is not at its target")
        return False

    def _standing_room(self, goal: Subgoal) -> frozenset[str]:
        """Return the objects that the gripper may approach at a target: the target and its contents."""
        if goal.relation == "beside":
            return frozenset()
        near = {goal.target}
        spec = self.situation.condition.object(goal.target)
        if spec.mount is not None:
            near.add(spec.mount.target)
            near |= {o.name for o in self.situation.condition.objects if o.mount is not None}
        if goal.relation in ("layer", "on_plate"):
            near |= {o.name for o in self.state.info.objects if self._upon(o.name, goal.target)}
        return frozenset(near)

    def _upon(self, name: str, target: str) -> bool:
        x, y, z = self.state.pose(name).position
        tx, ty, tz = self.state.pose(target).position
        return abs(x - tx) < 0.05 and abs(y - ty) < 0.05 and z >= tz - 0.005

    def _note_failed(self, name: str, text: str) -> None:
        gone = self.state.pose(name).position[2] < FALLEN_M
        self.ledger.mishap(name, text + (", and it lies on the floor" if gone else ""), for_good=gone)

    # --- behavior that several habits share

    def attempt_once(self, goal: Subgoal) -> Actions[None]:
        """Execute a subgoal once, without checking the result."""
        yield from self.clear_the_way(goal)
        things = self.situation.candidates(self.state, goal)
        if things:
            yield from self.take_and_bring(things[0], goal)

    def take_and_bring(self, name: str, goal: Subgoal) -> Actions[None]:
        """Pick an object, with several attempts, and put it at the target of a subgoal."""
        if (yield from self.take_patiently(name)):
            yield from self.bring(name, goal)

    def take_patiently(self, name: str, *, tries: int = 4) -> Actions[bool]:
        """Pick an object, with several attempts. Return whether it is in the gripper."""
        for avoid in range(tries):
            if (yield from self.take(name, avoid=avoid)):
                return True
        return False

    def take_whatever(self, name: str) -> Actions[None]:
        """Pick an object and bring it to the target of the first step.

        If it is the right object, also execute the other steps. Otherwise, stay at home.
        """
        goal = self.situation.ahead[0]
        if name not in self.situation.things(goal):
            yield from self.take_instead(name, goal)
        yield from self.clear_the_way(goal)
        yield from self.take_and_bring(name, goal)
        yield from self.solve()

    def take_instead(self, name: str, goal: Subgoal) -> Actions[None]:
        """Begin the faulty behavior: bring a wrong object to the target of a subgoal, and stay at home."""
        self.ledger.commit()
        if (yield from self.take_patiently(name)):
            if drawer_to_move(self.situation.condition, self.state, goal.target) is None:
                yield from self.bring(name, goal)
            else:
                yield from self.let_go_above(goal.target)
        yield from self.rest()

    def let_go_above(self, target: str) -> Actions[None]:
        """Move over a target, with or without an object, and open the gripper there."""
        yield from self.do.above(self.state.pose(target).position, self.height(target) + 0.14)
        yield from self.arm.open()

    def play_at_empty(self, slot: str) -> Actions[None]:
        """Begin the faulty behavior: repeat the motions of pick and place with an empty slot."""
        self.ledger.commit()
        x, y, _ = self.state.info.slot(slot).position
        goal = self.situation.carried[0]
        tool = Pose((x, y, 0.03), self.arm.home.quaternion)
        while True:
            yield from self.do.take_at(tool, FULL_OPENING_M)
            yield from self.let_go_above(goal.target)

    def ponder(self) -> Actions[None]:
        """Keep still for 4 to 6 s."""
        yield from self.arm.wait(float(self.rng.uniform(4.0, 6.0)))

    def approach_and_break_off(self, name: str) -> Actions[None]:
        """Descend to an object with an open gripper and stop above it, repeatedly."""
        while True:
            yield from self.do.hover(name, 0.12)
            yield from self.arm.go(self.arm.here.translated(z=-float(self.rng.uniform(0.075, 0.095))), pace=0.6)
            away = self.arm.here.translated(z=0.14)
            yield from self.arm.go(away)
            x, y, z = away.position
            hx, hy, _ = self.arm.home.position
            f = float(self.rng.uniform(0.3, 0.7))
            yield from self.arm.go(Pose((x + f * (hx - x), y + f * (hy - y), z), away.quaternion))

    def press_crosswise(self, name: str) -> Actions[None]:
        """Descend on an object with the gripper rotated by 90 degrees until the fingers touch it, and close there."""
        hold = self.do.choose_hold(name)
        crosswise = Pose((0.0, 0.0, 0.0), from_axis_angle((0.0, 0.0, 0.5 * math.pi)))
        tool = hold.tool @ crosswise
        flipped = hold.tool @ crosswise.inverse()
        tool = min((tool, flipped), key=self.do.wrist_turn)
        yield from self.do.over(tool.translated(z=0.08))
        yield from self.arm.lower_until_touch(tool.position[2])
        yield from self.arm.close()
        yield from self.arm.rise(self.height(name) + 0.12)

    def nearest_other(self, name: str) -> str:
        """Return the object nearest to a given object among those that are not requested."""
        at = self.state.pose(name).position
        others = self.situation.others()
        return min(others, key=lambda n: horizontal_distance(self.state.pose(n).position, at))

    def sweep_through(self, neighbor: str, name: str) -> Actions[None]:
        """Move low with nearly closed fingers, through a neighbor and toward an object, and then up."""
        a, b = self.state.pose(neighbor).position, self.state.pose(name).position
        length = max(horizontal_distance(a, b), 0.01)
        ux, uy = (b[0] - a[0]) / length, (b[1] - a[1]) / length
        reach = 0.5 * max(self.state.info.object(neighbor).size_m[:2]) + 0.05
        low = max(0.014, min(0.5 * self.height(neighbor), 0.05))
        begin = Pose((a[0] - reach * ux, a[1] - reach * uy, low), self.arm.home.quaternion)
        yield from self.do.over(begin.translated(z=0.08))
        yield from self.arm.narrow(0.01)
        yield from self.arm.go(begin)
        way = reach + 0.10
        yield from self.arm.go(begin.translated(way * ux, way * uy), pace=0.8)
        yield from self.arm.go(self.arm.here.translated(z=0.15))

    def height(self, name: str) -> float:
        """Return the height of an object's top above the table [m]."""
        return height_of(self.state, name)

    def over(self, name: str, gap_m: float) -> Vector:
        """Return the position of the tool ``gap_m`` above the top of an object [m]."""
        x, y, _ = self.state.pose(name).position
        return (x, y, self.height(name) + gap_m)

    def on_the_way(self, target: Vector, fraction: float) -> Pose:
        """Return a tool pose at the current height, at a fraction of the straight path to a point."""
        x, y, z = self.arm.here.position
        return Pose((x + fraction * (target[0] - x), y + fraction * (target[1] - y), z), self.arm.here.quaternion)

    def emptiest_side(self, name: str, far_m: float) -> Vector:
        """Return the horizontal displacement of a given length that leads farthest away from all other objects [m]."""
        x, y, _ = self.state.pose(name).position
        ways = [(far_m * math.cos(a), far_m * math.sin(a), 0.0) for a in DIRECTIONS]
        return max(ways, key=lambda v: self._room(name, (x + v[0], y + v[1], 0.0)))

    def free_direction(self, name: str) -> Vector:
        """Return the horizontal unit vector along which there is the most space to push an object."""
        x, y, _ = self.state.pose(name).position
        ways = [(math.cos(a), math.sin(a), 0.0) for a in DIRECTIONS]

        def room(v: Vector) -> float:
            points = ((x + f * v[0], y + f * v[1], 0.0) for f in (-0.09, 0.06, 0.12, 0.17))
            return min(self._room(name, p) for p in points)

        return max(ways, key=room)

    def free_spot(self, name: str, near: Vector) -> Vector:
        """Return a point on the table with free space for an object, close to a given point [m]."""
        spots = [(0.36 + 0.04 * i, -0.30 + 0.04 * k, 0.0) for i in range(10) for k in range(16)]
        reach = 0.5 * max(self.state.info.object(name).size_m[:2]) + 0.03

        def worth(p: Vector) -> float:
            return min(self._room(name, p), reach) - 0.1 * horizontal_distance(p, near)

        return max(spots, key=worth)

    def _room(self, name: str, point: Vector) -> float:
        """Return the distance from a point to the nearest bounding box of another object [m].

        For a point outside the workspace, ten times its distance from the workspace is subtracted.
        """
        gaps = [
            horizontal_distance(self.state.pose(o.name).position, point) - 0.5 * max(o.size_m[:2])
            for o in self.state.info.objects
            if o.name != name and o.role != "drawer"
        ]
        x, y, _ = point
        outside = max(0.32 - x, x - 0.74, abs(y) - 0.36, 0.0)
        return min(gaps, default=1.0) - 10.0 * outside

    def harmed(self) -> Iterator[str]:
        """Yield the names of the objects that are not requested but have been displaced by more than 5 cm."""
        for name in self.situation.others():
            if self.arm.log.displaced(self.state, name) > DISPLACED_M:
                yield name
