"""Checkpoints trained on LIBERO: units as measured, the origin of each suite, and LIBERO's own tool point."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from tests.looping import each

from betterbench.errors import InvalidInputError
from betterbench.interface import Execution, Observation
from betterbench.policies.clients.remote import describe_remote_policy
from betterbench.policies.conventions.adapter import Adapter, InstructionRule
from betterbench.policies.conventions.answers import AnswerPart, AnswerRule
from betterbench.policies.conventions.presets import PRESETS, adapter_of
from betterbench.policies.kinds import read_address

SIGNED = ("openpi_libero", "vla_eval_libero")
"""Layouts whose checkpoints close the gripper with a positive number; those of the others count open as 1."""

LAYOUTS = (
    *(*SIGNED, "being_h_libero", "gr00t_libero_panda", "starvla_libero", "starvla_state_libero", "openvla_libero"),
    "openvla_oft_libero",
)
BASES = {
    "spatial": (-0.66, 0.0, 0.912),
    "object": (-0.6, 0.0, 0.0),
    "goal": (-0.66, 0.0, 0.912),
    "10": (-0.66, 0.0, 0.912),
    "90": (-0.66, 0.0, 0.912),
    "study": (-0.75, 0.0, 0.912),
    "living_room": (-0.51, 0.0, 0.42),
}


def seen(tool=(0.0, 1.0, 0.0, 0.0)):
    return Observation(
        instruction="pack the apple",
        step=0,
        images={n: np.arange(256 * 256 * 3, dtype=np.uint32).reshape(256, 256, 3).astype(np.uint8) for n in ("front",)}
        | {"wrist": np.zeros((256, 256, 3), np.uint8)},
        joint_positions=np.zeros(7),
        joint_velocities=np.zeros(7),
        ee_position=np.array([0.4, 0.1, 0.3]),
        ee_quaternion=np.array(tool),
        gripper_width=0.06,
        depth={},
        masks={},
    )


def position(adapter, observation):
    rules = [r for r in adapter.states if r.parts[0] in ("ee_position", "ee_x", "ee_y", "ee_z")]
    return np.concatenate([np.asarray(adapter.state(rule, observation))[:3] for rule in rules])


@each("layout", LAYOUTS)
@each("suite", BASES)
def test_every_suite_has_a_preset_that_needs_nothing_else(layout, suite):
    preset = PRESETS[f"{layout}_{suite}"]
    answer = preset.answer
    assert (answer.translation_unit_m, answer.rotation_unit_rad) == (0.0125, 0.1)
    assert all(view.mirror and not view.turn for view in preset.views)
    # The tool points down, so LIBERO's point, 6.4 mm nearer to the hand, is above ours.
    expected = np.array([0.4, 0.1, 0.3 + 0.0064]) + BASES[suite]
    if preset.states:
        np.testing.assert_allclose(position(preset, seen()), expected, atol=1e-6)
    assert answer.gripper == ("close_positive" if layout in SIGNED else "open_fraction")
    assert Adapter.from_json(preset.to_json()) == preset


def test_a_unit_is_what_libero_really_moves():
    own = np.array([[1.0, 0.0, -0.4, 0.0, 0.5, 1.0, 1.0]])
    reply = {"actions": own}
    measured = adapter_of(read_address("openpi://h?preset=openpi_libero&units=libero_measured"))
    whole = PRESETS["openpi_libero"].actions(reply, seen())
    np.testing.assert_allclose(measured.actions(reply, seen())[0, :3], whole[0, :3] / 4.0)
    np.testing.assert_allclose(measured.actions(reply, seen())[0, 3:6], whole[0, 3:6] / 5.0)
    left = adapter_of(read_address("openpi://h?preset=openpi_libero_object&units=libero"))
    np.testing.assert_array_equal(left.actions(reply, seen()), whole)


@pytest.mark.parametrize("name", ["openpi_libero", "being_h_libero", "vla_eval"])
def test_policies_fine_tuned_on_our_demonstrations_are_unaffected(name):
    preset = PRESETS[name]
    assert (preset.answer.translation_unit_m, preset.answer.rotation_unit_rad) == (0.05, 0.5)
    np.testing.assert_allclose(position(preset, seen()), [0.4, 0.1, 0.3], atol=1e-6)
    assert not any(view.mirror for view in preset.views)


def test_the_tool_point_follows_the_tool():
    tilted = Rotation.from_euler("xyz", [np.pi, np.pi / 2, 0.0])
    z_axis = tilted.apply([0.0, 0.0, 1.0])
    observation = seen(tilted.as_quat(canonical=True, scalar_first=True))
    preset = replace(PRESETS["openpi_libero_spatial"], ee_offset_m=(0.0, 0.0, 0.0))
    np.testing.assert_allclose(position(preset, observation), [0.4, 0.1, 0.3] - 0.0064 * z_axis, atol=1e-6)


def test_an_absolute_pose_is_one_of_the_policys_own_tool_point():
    parts = tuple(AnswerPart(("actions",), kind) for kind in ("translation", "rotation", "gripper"))
    rule = AnswerRule("ee_pose", parts, rotation="quaternion_wxyz")
    mine = Adapter(
        "mine", (), (), InstructionRule(("prompt",)), rule, ee_offset_m=(1.0, 2.0, 3.0), tool_offset_m=(0.0, 0.0, -0.01)
    )
    reply = {"actions": np.array([[1.4, 2.1, 3.31, 0.0, 1.0, 0.0, 0.0, 1.0]])}
    actions = mine.actions(reply, seen())
    np.testing.assert_allclose(actions[0, :3], [0.4, 0.1, 0.3])
    np.testing.assert_allclose(mine.reply(actions, seen())["actions"], reply["actions"])


def executed(query):
    address = read_address(f"openpi://h?{query}")
    return describe_remote_policy(address, adapter_of(address), {}).execution


@each(
    "query, expected",
    [
        ("preset=openpi_libero", Execution(horizon=5)),
        ("preset=openpi_libero_goal", Execution(horizon=5)),
        ("preset=openpi_droid", Execution(horizon=8)),
        ("preset=being_h_libero", Execution(horizon=8)),
        ("preset=vla_eval", Execution()),
        ("preset=openpi_libero&horizon=10", Execution(horizon=10)),
        ("preset=openpi_libero&ahead=2", Execution(horizon=5, ahead=2)),
        ("preset=openpi_libero&ensemble=0.01", Execution(ensemble=0.01)),
    ],
)
def test_a_preset_executes_as_much_of_a_chunk_as_the_known_client(query, expected):
    assert executed(query) == expected


def test_asking_further_ahead_than_a_preset_executes_names_the_preset():
    with pytest.raises(
        InvalidInputError, match=r"ahead=5 must be less than the number of actions .* preset .*\(5\).*horizon=N"
    ):
        executed("preset=openpi_libero&ahead=5")


def test_an_adapter_of_a_file_has_a_horizon_too():
    assert Adapter.from_json(PRESETS["vla_eval"].to_json() | {"horizon": 3}).horizon == 3
    with pytest.raises(InvalidInputError, match="horizon"):
        Adapter.from_json(PRESETS["vla_eval"].to_json() | {"horizon": 0})
