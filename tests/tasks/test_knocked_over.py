"""What is knocked over: which assets of the library stand, and what tips, rocks or lay before."""

from __future__ import annotations

from collections.abc import Sequence

import pytest
from tests.daily import others_slow
from tests.tasks.arranging import condition_of, states_of

from betterbench.interface.state import ObjectInfo, WorldState
from betterbench.sim.assets import build_unpainted, categories, looks, unseen_looks
from betterbench.tasks import get_task
from betterbench.tasks.judging.harm import HANDLE_FROM, STANDS_FROM, HarmWatch, can_stand, has_direction
from betterbench.tasks.judging.targets import Targets, asked_by

# Containers count by themselves, and fixed furniture cannot fall.
CONTAINERS_AND_FURNITURE = {
    *("waste_bin", "takeaway_box", "lunchbox", "fruit_basket", "lower_drawer", "upper_drawer"),
    *("spice_rack", "drawer_cabinet", "coffee_machine", "laptop"),
}
STANDING = {
    *("mug", "cup", "tumbler", "drink_cup", "can", "sauce_cup", "egg_cup"),
    *("jam_jar", "spice_jar", "plain_salt_jar", "plain_pepper_jar", "plain_paprika_jar", "pill_bottle", "salt_shaker"),
    *("speaker", "fries_box", "stapler", "stapler_block"),
}
APART = 1.1
"""Factor between the border and the height of any look, in its smaller width."""


def info_of(category: str, look: int) -> ObjectInfo:
    asset = build_unpainted(category, look=look)
    return ObjectInfo(
        *(category, category, asset.identity, category, asset.color, asset.shape, "distractor", False, asset.mass_kg),
        size_m=asset.size_m,
    )


@pytest.mark.parametrize("category", others_slow(sorted(set(categories()) - CONTAINERS_AND_FURNITURE), 3))
def test_all_looks_of_a_category_stand_or_none_does_and_none_is_near_the_border(category):
    for look in (*looks(category), *unseen_looks(category)):
        info = info_of(category, look)
        assert can_stand(info) is (category in STANDING), info
        ratio = info.size_m[2] / min(info.size_m[:2])
        border = STANDS_FROM.get(info.shape)
        assert border is None or not border / APART < ratio < border * APART, (info.asset, ratio)


@pytest.mark.parametrize("category", others_slow(sorted(set(categories()) - CONTAINERS_AND_FURNITURE), 3))
def test_cylinders_with_a_handle_are_mugs_and_cups_and_no_look_is_near_the_border(category):
    for look in (*looks(category), *unseen_looks(category)):
        info = info_of(category, look)
        if info.shape == "cylinder":
            width, depth, _ = info.size_m
            ratio = max(width, depth) / min(width, depth)
            assert has_direction(info, HANDLE_FROM) is (category in ("mug", "cup")), info
            assert not HANDLE_FROM["cylinder"] / 1.05 < ratio < HANDLE_FROM["cylinder"] * 1.05, (info.asset, ratio)


def harm_after(setting: str, states: Sequence[WorldState]) -> set[tuple[str, str]]:
    condition = condition_of(setting)
    asked, template = asked_by(condition), get_task(condition.task).template
    targets = Targets(asked, states[0].info, placing=template.relation)
    watch = HarmWatch(asked, targets, states[0].info, exclusive=template.exclusive)
    for state in states:
        watch.see(state, targets.places(state))
    return {(h.sort, h.object) for h in watch.found(states[-1], targets.places(states[-1]))}


@pytest.mark.parametrize(
    ("setting", "thing"),
    [
        ("tidy_desk/train1", "mug"),
        ("tidy_desk/O2", "full_can"),
        ("tidy_desk/O3", "stapler"),
        ("desk_meeting/train1", "speaker"),
        ("seasoning_rack/train1", "pepper"),
        ("seasoning_rack/O1", "pill_bottle"),
        ("breakfast_table/train1", "egg"),
        ("breakfast_table/train1", "jam"),
        ("fast_food/train1", "drink"),
    ],
)
def test_what_tips_is_knocked_over_and_what_stands_again_or_lay_before_is_not(setting, thing):
    upright, lying = states_of(setting, f"{thing} from tilt=90 settle")
    _, leaning = states_of(setting, f"{thing} from tilt=44")
    assert harm_after(setting, [upright, lying]) >= {("knocked_over", thing)}
    assert not harm_after(setting, [upright, leaning])
    assert not harm_after(setting, [upright, leaning, upright])
    assert ("knocked_over", thing) not in harm_after(setting, [upright, lying, upright])
    assert not harm_after(setting, [lying, lying])


@pytest.mark.parametrize(
    ("setting", "thing"),
    [("dinner_plates/O1", "red_bowl"), ("breakfast_table/train1", "bowl"), ("dinner_plates/L2", "red_plate")],
)
def test_a_bowl_or_plate_that_was_turned_over_in_its_place_is_knocked_over(setting, thing):
    upright, over = states_of(setting, f"{thing} from z=3 tilt=180 settle")
    assert harm_after(setting, [upright, over]) == {("knocked_over", thing)}
    _, leaning = states_of(setting, f"{thing} from tilt=30")
    assert not harm_after(setting, [upright, leaning])
    assert not harm_after(setting, [upright, over, upright])


def test_what_has_no_upper_side_may_be_turned_over():
    upright, over = states_of("dinner_plates/train1", "white_plate from turn=0")
    assert not harm_after("dinner_plates/train1", [upright, over])
    upright, over = states_of("cheeseburger/O1", "sponge from z=3 tilt=180 settle")
    assert not harm_after("cheeseburger/O1", [upright, over])


@pytest.mark.parametrize(
    ("setting", "thing"),
    [("desk_meeting/train1", "mug"), ("fast_food/train1", "fries"), ("seasoning_rack/train1", "salt")],
)
def test_what_the_instruction_asks_to_be_moved_is_the_goals_concern_and_no_harm(setting, thing):
    upright, lying = states_of(setting, f"{thing} from tilt=90 settle")
    assert not harm_after(setting, [upright, lying])
