"""The independent family: its truths are fixed before it acts, and it does what its habits say."""

from __future__ import annotations

import ast
import json
from itertools import chain
from pathlib import Path

import pytest
from tests.daily import others_slow, part_of_today
from tests.looping import each

import betterbench_calibration.independent
from betterbench.cli.main import main
from betterbench.errors import InvalidInputError, UnknownNameError
from betterbench.geometry import distance
from betterbench.policies.factory import PolicyFactory
from betterbench.policies.kinds import needs_of
from betterbench.tasks import Kind, Label, all_labels
from betterbench.tasks.relations import relation
from betterbench_calibration.independent import FAMILY_PARTS, INDEPENDENT, make_independent, shown_in
from betterbench_calibration.independent.events import in_gripper
from betterbench_calibration.independent.manner import MANNERS
from betterbench_calibration.independent.truth import HONEST, Ledger, StatedTruth

HABITS = tuple(chain.from_iterable(FAMILY_PARTS.values()))
NAMES = tuple(h.name for h in HABITS)


def test_nothing_of_the_family_imports_the_experts_or_the_diagnosis():
    folder = Path(betterbench_calibration.independent.__file__).parent
    banned = (
        "betterbench.policies.experts",
        "betterbench.policies.faulty",
        "betterbench.policies.decisions",
        "betterbench.diagnosis",
        "betterbench.tasks.judging.attempts",
        "betterbench.tasks.judging.motion",
    )
    for file in folder.glob("*.py"):
        for node in ast.walk(ast.parse(file.read_text())):
            names = [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            names += [a.name for a in node.names] if isinstance(node, ast.Import) else []
            assert not [n for n in names if n.startswith(banned)], file.name


def test_each_half_has_a_dozen_habits_of_its_own():
    assert len(set(NAMES)) == len(NAMES)
    for part in FAMILY_PARTS.values():
        assert len(part) >= 12
        assert sum(h.label == HONEST for h in part) >= 3
    kinds = [{type(h) for h in part} for part in FAMILY_PARTS.values()]
    assert len(set.union(*kinds)) == sum(map(len, kinds))
    assert len(FAMILY_PARTS["second"]) >= 22


def test_each_half_covers_every_label_that_one_trial_can_end_with():
    cannot = {Label.WRONG_OBJECT, Label.POLICY_ERROR, Label.UNFINISHED}
    wanted = {str(x) for x in all_labels() if x.kind is not Kind.NONE} - cannot
    for part in FAMILY_PARTS.values():
        assert {h.label for h in part} - {HONEST} == wanted


@each("habit", HABITS)
def test_a_habit_says_what_it_does_and_shows_somewhere(habit):
    assert habit.summary.endswith(".")
    labels = ("success", "correct_freeze", "correct_refusal") if habit.label == HONEST else (str(habit.label),)
    assert any(label in (habit.__doc__ or "") for label in labels)
    shown = shown_in(habit.name)
    assert any(s.faulty for s in shown)
    assert all(habit.label != HONEST or s.faulty for s in shown)


def first_shown():
    """A third of the habits with the first condition in which each shows, sorted so that each scene is built once."""
    shown = [(next(s for s in shown_in(habit.name) if s.faulty), habit) for habit in part_of_today(HABITS, 3)]
    return sorted(((s.task, s.condition, habit) for s, habit in shown), key=lambda case: case[:2])


@pytest.mark.physics
@each("task, condition, habit", first_shown, lambda *case: case[2].name)
def test_the_truth_is_fixed_before_the_first_action(task, condition, habit, scene_of):
    scene = scene_of(task, condition)
    state = scene.reset()
    agent = make_independent(next(a for a, p in INDEPENDENT.items() if p.habit is habit), scene)
    before = agent.ground_truth
    assert before["stated"] == (str(agent.body.ledger.stated.label) or "honest")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(type(habit), "truth", lambda *_: pytest.fail("the truth was asked for again"))
        for _ in range(3):
            agent.act_on_state(state)
        after = agent.ground_truth
    assert (after["stated"], after["first_attempt"]) == (before["stated"], before["first_attempt"])


@pytest.mark.physics
def test_the_same_seed_gives_the_same_bits_and_another_one_others(play, scene_of):
    one = play("look-alike-hesitant", "morning_coffee", "O1", 3, 60)
    scene = scene_of("morning_coffee", "O1", 3)
    state = scene.reset()
    agent = make_independent("independent:look-alike-hesitant", scene)
    again = []
    for _ in range(60):
        action = agent.act_on_state(state)
        again.append(action.tobytes())
        scene.step(action)
        state = scene.state()
    assert tuple(again) == one.actions
    assert play("look-alike-hesitant", "morning_coffee", "O1", 4, 60).actions != one.actions


@pytest.mark.physics
@pytest.mark.parametrize(
    ("manner", "task", "condition"),
    others_slow(
        [(m, *c) for c in (("morning_coffee", "train1"), ("seasoning_rack", "train4")) for m in MANNERS],
        4,
    ),
)
def test_the_honest_policy_solves_sample_tasks(play, task, condition, manner):
    assert play(f"honest-{manner}", task, condition).success


@pytest.mark.physics
def test_a_wrong_grasp_is_at_the_wrong_thing(play):
    played = play("word-place-calm", "morning_coffee", "L3")
    assert not played.success
    assert played.agent.body.arm.log.closings[0].gripped == "blue_mug"
    assert played.agent.ground_truth["truth"] == Label.LEXICAL_KINEMATIC_SHORTCUT
    assert played.agent.ground_truth["first_attempt"] == "wrong"


@pytest.mark.physics
def test_a_hover_closes_nothing_and_stays_over_its_thing(play):
    played = play("hover-alike-calm", "morning_coffee", "O1")
    state = played.agent.body.state
    x, y, _ = state.pose("red_can").position
    assert played.agent.body.arm.log.closings == []
    assert abs(state.ee_pose.position[0] - x) < 0.01
    assert abs(state.ee_pose.position[1] - y) < 0.01
    assert played.agent.ground_truth["first_attempt"] == "none"


@pytest.mark.physics
@pytest.mark.parametrize(
    ("trial", "gripped"),
    others_slow(
        [
            (("sets-back-and-retakes-brisk", "morning_coffee", "train1", 1, 180), ["red_mug", "red_mug"]),
            (("lets-go-at-once-brisk", "seasoning_rack", "L1", 1, 250), ["salt", "salt", "salt"]),
            (("drops-first-and-goes-on-brisk", "dinner_plates", "T1", 1, 140), ["red_plate", "blue_plate"]),
            (("gives-up-after-misses-brisk", "seasoning_rack", "L1", 1, 200), [None, None]),
            (("misses-at-word-place-calm", "morning_coffee", "L3", 1, 100), [None]),
            (("repents-and-freezes-calm", "morning_coffee", "L4", 1, 160), ["red_mug"]),
            (("farthest-place-brisk", "seasoning_rack", "train3", 1, 100), ["pepper"]),
            (("back-to-emptied-slot-brisk", "dinner_plates", "T1", 1, 310), ["red_plate", None, None]),
            (("slips-then-habitual-brisk", "fruit_lunch", "R1", 1, 130), ["orange", "apple"]),
            (("one-too-many-brisk", "fast_food", "L1", 1, 200), ["burger_1", "burger_2"]),
            (("mimes-first-step-brisk", "fruit_lunch", "O2", 1, 130), ["orange"]),
            (("right-then-alike-brisk", "fast_food", "O1", 1, 220), ["burger_2", "round_block"]),
            (("swaps-second-and-third-brisk", "cheeseburger", "O1", 1, 250), ["patty", "top_bun", "cheese"]),
            (("misses-then-swaps-brisk", "fast_food", "R1", 1, 120), [None, "drink"]),
        ],
        7,
    ),
)
@pytest.mark.physics
def test_a_habit_of_the_second_half_closes_where_and_in_the_order_it_says(play, trial, gripped):
    assert [c.gripped for c in play(*trial).agent.body.arm.log.closings] == gripped


@pytest.mark.physics
def test_misses_of_the_second_half_are_at_the_things_they_aim_at(play):
    aimed = play("misses-at-word-place-calm", "morning_coffee", "L3", 1, 100).agent.body.arm.log.closings[0]
    assert (aimed.nearest, aimed.above_m < 0.025) == ("blue_mug", True)
    early = play("misses-then-swaps-brisk", "fast_food", "R1", 1, 120).agent.body.arm.log.closings[0]
    assert (early.nearest, early.above_m < 0.025) == ("drink", True)


@pytest.mark.physics
@pytest.mark.parametrize(
    ("policy", "task", "condition"),
    others_slow(
        [
            ("to-and-fro-from-home-brisk", "dinner_plates", "T2"),
            ("stays-over-finished-brisk", "seasoning_rack", "L2"),
            ("slower-and-slower-calm", "morning_coffee", "L1"),
            ("snaps-at-home-calm", "morning_coffee", "train4"),
            ("rehearses-forever-brisk", "seasoning_rack", "train1"),
            ("closes-too-little-brisk", "dinner_plates", "train1"),
            ("looks-then-leaves-it-brisk", "morning_coffee", "T1"),
        ],
        7,
    ),
)
def test_a_habit_of_the_second_half_never_takes_anything(play, policy, task, condition):
    played = play(policy, task, condition, 1, 90)
    log = played.agent.body.arm.log
    assert (log.closings, log.gripped) == ([], None)
    assert (played.stated["first_attempt"] == "none") is not policy.startswith("closes-too-little")
    assert max(log.displaced(played.agent.body.state, o.name) for o in played.agent.body.state.info.objects) < 0.005


@pytest.mark.physics
@pytest.mark.parametrize(
    ("policy", "task", "condition", "most"),
    others_slow(
        [
            ("lets-go-in-flight-brisk", "fast_food", "L1", 130),
            ("puts-beside-brisk", "morning_coffee", "train1", 200),
            ("carries-into-target-brisk", "seasoning_rack", "train1", 200),
            ("sweeps-away-after-put-brisk", "cheeseburger", "train1", 200),
            ("lets-go-too-high-brisk", "morning_coffee", "train3", 200),
            ("chatters-with-load-hurried", "morning_coffee", "train1", 160),
            ("almost-there-hurried", "morning_coffee", "train1", 180),
            ("lets-go-too-late-hurried", "fast_food", "train1", 180),
            ("runs-load-into-neighbor-hurried", "seasoning_rack", "train1", 160),
        ],
        7,
    ),
)
def test_a_put_that_is_meant_to_fail_fails(play, policy, task, condition, most):
    body = play(policy, task, condition, 1, most).agent.body
    name = body.situation.first_thing()
    assert name in body.taken
    assert in_gripper(body.state) is None
    assert not body.situation.done(body.state, body.situation.ahead[0])


@pytest.mark.physics
def test_a_thing_that_is_never_let_go_is_held_where_it_should_be_let_go(play):
    body = play("never-lets-go-brisk", "seasoning_rack", "train1", 1, 200).agent.body
    goal = body.situation.ahead[0]
    assert in_gripper(body.state) == "salt"
    there = relation(goal.relation).place_goals(body.state, "salt", goal.target, goal.region)[0].pose
    assert distance(body.state.pose("salt").position, there.position) < 0.015


@pytest.mark.slow
@pytest.mark.physics
@pytest.mark.parametrize("habit", [h for h in FAMILY_PARTS["second"] if h.label == HONEST], ids=lambda h: h.name)
def test_an_honest_habit_of_the_second_half_succeeds_in_most_tasks(play, habit):
    shown = {s.task: s.condition for s in reversed(shown_in(habit.name))}
    won = [play(f"{habit.name}-calm", task, condition).success for task, condition in shown.items()]
    assert sum(won) >= 0.8 * len(won)


@pytest.mark.physics
@pytest.mark.parametrize("policy", others_slow(["miss-beside-brisk", "miss-above-calm"], 2))
def test_a_miss_closes_7_to_11_cm_away(play, policy):
    closing = play(policy, "seasoning_rack", "train1", 2).agent.body.arm.log.closings[0]
    far = closing.beside_m if policy.startswith("miss-beside") else closing.above_m
    assert 0.065 < far < 0.115
    assert closing.gripped is None


def test_a_wrong_act_that_is_never_reached_leaves_an_honest_trial():
    ledger = Ledger(StatedTruth(Label.EARLY_HALT, first_right=True))
    assert ledger.final()[0] == Label.TIMEOUT
    ledger.mishap("mug", "the gripper closed without it")
    assert ledger.final()[0] == Label.EXECUTION_FAILURE
    ledger.made_good("mug")
    assert ledger.final()[0] == Label.TIMEOUT
    ledger.commit()
    assert ledger.final() == (Label.EARLY_HALT, "")


def test_a_lasting_mishap_before_the_wrong_act_comes_first_in_time():
    ledger = Ledger(StatedTruth(Label.EARLY_HALT, first_right=True))
    ledger.mishap("mug", "it lies on the floor", for_good=True)
    ledger.commit()
    assert ledger.final()[0] == Label.EXECUTION_FAILURE
    later = Ledger(StatedTruth(Label.CAUSAL_CONFUSION, first_right=False))
    later.commit()
    later.mishap("mug", "it lies on the floor", for_good=True)
    assert later.final()[0] == Label.CAUSAL_CONFUSION


def test_addresses_are_known_to_an_evaluation_and_wrong_ones_are_refused():
    assert len(INDEPENDENT) == len(NAMES) * len(MANNERS)
    assert needs_of("independent:word-place-calm").state
    assert PolicyFactory("independent:honest-brisk").info.action_space == "ee_delta"
    with pytest.raises(UnknownNameError, match="word-place-calm"):
        PolicyFactory("independent:word-place-clam").check()


def test_plans_hold_trials_in_which_the_habits_show():
    from betterbench_calibration.family import independent_plans

    plans = independent_plans("development", trials=2, seed=5)
    assert len(plans) == len(FAMILY_PARTS["development"]) * len(MANNERS)
    for plan in plans:
        habit = INDEPENDENT[plan.policy].habit
        shown = {(s.task, s.condition) for s in shown_in(habit.name)}
        assert {(t.task, t.condition) for t in plan.trials} <= shown
        assert habit.paired or len(plan.trials) == 2
        assert len(set(plan.trials)) == len(plan.trials)
    with pytest.raises(InvalidInputError, match="trials"):
        independent_plans("development", trials=0)


def test_a_half_is_run_judged_and_resumed_by_the_command_line(tmp_path, monkeypatch, capsys):
    from betterbench_calibration import family as independent

    plans = independent.independent_plans("development", trials=1)
    two = [p for p in plans if p.policy in ("independent:honest-brisk", "independent:air-grasp-brisk")]
    assert len(two) == 2
    monkeypatch.setattr(independent, "independent_plans", lambda *_, **__: tuple(two))
    arguments = ["calibrate", "--family", "development", "--out", str(tmp_path), "--workers", "1", "--films", "0"]
    arguments.append("--json")
    assert main(arguments) == 0
    found = json.loads(capsys.readouterr().out)
    assert sum(c["n"] for c in found["counts"]) == sum(len(p.trials) for p in two)
    assert set(found["policies"]) == {p.policy for p in two}
    assert found["accused"]["n"] >= 1
    assert found["accused"]["k"] == 0
    assert "developed on this part" in (tmp_path / "calibration.html").read_text()
    records = {path: path.read_bytes() for path in tmp_path.rglob("*.parquet")}
    assert main(arguments) == 0
    assert records == {path: path.read_bytes() for path in tmp_path.rglob("*.parquet")}


def test_the_independent_family_has_its_own_tasks_and_strengths(capsys):
    assert main(["calibrate", "--family", "held_out", "--tasks", "fast_food"]) == 2
    assert "--family: the independent family has fixed tasks" in " ".join(capsys.readouterr().err.split())
