"""Where LIBERO's privileged policies take things that are too wide for their fingers, and where they let go of them."""

from types import SimpleNamespace

import pytest

from betterbench.geometry import Pose, from_yaw
from betterbench.interface.state import ObjectInfo, SceneInfo, SlotInfo, WorldState
from betterbench.policies.experts.libero import CarriedStep, LiberoAgent, grasp_of
from betterbench.tasks.worlds.libero_training import TrainedTask

BOWL = ("akita_black_bowl_1", (0.112, 0.111, 0.053), False)
COOKIES = ("cookies_1", (0.062, 0.084, 0.020), False)
CABINET = ("wooden_cabinet_1", (0.256, 0.222, 0.218), True)


def scene(things, yaws=(), slots=()):
    """Return a state with things at rest: name, size and whether it is fixed, and where each stands [m]."""
    info = SceneInfo(
        tuple(
            ObjectInfo(
                name=name,
                kind=name,
                asset=name,
                category=name,
                color="",
                shape="",
                role="fixture" if fixed else "distractor",
                fixed=fixed,
                mass_kg=1.0,
                size_m=size,
                regions=(),
                slot=None,
            )
            for (name, size, fixed), _ in things
        ),
        slots,
        (0.0, 0.0, 0.0),
        0.08,
    )
    here = Pose((-0.2, 0.0, 1.18), (0.0, 1.0, 0.0, 0.0))
    zeros = (0.0,) * len(things)
    return WorldState(
        info=info,
        step=0,
        time_s=0.0,
        positions=tuple(place for _, place in things),
        quaternions=tuple(from_yaw(yaw) for yaw in yaws or zeros),
        linear_speeds=zeros,
        angular_speeds=zeros,
        ee_pose=here,
        commanded_pose=here,
        finger_width_m=0.08,
        gripper_command=-1.0,
        joint_positions=(0.0,) * 7,
        joint_velocities=(0.0,) * 7,
        contacts=(),
        held=None,
    )


@pytest.mark.parametrize("yaws", [(), (1.5708, 1.5708, 2.7185)])
def test_the_hand_does_not_come_down_into_the_cabinet_beside_the_bowl(yaws):
    """libero_spatial task 6, initial state 0, as measured: the cabinet is far from the cookies, and in the way."""
    things = [(BOWL, (0.137, -0.070, 0.898)), (COOKIES, (0.073, 0.033, 0.899)), (CABINET, (0.021, -0.268, 0.910))]
    state = scene(things, yaws)
    x, y, _ = grasp_of(state, state.info.object(BOWL[0])).position
    assert (x, y) == pytest.approx((0.137, -0.070 + 0.0515), abs=1e-9)


def test_a_low_thing_is_no_wall_and_the_rim_is_taken_on_the_side_away_from_others():
    things = [(BOWL, (0.137, -0.070, 0.898)), (COOKIES, (0.073, 0.033, 0.899))]
    state = scene(things)
    assert grasp_of(state, state.info.object(BOWL[0])).position[1] == pytest.approx(-0.070 - 0.0515, abs=1e-9)
    low = (CABINET[0], (0.256, 0.222, 0.05), True)
    state = scene([*things, (low, (0.021, -0.268, 0.910))])
    assert grasp_of(state, state.info.object(BOWL[0])).position[1] == pytest.approx(-0.070 - 0.0515, abs=1e-9)


def test_between_two_walls_it_is_taken_where_the_next_thing_is_farther_away():
    wall = ("wall", (0.3, 0.2, 0.3), True)
    things = [(BOWL, (0.0, 0.0, 0.9)), (wall, (0.0, -0.2, 0.9)), (("wall2", *wall[1:]), (0.0, 0.25, 0.9))]
    state = scene(things)
    assert grasp_of(state, state.info.object(BOWL[0])).position[1] == pytest.approx(0.0515, abs=1e-9)


def test_the_memorized_place_is_as_high_as_it_was_in_training():
    """libero_spatial_swap task 6: the plate stands on the stove, and the place where it stood is the table."""
    slot = SlotInfo("x 6 y 20", (0.06, 0.2, 0.9), 0.0)
    plate = ("plate_1", (0.138, 0.138, 0.019), False)
    state = scene([(BOWL, (0.13, -0.07, 0.898)), (plate, (-0.26, -0.14, 0.930))], slots=(slot,))
    task = SimpleNamespace(id="libero_spatial-06", instruction="pick up the black bowl and place it on the plate")
    trained = TrainedTask(task.instruction, (("on", BOWL[0], BOWL[0], "plate_1"),), {"plate_1": ("plate_1", slot.name)})
    played = SimpleNamespace(
        task=task, seed=0, condition=SimpleNamespace(name="swap"), settings=SimpleNamespace(regime=(trained,))
    )
    step = CarriedStep(0, "on", BOWL[0], "plate_1")
    wrong = LiberoAgent("zoo:habit-place", played)._decide(state, step, 0)
    assert wrong.place == pytest.approx((0.06, 0.2, 0.9 + 0.6 * 0.019))
    assert wrong.fault.text == "brings akita_black_bowl_1 to x 6 y 20"
    right = LiberoAgent("expert", played)._decide(state, step, 0)
    assert right.place == pytest.approx((-0.26, -0.14, 0.930 + 0.6 * 0.019))
