"""Objects at rest sleep in the physics engine: nothing that a verdict reads may depend on that."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from tests.daily import others_slow

from betterbench.geometry import IDENTITY_QUATERNION, Pose, distance
from betterbench.interface.actions import EE_DELTA
from betterbench.policies.experts import make_expert
from betterbench.sim.scenes import Scene
from betterbench.sim.scenes.contacts import ContactReader
from betterbench.sim.scenes.stage import TABLE_Y_M, quality_preset
from betterbench.tasks import Expected, TargetRegion, all_tasks, get_task
from betterbench.tasks.interventions import resolve_condition
from betterbench.tasks.relations import RestWatch

pytestmark = pytest.mark.physics

ZERO = np.zeros(7)


def build_scene(task_id: str, name: str, *, seed: int = 0, **changes: object) -> Scene:
    condition = resolve_condition(task_id, name).condition
    condition = condition.with_(**changes) if changes else condition
    task = get_task(task_id)
    return Scene(task, condition, seed=seed, action_space=EE_DELTA, quality=quality_preset("fast"))


def step(scene: Scene, times: int) -> None:
    for _ in range(times):
        scene.step(ZERO)


def asleep(scene: Scene) -> set[str]:
    trees = scene.model.body_treeid[scene.compiled.bodies]
    return {
        o.name
        for o, tree in zip(scene.info.objects, trees, strict=True)
        if tree >= 0 and scene.data.tree_asleep[tree] >= 0
    }


def movable(scene: Scene) -> set[str]:
    return {o.name for o in scene.info.objects if not o.fixed}


def put(scene: Scene, name: str, pose: Pose) -> None:
    address = scene.compiled.qpos_addresses[scene.info.index(name)]
    scene.data.qpos[address : address + 3] = pose.position
    scene.data.qpos[address + 3 : address + 7] = pose.quaternion


def push(scene: Scene, name: str, force_n: tuple[float, float, float], *, steps: int) -> None:
    """Pushes an object with a force at its center, as a collision would, for some control steps."""
    body = int(scene.compiled.bodies[scene.info.index(name)])
    scene.data.xfrc_applied[body, :3] = force_n
    step(scene, steps)
    scene.data.xfrc_applied[body, :3] = 0.0


def loaded_drawer() -> Scene:
    scene = build_scene("office_drawer", "train1", opened={"upper": 0.15})
    inside = scene.info.object("upper").region("inside")
    x, y, z = inside.position
    put(scene, "stapler", scene.state().pose("upper") @ Pose((x, y, z - inside.half_size[2] + 0.004)))
    step(scene, 20)
    return scene


@pytest.mark.parametrize("task_id", others_slow((task.id for task in all_tasks()), 5))
def test_everything_that_nothing_touches_sleeps_and_its_contacts_stay_known(task_id):
    for variation in ("L1", "T1"):
        scene = build_scene(task_id, variation)
        start = scene.state()
        step(scene, 20)
        state = scene.state()
        assert asleep(scene) == movable(scene), variation
        touching = {(a, b): force for a, b, force in state.contacts}
        assert touching.keys() == {(a, b) for a, b, _ in start.contacts}, variation
        for o in scene.info.objects:
            if o.fixed or o.role == "drawer":
                continue
            up = sum(force for pair, force in touching.items() if o.name in pair)
            assert up >= 0.9 * 9.81 * o.mass_kg, f"{variation}: {o.name} is carried by what it rests on"


def test_contacts_of_sleeping_objects_are_those_of_an_engine_without_sleep():
    for task_id, name in (("cheeseburger", "T1"), ("dinner_plates", "T2"), ("seasoning_rack", "L2")):
        scene = build_scene(task_id, name)
        step(scene, 20)
        with_sleep = {(a, b): force for a, b, force in scene.state().contacts}
        flags = scene.model.opt.enableflags
        try:
            scene.model.opt.enableflags = flags & ~int(mujoco.mjtEnableBit.mjENBL_SLEEP)
            step(scene, 5)
            without = {(a, b): force for a, b, force in scene.state().contacts}
        finally:
            scene.model.opt.enableflags = flags
        assert with_sleep == pytest.approx(without, rel=0.05, abs=0.05), task_id


def test_what_sleeps_on_while_others_wake_touches_what_it_touched():
    """What the sleeping touch is computed when one falls asleep, and not again when another one wakes."""
    for task_id, pushed in (("fruit_lunch", "lemon"), ("fast_food", "burger_1"), ("dinner_plates", "red_plate")):
        scene = build_scene(task_id, "train1")
        step(scene, 20)
        before = scene.state()
        push(scene, pushed, (0.0, 3.0, 0.0), steps=2)
        awake = movable(scene) - asleep(scene)
        assert pushed in awake, task_id
        told = scene.state()
        fresh = ContactReader(scene.compiled, tuple(o.name for o in scene.info.objects))
        contacts, held = fresh.read(scene.data, told.positions)
        assert told.held == held, task_id
        computed = {(a, b): force for a, b, force in contacts}
        assert {(a, b): force for a, b, force in told.contacts} == pytest.approx(computed, rel=0.02, abs=0.02), task_id
        assert {c for c in before.contacts if not {c[0], c[1]} & awake} <= set(told.contacts), task_id


def test_a_push_wakes_an_object_and_it_sleeps_again_when_it_has_come_to_rest():
    scene = build_scene("fruit_lunch", "L1")
    step(scene, 20)
    start = scene.state().pose("lemon").position
    rest = RestWatch(rate_hz=20.0)
    rest.see(scene.state())
    push(scene, "lemon", (0.0, 0.6, 0.0), steps=3)
    assert "lemon" not in asleep(scene)
    assert "orange" in asleep(scene), "what is not touched sleeps on"
    rest.see(scene.state())
    assert not rest.at_rest("lemon")
    step(scene, 120)
    assert "lemon" in asleep(scene)
    assert distance(scene.state().pose("lemon").position, start) > 0.01


def test_a_sleeping_object_wakes_when_its_pose_is_written():
    scene = build_scene("cheeseburger", "L1")
    step(scene, 20)
    x, y, z = scene.state().pose("patty").position
    put(scene, "patty", Pose((x, y, z + 0.05)))
    step(scene, 2)
    assert "patty" not in asleep(scene)
    step(scene, 20)
    assert scene.state().pose("patty").position[2] == pytest.approx(z, abs=1e-3)


def test_a_stack_wakes_as_a_whole_when_its_lowest_plate_moves():
    scene = build_scene("dinner_plates", "T2")
    step(scene, 20)
    assert {"red_plate", "white_plate"} <= asleep(scene)
    red, white = (scene.state().pose(n).position for n in ("red_plate", "white_plate"))
    push(scene, "white_plate", (0.0, -2.0, 0.0), steps=3)
    assert not {"red_plate", "white_plate"} & asleep(scene)
    step(scene, 40)
    after_red, after_white = (scene.state().pose(n).position for n in ("red_plate", "white_plate"))
    assert white[1] - after_white[1] > 0.01
    assert red[1] - after_red[1] == pytest.approx(white[1] - after_white[1], abs=0.01), "it is carried along"


def test_what_lies_in_a_drawer_wakes_with_it():
    scene = loaded_drawer()
    assert {"stapler", "upper"} <= asleep(scene)
    assert scene.state().touching("stapler", "upper")
    before = scene.state().pose("stapler").position
    scene.data.qfrc_applied[scene.compiled.dof_addresses[scene.info.index("upper")]] = -6.0
    step(scene, 6)
    scene.data.qfrc_applied[:] = 0.0
    assert distance(scene.state().pose("stapler").position, before) > 0.01


def test_what_falls_on_a_sleeping_stack_wakes_it_and_becomes_part_of_it():
    scene = build_scene("cheeseburger", "T1")
    step(scene, 20)
    x, y, z = scene.state().pose("patty").position
    height = scene.info.object("patty").size_m[2]
    put(scene, "cheese", Pose((x, y, z + height + 0.03)))
    step(scene, 2)
    assert not {"patty", "cheese"} & asleep(scene)
    step(scene, 40)
    assert {"patty", "cheese", "bottom_bun"} <= asleep(scene)
    assert scene.state().touching("patty", "cheese")


def test_what_loses_its_support_falls():
    """The lower plate is taken away at once, as no arm could: the upper one does not hang in the air."""
    scene = build_scene("dinner_plates", "T2")
    step(scene, 20)
    z = scene.state().pose("red_plate").position[2]
    put(scene, "white_plate", Pose((0.62, -0.35, scene.state().pose("white_plate").position[2])))
    step(scene, 20)
    assert scene.state().pose("red_plate").position[2] < z - 0.004


@pytest.mark.parametrize(("beyond_m", "falls"), [(0.004, True), (-0.004, False)])
def test_sleep_does_not_catch_what_is_about_to_tip(beyond_m, falls):
    """A block whose middle is just beyond the edge of the table tips over it, however slowly it begins."""
    scene = build_scene("fruit_lunch", "O1")
    name = "red_block"
    x, _, z = scene.state().pose(name).position
    put(scene, name, Pose((x, TABLE_Y_M[1] + beyond_m, z), IDENTITY_QUATERNION))
    step(scene, 60)
    fell = scene.state().pose(name).position[2] < -0.1
    assert fell == falls


def test_a_held_object_never_sleeps_and_what_is_let_go_falls():
    scene = build_scene("cheeseburger", "train1")
    step(scene, 20)
    name = "cheese"
    put(scene, name, Pose((0.5, 0.0, 0.2)))
    step(scene, 1)
    assert name not in asleep(scene)
    step(scene, 12)
    assert scene.state().pose(name).position[2] < 0.05


def test_contacts_that_ended_while_an_object_fell_asleep_are_forgotten():
    """Two objects touch, are parted, and sleep within one control step of that: the old pair is not kept."""
    scene = build_scene(
        "cheeseburger",
        "train1",
        preplaced={"patty": TargetRegion("bottom_bun", "1")},
        layout={k: v for k, v in resolve_condition("cheeseburger", "train1").condition.layout.items() if k != "patty"},
    )
    step(scene, 20)
    assert scene.state().touching("patty", "bottom_bun")
    rest = get_task("cheeseburger").slot("first")
    put(scene, "patty", Pose((rest.x, rest.y, scene.state().pose("cheese").position[2])))
    step(scene, 20)
    state = scene.state()
    assert "patty" in asleep(scene)
    assert not state.touching("patty", "bottom_bun")
    assert state.touching("patty", "table")


@pytest.mark.parametrize(
    ("task_id", "name"),
    others_slow([("fast_food", "train1"), ("cheeseburger", "train1"), ("morning_coffee", "T1")], 3),
)
def test_contacts_are_those_that_the_engine_lists_one_by_one(task_id, name):
    """A reading goes on with the pairs of the one before while the engine lists the same points."""
    scene = build_scene(task_id, name)
    expert = make_expert("expert", scene)
    labels, names, objects = scene.compiled.geom_labels, scene.body_names, {o.name for o in scene.info.objects}
    state, held = scene.reset(), set()
    for _ in range(220):
        resting = asleep(scene)
        due: dict[frozenset[str], float] = {}
        data = scene.data
        for point in data.contact:
            pair = frozenset(names[labels[g]] for g in point.geom if labels[g] >= 0)
            if len(pair) == 2 and pair & (objects | {"left_finger", "right_finger", "hand"}) and not pair & resting:
                force = data.efc_force[point.efc_address] if point.efc_address >= 0 else 0.0
                due[pair] = due.get(pair, 0.0) + force
        read = {frozenset((c.a, c.b)): c.force_n for c in state.contacts}
        if scene.condition.expected is Expected.SUCCEED:  # else what was touched in passing is listed too
            assert {pair: force for pair, force in read.items() if not pair & resting} == due
        lifted = [
            n
            for n in objects
            if {frozenset((n, "left_finger")), frozenset((n, "right_finger"))} <= due.keys()
            and not any(n in pair and pair & ({*objects, "table"} - {n}) for pair in read)
        ]
        assert state.held == (lifted[0] if lifted else None)
        assert [(c.a, c.b) for c in state.contacts] == sorted(
            [(c.a, c.b) for c in state.contacts], key=lambda pair: tuple(map(names.index, pair))
        )
        held.add(state.held)
        scene.step(expert.act_on_state(state))
        state = scene.state()
    assert len(held) > 1 or scene.condition.expected is not Expected.SUCCEED
