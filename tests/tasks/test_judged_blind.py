"""Scenes that were judged blind from image and instruction: the text files say how, and hold the judgments.

The first set is checked each day, and each of the others every eleventh day.
"""

from __future__ import annotations

import math
from collections import Counter
from pathlib import Path
from typing import NamedTuple

import pytest
from tests.daily import in_turn
from tests.tasks.arranging import condition_of, states_of

from betterbench.geometry import tilt_of, yaw_of
from betterbench.tasks import GoalTracker, get_task
from betterbench.tasks.relations import is_at, relation
from betterbench.tasks.relations.beside import side_of
from betterbench.tasks.relations.placing import foot

LEAST_AGREEMENT = 0.98


class Scene(NamedTuple):
    kind: str
    setting: str
    pair: str
    region: str
    arrangement: str
    votes: str
    instruction: str

    @property
    def accepted(self) -> bool:
        return self.votes.count("y") >= 2


def _scenes(name: str) -> list[Scene]:
    lines = (Path(__file__).parent / name).read_text().splitlines()
    return [Scene(*(cell.strip() for cell in line.split("|"))) for line in lines if line and line[0] != "#"]


SCENES = _scenes("judged_blind.txt")
HELD_OUT = _scenes("judged_held_out.txt")
BY_CHANCE = _scenes("judged_by_chance.txt")
HARM = _scenes("judged_harm.txt")
AGAIN = _scenes("judged_again.txt")
THIRD = _scenes("judged_third.txt")
FOURTH = _scenes("judged_fourth.txt")
FIFTH = _scenes("judged_fifth.txt")
SIXTH = _scenes("judged_sixth.txt")
SEVENTH = _scenes("judged_seventh.txt")
EIGHTH = _scenes("judged_eighth.txt")
SAID = [scene for scene in SCENES if "without" not in scene.kind]
"""Scenes with an instruction as the suite gives it."""


def accepts(scene: Scene) -> bool:
    start, state = states_of(scene.setting, scene.arrangement)
    if scene.kind.split(",")[0] == "harm":
        condition = condition_of(scene.setting)
        tracker = GoalTracker(condition, state.info, template=get_task(condition.task).template, control_rate_hz=20.0)
        tracker.update(start)
        for _ in range(6):  # a quarter second after it was put there, everything is at rest
            truth = tracker.update(state)
        return truth.goal
    thing, target = scene.pair.split(" > ")
    return relation(scene.kind.split(",")[0]).holds(state, thing, target, scene.region.removeprefix("-"))


@pytest.fixture(scope="module")
def disagreed() -> list[Scene]:
    return [scene for scene in SAID if accepts(scene) is not scene.accepted]


def test_goals_and_harm_are_what_a_person_accepts(disagreed):
    agreement = 1.0 - len(disagreed) / len(SAID)
    assert agreement >= LEAST_AGREEMENT, f"{agreement:.3f}: {disagreed}"


def test_the_disagreements_are_known(disagreed):
    """A spoon at the upper right, and a cup almost behind the plate, as later judges accept it (docs/sides.md)."""
    assert [(s.pair, s.region) for s in disagreed] == [("spoon > plate", "right"), ("cup > plate", "upper_right")]


def test_every_relation_and_harm_is_judged_with_both_verdicts():
    counts = Counter((scene.kind, scene.accepted) for scene in SAID)
    assert len(SAID) >= 60
    for kind in ("beside", "inside", "on_plate", "in_hole", "on_ring", "layer", "closed", "harm"):
        assert counts[kind, False] >= 2, kind
        assert counts[kind, True] >= 1 or kind == "in_hole", kind  # none of the jars that were let go slid in
    sides = Counter((s.pair.split(" > ")[1], s.region) for s in SAID if s.kind == "beside")
    assert len(sides) == 6
    assert min(sides.values()) >= 10


def test_without_next_to_a_person_accepts_what_lies_far_from_the_plate():
    """Tables are laid from slots that lie there, so the instruction has to say more than the side."""
    far = [s for s in SCENES if "without" in s.kind and s.accepted and not accepts(s)]
    assert len(far) >= 5


@in_turn(0, 11)
def test_scenes_posed_afterwards_agree_but_near_borders():
    """Six differ, four of them objects pushed by 4 to 5 cm: docs/sides.md lists them."""
    disagreed = [scene for scene in HELD_OUT if accepts(scene) is not scene.accepted]
    assert len(HELD_OUT) == 80
    assert len(disagreed) <= 6, disagreed
    assert {scene.kind for scene in disagreed} <= {"beside", "on_plate", "harm"}


@in_turn(1, 11)
def test_goals_posed_by_chance_are_what_people_accept():
    goals = [scene for scene in BY_CHANCE if scene.kind != "harm"]
    disagreed = [scene for scene in goals if accepts(scene) is not scene.accepted]
    assert len(goals) == 66
    assert 1.0 - len(disagreed) / len(goals) >= LEAST_AGREEMENT, disagreed


@in_turn(2, 11)
def test_harm_posed_by_chance_is_what_people_call_harm_but_for_pushes():
    """Two differ: a mug and an orange pushed by 6.0 and 9.5 cm, of which the judges were unsure."""
    harm = [scene for scene in BY_CHANCE if scene.kind == "harm"]
    disagreed = [scene for scene in harm if accepts(scene) is not scene.accepted]
    assert len(harm) == 18
    assert len(disagreed) <= 2, disagreed


@in_turn(3, 11)
def test_what_is_turned_moved_or_left_open_is_harm_where_people_say_so():
    """Of 63 scenes 9 differ: eight pushes of 5 to 7 cm, where law 7 has 5, and a speaker turned by 35 degrees."""
    disagreed = [scene for scene in HARM if accepts(scene) is not scene.accepted]
    pushed = [scene for scene in disagreed if scene.accepted]
    assert len(HARM) == 63
    assert len(pushed) <= 8, pushed
    assert len(disagreed) - len(pushed) <= 1, disagreed


@in_turn(4, 11)
def test_scenes_posed_again_agree_wherever_the_judges_are_sure():
    """Two of 84 differ, and in each a judge is unsure: docs/sides.md lists them. Five did while drinks might lie."""
    disagreed = [scene for scene in AGAIN if accepts(scene) is not scene.accepted]
    assert len(AGAIN) == 84
    assert [scene for scene in disagreed if scene.kind.endswith(", sure")] == []
    assert [(s.setting, s.pair) for s in disagreed] == [
        ("desk_meeting/train9", "mouse > laptop"),  # upside down, which the judges did not see
        ("desk_meeting/O1", "-"),  # a soap bar turned by 56 degrees
    ]


@in_turn(5, 11)
def test_a_third_set_differs_only_where_the_judges_are_unsure():
    """Three of 65 differ, listed in docs/sides.md. Five did before cutlery was allowed to lie face down."""
    disagreed = [scene for scene in THIRD if accepts(scene) is not scene.accepted]
    assert len(THIRD) == 65
    assert [scene for scene in disagreed if scene.kind.endswith(", sure")] == []
    assert sorted((s.setting, s.pair) for s in disagreed) == [
        ("breakfast_table/train3", "cup > plate"),  # low for "upper right"
        ("breakfast_table/train6", "spoon > plate"),  # reversed
        ("morning_coffee/train4", "blue_mug > coffee_machine"),  # 2 cm beside the ring's middle
    ]


@in_turn(6, 11)
def test_a_fourth_set_near_the_borders_differs_only_where_the_judges_are_unsure():
    """Ten of 60 differ; half lie close to a border. Fourteen did when they were judged."""
    disagreed = [scene for scene in FOURTH if accepts(scene) is not scene.accepted]
    sure = [scene for scene in FOURTH if scene.kind.endswith(", sure")]
    assert (len(FOURTH), len(sure)) == (60, 36)
    assert len(disagreed) <= 10, disagreed
    assert [(s.setting, s.pair) for s in disagreed if s in sure] == []
    assert all(s.accepted for s in disagreed)  # the program accepted nothing that people do not


@in_turn(7, 11)
def test_a_fifth_set_agrees_with_the_rules_that_it_changed():
    """Three of 66 differed: a plate 4.7 cm off center, a spoon 0.6 cm from a plate, a mug 27 cm from a laptop."""
    disagreed = [scene for scene in FIFTH if accepts(scene) is not scene.accepted]
    assert (len(FIFTH), sum(scene.kind.endswith(", sure") for scene in FIFTH)) == (66, 57)
    assert disagreed == []


@in_turn(8, 11)
def test_a_seventh_set_written_by_hand_differs_only_where_the_judges_are_unsure():
    """Three of 72 differ, and the program denies all of them. docs/sides.md lists them."""
    disagreed = [scene for scene in SEVENTH if accepts(scene) is not scene.accepted]
    assert (len(SEVENTH), sum(scene.kind.endswith(", sure") for scene in SEVENTH)) == (72, 56)
    assert {(s.setting, s.kind, s.accepted) for s in disagreed} == {
        ("fast_food/R1", "inside, unsure", True),
        ("morning_coffee/L4", "on_ring, unsure", True),
        ("desk_meeting/train9", "beside, unsure", True),
    }


@in_turn(9, 11)
def test_an_eighth_set_written_by_hand_agrees():
    """The program agreed in all 72 scenes when they were judged; see docs/sides.md."""
    disagreed = [scene for scene in EIGHTH if accepts(scene) is not scene.accepted]
    assert (len(EIGHTH), sum(scene.kind.endswith(", sure") for scene in EIGHTH)) == (72, 61)
    assert disagreed == []


@in_turn(10, 11)
def test_a_sixth_set_differs_only_where_the_judges_are_unsure():
    """Two of 66 differ, and the program denies both. Three did before a speaker could be 24 cm behind a laptop."""
    disagreed = [scene for scene in SIXTH if accepts(scene) is not scene.accepted]
    assert (len(SIXTH), sum(scene.kind.endswith(", sure") for scene in SIXTH)) == (66, 46)
    assert [(s.setting, s.pair, s.kind.endswith(", sure"), s.accepted) for s in disagreed] == [
        ("fast_food/train1", "-", False, True),  # the box rotated by 20 degrees
        ("breakfast_table/train5", "spoon > plate", False, True),  # 10 cm from the plate, where spoons start
    ]


POSTURES = {"face down": (2, 2), "reversed": (1, 10), "slanted by 51 to 88 degrees": (0, 5)}
"""Scenes with cutlery in a posture at the right place: the number that people accept, and the number judged."""


def test_postures_of_cutlery_are_accepted_as_people_accept_them():
    counts = Counter()
    for scene in (s for scenes in (SCENES, HELD_OUT, BY_CHANCE, AGAIN, THIRD) for s in scenes):
        posture = posture_of(scene)
        if posture is not None:
            counts[posture, scene.accepted] += 1
            assert accepts(scene) is (posture == "face down"), scene
    assert {p: (counts[p, True], counts[p, True] + counts[p, False]) for p in POSTURES} == POSTURES


def posture_of(scene: Scene) -> str | None:
    """Return the posture of cutlery that lies on the table at the named side of a plate, if it is not the usual one."""
    thing, _, target = scene.pair.partition(" > ")
    if thing not in ("fork", "spoon") or target != "plate":
        return None
    _, state = states_of(scene.setting, scene.arrangement)
    pose, anchor = state.pose(thing), state.pose(target)
    side = side_of(state.info.object(target), *anchor.inverse().apply(foot(state, thing))[:2])
    if not is_at(side, scene.region) or not state.touching(thing, "table"):
        return None
    turned = abs(math.remainder(yaw_of(pose.quaternion) - yaw_of(anchor.quaternion), 2.0 * math.pi))
    if tilt_of(pose.quaternion) > math.radians(135.0):
        return "face down" if turned < math.radians(45.0) else None
    if turned > math.radians(135.0):
        return "reversed"
    return "slanted by 51 to 88 degrees" if math.radians(45.0) < turned < math.radians(90.0) else None
