"""What the cameras show of each task: the limits hold for all conditions, seeds and jitters."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from tests.daily import TODAY, others_slow, part_of_today

from betterbench.interface.actions import EE_DELTA
from betterbench.interface.state import CameraOffset, ViewJitter
from betterbench.sim.assets import looks, unseen_looks
from betterbench.sim.scenes import Renderer, Scene
from betterbench.sim.scenes.appearance import look_of
from betterbench.sim.scenes.cameras import camera_matrices
from betterbench.sim.scenes.framing import (
    BACKGROUND,
    GRIPPER_PX,
    MARGIN_M,
    SIDE_PX,
    VISIBLE,
    FramingView,
    extreme_jitters,
    least_margin_m,
)
from betterbench.sim.scenes.stage import quality_preset
from betterbench.tasks import Condition, Looks, Task, get_task, suite_tasks
from betterbench.tasks.interventions import resolve_condition, vary
from betterbench.tasks.interventions.balanced import balanced_conditions, slots_aside

pytestmark = [pytest.mark.physics, pytest.mark.render]

EXTREME = tuple(extreme_jitters())


def scene_at(task: Task, condition: Condition, seed: int, looks: Looks = "seen") -> Scene:
    return Scene(task, condition, seed=seed, action_space=EE_DELTA, quality=quality_preset("fast"), looks=looks)


def conditions_of(task: Task) -> tuple[Condition, ...]:
    return (*task.training, *(vary(task, v)[0] for v in task.variations))


def scenes(task: Task, seed: int):
    for condition in conditions_of(task):
        yield scene_at(task, condition, seed)


def faults(scene: Scene, jitters) -> list[str]:
    """What an image of the scene's start shows worse than the limits allow, at any of the jitters."""
    found, name = [], f"{scene.condition.id} seed {scene.seed}"
    view = FramingView(scene)
    for jitter in jitters:
        framing = view.start(jitter)
        if framing.gripper_px < GRIPPER_PX:
            found.append(f"{name}: {framing.gripper_px} px of the gripper")
        if framing.background > BACKGROUND:
            found.append(f"{name}: {framing.background:.2f} background")
        for asked in framing.asked:
            if asked.side_px < SIDE_PX or asked.visible < VISIBLE:
                found.append(f"{name}: {asked.name} {asked.side_px:.0f} px, {asked.visible:.2f} visible")
    view.close()
    margin = least_margin_m(scene)
    return [*found, *([f"{name}: margin {1e3 * margin:.0f} mm"] if margin < MARGIN_M else [])]


SEEDS = 40
"""Seeds over which nearly every look and every room is met many times."""


@pytest.mark.parametrize("task_id", part_of_today(suite_tasks("better60"), 9))
def test_every_condition_is_framed_as_promised(task_id):
    """Each condition at one of the seeds, another one each day; the slow test has all of them."""
    found, task = [], get_task(task_id)
    for number, condition in enumerate(conditions_of(task)):
        found += faults(scene_at(task, condition, (TODAY + 7 * number) % SEEDS), (None,))
    assert not found, "\n".join(found)


@pytest.mark.slow
@pytest.mark.parametrize("task_id", suite_tasks("better60"))
def test_every_condition_is_framed_as_promised_at_every_seed(task_id):
    found = [f for seed in range(SEEDS) for s in scenes(get_task(task_id), seed) for f in faults(s, (None,))]
    assert not found, "\n".join(found)


def targets_of(task: Task) -> list[tuple[Condition, int, Looks]]:
    """One trial for each look of a target, each of its slots and each target region: condition, seed and looks."""
    category, found = task.training[0].object(task.training[0].instruction.subgoals[-1].target).category, {}
    met: dict[str, set[int]] = {"seen": set(), "unseen": set()}
    drawn: dict[tuple[str, str, int, str], int] = {}
    for shown, seed, condition in itertools.product(("seen", "unseen"), range(2 * SEEDS), conditions_of(task)):
        for goal in condition.instruction.subgoals:
            target = condition.object(goal.target)
            trial_of = (target.category, target.color, seed, shown)
            if trial_of not in drawn:
                drawn[trial_of] = look_of(task.id, seed, target, shown=shown)
            look = drawn[trial_of]
            met[shown] |= {look} if target.category == category else set()
            found.setdefault(
                (target.category, look, target.color, condition.layout.get(goal.target), goal.region),
                (condition, seed, shown),
            )
    assert met == {"seen": {*looks(category)}, "unseen": {*unseen_looks(category)}}
    return [*found.values()]


def short_margins(task: Task, trials) -> str:
    """The trials in which a slot or a target is nearer to the edge of the image than the limit."""
    found = ((trial, least_margin_m(scene_at(task, *trial))) for trial in trials)
    return "\n".join(f"{c.id} seed {seed}: {1e3 * m:.1f} mm" for (c, seed, _), m in found if m < MARGIN_M)


@pytest.mark.parametrize("task_id", part_of_today(suite_tasks("better60"), 5))
def test_a_target_of_any_look_is_in_the_picture_wherever_it_may_stand(task_id):
    """Margins count the ends of the jitters of slot and camera at once, so one trial of each look is enough.

    Every twelfth look and place is checked, others each day; the slow test has all of them.
    """
    task = get_task(task_id)
    assert not short_margins(task, part_of_today(targets_of(task), 12))


@pytest.mark.slow
@pytest.mark.parametrize("task_id", suite_tasks("better60"))
def test_every_target_is_in_the_picture_wherever_it_may_stand(task_id):
    task = get_task(task_id)
    assert not short_margins(task, targets_of(task))


def test_a_target_that_an_earlier_step_moves_is_not_measured_where_it_starts():
    """In T1 of dinner_plates, the red plate is put on another plate before it becomes a target."""
    task = get_task("dinner_plates")
    first, then = resolve_condition("dinner_plates", "T1").condition, task.training[0]
    assert [goal.target for goal in first.instruction.subgoals] == ["white_plate", "red_plate"]
    assert least_margin_m(scene_at(task, first, 0)) == least_margin_m(scene_at(task, then, 0))


def test_what_the_edge_of_the_image_cuts_off_is_not_visible():
    task = get_task("tidy_desk")
    view = FramingView(scene_at(task, task.train("train1"), 0))
    turned = [ViewJitter({"front": CameraOffset((0.0, 0.0, 0.0), (up, 0.0, 0.0))}) for up in np.linspace(0.1, 0.2, 11)]
    shares = [{asked.name: asked.visible for asked in view.start(jitter).asked}["crushed_can"] for jitter in turned]
    view.close()
    assert shares[0] == 1.0
    assert shares[-1] == 0.0
    assert all(before >= after for before, after in itertools.pairwise(shares))
    assert any(0.2 < share < 0.8 for share in shares)


@pytest.mark.parametrize("task_id", [name for name in suite_tasks("better60") if slots_aside(name)])
def test_what_stands_aside_is_in_the_picture(task_id):
    aside = {slot.name for slot in slots_aside(task_id)}
    shown = [c for c in balanced_conditions(task_id) if aside & set(c.layout.values())]
    found = resolve_condition(task_id, shown[0].name)
    assert not faults(Scene(found.task, found.condition, seed=0, action_space=EE_DELTA), (None,))


@pytest.mark.slow
@pytest.mark.parametrize("task_id", suite_tasks("better60"))
def test_every_condition_is_framed_at_the_ends_of_the_jitter(task_id):
    found = []
    for number, seed in enumerate((1, 2, 3)):
        for s in scenes(get_task(task_id), seed):
            found += faults(s, (None, *EXTREME[number::21]))
    assert not found, "\n".join(found)


@pytest.mark.parametrize("task_id", others_slow(suite_tasks("better60"), 5))
def test_the_gripper_is_seen_over_every_slot(task_id):
    task = get_task(task_id)
    s = next(scenes(task, 0))
    view = FramingView(s)
    for slot, jitter in itertools.product(task.slots, EXTREME[::21]):
        assert view.gripper_over(slot.name, jitter) >= GRIPPER_PX, slot.name
    view.close()


@pytest.mark.parametrize("task_id", ["fast_food", "morning_coffee"])
def test_the_wrist_camera_sees_both_fingertips_and_the_table_under_them(task_id):
    s = next(scenes(get_task(task_id), 0))
    with Renderer(s.model, width=256, height=256, quality=s.quality) as renderer:
        masks = renderer.render(s.data, "wrist", rgb=False, masks=True).masks
    fingers = [s.model.body("robot/" + name).id for name in s.compiled.robot.finger_bodies]
    assert all((masks == finger).sum() > 300 for finger in fingers)
    x, y, _ = s.state().ee_pose.position
    pixels, _ = camera_matrices(s.model, s.data, "wrist").project(np.array([[x, y, 0.0]]))
    assert np.all((pixels > 20) & (pixels < 236)), "what lies under the fingers"
    arm = [b for b in range(s.model.nbody) if s.model.body(b).name.startswith("robot/") and b not in fingers]
    assert np.isin(masks, arm).mean() < 0.15, "the robot itself fills little of the image"
