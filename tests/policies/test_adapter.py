"""Adapters: requests as each preset's policy wants them, answers as ours, and the JSON form."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from tests.looping import each

from betterbench.errors import HandshakeError, InvalidInputError, PolicyError, UnknownNameError
from betterbench.interface import EpisodeStart, Observation
from betterbench.interface.actions import ACTION_SPACES, EE_DELTA, action_space
from betterbench.policies.conventions.adapter import Adapter, InstructionRule
from betterbench.policies.conventions.answers import AnswerPart, AnswerRule
from betterbench.policies.conventions.handshake import Declaration, compare_declarations, declare_adapter, declare_space
from betterbench.policies.conventions.presets import NATIVE, OPENPI_DROID, OPENPI_LIBERO, PRESETS, VLA_EVAL, adapter_of
from betterbench.policies.conventions.proprioception import StateRule
from betterbench.policies.conventions.rotation import ROTATION_SIZES, from_format
from betterbench.policies.kinds import make_policy, read_address
from betterbench.tasks import TrialId

TOOL = Rotation.from_euler("xyz", [3.0, 0.2, -0.4])
ONE = ("actions",)
TWIST = tuple(AnswerPart(ONE, kind) for kind in ("translation", "rotation", "gripper"))
JOINTS = (AnswerPart(ONE, "joints"), AnswerPart(ONE, "gripper"))


@pytest.fixture
def observation():
    return seen()


def seen():
    return Observation(
        instruction="pack the apple",
        step=4,
        images={n: np.full((256, 256, 3), i, np.uint8) for i, n in enumerate(("front", "wrist", "left_shoulder"))},
        joint_positions=np.arange(7) / 10,
        joint_velocities=np.arange(7) / 100,
        ee_position=np.array([0.4, 0.1, 0.3]),
        ee_quaternion=TOOL.as_quat(canonical=True, scalar_first=True),
        gripper_width=0.06,
        depth={},
        masks={},
    )


def adapter(answer, **options):
    return Adapter("mine", (), (), InstructionRule(("prompt",)), answer, **options)


def read(rule, reply, **options):
    return adapter(rule, **options).actions({"actions": np.asarray(reply, float)}, seen())


AXES = (
    *(AnswerPart((f"{axis}",), f"translation_{axis}") for axis in "xyz"),
    *(AnswerPart((name,), f"rotation_{axis}") for name, axis in zip(("roll", "pitch", "yaw"), "xyz", strict=True)),
    AnswerPart(("gripper",), "gripper"),
)


@given(rows=st.lists(st.lists(st.floats(-1, 1), min_size=7, max_size=7), min_size=1, max_size=4))
@settings(max_examples=40, deadline=None)
@pytest.mark.parametrize("rotation", ["axis_angle", "rpy"])
@pytest.mark.parametrize("frame", ["base", "tool"])
def test_axis_by_axis_means_the_same_as_whole(rotation, frame, rows):
    chunk = np.array(rows)
    whole = adapter(AnswerRule("ee_delta", TWIST, rotation=rotation, frame=frame))
    single = adapter(AnswerRule("ee_delta", AXES, rotation=rotation, frame=frame))
    reply = {part.key[0]: chunk[:, i : i + 1] for i, part in enumerate(AXES)}
    actions = single.actions(reply, seen())
    assert np.array_equal(actions, whole.actions({"actions": chunk}, seen()))
    again = single.actions(single.reply(actions, seen()), seen())
    assert np.allclose(again, actions, atol=1e-9)


def test_axes_may_stand_in_one_array_in_any_order():
    order = (3, 0, 6, 1, 5, 2, 4)
    parts = tuple(AnswerPart(ONE, AXES[i].kind) for i in order)
    row = np.arange(7) / 10
    assert np.allclose(read(AnswerRule("ee_delta", parts), row[list(order)]), [row])


def test_the_axes_of_the_state_are_the_numbers_of_its_vectors(observation):
    def values(*parts):
        return StateRule(("s",), parts, "float64").read(observation, ee_offset_m=(1, 2, 3), gripper_opening_m=0.08)

    assert values("ee_x", "ee_y", "ee_z").tolist() == values("ee_position").tolist()
    assert values(*(f"ee_axis_angle_{a}" for a in "xyz")).tolist() == values("ee_axis_angle").tolist()
    assert values("ee_roll", "ee_pitch", "ee_yaw").tolist() == values("ee_rpy").tolist()
    assert values(*(f"ee_quaternion_{a}" for a in "wxyz")).tolist() == values("ee_quaternion_wxyz").tolist()
    from_down = values("ee_roll_from_down", "ee_pitch_from_down", "ee_yaw_from_down")
    assert from_down.tolist() == values("ee_rpy_from_down").tolist()
    down = Rotation.from_quat([1, 0, 0, 0])
    assert np.allclose(from_down, (TOOL * down.inv()).as_euler("xyz"))
    assert StateRule(("s",), ("ee_x",), scalar=True).size == 1


def test_the_adapter_of_the_documentation_can_be_read():
    page = (Path(__file__).parents[2] / "docs" / "policies.md").read_text(encoding="utf-8")
    form = json.loads(page.partition("```json\n")[2].partition("```")[0])
    reply = {part["key"]: [0.1 * i] for i, part in enumerate(form["answer"]["parts"])}
    made = Adapter.from_json(form)
    assert np.allclose(made.actions(reply, seen()), [[0.0, 0.1, 0.2, 0.3, 0.4, 0.5, -1.0]])
    assert made.request(seen())["state"]["x"].tolist() == [[[np.float32(0.4)]]]


def test_an_offset_moves_single_axes_too():
    address = read_address("gr00t://host?preset=gr00t_libero_panda&ee_offset=-0.66,0,0.912")
    message = adapter_of(address).request(seen())
    assert np.allclose([message["state"][a] for a in "xyz"], np.reshape([0.4 - 0.66, 0.1, 0.3 + 0.912], (3, 1, 1, 1)))


def test_constants_go_with_every_request_and_the_address_sets_them():
    def asked(query):
        return adapter_of(read_address(f"http://host/act?{query}")).request(seen())

    assert "unnorm_key" not in asked("preset=openvla")
    assert asked("preset=openvla&send.unnorm_key=bridge_orig")["unnorm_key"] == "bridge_orig"
    message = asked("preset=x_vla&send.domain_id=3&send.options/fast=true&send.rate=0.5")
    assert (message["domain_id"], message["steps"], message["options"], message["rate"]) == (3, 10, {"fast": True}, 0.5)
    with pytest.raises(InvalidInputError, match=r"x_vla sends domain_id, .*Add send\.domain_id=VALUE"):
        asked("preset=x_vla")
    with pytest.raises(InvalidInputError, match="two entries use the key 'instruction'"):
        asked("preset=openvla&send.instruction=go")
    with pytest.raises(UnknownNameError, match=r"send\.x"):
        read_address("gr00t://host?send.x=1")


@each("preset", PRESETS.values())
def test_the_answer_of_every_preset_means_the_actions_that_it_was_written_for(preset):
    space = action_space(preset.answer.space)
    draw = np.random.default_rng(3)
    actions = draw.uniform(-0.4, 0.4, (5, space.dim))
    if space.dim == len("xyzwxyzg"):
        first = space.components[3] == "qw"
        actions[:, 3:7] = Rotation.random(5, random_state=3).as_quat(canonical=True, scalar_first=first)
    actions[:, -1] = draw.choice([-1.0, 1.0], 5)
    reply = preset.reply(actions, seen())
    atol = 1e-9 if preset.answer.precision == "float64" else 1e-6
    assert np.allclose(preset.actions(reply, seen()), actions, atol=atol)


@each("preset", PRESETS.values())
def test_the_json_form_round_trips_with_every_default_written_out(preset, tmp_path):
    form = json.loads(json.dumps(preset.to_json()))
    assert Adapter.from_json(form) == preset
    assert set(form) == set(Adapter.__dataclass_fields__)
    assert set(form["answer"]) == set(AnswerRule.__dataclass_fields__)
    file = tmp_path / "adapter.json"
    file.write_text(json.dumps(form), encoding="utf-8")
    assert Adapter.load(file) == preset


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"views": [{"key": "a", "camera": "front", "fit": "fill"}]}, r"views\[0\]\.fit: .*'pad', 'crop' or 'stretch'"),
        ({"views": [{"key": "a"}]}, r"views\[0\]\.camera: is missing"),
        ({"states": [{"key": "s", "parts": ["ee_positon"]}]}, r"states\[0\]\.parts\[0\]"),
        ({"states": [{"key": "s", "parts": []}]}, "state s: the state has no parts"),
        ({"color": "red"}, "color: is unknown"),
        ({"instruction": {"key": "p", "depth": False}}, "instruction.depth: expected a number, got a boolean"),
        ({"leading_axes": True}, "leading_axes: expected a number, got a boolean"),
        (
            {"views": [{"key": "a", "camera": "front", "turn": False}]},
            r"views\[0\].turn: expected a number, got a boolean",
        ),
        ({"instruction": {"key": ["a", ""]}}, "a key is empty"),
        ({"states": [{"key": "prompt", "parts": ["step"]}]}, "two entries use the key 'prompt'"),
        ({"answer": {"space": "ee_delt"}}, "Did you mean 'ee_delta'"),
        (
            {"answer": {"parts": [{"key": "a", "kind": "translation"}]}},
            "ee_delta needs each of gripper, rotation, translation",
        ),
        ({"answer": {"parts": [{"key": "a", "kind": "action", "size": 6}]}}, "expected 7 columns, got 6"),
        ({"answer": {"parts": [{"key": "a", "kind": "unused"}]}}, "the number of columns is missing"),
        ({"answer": {"translation_unit_m": 0.0}}, "translation_unit_m: 0 is out of range"),
        (
            {"answer": {"parts": [{"key": p.key[0], "kind": p.kind} for p in AXES[1:]]}},
            "ee_delta needs each of gripper",
        ),
        (
            {"answer": {"parts": [{"key": p.key[0], "kind": p.kind} for p in (*AXES, TWIST[0])]}},
            "translation once",
        ),
        (
            {"answer": {"rotation": "matrix", "parts": [{"key": p.key[0], "kind": p.kind} for p in AXES]}},
            "matrix has 9 numbers, not three axes",
        ),
        ({"constants": [{"key": "prompt", "value": 1}]}, "two entries use the key 'prompt'"),
        ({"constants": [{"key": "c", "value": [1]}]}, r"constants\[0\]\.value"),
        ({"gripper_opening_m": -1}, "gripper_opening_m"),
        ({"ee_offset_m": [0, 0]}, "ee_offset_m"),
    ],
)
def test_a_wrong_file_is_named_with_the_path_of_the_field(change, text, tmp_path):
    form = {"views": [], "states": [], "instruction": {"key": "prompt"}, **change}
    file = tmp_path / "mine.json"
    file.write_text(json.dumps(form), encoding="utf-8")
    with pytest.raises((InvalidInputError, UnknownNameError), match=text) as caught:
        Adapter.load(file)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("text", ["", "{", "[1]", "null", "[" * 100_000])
def test_a_file_that_is_no_adapter_is_refused(text, tmp_path):
    file = tmp_path / "mine.json"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(InvalidInputError, match=r"mine\.json"):
        Adapter.load(file)


def test_droid_gets_its_keys_and_its_velocities_become_joint_steps(observation):
    message = OPENPI_DROID.request(observation)
    assert set(message) == {
        "observation/exterior_image_1_left",
        "observation/wrist_image_left",
        "observation/joint_position",
        "observation/gripper_position",
        "prompt",
    }
    assert message["observation/exterior_image_1_left"][0, 0, 0] == 2  # the shoulder camera
    assert message["observation/gripper_position"].tolist() == [np.float32(0.25)]
    # 0.2 rad per step at 15 Hz are 3 rad/s, that is 0.15 rad per step at 20 Hz, and one unit of ours is 0.1 rad.
    chunk = np.array([[0.4, 0, 0, 0, 0, 0, -0.2, 0.9], [0, 0, 0, 0, 0, 0, 0, 0.2]])
    actions = OPENPI_DROID.actions({"actions": chunk}, observation)
    assert np.allclose(actions[:, [0, 6]], [[0.6, -0.3], [0, 0]])
    assert actions[:, 7].tolist() == [1.0, -1.0]


def test_gr00t_is_nested_with_batch_and_time_axes(observation):
    message = PRESETS["gr00t_new_embodiment"].request(observation)
    assert message["video"]["front"].shape == (1, 1, 256, 256, 3)
    assert message["state"]["ee_position"].shape == (1, 1, 3)
    assert message["language"] == {"annotation.human.action.task_description": [["pack the apple"]]}
    reply = {"ee_position": np.ones((1, 4, 3)), "ee_rotation": np.zeros((1, 4, 3)), "gripper": -np.ones((1, 4, 1))}
    assert PRESETS["gr00t_new_embodiment"].actions(reply, observation).tolist() == [[1, 1, 1, 0, 0, 0, -1]] * 4


def test_being_h_has_a_batch_axis_and_takes_nested_lists(observation):
    being_h = PRESETS["being_h_libero"]
    message = being_h.request(observation)
    assert message["video.top_view"].shape == (1, 256, 256, 3)
    assert message["state.libero_gripper_position"].shape == (1, 2)
    assert message["language.instruction"] == ["pack the apple"]
    reply = {
        "action.eef_position": [[0.1, 0.2, 0.3]] * 2,
        "action.eef_rotation": [[[0.0, 0.0, 0.5]] * 2],
        "action.gripper_position": [1.0, -1.0],
    }
    assert being_h.actions(reply, observation).tolist() == [
        [0.1, 0.2, 0.3, 0, 0, 0.5, 1],
        [0.1, 0.2, 0.3, 0, 0, 0.5, -1],
    ]


def test_native_is_the_whole_observation_and_the_only_one_that_names_the_trial(observation):
    start, trial = EpisodeStart("pack the apple", 7, "ee_delta"), TrialId("fruit_lunch", "L3", 5)
    assert NATIVE.request(observation, start)["better/episode"] == {
        "instruction": "pack the apple",
        "episode": 7,
        "action_space": "ee_delta",
    }
    message = NATIVE.request(observation, start, trial)
    assert message["better/episode"]["condition"] == "L3"
    assert message["better/joint_positions"].dtype == np.float64
    assert message["better/joint_positions"].tolist() == observation.joint_positions.tolist()
    assert message["better/ee_position"].tolist() == observation.ee_position.tolist()
    assert type(message["better/step"]) is int
    assert np.array_equal(message["better/images/wrist"], observation.images["wrist"])
    for preset in PRESETS.values():
        assert (preset.episode_key is not None) == (preset is NATIVE)


def test_a_camera_that_is_not_rendered_is_named(observation):
    with pytest.raises(PolicyError, match=r"needs the camera 'left_shoulder'.*renders front.*camera\.observation"):
        OPENPI_DROID.request(replace(observation, images={"front": observation.images["front"]}))


def test_states_come_in_the_order_and_format_asked_for(observation):
    parts = (
        "gripper_fingers",
        "ee_rpy",
        "gripper_open_fraction",
        "gripper_closed_fraction",
        "zero",
        "joint_velocities",
    )
    rule = StateRule(("s",), parts, "float64")
    values = rule.read(observation, ee_offset_m=(0, 0, 0), gripper_opening_m=0.08)
    expected = [0.03, -0.03, *TOOL.as_euler("xyz"), 0.75, 0.25, 0.0, *(np.arange(7) / 100)]
    assert np.allclose(values, expected)
    assert rule.size == len(expected)
    moved = StateRule(("s",), ("ee_position",)).read(observation, ee_offset_m=(-0.66, 0, 0.912), gripper_opening_m=0.08)
    assert moved.dtype == np.float32
    assert np.allclose(moved, [-0.26, 0.1, 1.212])


@pytest.mark.parametrize("form", ROTATION_SIZES)
@pytest.mark.parametrize("axis", ["x", "y", "z"])
def test_a_tool_that_points_down_has_a_state_without_jumps(observation, form, axis):
    """The images of two states that are a thousandth of a radian apart look the same; so do the numbers."""
    rule = StateRule(("s",), (f"ee_{form}",), "float64")
    values = []
    for angle in np.arange(-0.05, 0.05, 0.001):
        tool = Rotation.from_euler(axis, angle) * Rotation.from_euler("xyz", [np.pi, 0.02, 0.03])
        seen = replace(observation, ee_quaternion=tool.as_quat(canonical=True, scalar_first=True))
        values.append(rule.read(seen, ee_offset_m=(0, 0, 0), gripper_opening_m=0.08))
        assert Rotation.from_quat(from_format(values[-1].tolist(), form), scalar_first=True).approx_equal(tool, 1e-6)
    assert np.abs(np.diff(values, axis=0)).max() < 0.01


# ------------------------------------------------------------------------------------------------------- answers


def test_libero_numbers_are_played_as_they_are():
    chunk = np.random.default_rng(0).uniform(-1, 1, (5, 7))
    assert np.array_equal(read(AnswerRule("ee_delta", TWIST), chunk), chunk)


def test_each_polarity_closes_when_it_means_to():
    for polarity, number, closes in [
        ("close_positive", 0.3, True),
        ("close_positive", -0.3, False),
        ("open_positive", 0.3, False),
        ("open_positive", -0.3, True),
        ("closed_fraction", 0.8, True),
        ("closed_fraction", 0.2, False),
        ("open_fraction", 0.8, False),
        ("open_fraction", 0.2, True),
    ]:
        assert "positive closes" in EE_DELTA.convention
        action = read(AnswerRule("ee_delta", TWIST, gripper=polarity), [0, 0, 0, 0, 0, 0, number])
        assert bool(EE_DELTA.clip(action[0])[6] > 0) is closes


def test_physical_units_are_divided_by_ours():
    rule = AnswerRule("ee_delta", TWIST, translation_unit_m=1.0, rotation_unit_rad=1.0)
    assert np.allclose(read(rule, [0.05, 0, -0.025, 0.5, 0, 0.1, 1]), [[1, 0, -0.5, 1, 0, 0.2, 1]])


def test_a_tool_frame_delta_moves_along_the_tool():
    rule = AnswerRule("ee_delta", TWIST, frame="tool")
    actions = read(rule, [[0, 0, 1, 0, 0, 0, 1], [0.2, 0, 0, 0, 0, 0.4, 1], [1, 0, 0, 0, 0, 0, 1]])
    assert np.allclose(actions[0, :3], TOOL.as_matrix()[:, 2])
    assert np.allclose(actions[1, 3:6], TOOL.as_matrix()[:, 2] * 0.4)
    # The third step moves along the x axis of a tool that the second one has turned by 0.2 rad about its own z.
    turned = TOOL * Rotation.from_rotvec([0, 0, 0.2])
    assert np.allclose(actions[2, :3], turned.as_matrix()[:, 0])


def test_absolute_poses_take_the_offset_off_and_normalize():
    rule = AnswerRule("ee_pose", TWIST, rotation="quaternion_xyzw")
    q = 2.0 * TOOL.as_quat(canonical=True)
    (action,) = read(rule, [-0.26, 0.1, 1.212, *q, 1.0], ee_offset_m=(-0.66, 0, 0.912))
    assert np.allclose(action, [0.4, 0.1, 0.3, *TOOL.as_quat(canonical=True, scalar_first=True), 1.0])


RULES = [
    AnswerRule("ee_delta"),
    AnswerRule("ee_delta", TWIST),
    AnswerRule("ee_delta_measured", TWIST[::-1], gripper="open_positive", translation_unit_m=1.0),
    AnswerRule("ee_delta", TWIST, rotation="rpy", rotation_unit_rad=1.0, frame="tool"),
    AnswerRule("ee_delta", TWIST, rotation="rotation_6d", gripper="closed_fraction"),
    AnswerRule("ee_delta", (*TWIST, AnswerPart(ONE, "unused", 3)), rotation="quaternion_xyzw", frame="tool"),
    AnswerRule("ee_delta", TWIST, step_rate_hz=10.0),
    AnswerRule("ee_pose", TWIST, rotation="rotation_6d_rows"),
    AnswerRule("ee_pose", TWIST, rotation="matrix", gripper="open_fraction"),
    AnswerRule("joint_position", JOINTS),
    AnswerRule("joint_delta", JOINTS, joint_unit_rad=0.2, step_rate_hz=15.0, gripper="closed_fraction"),
]


@pytest.mark.parametrize("rule", RULES)
@given(data=st.data())
@settings(max_examples=10)
def test_reading_what_was_written_gives_the_actions_back(rule, data):
    space = ACTION_SPACES[rule.space]
    draw = np.random.default_rng(data.draw(st.integers(0, 10**6)))
    actions = draw.uniform(space.low, space.high, (data.draw(st.integers(1, 5)), space.dim))
    actions[:, -1] = np.sign(actions[:, -1])
    if rule.space == "ee_pose":
        turns = Rotation.random(len(actions), rng=draw)
        actions[:, 3:7] = [t.as_quat(canonical=True, scalar_first=True) for t in turns]
    mine = adapter(rule, ee_offset_m=(0.1, -0.2, 0.3))
    back = mine.actions(mine.reply(actions, seen()), seen())
    assert back.shape == actions.shape
    assert np.allclose(back, actions, atol=1e-9)


@each("rule", RULES)
@each("bad", [np.nan, np.inf, -np.inf])
def test_numbers_that_are_not_finite_stay_so_and_spoil_no_other_row(rule, bad):
    space = ACTION_SPACES[rule.space]
    mine = adapter(rule)
    good = np.tile(0.5 * np.eye(space.dim)[3], (3, 1)) + 0.25 * np.eye(space.dim)[-1]
    reply = mine.reply(good, seen())["actions"]
    reference = mine.actions({"actions": reply}, seen())
    for column in range(min(7, reply.shape[1])):
        spoilt = reply.copy()
        spoilt[1, column] = bad
        actions = mine.actions({"actions": spoilt}, seen())
        assert not np.isfinite(actions[1]).all()
        assert np.isfinite(actions[0]).all()
        assert np.array_equal(actions[0], reference[0])


def test_a_rotation_that_is_none_is_a_policy_error():
    with pytest.raises(PolicyError, match=r"the reply contains an invalid rotation .*Send quaternion_xyzw"):
        read(AnswerRule("ee_pose", TWIST, rotation="quaternion_xyzw"), [0, 0, 0, 0, 0, 0, 0, 1])


def test_chunks_of_different_lengths_are_refused():
    reply = {"ee_position": np.ones((4, 3)), "ee_rotation": np.zeros((3, 3)), "gripper": -np.ones((4, 1))}
    with pytest.raises(PolicyError, match=r"different lengths \(ee_position: 4, ee_rotation: 3, gripper: 4\)"):
        PRESETS["gr00t_new_embodiment"].actions(reply, seen())


def test_a_reply_that_is_no_map_is_refused():
    with pytest.raises(PolicyError, match="expected a map with actions as the reply, got list"):
        OPENPI_LIBERO.actions([1], seen())


# ------------------------------------------------------------------------------------------------------ addresses


def parse(query):
    return adapter_of(read_address(f"openpi://localhost:8000?{query}"))


def test_an_address_changes_what_differs_from_a_preset(tmp_path):
    changed = parse(
        "preset=openpi_libero&size=320x240&fit=crop&keep=0.9&turn=180&mirror=true&ee_offset=-0.66,0,0.912"
        "&camera.observation/image=left_shoulder&units=physical&gripper=open_positive&rotation=rpy&frame=tool"
    )
    view = changed.views[0]
    assert (view.width, view.height, view.fit, view.keep, view.turn, view.mirror) == (320, 240, "crop", 0.9, 180, True)
    assert (view.camera, changed.views[1].camera) == ("left_shoulder", "wrist")
    assert changed.ee_offset_m == (-0.66, 0.0, 0.912)
    answer = changed.answer
    assert (answer.translation_unit_m, answer.rotation_unit_rad) == (1.0, 1.0)
    assert (answer.gripper, answer.rotation, answer.frame) == ("open_positive", "rpy", "tool")
    file = tmp_path / "mine.json"
    file.write_text(json.dumps(replace(changed, name="mine").to_json()), encoding="utf-8")
    assert parse(f"adapter={file}").name == "mine"
    assert parse("preset=openpi_libero") == OPENPI_LIBERO


def test_malformed_changes_are_one_clear_line():
    for query, text in [
        ("preset=openpi_libero&size=big", "size=big is not an image size"),
        ("preset=openpi_libero&turn=45", "Unknown turn '45'"),
        ("preset=openpi_libero&keep=2", "keep = 2"),
        ("preset=openpi_libero&keep=x", "keep: expected a number, got 'x'"),
        ("preset=openpi_libero&ee_offset=1,2", "does not consist of three numbers"),
        ("preset=openpi_libero&ee_offset=1,2,nan", "ee_offset_m"),
        ("preset=openpi_libero&gripper=close_positve", "Did you mean 'close_positive'"),
        ("preset=openpi_libero&camera.observation/imag=front", "Did you mean 'observation/image'"),
        ("preset=openpi_libero&action_space=joint_delta", "joint_delta needs each of gripper, joints"),
        ("preset=openpi_libero&adapter=x.json", "both a preset and an adapter"),
        ("adapter=no_such_file.json", "cannot be read"),
        ("preset=openpi", "Did you mean 'openpi_"),
        ("preset=native&gripper=open_positive", "complete actions"),
        ("preset=native&rotation=rpy", "complete actions"),
        ("preset=native&units=physical", "complete actions"),
        ("preset=native&frame=tool", "complete actions"),
        ("preset=openpi_droid&rotation=rpy", "rotation has no effect for joint_delta"),
        ("preset=openpi_droid&units=physical", "units has no effect for joint_delta"),
        ("preset=openpi_libero&action_space=ee_pose&units=physical", "units has no effect for ee_pose"),
        ("preset=openpi_droid&ee_offset=1,2,3", "openpi_droid does not contain the end-effector position"),
        ("preset=native&ee_offset=1,2,3", "the native layout uses the robot's base frame"),
    ]:
        with pytest.raises((InvalidInputError, UnknownNameError), match=text) as caught:
            parse(query)
        assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("text", "server"),
    [
        ("openpi://localhost", ("localhost", 8000)),
        ("gr00t://10.0.0.1", ("10.0.0.1", 5555)),
        ("openpi://[::1]:9000", ("::1", 9000)),
        ("vla-eval:host:1", ("host", 1)),
        ("starvla://host", ("host", 10093)),
        ("http://host/act", ("host", 8000)),
        ("https://host/v1/act", ("host", 443)),
    ],
)
def test_servers_have_default_ports(text, server):
    assert read_address(text).server() == server


def test_an_address_has_a_path_where_servers_have_one():
    assert read_address("http://host:1?preset=openvla").path == "/act"
    assert read_address("http://host:1/").path == "/act"
    assert read_address("http://host:1/v1/predict?preset=openvla").path == "/v1/predict"


@pytest.mark.parametrize("text", ["lerobot://gpu-box:8080", "grpc://gpu-box:8080"])
def test_lerobots_own_server_is_refused_because_it_pickles(text):
    with pytest.raises(InvalidInputError, match=r"gRPC\) pickles observations and actions.*Write lerobot:CHECKPOINT"):
        read_address(text)
    with pytest.raises(InvalidInputError, match="pickles"):
        make_policy(text)


def test_addresses_that_mean_nothing_are_refused():
    for text in [
        "openpi://",
        "openpi:",
        "openpi",
        "",
        "http://",
        "http://user@host/act",
        "http://host/act\u00e9",
        "http://host\u00e9/act",
        "ftp://localhost",
        "openpi://host:0",
        "openpi://host:99999",
        "openpi://host:port",
        "openpi://user@host:80",
        "openpi://host/path#part",
        "gr00t://host/path",
        "openpi://a b:80",
        "openpi://host\n:80",
        "openpi://host?x",
        "openpi://host?timeout",
        "openpi://host?timeout=",
        "openpi://host?timeout=1&timeout=2",
        "openpi://host?horizon=0",
        "openpi://host?horizon=1.5",
        "openpi://host?horizon=4&ahead=4",
        "openpi://host?ensemble=inf",
        "openpi://host?ensemble=nan",
        "openpi://host?camera.=front",
        "openpi://host?images=png",
        "lerobot://checkpoint",
        "lerobot:",
    ]:
        with pytest.raises((InvalidInputError, UnknownNameError)):
            read_address(text)


def test_options_of_an_address_are_typed():
    address = read_address("lerobot:some/folder?device=cpu&horizon=4&ahead=1")
    assert (address.scheme, address.target, str(address)) == ("lerobot", "some/folder", address.text)
    assert (address.execution().horizon, address.execution().ahead) == (4, 1)
    assert read_address("openpi://host?ensemble=0.01").execution().ensemble == 0.01
    assert address.choice("device", ("cpu", "cuda"), "cuda") == "cpu"


# ----------------------------------------------------------------------------------------------------- handshakes


def test_sides_that_agree_or_keep_silent_pass():
    compare_declarations(declare_adapter("this side", VLA_EVAL), Declaration("the server"))
    compare_declarations(declare_space("a", EE_DELTA), declare_space("b", EE_DELTA))
    compare_declarations(Declaration("a", cameras={"x": (224, 224)}), Declaration("b", cameras={"x": None}))


def test_every_difference_is_named_in_one_line():
    ours = Declaration("this side", rotation="rpy", rate_hz=20.0, cameras={"front": (224, 224)})
    theirs = Declaration("the server", rotation="axis_angle", rate_hz=15.0, cameras={"front": (256, 256), "top": None})
    with pytest.raises(HandshakeError) as caught:
        compare_declarations(ours, theirs)
    text = str(caught.value)
    for part in (
        "rotation: this side declares 'rpy', the server declares 'axis_angle'",
        "rate hz: this side declares 20, the server declares 15",
        "camera front: this side declares 224 x 224, the server declares 256 x 256",
        "camera top: the server needs this image, but this side provides front",
    ):
        assert part in text
    assert "\n" not in text


def test_a_declaration_can_be_shown_as_a_table():
    rows = declare_adapter("this side", OPENPI_LIBERO).rows()
    assert rows["camera observation/image"] == "224 x 224"
    assert rows["rotation"] == "axis_angle"
    assert math.isclose(float(rows["rate hz"]), 20.0)
