"""The scene at reset: at rest, free of penetration, the same bits every time, and blind to names and order."""

from __future__ import annotations

import dataclasses
import functools
import gc
import itertools
import math
import weakref

import mujoco
import numpy as np
import pytest
from tests.daily import others_slow, part_of_today

from betterbench.errors import InvalidActionError, PremiseError
from betterbench.geometry import Pose, distance
from betterbench.interface.actions import EE_DELTA
from betterbench.interface.state import WorldState
from betterbench.policies.experts import make_expert
from betterbench.sim.assets import build
from betterbench.sim.scenes import Clearance, Scene, builder, place_objects
from betterbench.sim.scenes.stage import quality_preset
from betterbench.tasks import Condition, Expected, GoalTracker, TargetRegion, all_tasks, get_task
from betterbench.tasks.interventions import vary

pytestmark = pytest.mark.physics

TASKS = [t.id for t in all_tasks()]
STILL = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, -1.0])


def condition_of(task_id: str, name: str) -> Condition:
    task = get_task(task_id)
    return task.train(name) if name.startswith("train") else vary(task, task.variation(name))[0]


def build_scene(condition: Condition, seed: int = 0) -> Scene:
    task = get_task(condition.task)
    return Scene(task, condition, seed=seed, action_space=EE_DELTA, quality=quality_preset("fast"))


@functools.lru_cache(maxsize=8)
def scene(task_id: str, name: str, seed: int = 0) -> Scene:
    return build_scene(condition_of(task_id, name), seed)


@pytest.fixture(
    scope="module",
    params=[*part_of_today(TASKS, 5), *(pytest.param((t, True), marks=pytest.mark.slow) for t in TASKS)],
    ids=lambda p: p if isinstance(p, str) else f"all of {p[0]}",
)
def scenes(request: pytest.FixtureRequest) -> list[Scene]:
    """Conditions of one task: the first of training and, of half the axes each day, the first; or all.

    Each scene is built once.
    """
    task_id, whole = (request.param, False) if isinstance(request.param, str) else request.param
    task = get_task(task_id)
    of_each_axis = list({v.axis: v for v in reversed(task.variations)}.values())
    chosen = (*task.training, *task.variations) if whole else (task.training[0], *part_of_today(of_each_axis, 2))
    return [build_scene(condition_of(task.id, c.name)) for c in chosen]


def world(state: WorldState) -> dict[str, tuple[object, ...]]:
    return {
        o.name: (state.pose(o.name), state.linear_speeds[i], state.angular_speeds[i])
        for i, o in enumerate(state.info.objects)
    }


def test_initial_state_is_at_rest(scenes):
    for s in scenes:
        before = s.reset()
        assert not any(before.linear_speeds), s.condition.id
        fastest = 0.0
        for _ in range(100):
            s.step(STILL)
            fastest = max(fastest, *s.state().linear_speeds)
        after = s.state()
        for o in before.info.objects:
            moved = distance(before.pose(o.name).position, after.pose(o.name).position)
            assert moved < 0.5e-3, f"{s.condition.id}: {o.name} moved {moved * 1e3:.2f} mm in 5 s"
        assert fastest < 0.02, s.condition.id
        assert distance(before.ee_pose.position, after.ee_pose.position) < 2e-3, s.condition.id


def test_initial_state_is_free_of_penetration(scenes):
    for s in (*scenes, *(build_scene(s.condition, 3) for s in scenes)):
        s.reset()
        assert s.data.ncon > 0, f"{s.condition.id}: objects stand on something"
        assert s.data.contact.dist.min() > -0.5e-3, s.condition.id
        labels = s.compiled.geom_labels
        robot = {s.body_names.index(n) for n in ("left_finger", "right_finger", "hand", "arm")}
        touching = {int(x) for x in labels[s.data.contact.geom].ravel()} & robot
        assert not touching, f"{s.condition.id}: the arm touches nothing at reset"


@pytest.mark.slow
@pytest.mark.parametrize("task_id", TASKS)
def test_every_seed_of_a_run_stands_and_keeps_its_premise(task_id):
    """The default of twenty seeds and more: at rest at once, free of penetration, premise kept."""
    task = get_task(task_id)
    for name, seed in itertools.product((c.name for c in (*task.training, *task.variations)), range(40)):
        s = build_scene(condition_of(task_id, name), seed)
        before = s.reset()
        assert s.data.contact.dist.min() > -0.5e-3, (name, seed)
        for _ in range(10):
            s.step(STILL)
        after = s.state()
        for o in before.info.objects:
            moved = distance(before.pose(o.name).position, after.pose(o.name).position)
            assert moved < 0.5e-3, (name, seed, o.name)


def test_goal_is_false_at_reset_unless_nothing_is_to_be_done(scenes):
    for s in scenes:
        tracker = GoalTracker(s.condition, s.info, template=s.task.template, control_rate_hz=s.control_rate_hz)
        truth = tracker.update(s.reset())
        assert truth.goal is (s.condition.expected is Expected.STAY_STILL), s.condition.id
        assert not truth.success, s.condition.id
        assert not truth.forbidden, s.condition.id


def test_reset_reproduces_every_bit_whatever_happened(scenes):
    for s in scenes:
        first = s.reset()
        start = (s.data.qpos.tobytes(), s.data.qvel.tobytes(), s.data.ctrl.tobytes(), s.data.time)
        draw = np.random.default_rng(5)
        for _ in range(12):
            s.step(draw.uniform(-1, 1, 7))
        assert s.data.qpos.tobytes() != start[0], s.condition.id
        assert s.reset() == first, s.condition.id
        assert (s.data.qpos.tobytes(), s.data.qvel.tobytes(), s.data.ctrl.tobytes(), s.data.time) == start


@pytest.mark.parametrize("task_id", others_slow(TASKS, 4))
def test_two_scenes_with_one_seed_live_the_same_life(task_id):
    one, two = build_scene(condition_of(task_id, "train1"), 4), build_scene(condition_of(task_id, "train1"), 4)
    assert one.reset() == two.reset()
    draw = np.random.default_rng(0)
    for action in draw.uniform(-1, 1, (40, 7)):
        assert np.array_equal(one.step(action), two.step(action))
    assert one.state() == two.state()
    assert one.data.qpos.tobytes() == two.data.qpos.tobytes()


def test_another_seed_is_another_trial(scenes):
    one = scenes[0]
    assert world(one.reset()) != world(build_scene(one.condition, 1).reset())


def renamed(condition: Condition, names: dict[str, str]) -> Condition:
    goals = tuple(dataclasses.replace(g, target=names[g.target]) for g in condition.instruction.subgoals)

    def place(p: TargetRegion) -> TargetRegion:
        return dataclasses.replace(p, target=names[p.target])

    return condition.with_(
        objects=tuple(
            dataclasses.replace(o, name=names[o.name], mount=None if o.mount is None else place(o.mount))
            for o in condition.objects
        ),
        layout={names[n]: slot for n, slot in condition.layout.items()},
        preplaced={names[n]: place(p) for n, p in condition.preplaced.items()},
        opened={names[n]: distance_m for n, distance_m in condition.opened.items()},
        instruction=dataclasses.replace(condition.instruction, subgoals=goals),
    )


def shuffled(condition: Condition) -> Condition:
    return condition.with_(
        objects=condition.objects[::-1],
        layout=dict(reversed(condition.layout.items())),
        preplaced=dict(reversed(condition.preplaced.items())),
        opened=dict(reversed(condition.opened.items())),
    )


def test_names_and_listing_order_change_nothing(scenes):
    for plain in scenes:
        condition = plain.condition
        # Names that sort the other way round.
        names = {o.name: f"x{i}" for i, o in enumerate(sorted(condition.objects, key=lambda o: o.name, reverse=True))}
        other = build_scene(shuffled(renamed(condition, names)))
        assert plain.compiled is other.compiled, condition.id
        assert plain.reset().positions == other.reset().positions, condition.id
        draw = np.random.default_rng(1)
        for action in draw.uniform(-1, 1, (10, 7)):
            plain.step(action)
            other.step(action)
        assert plain.data.qpos.tobytes() == other.data.qpos.tobytes(), condition.id
        assert plain.data.qvel.tobytes() == other.data.qvel.tobytes(), condition.id
        assert [names[o.name] for o in plain.info.objects] == [o.name for o in other.info.objects], condition.id


def test_adding_an_object_moves_no_other():
    condition = condition_of("fast_food", "train1")
    poses = {p.spec.name: p.pose for p in place_objects(get_task("fast_food"), condition, 6)}
    fewer = condition.with_(
        objects=tuple(o for o in condition.objects if o.name != "drink"),
        layout={n: s for n, s in condition.layout.items() if n != "drink"},
    )
    for placement in place_objects(get_task("fast_food"), fewer, 6):
        assert placement.pose == poses[placement.spec.name]


def test_layout_and_language_share_one_compiled_model():
    base = scene("fast_food", "train1")
    for name in ("train2", "L1", "R1", "R2", "T2"):
        assert scene("fast_food", name).compiled is base.compiled
    for name in ("O1", "T1"):
        assert scene("fast_food", name).compiled is not base.compiled


def test_the_scene_knows_its_objects_and_slots(scenes):
    s = scenes[0]
    assert {o.name for o in s.info.objects} == {o.name for o in s.condition.objects}
    for o in s.info.objects:
        assert o.slot == s.condition.layout.get(o.name)
        assert min(o.size_m) > 0.0
        assert o.mass_kg > 0.0
    assert [slot.name for slot in s.info.slots] == [slot.name for slot in s.task.slots]
    state = s.reset()
    assert state.step == 0
    assert state.time_s == 0.0
    assert state.held is None
    assert state.gripper_command == -1.0
    assert state.ee_pose.position == pytest.approx(s.info.home_position)
    assert state.finger_width_m == pytest.approx(s.info.gripper_opening_m)


def test_a_scene_is_freed_with_the_last_reference_to_it():
    """Each holds some 10 MB outside of Python, which no garbage collection knows of: nothing may refer to itself."""
    gc.collect()
    gc.disable()
    try:
        s = build_scene(condition_of("morning_coffee", "train1"))
        expert, state = make_expert("expert", s), s.reset()
        for _ in range(5):
            s.step(expert.act_on_state(state))
            state = s.state()
        held = [weakref.ref(x) for x in (s, s.controller, s.controller.ik, expert)]
        del s, expert
        assert [x() for x in held] == [None] * len(held)
    finally:
        gc.enable()


def test_time_goes_by_in_whole_control_steps():
    s = scene("morning_coffee", "train1")
    s.reset()
    for step in range(1, 6):
        s.step(STILL)
        state = s.state()
        assert state.step == step
        assert state.time_s == pytest.approx(step * 0.05)
        assert s.data.time == pytest.approx(state.time_s)
    s.reset()


def test_step_reports_what_was_really_applied_and_refuses_the_impossible():
    s = scene("morning_coffee", "train1")
    s.reset()
    asked = np.array([2.0, -3.0, 0.5, 0.0, 0.0, 0.0, 7.0])
    assert s.step(asked).tolist() == [1.0, -1.0, 0.5, 0.0, 0.0, 0.0, 1.0]
    assert s.state().gripper_command == 1.0
    qpos = s.data.qpos.copy()
    for bad in (np.full(7, np.nan), np.full(7, np.inf), np.zeros(6), np.zeros((1, 7)), np.array(["a"] * 7)):
        with pytest.raises(InvalidActionError):
            s.step(bad)
    assert np.array_equal(s.data.qpos, qpos), "a refused action moves nothing"
    s.reset()


# --------------------------------------------------------------------------------------------------------- the premise


def patched(monkeypatch, category, **changes):
    """Makes the library build one category differently, as a changed asset would."""

    def other(name, **arguments):
        asset = build(name, **arguments)
        return dataclasses.replace(asset, **changes) if name == category else asset

    monkeypatch.setattr(builder, "build", other)


def test_an_asset_that_no_longer_stands_stops_the_run(monkeypatch):
    can = build("can", color="red")
    # A round bottom and a heavy head: the can falls over when it settles.
    ball = dataclasses.replace(can.collision[0], shape="sphere", size=(0.03, 0.0, 0.0), position=(0.0, 0.0, 0.03))
    patched(monkeypatch, "can", collision=(ball,), center_of_mass=(0.02, 0.0, 0.1))
    s = build_scene(condition_of("morning_coffee", "O1"))
    with pytest.raises(PremiseError, match="red_can does not stand upright") as caught:
        s.reset()
    assert "morning_coffee/O1 seed 0" in str(caught.value)
    assert "MuJoCo" in str(caught.value)


def test_an_instruction_without_its_object_stops_the_run():
    """O1 has one burger and a block: both burgers cannot be packed."""
    condition = condition_of("fast_food", "O1").with_(instruction=condition_of("fast_food", "T2").instruction)
    s = build_scene(condition)
    with pytest.raises(PremiseError, match="names 'burger', but the scene has 1 of 2"):
        s.reset()
    s.reset(check_premise=False)


def test_a_moved_fixture_stops_the_run(monkeypatch):
    ordinary = builder.slot_pose

    def shifted(task, seed, slot):
        (x, y, z), yaw = ordinary(task, seed, slot)
        return ((x + 0.06, y, z), yaw) if slot == "near" else ((x, y, z), yaw)

    monkeypatch.setattr(builder, "slot_pose", shifted)
    with pytest.raises(PremiseError, match="does not stand in its slot 'near'"):
        build_scene(condition_of("morning_coffee", "train1")).reset()


# ------------------------------------------------------------------------------------------------------------ clearance


def everything(s: Scene) -> tuple[bytes, ...]:
    size = mujoco.mj_stateSize(s.model, mujoco.mjtState.mjSTATE_INTEGRATION)
    full = np.empty(size)
    mujoco.mj_getState(s.model, s.data, full, mujoco.mjtState.mjSTATE_INTEGRATION)
    buffer = np.zeros(mujoco.mj_sizeModel(s.model), dtype=np.uint8)
    mujoco.mj_saveModel(s.model, None, buffer)
    return full.tobytes(), buffer.tobytes(), s.data.contact.geom.tobytes(), s.data.xpos.tobytes()


@pytest.mark.parametrize(
    ("where", "thing", "beside", "height", "angle"),
    [
        ("morning_coffee/T1", "blue_mug", -0.067, 0.064, 1.974),
        ("morning_coffee/T1", "blue_mug", -0.0665, 0.067, 1.974),
        ("morning_coffee/T1", "blue_mug", 0.063, 0.094, 2.479),
        ("fruit_lunch/O1", "red_block", 0.062, 0.055, 0.8),
        ("fruit_lunch/O1", "red_block", 0.064, 0.05, 0.8),
    ],
)
def test_where_nothing_may_be_touched_no_graze_between_two_readings_is_missed(where, thing, beside, height, angle):
    """An open gripper sweeps past a mug or a block so fast that it touches it between two control steps only."""
    s = build_scene(condition_of(*where.split("/")))
    state = s.reset()
    tracker = GoalTracker(s.condition, s.info, template=s.task.template, control_rate_hz=s.control_rate_hz)
    tracker.update(state)
    i = s.info.index(thing)
    place, ahead = np.array([*state.positions[i][:2], 0.0]), np.array([math.cos(angle), math.sin(angle), 0.0])
    aside = beside * np.array([-ahead[1], ahead[0], 0.0])
    up, down = np.array([0.0, 0.0, 0.4]), np.array([0.0, 0.0, height])
    before, behind = place - 0.22 * ahead + aside, place + 0.22 * ahead + aside
    stations = [before + up, before + down, behind + down, behind + down + up, np.array(s.info.home_position)]
    broken, touched, k = [], [], 0
    for step in range(min(s.step_limit, 30 * len(stations))):
        action = STILL.copy()
        if k < len(stations):
            way = stations[k] - np.array(state.ee_pose.position)
            far = float(np.linalg.norm(way))
            action[:3] = way / max(far, 0.05)
            k += far < 0.02 or step > 25 * (k + 1)
        s.step(action)
        state = s.state()
        assert state == s.state()
        broken.append(tracker.update(state).forbidden)
        touched.append(state.touched_by_gripper(thing))
    assert distance(state.positions[i], s.reset().positions[i]) > 0.01, "the sweep has to move the thing"
    assert any(touched)
    assert broken.index(True) == touched.index(True)
    assert not tracker.update(state).success


def test_clearance_never_touches_the_scene():
    s = scene("fast_food", "train1")
    state = s.reset()
    before = everything(s)
    clearance = Clearance(s)
    clearance.load(state)
    draw = np.random.default_rng(2)
    for joints in draw.uniform(-2.5, 2.5, (20, 7)):
        clearance.touches(joints, finger_width_m=0.05, held="fries", held_pose=Pose((0.5, 0.0, 0.3)))
    assert everything(s) == before
    assert s.state() == state


def test_clearance_sees_what_is_in_the_way_and_what_is_ignored():
    s = scene("morning_coffee", "train1")
    state = s.reset()
    clearance = Clearance(s)
    clearance.load(state)
    home = np.array(state.joint_positions)
    assert clearance.touches(home, finger_width_m=0.08) == ()
    # A mug between the open fingers of the hand at home, and one through the hand.
    x, y, z = state.ee_pose.position
    in_hand = dataclasses.replace(
        state,
        positions=tuple(
            (x, y, z + 0.05) if o.name == "red_mug" else p
            for o, p in zip(state.info.objects, state.positions, strict=True)
        ),
    )
    clearance.load(in_hand)
    hits = clearance.touches(home, finger_width_m=0.08)
    assert hits
    assert all("red_mug" in h.split("-") for h in hits)
    assert clearance.touches(home, finger_width_m=0.08, ignore=frozenset({"red_mug"})) == ()
    clearance.load(state)
    assert clearance.touches(home, finger_width_m=0.08) == ()


def test_clearance_notices_a_held_object_that_runs_into_another():
    s = scene("fast_food", "train1")
    state = s.reset()
    clearance = Clearance(s)
    clearance.load(state)
    home = np.array(state.joint_positions)
    onto = state.pose("drink")
    hits = clearance.touches(home, finger_width_m=0.08, held="fries", held_pose=onto)
    assert any("drink" in h and "fries" in h for h in hits)
    free = Pose((0.5, 0.0, 0.5))
    assert not any("drink" in h for h in clearance.touches(home, finger_width_m=0.08, held="fries", held_pose=free))


def test_contacts_that_clearance_does_not_look_for_change_no_answer(monkeypatch):
    s = scene("fast_food", "train1")
    state, rng = s.reset(), np.random.default_rng(0)
    quick, full = Clearance(s), Clearance(s)
    for name in ("geom_contype", "geom_conaffinity", "body_contype", "body_conaffinity"):
        getattr(full._model, name)[:] = getattr(s.model, name)
    monkeypatch.setattr(full, "_let_look", lambda *_, **__: None)
    quick.load(state)
    full.load(state)
    found = set()
    for number in range(120):
        joints = np.array(state.joint_positions) + rng.uniform(-0.9, 0.9, 7)
        held = (None, "burger_1", "drink")[number % 3]
        pose = Pose((rng.uniform(0.3, 0.7), rng.uniform(-0.3, 0.3), rng.uniform(-0.01, 0.1)))
        asked = {"finger_width_m": rng.uniform(0.0, 0.08), "held": held, "held_pose": pose if held else None}
        answer = quick.touches(joints, **asked)
        assert answer == full.touches(joints, **asked)
        found.update(answer)
    assert len(found) > 5
