"""Actions in other action spaces, gripper commands, subgoals, layouts and statistics."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.looping import each

from betterbench.demonstrations.export.actions import actions_in, commands
from betterbench.demonstrations.export.frames import DONE, active_subgoals, frame_numbers
from betterbench.demonstrations.export.layout import layout_of
from betterbench.demonstrations.export.numbers import color_counts, image_stats, sampled_rows, vector_stats
from betterbench.errors import InvalidInputError, UnknownNameError
from betterbench.interface.actions import ACTION_SPACES
from betterbench.policies.conventions.presets import OWN_PRESETS
from betterbench.records import Demonstrator, SubgoalSegment
from betterbench.sim.scenes import Scene
from betterbench.sim.scenes.stage import quality_preset
from betterbench.tasks import get_task

OTHERS = ("joint_position", "joint_delta", "ee_pose", "ee_delta_measured")


@pytest.mark.physics
@pytest.mark.parametrize("space", OTHERS)
def test_actions_in_another_space_command_the_same_motion(space, demonstrations):
    trial, record = list(demonstrations.records.items())[-1]
    task = get_task(trial.task)
    condition = next(c for c in task.training if c.name == trial.condition)
    quality = quality_preset("fast")
    scene = Scene(task, condition, seed=trial.seed, action_space=ACTION_SPACES[space], quality=quality)
    arm = scene.arm_addresses
    for row, action in enumerate(actions_in(record, ACTION_SPACES[space])):
        np.testing.assert_array_equal(scene.step(action), action)  # inside the bounds
        here, there = scene.simulator_state()["qpos"][arm], record.qpos[row + 1][arm]
        assert np.abs(here - there).max() < (1e-9 if space == "joint_position" else 0.02), row


def test_in_the_space_of_the_record_they_are_the_applied_ones(demonstrations):
    record = next(iter(demonstrations.records.values()))
    np.testing.assert_array_equal(actions_in(record, ACTION_SPACES["ee_delta"]), record.applied[1:])


@pytest.mark.parametrize("space", ["ee_delta", "ee_pose", "ee_delta_measured"])
def test_noise_on_executed_actions_is_not_in_the_labels(space, demonstrations):
    """A record whose executed actions were disturbed has the labels that lead to where the meant actions would have."""
    record = next(iter(demonstrations.records.values()))
    noise = np.zeros_like(record.applied)
    noise[1:, :6] = np.random.default_rng(0).normal(0.0, 0.02, noise[1:, :6].shape)
    meant = actions_in(record, ACTION_SPACES[space])
    noisy = dataclasses.replace(record.metadata, demonstrator=Demonstrator("amplified", "amplify", action_noise=0.02))
    disturbed = dataclasses.replace(record, metadata=noisy, action=record.applied, applied=record.applied + noise)
    tolerance = 0.0 if space == "ee_delta" else 1e-9
    np.testing.assert_allclose(actions_in(disturbed, ACTION_SPACES[space]), meant, rtol=0, atol=tolerance)


def test_a_record_without_joint_references_cannot_be_said_in_joints(demonstrations):
    record = next(iter(demonstrations.records.values()))
    record = dataclasses.replace(record, act=record.act[:, :3])
    with pytest.raises(InvalidInputError, match="joint references, but the record has 3"):
        actions_in(record, ACTION_SPACES["joint_delta"])


@given(st.lists(st.sampled_from([-1.0, -0.3, 0.0, 0.4, 1.0]), min_size=1))
def test_commands_keep_the_last_one_where_the_gripper_is_kept(gripper):
    last, wanted = -1.0, []
    for value in gripper:
        last = float(np.sign(value)) if value else last
        wanted.append(value or last)
    np.testing.assert_array_equal(commands(np.array(gripper)), wanted)


def test_the_active_subgoal_is_that_of_the_segment(demonstrations):
    record = next(iter(demonstrations.records.values()))
    kept = [("pack_drink", 0, 3), ("pack_fries", 3, 5), ("", 5, len(record))]
    segments = tuple(SubgoalSegment(name, "", "", "", "", start, stop) for name, start, stop in kept)
    shown = dataclasses.replace(record, metadata=dataclasses.replace(record.metadata, segments=segments))
    done = [DONE] * (record.n_steps - 5)
    assert active_subgoals(shown) == (*["pack drink"] * 3, *["pack fries"] * 2, *done)
    assert active_subgoals(record) == (DONE,) * record.n_steps  # the gripper never closes


@each("name", sorted(OWN_PRESETS))
def test_every_preset_has_a_layout(name):
    layout = layout_of(name)
    columns = [*layout.all_images, *(c.name for c in layout.states), layout.action.name]
    assert len(columns) == len(set(columns))
    assert not any("/" in column for column in columns)
    assert {rule.key for rule in layout.adapter.states} == {p.key for c in layout.states for p in c.parts}
    assert layout.action.size == sum(layout.adapter.answer.columns.values())
    assert layout.adapter.answer.as_is or layout.to_json()["adapter"]["name"] == name
    for column in (*layout.states, layout.action):
        assert [p.start for p in column.parts] == [0, *(p.end for p in column.parts)][:-1]
        assert column.parts[-1].end == column.size


def test_layouts_that_do_not_exist_are_told():
    with pytest.raises(UnknownNameError, match="openpi_libero"):
        layout_of("openpi_libro")
    with pytest.raises(InvalidInputError, match="left_shoulder"):
        layout_of("openpi_droid", "default")


def test_droid_has_the_second_image_that_openpi_s_configuration_names():
    layout = layout_of("openpi_droid")
    assert layout.all_images["exterior_image_2_left"].camera == "left_shoulder"
    assert [c.name for c in layout.states] == ["joint_position", "gripper_position"]


@pytest.mark.parametrize("name", ["openpi_droid", "gr00t_oxe_droid", "x_vla", "gr00t_oxe_widowx"])
def test_layouts_of_other_action_spaces_can_be_filled(name, demonstrations):
    layout = layout_of(name)
    record = next(iter(demonstrations.records.values()))
    numbers = frame_numbers(record, layout)
    assert all(np.isfinite(values).all() and len(values) == record.n_steps for values in numbers.vectors.values())


def test_statistics_of_images_are_those_of_their_pixels():
    draw = np.random.default_rng(0)
    pictures = draw.integers(0, 256, (5, 8, 6, 3), np.uint8)
    stats = image_stats(sum(color_counts(p) for p in pictures), 5)
    pixels = pictures.reshape(-1, 3) / 255.0
    for what in ("min", "max", "mean", "std"):
        np.testing.assert_allclose(np.ravel(stats[what]), getattr(pixels, what)(axis=0), atol=1e-12)
    for name, share in (("q01", 0.01), ("q50", 0.5), ("q99", 0.99)):
        np.testing.assert_allclose(np.ravel(stats[name]), np.quantile(pixels, share, axis=0, method="inverted_cdf"))
    assert np.shape(stats["mean"]) == (3, 1, 1)


def test_statistics_of_a_constant_column_do_not_vary():
    stats = vector_stats(np.full((4, 2), 0.25, np.float32))
    assert stats["std"] == [0.0, 0.0]
    assert stats["q01"] == stats["q99"] == stats["mean"] == [0.25, 0.25]


def test_long_episodes_are_sampled_evenly_and_short_ones_wholly():
    assert sampled_rows(5) == set(range(5))
    assert len(sampled_rows(1000)) == 32
    assert {0, 999} < sampled_rows(1000)


@pytest.mark.parametrize("name", ["starvla_calvin", "vla_eval_absolute"])
def test_a_preset_of_another_world_has_no_layout(name):
    with pytest.raises(
        InvalidInputError, match=rf"{name}: the action space .* is not available in betterbench's own scenes"
    ):
        layout_of(name)
