"""Skills that are carried over: nothing changes in the scene of the source, and everything moves with the object."""

from __future__ import annotations

from dataclasses import replace

import pytest

from betterbench.demonstrations.making.retarget import carry_pick, carry_place
from betterbench.demonstrations.making.sources import _require_objects, demonstrated_source, grasp_shift, load_library
from betterbench.errors import BetterError, InvalidInputError, RecordError
from betterbench.geometry import Pose, angle_between, distance, from_yaw
from betterbench.records import RunFolder
from betterbench.sim.assets import build

pytestmark = pytest.mark.physics


@pytest.fixture(scope="module")
def record(sources):
    return next(iter(sources.records()))


@pytest.fixture(scope="module")
def source(record):
    return demonstrated_source(record)


def near(a: Pose, b: Pose, tolerance: float) -> bool:
    return distance(a.position, b.position) < tolerance and angle_between(a.quaternion, b.quaternion) < tolerance


def moved(state, name: str, shift: Pose):
    i = state.info.index(name)
    pose = shift @ state.pose(name)
    positions, quaternions = list(state.positions), list(state.quaternions)
    positions[i], quaternions[i] = pose.position, pose.quaternion
    return replace(state, positions=tuple(positions), quaternions=tuple(quaternions))


def skill(source, kind):
    return next(s for s in source.skills if s.window.kind == kind)


def test_a_pick_in_its_own_scene_is_what_it_was(record, source):
    pick = skill(source, "pick")
    again = carry_pick(pick, record.state(pick.window.start), pick.object.name, pick.asset)
    assert all(near(a, b, 1e-9) for a, b in zip(again.targets, pick.targets, strict=True))
    assert (again.gripper, again.change) == (pick.gripper, pick.change)
    assert pick.gripper[pick.change] > 0.0 >= pick.gripper[pick.change - 1]


def test_a_pick_moves_with_its_object(record, source):
    pick, shift = skill(source, "pick"), Pose((0.03, -0.02, 0.0), from_yaw(0.2))
    state = moved(record.state(pick.window.start), pick.object.name, shift)
    again = carry_pick(pick, state, pick.object.name, pick.asset)
    assert all(near(a, shift @ b, 1e-9) for a, b in zip(again.targets, pick.targets, strict=True))


def test_a_place_in_its_own_scene_brings_the_object_where_it_was_let_go(record, source):
    place = skill(source, "place")
    state = record.state(place.window.start)
    again = carry_place(place, state, place.window)
    assert again is not None
    # The object slips by less than 2 mm in the gripper between the beginning of the window and its release.
    assert all(near(a, b, 0.02) for a, b in zip(again.targets, place.targets, strict=True))
    assert distance(again.targets[place.change].position, place.targets[place.change].position) < 0.004


def test_a_grasp_is_the_same_one_on_another_instance():
    first, second = (build("mug", look=look, color="red") for look in (0, 1))
    for mine, theirs in zip(first.grasps, second.grasps, strict=True):
        shift = grasp_shift(first, mine.pose, second)
        assert near(shift @ mine.pose, theirs.pose, 1e-6)
    assert grasp_shift(first, first.grasps[0].pose, first) == Pose()
    far = first.grasps[0].pose.translated(z=1.0)
    assert grasp_shift(first, far, second) == Pose()


def test_the_library_has_what_is_demonstrated_and_nothing_else(sources):
    library = load_library(sources, "morning_coffee")
    assert [s.trial.condition for s in library.sources] == ["train1", "train2", "train3", "train4"]
    key = skill(library.sources[0], "pick").key
    assert {s.object.kind for s in library.skills(key)} == {key[1]}
    assert library.skills(("pick", "spaceship", "", "", "")) == ()
    with pytest.raises(InvalidInputError, match="no successful demonstration of fast_food"):
        load_library(RunFolder.open(sources.path), "fast_food")


def test_a_record_that_renames_an_object_is_refused_by_name(record):
    scene = record.metadata.scene
    named = (replace(scene.objects[0], name="stranger"), *scene.objects[1:])
    lied = replace(record, metadata=replace(record.metadata, scene=replace(scene, objects=named)))
    with pytest.raises(BetterError) as caught:
        demonstrated_source(lied)
    assert "\n" not in str(caught.value)
    with pytest.raises(RecordError, match="objects differ from those of its condition"):
        _require_objects(lied, [o.name for o in scene.objects])
