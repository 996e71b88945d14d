"""Where LIBERO's expert takes a thing that is too wide for its fingers: at its rim, where the hand has room."""

import pytest

from betterbench.experts.libero import grasp_of
from betterbench.geometry import Pose, from_yaw
from betterbench.state import ObjectInfo, SceneInfo, WorldState

BOWL = ("akita_black_bowl_1", (0.112, 0.111, 0.053), False)
COOKIES = ("cookies_1", (0.062, 0.084, 0.020), False)
CABINET = ("wooden_cabinet_1", (0.256, 0.222, 0.218), True)


def scene(things, yaws=()):
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
        (),
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
