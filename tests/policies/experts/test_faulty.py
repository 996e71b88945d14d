"""The calibration zoo: every policy runs everywhere, decides by its one rule, and knows its own fault."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.daily import others_slow
from tests.looping import each

from betterbench.calibration import true_label
from betterbench.episodes import TrialContext, run_episode
from betterbench.policies.decisions import Bring, GraspAt, Rest, Situation
from betterbench.policies.experts import EXPERTS, REPLAYS, expert_names, make_expert
from betterbench.policies.experts.probes import demonstration_seed
from betterbench.policies.faulty import BrokenRule, Lexical
from betterbench.records import Record
from betterbench.tasks import all_tasks, get_task
from betterbench.tasks.interventions import vary
from betterbench.tasks.randomness import FIRST_DEMONSTRATION_SEED

pytestmark = pytest.mark.physics

ZOO = [name for name in expert_names() if name.startswith("zoo:")]

EVERYWHERE = [
    (policy, t.id, t.variations[(i + j) % len(t.variations)].name)
    for i, policy in enumerate([*ZOO, *REPLAYS, "probe:no-language"])
    for j, t in enumerate(all_tasks())
]
"""Every policy on one variation of every task; ``better calibrate`` runs them all."""

KNOWN = {
    ("zoo:lexical", "morning_coffee", "L3"): "lexical_kinematic_shortcut",
    ("zoo:lexical", "fast_food", "O1"): "semantic_feature_collapse",
    ("zoo:layout", "morning_coffee", "L2"): "visual_layout_bias",
    ("zoo:inertia", "fast_food", "R1"): "behavioral_inertia",
    ("zoo:sequence", "seasoning_rack", "R1"): "behavioral_inertia",
    ("zoo:habit-place", "desk_meeting", "R1"): "behavioral_inertia",
    ("zoo:progress-cue", "fast_food", "T1"): "causal_confusion",
    ("zoo:repeat", "fast_food", "train1"): "causal_confusion",
    ("zoo:reorder", "fruit_lunch", "train1"): "order_violation",
    ("zoo:color", "morning_coffee", "O1"): "semantic_feature_collapse",
    ("zoo:shape", "office_drawer", "O1"): "semantic_feature_collapse",
    ("zoo:halt", "morning_coffee", "L1"): "early_halt",
    ("zoo:refuse", "morning_coffee", "O1"): "early_halt",
    ("zoo:phase", "fruit_lunch", "T1"): "phase_conflict",
    ("zoo:length", "seasoning_rack", "T1"): "early_halt",
    ("zoo:clumsy", "morning_coffee", "train1"): "execution_failure",
    ("zoo:slow", "morning_coffee", "train1"): "timeout",
    ("zoo:crash", "morning_coffee", "T1"): "policy_error",
}
"""What each rule does on one condition, by hand: the policies' own ground_truth are held against it."""


def run(scene, policy: str, task_id: str, name: str, seed: int = 0) -> tuple[Record, dict[str, str]]:
    made = scene(task_id, name, seed)
    agent = make_expert(policy, made)
    record = run_episode(made, agent, context=TrialContext(policy)).record
    return record, agent.ground_truth


def test_every_policy_of_the_zoo_has_a_known_fault():
    assert {policy for policy, _, _ in KNOWN} == set(ZOO)
    assert len(ZOO) >= 10


@pytest.mark.parametrize(("policy", "task_id", "name"), others_slow(KNOWN, 6))
def test_a_policy_knows_its_fault_and_it_costs_the_goal(scene, policy, task_id, name):
    record, ground_truth = run(scene, policy, task_id, name)
    assert record.outcome.clipped_actions == 0
    assert (record.outcome.termination == "policy_error") is (policy == "zoo:crash"), record.outcome.error
    assert np.abs(record.action[1:]).max() <= 1.0
    assert not record.outcome.success
    assert ground_truth["truth"] == KNOWN[policy, task_id, name], ground_truth


@pytest.mark.parametrize("policy", others_slow(["zoo:lexical", "zoo:clumsy", "zoo:slow", "zoo:crash"], 4))
def test_a_rule_that_does_not_apply_leaves_the_expert(scene, episode, policy):
    record, ground_truth = run(scene, f"{policy}?strength=0", "morning_coffee", "L3")
    assert record.outcome.success
    assert ground_truth == {"truth": "", "fault": "", "mishap": ""}
    assert np.array_equal(record.qpos, episode("expert", "morning_coffee", "L3").qpos)


def test_action_noise_shakes_and_does_not_fail(scene, episode):
    calm = episode("expert", "morning_coffee", "train1")
    shaky, _ = run(scene, "expert?action_noise=0.002", "morning_coffee", "train1")
    assert shaky.outcome.success
    n = min(len(calm.action), len(shaky.action), 30)
    off = np.abs(calm.action[5:n, :3] - shaky.action[5:n, :3]).mean()
    assert 0.005 < off < 0.2
    again, _ = run(scene, "expert?action_noise=0.002", "morning_coffee", "train1")
    assert np.array_equal(shaky.action[1:], again.action[1:])


def test_the_strength_is_the_share_of_trials():
    task = get_task("morning_coffee")
    condition, _ = vary(task, task.variation("L3"))
    for strength in (0.3, 0.6):
        applied = sum(Lexical(Situation(task, condition, seed), strength).applies for seed in range(600))
        assert abs(applied / 600 - strength) < 0.07
    stronger = {s for s in range(200) if Lexical(Situation(task, condition, s), 0.6).applies}
    weaker = {s for s in range(200) if Lexical(Situation(task, condition, s), 0.3).applies}
    assert weaker < stronger


def test_right_decisions_are_those_of_the_instruction(scene):
    """An ordered instruction has one next step, a free one has any; a drawer is closed after it was loaded."""
    cases = {
        ("fruit_lunch", "train1"): [Bring("apple", "lunchbox", "inside", "")],
        ("desk_meeting", "train1"): [
            Bring("mouse", "laptop", "beside", "right"),
            Bring("mug", "laptop", "beside", "left"),
        ],
        ("office_drawer", "train2"): [Bring("stapler", "upper", "inside", "")],
        ("morning_coffee", "T1"): [],
        ("fruit_lunch", "O1"): [Bring("orange", "lunchbox", "inside", "")],
    }
    for (task_id, name), wanted in cases.items():
        made = scene(task_id, name, 0)
        rule = BrokenRule(Situation(made.task, made.condition, 0))
        assert list(rule.right_decisions(made.reset())) == wanted, (task_id, name)


def test_a_wrong_decision_is_called_by_what_it_is(scene):
    made = scene("fast_food", "O1", 0)
    rule, state = BrokenRule(Situation(made.task, made.condition, 0)), made.reset()
    block = next(o.name for o in made.condition.objects if o.kind == "round block")
    decisions = {
        Bring("burger_2", "box", "inside", ""): None,
        Bring(block, "box", "inside", ""): "semantic_feature_collapse",
        Bring("drink", "box", "inside", ""): "wrong_object",
        GraspAt("first"): "semantic_feature_collapse",  # the block stands there
        GraspAt("third"): "wrong_object",
        Rest(): "early_halt",
    }
    for decision, label in decisions.items():
        assert rule._label_of(state, (), decision) == label, decision


def test_an_open_loop_probe_plays_a_demonstration_and_sees_nothing(scene):
    """Law 8: what is played was drawn for demonstrations, never with the seed of a trial."""
    assert demonstration_seed("probe:replay", 7) >= FIRST_DEMONSTRATION_SEED
    assert demonstration_seed("probe:no-images", 7) >= FIRST_DEMONSTRATION_SEED
    assert demonstration_seed("probe:replay", 7) != demonstration_seed("probe:no-images", 7)
    expert, _ = run(scene, "expert", "morning_coffee", "train1", demonstration_seed("probe:replay", 0))
    played, _ = run(scene, "probe:replay", "morning_coffee", "O1")
    n = len(expert.action)
    assert np.array_equal(played.action[1:n], expert.action[1:])
    assert not played.outcome.success
    made = scene("morning_coffee", "train1")
    state = made.reset()
    for policy, same in (("probe:replay", True), ("probe:no-images", False)):
        agent = make_expert(policy, made)
        actions = [agent.act_on_state(replace(state, step=step)) for step in range(60)]
        assert np.array_equal(actions, expert.action[1:61]) is same, policy


def test_a_rule_that_decides_like_the_expert_drives_the_same_episode_to_the_same_bits(scene, episode):
    witness, said = run(scene, "expert:witness", "fast_food", "R1")
    same = set(said["same"].split())
    assert "zoo:lexical" in same
    assert "zoo:inertia" not in same
    assert "zoo:clumsy" not in same
    lexical, _ = run(scene, "zoo:lexical", "fast_food", "R1")
    for other in (lexical, episode("expert", "fast_food", "R1")):
        assert np.array_equal(witness.qpos, other.qpos)
        assert np.array_equal(witness.action[1:], other.action[1:])


@pytest.mark.slow
@pytest.mark.parametrize(("policy", "task_id", "name"), EVERYWHERE, ids=["-".join(e) for e in EVERYWHERE])
def test_every_policy_runs_on_every_task(scene, policy, task_id, name):
    record, ground_truth = run(scene, policy, task_id, name)
    if policy != "zoo:crash":
        assert record.outcome.termination != "policy_error", record.outcome.error
    assert record.outcome.clipped_actions == 0
    true_label(ground_truth, expected=get_task(task_id).variation(name).expected.value, success=record.outcome.success)


@each("policy", ZOO)
def test_zoo_policy_says_what_it_does(policy):
    assert EXPERTS[policy].summary.endswith(".")
    assert EXPERTS[policy].address == policy


def test_agents_answer_the_same_on_the_same_states(scene):
    """Two agents of one address in two equal scenes play the same episode: nothing but the trial decides."""
    for policy in ("expert", "zoo:clumsy", "zoo:halt"):
        one, two = scene("morning_coffee", "train2", 3), scene("morning_coffee", "train2", 3)
        a, b = make_expert(policy, one), make_expert(policy, two)
        assert a.name == policy
        first, second = one.reset(), two.reset()
        for _ in range(40):
            x, y = a.act_on_state(first), b.act_on_state(second)
            assert np.array_equal(x, y)
            one.step(x)
            two.step(y)
            first, second = one.state(), two.state()
