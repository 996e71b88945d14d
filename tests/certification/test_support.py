"""Support: what a training regime contains, and what an episode is seen to do."""

from __future__ import annotations

import dataclasses
import math

import pytest
from tests.looping import each

from betterbench.certification.handling import DrawerMove, Handling, Pick, Preplaced, Put, Release
from betterbench.certification.support import LEFT_M, LEFT_RAD, TrainedSupport
from betterbench.geometry import Pose, from_yaw
from betterbench.sim.scenes import engine_version
from betterbench.tasks import Slot, all_tasks, get_task
from betterbench.tasks.demonstrated import (
    HEIGHT_MM,
    REACH_MM,
    Demonstrated,
    FinalPoses,
    FlatPose,
    Releases,
    demonstrated,
)
from betterbench.tasks.interventions import vary

TASKS = all_tasks()


def support_of(task, **measured) -> TrainedSupport:
    """The support of a task; keywords replace what its demonstrations show."""
    found = demonstrated(task, engine=engine_version())
    return TrainedSupport.of(task, dataclasses.replace(found, **measured))


def pick(slot: Slot, kind="burger", *, dx=0.0, turn=0.0) -> Pick:
    return Pick("thing", kind, Pose((slot.x + dx, slot.y, 0.0), from_yaw(slot.yaw + turn)))


def trained_height_m(slot: str, relation: str, region: str, level: int) -> float:
    """Returns a height at which demonstrations of any task let go of something there; 0 if none does [m]."""
    for task in TASKS:
        for found in demonstrated(task, engine=engine_version()).releases:
            if found.place == (slot, relation, region, level):
                return found.heights_mm[len(found.heights_mm) // 2] / 1000.0
    return 0.0


def put(slot: Slot, relation, kind, region="", *, level=1, dx=0.0, fixed=False, let_go=None) -> Put:
    base = Pose((slot.x + dx, slot.y, 0.0), from_yaw(slot.yaw))
    release = let_go or Release(trained_height_m(slot.name, relation, region, level), 0.0, 0.0)
    return Put(
        object="thing",
        kind="thing",
        asset="thing#0",
        relation=relation,
        target_kind=kind,
        target_asset=f"{kind}#0",
        region=region,
        slot=slot.name,
        level=level,
        base_pose=base,
        base_fixed=fixed,
        pose=base,
        target_pose=base,
        release=release,
    )


def preplaced(kind, target_kind, pose) -> Preplaced:
    return Preplaced("thing", kind, f"{kind}#0", target_kind, f"{target_kind}#0", "", pose)


@each("task", TASKS, name=lambda t: t.id)
def test_what_training_asks_for_is_inside_its_own_support(task):
    trained = support_of(task)
    for condition in task.training:
        for goal in condition.instruction.subgoals:
            for name in condition.resolve(goal.reference):
                if name in condition.layout:
                    slot = task.slot(condition.layout[name])
                    found = trained.judge(pick(slot, condition.object(name).kind))
                    assert found.problem is None
                    assert found.slack_m == pytest.approx(max(s.jitter_m for s in trained.pick_slots if s == slot))


def test_a_pick_counts_up_to_the_border_of_the_jitter_and_no_farther():
    trained, slot = support_of(get_task("fast_food")), None
    slot = trained.pick_slots[0]
    inside = trained.judge(pick(slot, dx=slot.jitter_m))
    assert inside.problem is None
    assert inside.slack_m == pytest.approx(0.0, abs=1e-9)
    outside = trained.judge(pick(slot, dx=slot.jitter_m + 0.003))
    assert outside.problem is not None
    assert "3.0 mm outside" in outside.problem
    assert outside.slack_m == pytest.approx(-0.003)


def test_a_pick_of_what_was_never_grasped_or_turned_too_far_is_outside():
    trained = support_of(get_task("fast_food"))
    slot = trained.pick_slots[0]
    assert "no demonstration grasps a brick" in trained.judge(pick(slot, "brick")).problem
    assert "degrees beyond" in trained.judge(pick(slot, turn=slot.yaw_jitter + 0.1)).problem


def test_a_slot_that_holds_only_distractors_in_training_is_no_pick_slot():
    task = get_task("fast_food")
    held = {s.name for s in support_of(task).pick_slots}
    stand = task.train("train1").layout["box"]
    assert stand not in held
    assert support_of(task).judge(pick(task.slot(stand))).problem is not None


def test_a_put_needs_a_trained_target_a_trained_spot_and_a_target_that_stands_there():
    task = get_task("dinner_plates")
    trained = support_of(task)
    right, back = task.slot("stand_right"), task.slot("left_back")
    assert trained.judge(put(right, "on_plate", "white plate")).problem is None
    assert trained.judge(put(right, "on_plate", "red plate", level=2)).problem is None
    assert trained.judge(put(right, "on_plate", "red plate")).problem is None, "kind and place each trained: suite, R1"
    assert "puts anything on_plate blue plate" in trained.judge(put(right, "on_plate", "blue plate")).problem
    assert "no demonstration uses" in trained.judge(put(right, "on_plate", "red plate", level=3)).problem
    assert "no demonstration uses" in trained.judge(put(back, "on_plate", "red plate")).problem
    pushed = trained.judge(put(right, "on_plate", "white plate", dx=right.jitter_m + 0.004))
    assert pushed.problem is None, "setting a plate down may push the one below"
    assert "mm outside" in trained.judge(put(right, "on_plate", "white plate", dx=right.jitter_m + 0.006)).problem
    fixed = put(right, "on_plate", "white plate", dx=right.jitter_m + 0.004, fixed=True)
    assert "mm outside" in trained.judge(fixed).problem


def test_a_put_on_what_stands_in_no_slot_is_outside():
    task = get_task("dinner_plates")
    lost = dataclasses.replace(put(task.slot("stand_right"), "on_plate", "white plate"), slot=None)
    assert "is not in a slot" in support_of(task).judge(lost).problem


def test_drawers_count_with_the_cabinet_they_slide_in():
    trained = support_of(get_task("office_drawer"))
    assert trained.judge(DrawerMove("upper", "upper drawer", "cabinet_back")).problem is None
    assert trained.judge(DrawerMove("upper", "upper drawer", "left_back")).problem is not None
    assert trained.judge(DrawerMove("upper", "upper drawer", None)).problem is not None


# ---------------------------------------------------------------------------------------------------- demonstrations


def test_a_release_counts_with_its_height():
    task = get_task("cheeseburger")
    measured = (Releases("stand", "layer", "2", 1, (42.0, 60.0), ((0, 0),)),)
    trained, stand = support_of(task, releases=measured), task.slot("stand")
    for off_mm, problem in ((0.0, None), (4.9, None), (-4.9, None), (8.0, "8.0 mm above"), (-8.0, "8.0 mm below")):
        let_go = Release(0.042 + 0.001 * off_mm, 0.0, 0.0)
        found = trained.judge(put(stand, "layer", "bottom bun", "2", let_go=let_go)).problem
        assert (found is None) if problem is None else (problem in found and "every height" in found)
    assert trained.judge(put(stand, "layer", "bottom bun", "2", let_go=Release(0.061, 0.1, 0.0))).problem is None
    assert "no measured demonstration" in trained.judge(put(stand, "layer", "bottom bun", "3")).problem
    assert HEIGHT_MM == 5.0, "suite, section 3"


def test_a_release_in_a_container_counts_with_its_place():
    task = get_task("fast_food")
    measured = (Releases("stand", "inside", "", 1, (7.0,), ((-60, 0), (60, 0))),)
    trained, stand = support_of(task, releases=measured), task.slot("stand")
    for x, y, problem in (
        (0.060, 0.0, None),
        (-0.060, 0.014, None),
        (0.0, 0.0, "60.0 mm to the side"),
        (0.06, 0.06, "60.0"),
    ):
        found = trained.judge(put(stand, "inside", "box", let_go=Release(0.007, x, y))).problem
        assert (found is None) if problem is None else (problem in found)
    assert REACH_MM == 15.0


def test_what_is_preplaced_has_to_stand_as_a_demonstration_leaves_it():
    task = get_task("morning_coffee")
    left = FinalPoses(
        "red mug", "red mug#1", "coffee machine", "machine#1", "on_ring", "", (FlatPose(72.0, -0.4, 40.0),)
    )
    trained = support_of(task, final_poses=(left,))

    def judged(dx=0.0, turn=0.0, kind="red mug", target="coffee machine"):
        pose = Pose((0.072 + dx, -0.0004, 0.012), from_yaw(math.radians(40.0) + turn))
        return trained.judge(preplaced(kind, target, pose)).problem

    assert judged() is None
    assert judged(LEFT_M - 1e-4, -LEFT_RAD + 1e-4) is None
    assert "57 degrees" in judged(turn=math.radians(57.0))
    assert "70.0 mm" in judged(dx=0.07)
    assert judged(kind="blue mug") is None, "a thing and a target may be combined anew"
    assert "where no demonstration leaves an object" in judged(target="lunchbox")


@each("task", TASKS, name=lambda t: t.id)
def test_every_trained_place_was_measured(task):
    found = demonstrated(task, engine=engine_version())
    assert {r.place for r in found.releases} == set(support_of(task).spots)
    assert found.solved >= len(task.training)
    for variation in task.variations:
        condition = vary(task, variation)[0]
        for name, place in condition.preplaced.items():
            kind, target = (condition.object(n).kind for n in (name, place.target))
            there = found.final_poses_at(target, task.template.relation, place.region, kind=kind, assets=("", ""))
            assert len(there) >= 4, f"{variation.name} {name}"


def test_the_pose_of_the_same_asset_comes_first_then_that_of_the_same_kind():
    def left(kind, asset, x_mm, box="box#1"):
        return FinalPoses(kind, asset, "lunchbox", box, "inside", "", (FlatPose(x_mm, 0.0, 0.0),))

    poses = (
        left("apple", "apple#1", 1.0),
        left("apple", "apple#2", 2.0),
        left("apple", "apple#2", 2.5, "box#2"),
        left("orange", "orange#1", 3.0),
    )
    found = Demonstrated("", "", 1, 3, (), poses)

    def xs(kind, asset, box):
        return [p.x_mm for p in found.final_poses_at("lunchbox", "inside", "", kind=kind, assets=(asset, box))]

    assert xs("apple", "apple#2", "box#2") == [2.5]
    assert xs("apple", "apple#2", "box#3") == [2.0, 2.5]
    assert xs("apple", "apple#9", "box#1") == [1.0, 2.0, 2.5]
    assert xs("lemon", "lemon#1", "box#1") == [1.0, 2.0, 2.5, 3.0]


# ------------------------------------------------------------------------------------------------------------ watching

FINGERS = (("left_finger", "burger_1"), ("right_finger", "burger_1"))
pytestmark = pytest.mark.physics


@pytest.fixture
def fast_food(start):
    return start("fast_food")


def test_one_pick_and_one_put_are_seen_whatever_the_object_brushes_on_its_way(fast_food, posed, in_bag):
    task, condition, state = fast_food
    begun = state.pose("burger_1")
    up, there = begun.translated(z=0.1), in_bag(state)
    watch = Handling(task, condition)
    watch.update(state)
    nudged = begun.translated(x=0.02)
    watch.update(posed(state, {"burger_1": nudged}, contacts=(("left_finger", "burger_1"), ("burger_1", "table"))))
    watch.update(posed(state, {"burger_1": up}, contacts=FINGERS, held="burger_1"))
    watch.update(posed(state, {"burger_1": up}, contacts=(*FINGERS, ("burger_1", "box")), held=None))
    watch.update(posed(state, {"burger_1": up}, contacts=FINGERS, held="burger_1"))
    watch.update(posed(state, {"burger_1": there}, contacts=(("burger_1", "box"),)))
    taken, given = watch.finish()
    assert isinstance(taken, Pick)
    assert taken.pose == begun, "a nudge before the grasp is not where it was picked"
    assert isinstance(given, Put)
    assert (given.relation, given.slot, given.level) == ("inside", condition.layout["box"], 1)
    assert given.release.height_m == pytest.approx(up.position[2]), "where both fingers last had it"
    x, y, _ = state.pose("box").inverse().apply(up.position)
    assert given.release[1:] == pytest.approx((x, y))
    assert support_of(task).judge(taken).problem is None
    assert "above every height" in support_of(task).judge(given).problem


def test_what_is_lost_and_taken_again_elsewhere_is_outside(fast_food, posed):
    task, condition, state = fast_food
    begun = state.pose("burger_1")
    fell = begun.translated(x=0.06, y=0.05)
    watch = Handling(task, condition)
    watch.update(state)
    watch.update(posed(state, {"burger_1": begun.translated(z=0.1)}, contacts=FINGERS, held="burger_1"))
    watch.update(posed(state, {"burger_1": fell}, contacts=(("burger_1", "table"),)))
    watch.update(posed(state, {"burger_1": fell.translated(z=0.1)}, contacts=FINGERS, held="burger_1"))
    found = [support_of(task).judge(p) for p in watch.finish()]
    assert found[0].problem is None
    assert "loses" in found[1].text
    assert found[1].problem is None
    assert "outside every pick slot" in found[2].problem


def test_what_was_pushed_aside_before_it_is_taken_was_picked_where_it_came_to_rest(fast_food, posed):
    task, condition, state = fast_food
    aside = state.pose("burger_1").translated(x=0.08)
    watch = Handling(task, condition)
    watch.update(state)
    for _ in range(6):
        watch.update(posed(state, {"burger_1": aside}, contacts=(("burger_1", "table"),)))
    watch.update(posed(state, {"burger_1": aside.translated(z=0.1)}, contacts=FINGERS, held="burger_1"))
    taken = watch.finish()[0]
    assert isinstance(taken, Pick)
    assert taken.pose == aside
    assert support_of(task).judge(taken).problem is not None


@pytest.mark.parametrize(
    ("moves_m", "pushed_m", "aside"), [(0.006, 0.0055, False), (0.006, 0.0065, True), (0.0, 0.001, True)]
)
def test_a_fixed_finger_may_push_an_object_as_far_as_it_moves_to_touch_it(fast_food, posed, moves_m, pushed_m, aside):
    task, condition, state = fast_food
    begun = state.pose("burger_1")
    pushed = begun.translated(x=pushed_m)
    watch = Handling(task, condition, finger_moves_m=moves_m)
    watch.update(state)
    watch.update(posed(state, {"burger_1": pushed}, contacts=(("left_finger", "burger_1"), ("burger_1", "table"))))
    for _ in range(8):
        watch.update(posed(state, {"burger_1": pushed}, contacts=(("burger_1", "table"),)))
    watch.update(posed(state, {"burger_1": pushed.translated(z=0.1)}, contacts=FINGERS, held="burger_1"))
    taken = watch.finish()[0]
    assert isinstance(taken, Pick)
    assert taken.pose == (pushed if aside else begun)


def test_what_is_at_its_target_from_the_start_is_listed_first(start, posed):
    task, condition, state = start("dinner_plates", "train3")
    watch = Handling(task, condition)
    watch.update(state)
    (found,) = watch.finish()
    assert isinstance(found, Preplaced)
    assert (found.kind, found.target_kind) == ("red plate", "white plate")
    assert support_of(task).judge(found).problem is None
    moved = posed(state, {"red_plate": state.pose("red_plate").translated(x=0.03)})
    watch = Handling(task, condition)
    watch.update(moved)
    assert "mm and" in support_of(task).judge(watch.finish()[0]).problem


def test_untouched_scenes_hold_no_primitive(fast_food):
    task, condition, state = fast_food
    watch = Handling(task, condition)
    watch.update(state)
    watch.update(state)
    assert watch.finish() == ()


def test_a_drawer_that_moved_is_a_slide_of_its_cabinet(start, posed):
    task, condition, state = start("office_drawer")
    for travel, seen in ((0.004, 0), (0.01, 1)):
        watch = Handling(task, condition)
        watch.update(state)
        moved = state.pose("upper") @ Pose((travel, 0.0, 0.0))
        watch.update(posed(state, {"upper": moved}))
        slides = watch.finish()
        assert len(slides) == seen
        assert all(isinstance(s, DrawerMove) and s.slot == condition.layout["cabinet"] for s in slides)


def test_stacks_and_mounts_lead_down_to_their_slot(start, posed):
    task, condition, state = start("dinner_plates", "train3")
    blue = condition.resolve(condition.instruction.subgoals[0].reference)[0]
    red, white = "red_plate", "white_plate"
    floor = state.info.object(red).region("floor").position
    there = Pose(state.pose(red).apply(floor), state.pose(red).quaternion)
    fingers = (("left_finger", blue), ("right_finger", blue))
    watch = Handling(task, condition)
    watch.update(state)
    watch.update(posed(state, {blue: there.translated(z=0.1)}, contacts=fingers, held=blue))
    watch.update(posed(state, {blue: there}, contacts=((blue, red),)))
    given = watch.finish()[2]
    assert isinstance(given, Put)
    assert (given.target_kind, given.slot, given.level) == ("red plate", condition.layout[white], 2)
