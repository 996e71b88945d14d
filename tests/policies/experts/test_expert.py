"""The expert solves everything, stays inside the support of training, and recovers from what goes wrong."""

from __future__ import annotations

import gc
import weakref

import mujoco
import numpy as np
import pytest
from tests.daily import TODAY, part_of_today

from betterbench.certification.handling import Handling, Pick
from betterbench.certification.support import TrainedSupport
from betterbench.diagnosis.analysis.trace import trace_of
from betterbench.errors import PlanningError, UnknownNameError
from betterbench.geometry import Pose, distance, from_yaw, horizontal_distance
from betterbench.interface.actions import USUAL_ROBOT
from betterbench.policies.experts import expert_names, make_expert
from betterbench.policies.experts.motion import delta_action
from betterbench.policies.experts.planner import Planner
from betterbench.sim.scenes import engine_version
from betterbench.tasks import Axis, Expected, GoalTracker, Support, all_tasks, get_task
from betterbench.tasks.demonstrated import demonstrated
from betterbench.tasks.interventions.resolve import resolve_condition
from betterbench.tasks.judging.attempts import find_grasps
from betterbench.tasks.relations import relation

pytestmark = pytest.mark.physics

CONDITIONS = [(t.id, c.name) for t in all_tasks() for c in (*t.training, *t.variations)]
IDS = [f"{t}/{n}" for t, n in CONDITIONS]
SAMPLE = {
    (t.id, name)
    for i, t in enumerate(all_tasks())
    for name in part_of_today(
        [
            t.training[i % len(t.training)].name,
            *(of[i % len(of)].name for of in ([v for v in t.variations if v.axis is axis] for axis in Axis) if of),
        ],
        10,
        day=TODAY + i,
    )
}
"""A tenth of the following, another one each day: one training condition and one variation of each axis of every
task, another number in each task."""
QUICKLY = [pytest.param(t, n, id=f"{t}/{n}", marks=() if (t, n) in SAMPLE else pytest.mark.slow) for t, n in CONDITIONS]
"""All conditions, of which the default tests take the sample."""
SETTLING_M = 0.002
"""By how much a thing may stand beside its slot's jitter box because its asset settles [m]."""
SETTLING_RAD = 0.02


def picks(record):
    """Returns the objects that were held, each with its pose before it was first touched."""
    info = record.metadata.scene
    found = {}
    for i in dict.fromkeys(record.held[record.held >= 0].tolist()):
        found[info.objects[i].name] = record.state(0).pose(info.objects[i].name)
    return found


def check_solved(record):
    expected = record.metadata.expected
    assert record.outcome.error is None
    assert record.outcome.success
    assert record.outcome.clipped_actions == 0
    assert np.abs(record.action[1:]).max() <= 1.0
    assert not record.forbidden.any()
    if expected == Expected.SUCCEED:
        assert record.goal[-11:].all()
        assert not record.goal[0]
        assert record.outcome.termination == "success"


@pytest.mark.parametrize(("task_id", "name"), QUICKLY)
def test_expert_solves_every_condition(episode, task_id, name):
    record = episode("expert", task_id, name)
    check_solved(record)
    if record.metadata.expected == Expected.SUCCEED:
        condition = resolve_condition(task_id, name).condition
        limit = get_task(task_id).step_limit(condition) - condition.watch_steps
        # A person who teleoperates takes about three times as long; slow servos bound both.
        factor = 2.8 if get_task(task_id).robot == USUAL_ROBOT else 2.5
        assert (len(record) - 1 - condition.watch_steps) * factor <= limit


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2, 3, 4, 5])
@pytest.mark.parametrize(("task_id", "name"), CONDITIONS, ids=IDS)
def test_expert_solves_every_condition_on_more_seeds(episode, task_id, name, seed):
    check_solved(episode("expert", task_id, name, seed))


def primitives(record, task, condition):
    """Returns the picks, puts and slides of an episode."""
    handling = Handling(task, condition)
    for state in record.states():
        handling.update(state)
    return handling.finish()


@pytest.mark.parametrize(("task_id", "name"), QUICKLY)
def test_every_pick_and_place_lies_inside_the_support(episode, task_id, name):
    check_support(episode("expert", task_id, name), get_task(task_id), name)


def check_support(record, task, name):
    task_id = task.id
    condition = resolve_condition(task_id, name).condition
    found = primitives(record, task, condition)
    novel = not name.startswith("train") and task.variation(name).support is Support.NOVEL
    trained = TrainedSupport.of(task, demonstrated(task, engine=engine_version()))
    judged = [trained.judge(primitive) for primitive in found]
    assert any(j.problem for j in judged) == novel, [j.problem for j in judged]
    placing = [g for g in condition.instruction.subgoals if g.relation == task.template.relation]
    done = sum(record.subgoals[0, condition.instruction.subgoals.index(g)] for g in placing)
    if record.metadata.expected == Expected.SUCCEED:
        taken = [p for p in found if isinstance(p, Pick)]
        assert len(taken) == len(placing) - done, "one pick per open subgoal and none besides"
    else:
        assert not any(isinstance(p, Pick) for p in found)


@pytest.mark.slow
@pytest.mark.parametrize(("task_id", "name"), CONDITIONS, ids=IDS)
def test_support_on_more_seeds(episode, task_id, name):
    for seed in (1, 2, 3):
        check_support(episode("expert", task_id, name, seed), get_task(task_id), name)


@pytest.mark.parametrize(("task_id", "name"), QUICKLY)
def test_expert_disturbs_nothing_it_was_not_asked_to_move(episode, task_id, name):
    record = episode("expert", task_id, name)
    first, last = record.state(0), record.state(-1)
    moved = set(picks(record))
    for o in first.info.objects:
        if o.name not in moved and o.role in ("item", "distractor"):
            assert distance(first.pose(o.name).position, last.pose(o.name).position) < 0.01, o.name


@pytest.mark.parametrize(("task_id", "name"), QUICKLY)
def test_expert_takes_half_of_the_steps_it_may_use(episode, task_id, name):
    """A limit that the expert only just keeps would measure speed."""
    record = episode("expert", task_id, name)
    template = get_task(task_id).template
    if record.metadata.expected == Expected.SUCCEED:
        limit = template.base_steps + template.steps_per_subgoal * len(record.metadata.subgoal_names)
        assert record.n_steps < 0.85 * limit


# --------------------------------------------------------------------------------------------------------- disturbances


def teleport(scene, name, pose):
    i = scene.info.index(name)
    address, dof = scene.compiled.qpos_addresses[i], scene.compiled.dof_addresses[i]
    scene.data.qpos[address : address + 7] = (*pose.position, *pose.quaternion)
    scene.data.qvel[dof : dof + 6] = 0.0
    mujoco.mj_forward(scene.model, scene.data)


def live(scene, disturb):
    """Runs the expert and calls `disturb` on each state until it says that it has acted."""
    agent = make_expert("expert", scene)
    state = scene.reset()
    tracker = GoalTracker(
        scene.condition, scene.info, template=scene.task.template, control_rate_hz=scene.control_rate_hz
    )
    truth = tracker.update(state)
    acted_at = None
    limit = scene.task.step_limit(scene.condition)
    while state.step < limit and not truth.success:
        action = agent.act_on_state(state)
        assert np.abs(action).max() <= 1.0
        scene.step(action)
        state = scene.state()
        truth = tracker.update(state)
        if acted_at is None and disturb(state):
            acted_at = state.step
            state = scene.state()
    return truth, acted_at, state


@pytest.mark.parametrize(
    ("task_id", "shift"),
    [("morning_coffee", (0.0, -0.07)), pytest.param("fast_food", (0.02, -0.05), marks=pytest.mark.slow)],
)
def test_expert_recovers_from_a_missed_grasp(scene, task_id, shift):
    """Just before the hand closes, its object is moved aside."""
    s = scene(task_id, "train1")
    kinds = s.condition.instruction.subgoals[0].reference
    names = s.condition.resolve(kinds)

    def nudge(state):
        for name in names:
            pose = state.pose(name)
            above = state.ee_pose.position[2] - pose.position[2]
            if horizontal_distance(state.ee_pose.position, pose.position) < 0.06 and above < 0.09:
                teleport(s, name, pose.translated(*shift, 0.0))
                return True
        return False

    truth, acted_at, state = live(s, nudge)
    assert acted_at is not None, "the disturbance was made"
    assert truth.success, f"not solved by step {state.step} after the nudge at {acted_at}"


@pytest.mark.parametrize("task_id", ["morning_coffee", pytest.param("fast_food", marks=pytest.mark.slow)])
def test_expert_recovers_from_a_drop(scene, task_id):
    """In mid-air the held object vanishes from the hand and stands in its slot again."""
    s = scene(task_id, "train1")
    at_start = {o.name: s.state().pose(o.name) for o in s.info.objects}
    dropped = []

    def drop(state):
        if state.held is not None and state.pose(state.held).position[2] > 0.12:
            dropped.append(state.held)
            teleport(s, state.held, at_start[state.held])
            return True
        return False

    truth, acted_at, state = live(s, drop)
    assert dropped
    assert truth.success, f"not solved by step {state.step} after the drop at {acted_at}"


@pytest.mark.slow
def test_expert_gives_up_quietly_where_nothing_can_be_grasped(scene):
    """The mug has gone out of reach: the expert goes home and holds still, and nothing is raised."""
    s = scene("morning_coffee", "train1")

    def take_away(state):
        if state.step == 1:
            teleport(s, "red_mug", Pose((1.5, 1.5, 0.0)))
            return True
        return False

    truth, _, state = live(s, take_away)
    assert not truth.success
    assert state.step == s.task.step_limit(s.condition)
    assert max(abs(v) for v in state.joint_velocities) < 0.05


# ------------------------------------------------------------------------------------------------------------ the parts


def test_planner_says_why_there_is_no_grasp(scene):
    s = scene("morning_coffee", "train1")
    state = s.reset()
    planner = Planner(s)
    with pytest.raises(PlanningError, match="no free grasp of coffee_machine: it has no annotated grasp"):
        planner.plan_pick(state, "coffee_machine")
    plan = planner.plan_pick(state, "red_mug")
    assert plan.object == "red_mug"
    assert distance(plan.grasp.position, state.pose("red_mug").position) < 0.12
    assert plan.way[-1].position[2] > plan.grasp.position[2]


def test_planner_leaves_the_scene_alone(scene):
    s = scene("fast_food", "train1")
    state = s.reset()
    before = s.data.qpos.tobytes(), s.data.qvel.tobytes(), s.data.ctrl.tobytes()
    Planner(s).plan_pick(state, "burger_1")
    assert (s.data.qpos.tobytes(), s.data.qvel.tobytes(), s.data.ctrl.tobytes()) == before
    assert s.state() == state


def test_a_drawer_is_not_carried_to_be_closed(scene):
    s = scene("fast_food", "train1")
    with pytest.raises(PlanningError, match="closed is not established by carrying an object"):
        relation("closed").place_goals(s.reset(), "fries", "box", "")


@pytest.mark.parametrize(
    ("task_id", "name", "target"), [("fast_food", "fries", "box"), ("morning_coffee", "red_mug", "coffee_machine")]
)
def test_place_goals_satisfy_the_relation_they_are_for(scene, task_id, name, target):
    import dataclasses

    s = scene(task_id, "train1")
    state = s.reset()
    kind = s.task.template.relation
    goals = relation(kind).place_goals(state, name, target, "")
    i = state.info.index(name)
    for goal in goals[:3]:
        positions, quaternions = list(state.positions), list(state.quaternions)
        positions[i], quaternions[i] = goal.pose.position, goal.pose.quaternion
        there = dataclasses.replace(state, positions=tuple(positions), quaternions=tuple(quaternions), contacts=())
        assert relation(kind).holds(there, name, target)


def test_delta_action_is_clipped_and_zero_where_nothing_is_to_be_done():
    here = Pose((0.4, 0.1, 0.3), from_yaw(0.3))
    assert delta_action(here, here, -1.0).tolist() == [0.0] * 6 + [-1.0]
    far = delta_action(here, Pose((9.0, -9.0, 0.3), from_yaw(3.0)), 1.0)
    assert far[0] == 1.0
    assert far[1] == -1.0
    assert np.abs(far).max() <= 1.0
    assert delta_action(here, here.translated(x=0.05), 0.0)[0] == pytest.approx(1.0)


def test_unknown_expert_is_refused_with_the_closest(scene):
    with pytest.raises(UnknownNameError, match="zoo:lexical"):
        make_expert("zoo:lexica", scene("morning_coffee", "train1"))
    assert expert_names()[0] == "expert"


@pytest.mark.parametrize("policy", ["expert", "zoo:lexical"])
def test_a_closed_expert_holds_no_scene(scene, policy):
    """A run of thousands of trials would otherwise wait for the garbage collector with every scene."""
    mine = scene("morning_coffee", "train1")
    rule = make_expert(policy, mine)
    rule.act_on_state(mine.reset())
    held = weakref.ref(mine)
    gc.disable()
    try:
        rule.close()
        del mine, rule
        assert held() is None
    finally:
        gc.enable()


# ------------------------------------------------------------------------------------------------------ closing points


@pytest.mark.parametrize(
    ("task_id", "name"),
    [pytest.param(t, n, id=f"{t}/{n}", marks=p.marks) for p in QUICKLY for t, n in [p.values] if n.startswith("train")],
)
def test_the_expert_closes_where_the_slots_say_that_demonstrations_do(episode, task_id, name):
    record = episode("expert", task_id, name)
    setting = resolve_condition(task_id, name)
    trace = trace_of(record, setting.condition, step_limit=setting.task.step_limit(setting.condition))
    closings = [g for g in find_grasps(trace) if g.secured and not trace.is_drawer(g.object)]
    assert closings
    for grasp in closings:
        slot = trace.picked_slot(grasp.slot)
        assert slot is not None
        assert slot.beyond(trace.tool[grasp.end].tolist()) <= 0.004
