"""Objects that are pre-placed in one container: one demonstration left them so, leaning on each other, at rest."""

from __future__ import annotations

import dataclasses
import math

import pytest

from betterbench.certification.demonstrations import demonstrate
from betterbench.certification.examine import examine, examine_rest
from betterbench.certification.handling import Preplaced
from betterbench.certification.support import LEFT_M, LEFT_RAD, TrainedSupport
from betterbench.geometry import Pose, angle_between, distance, from_yaw, horizontal_distance, multiply
from betterbench.interface.actions import EE_DELTA
from betterbench.sim.scenes import Scene, engine_version
from betterbench.sim.scenes.stage import QUALITIES
from betterbench.tasks import TrialId, all_tasks, get_task
from betterbench.tasks.demonstrated import (
    DemonstrationsFile,
    FinalPose,
    JointPoses,
    LeaningPose,
    demonstrated,
    measured_so_far,
    read_demonstrations,
)
from betterbench.tasks.interventions import resolve_condition
from betterbench.tasks.randomness import FIRST_DEMONSTRATION_SEED
from betterbench.tasks.relations import RELATIONS

TASK = get_task("fruit_basket")
KNOWN = demonstrated(TASK, engine=engine_version())
BOTH = "T6"


def scene_of(seed: int, condition: str = BOTH) -> Scene:
    setting = resolve_condition(TASK.id, condition).condition
    return Scene(TASK, setting, seed=seed, action_space=EE_DELTA, quality=QUALITIES["fast"], robot_name="so101")


def leaning(x_mm: float, *, turn: float = 0.0) -> LeaningPose:
    return LeaningPose.of(Pose((0.001 * x_mm, 0.0, 0.003), multiply(from_yaw(turn), (0.9, 0.0, math.sqrt(0.19), 0.0))))


def joint(*objects: FinalPose, asset: str = "basket#0") -> JointPoses:
    return JointPoses("fruit basket", asset, "inside", "", objects)


def test_only_the_fruit_basket_starts_with_several_objects_in_one_place():
    crowded = set()
    for task in all_tasks():
        for c in (*task.training, *task.variations):
            places = list(resolve_condition(task.id, c.name).condition.preplaced.values())
            if len(set(places)) < len(places):
                crowded.add(f"{task.id}/{c.name}")
    assert crowded == {"fruit_basket/T2", "fruit_basket/T6"}


def test_poses_belong_to_kind_and_asset_and_a_third_object_excludes_them():
    lemon, other = FinalPose("lemon", "lemon#0", leaning(10.0)), FinalPose("lemon", "lemon#1", leaning(20.0))
    both = joint(lemon, other)
    first, second = both.posed([("lemon", "lemon#1"), ("lemon", "lemon#0")])
    assert (first.position[0], second.position[0]) == pytest.approx((0.02, 0.01))
    assert both.posed([("lemon", "lemon#0")]) is None
    assert both.posed([("lemon", "lemon#0"), ("lemon", "lemon#0")]) is None
    assert joint(lemon, lemon).posed([("lemon", "lemon#0")] * 2) is not None


def test_a_pose_survives_its_file():
    found = dataclasses.replace(KNOWN, together=(joint(FinalPose("lemon", "lemon#0", leaning(1.234, turn=0.7))),))
    file = DemonstrationsFile({"fruit_basket": found})
    assert read_demonstrations(file.to_text(), "test") == file
    exact = Pose((0.0123456, -0.02, 0.003), from_yaw(0.4321))
    assert distance(LeaningPose.of(exact).pose.position, exact.position) < 1e-5
    assert angle_between(LeaningPose.of(exact).pose.quaternion, exact.quaternion) < 3e-4


def in_basket(scene: Scene) -> list[Preplaced]:
    """Returns both fruits at the start, with their poses in the basket."""
    state = scene.reset(check_premise=False)
    middle = state.pose("basket") @ Pose(RELATIONS["inside"].middle(state.info.object("basket"), ""))
    found = []
    for name in ("lemon", "mangosteen"):
        info, base = state.info.object(name), state.info.object("basket")
        pose = middle.inverse() @ state.pose(name)
        found.append(Preplaced(name, info.kind, info.asset, base.kind, base.asset, "", pose))
    return found


@pytest.mark.physics
@pytest.mark.parametrize("seed", range(3))
def test_a_scene_begins_as_one_demonstration_ended_and_stays_so(seed):
    scene = scene_of(seed)
    fruits = in_basket(scene)
    objects = [(f.kind, f.asset) for f in fruits]
    known = KNOWN.joint_poses_at(fruits[0].target_asset, "inside", "")
    posed = [poses for one in known if (poses := one.posed(objects)) is not None]
    assert any(
        all(
            distance(f.pose.position, p.position) < 1e-4 and angle_between(f.pose.quaternion, p.quaternion) < 1e-3
            for f, p in zip(fruits, poses, strict=True)
        )
        for poses in posed
    )
    assert examine_rest(scene).clause.passed
    again = in_basket(scene_of(seed))
    assert [f.pose for f in again] == [f.pose for f in fruits]
    assert [f.pose for f in in_basket(scene_of(seed, "T2"))] == [f.pose for f in fruits], "the twins of both matrices"


@pytest.mark.physics
def test_without_such_a_demonstration_the_objects_are_moved_apart():
    with measured_so_far(TASK.id, dataclasses.replace(KNOWN, together=())):
        scene = scene_of(0)
        fruits = in_basket(scene)
        assert examine_rest(scene).clause.passed
    assert horizontal_distance(fruits[0].pose.position, fruits[1].pose.position) > 0.045


@pytest.mark.physics
def test_a_demonstration_of_both_fruits_tells_how_they_lie_together():
    found = demonstrate(TrialId(TASK.id, "train3", FIRST_DEMONSTRATION_SEED + 2), robot="so101")
    assert not found.problem
    (together,) = found.together
    same = [j for j in KNOWN.together if [o.asset for o in j.objects] == [o.asset for o in together.objects]]
    ends = [o.at.position_mm for o in together.objects]
    assert any(all(distance(o.at.position_mm, e) < 1.0 for o, e in zip(j.objects, ends, strict=True)) for j in same)
    assert [o.kind for o in together.objects] == ["lemon", "mangosteen"]


@pytest.mark.slow
@pytest.mark.physics
def test_a_demonstration_of_one_fruit_tells_nothing_of_both():
    alone = demonstrate(TrialId(TASK.id, "train1", FIRST_DEMONSTRATION_SEED), robot="so101")
    assert alone.together == ()


def judged(moved_mm: float = 0.0, turn: float = 0.0):
    """Returns the problems with two fruits in the poses of the first measured demonstration, the second one moved."""
    shown = KNOWN.together[0]
    fruits = []
    for i, o in enumerate(shown.objects):
        pose = o.at.pose
        if i:
            x, y, z = pose.position
            pose = Pose((x + 0.001 * moved_mm, y, z), multiply(from_yaw(turn), pose.quaternion))
        fruits.append(Preplaced(o.kind, o.kind, o.asset, shown.target_kind, shown.target_asset, "", pose))
    return [f.problem for f in TrainedSupport.of(TASK, KNOWN).judge_all(fruits)]


def test_clause_b_compares_both_with_one_demonstration():
    assert judged() == [None, None]
    assert judged(0.9 * 1000.0 * LEFT_M, 0.9 * LEFT_RAD) == [None, None]
    for problems in (judged(40.0), judged(turn=0.5)):
        assert all("in which a demonstration leaves them together" in problem for problem in problems)


def test_a_pair_of_two_different_demonstrations_is_outside():
    shown = KNOWN.together
    objects = [[(o.kind, o.asset) for o in j.objects] for j in shown]
    first, second = next(
        (a, b)
        for i, a in enumerate(shown)
        for j, b in enumerate(shown)
        if i < j and objects[i] == objects[j] and a.target_asset == b.target_asset
        if distance(a.objects[0].at.position_mm, b.objects[0].at.position_mm) > 20.0
    )
    mixed = [
        Preplaced(o.kind, o.kind, o.asset, first.target_kind, first.target_asset, "", o.at.pose)
        for o in (first.objects[0], second.objects[1])
    ]
    assert all(f.problem for f in TrainedSupport.of(TASK, KNOWN).judge_all(mixed))


@pytest.mark.slow
@pytest.mark.parametrize("condition", ["T2", "T6"])
def test_scenes_with_both_fruits_in_the_basket_are_certified(condition):
    for seed in range(16):
        assert examine(TrialId(TASK.id, condition, seed), robot="so101").passed, seed
