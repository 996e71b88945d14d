"""What a policy is trained on is what ``better eval`` shows it: number for number and pixel for pixel."""

from __future__ import annotations

import functools
import importlib.util
import re
import sys
from pathlib import Path

import numpy as np
import pytest
from tests.daily import part_of_today
from tests.kept_views import KeptViews

from betterbench.demonstrations.export import (
    ExportPlan,
    check,
    check_export,
    export_dataset,
    job,
    layout_of,
    pictures,
    select_demonstrations,
)
from betterbench.demonstrations.export.frames import frame_numbers, shown_images
from betterbench.demonstrations.export.pictures import Pictures
from betterbench.episodes import Observer
from betterbench.errors import InvalidInputError
from betterbench.interface import observation_spec
from betterbench.interface.actions import ROBOT_ACTION_SPACES
from betterbench.policies.clients.checkpoint import Features
from betterbench.policies.clients.lerobot import derive_adapter
from betterbench.policies.conventions.adapter import set_entry
from betterbench.policies.conventions.answers import get_entry
from betterbench.policies.conventions.presets import OWN_PRESETS
from betterbench.policies.kinds import read_address
from betterbench.tasks import TrialId

sys.path.insert(0, str(Path(__file__).parent))
from validators import check_modality, read_v21, read_v30

pytestmark = [pytest.mark.physics, pytest.mark.render]

LAYOUTS = {name: layout_of(name) for name in OWN_PRESETS}
RECORDED = ("ee_delta", *ROBOT_ACTION_SPACES)
"""Action spaces in which there are demonstrations."""
OF_RECORDED = [
    n for n, la in LAYOUTS.items() if la.observation.name == "default" and OWN_PRESETS[n].answer.space in RECORDED
]
OTHER_ROOM = re.compile(r"_(90|goal|object|spatial|living_room|study)$")
"""Ending of a preset that differs from the one that ends with _10 in the origin of LIBERO's world alone."""


SPACE_OF_TODAY = part_of_today([*ROBOT_ACTION_SPACES], len(ROBOT_ACTION_SPACES))[0]
"""Of the action spaces of robots, each has demonstrations of its own, so the default tests have one each day."""
ONE_ROOM = [name for name in OF_RECORDED if name.endswith("_10")]
SLOW = {f"lerobot_{space}" for space in ROBOT_ACTION_SPACES if space != SPACE_OF_TODAY}
SLOW |= {*ONE_ROOM} - {*part_of_today(ONE_ROOM, 5)}


@pytest.fixture(scope="module", autouse=True)
def kept_views():
    """Lets all tests draw in one process, or two where two draw at the same time."""
    views = KeptViews()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(pictures, "LimitedView", views)
        yield
    views.end()


@pytest.fixture(scope="module")
def drawn_in(demonstrations_in):
    """The pictures of each record in an action space, drawn again from the run folder alone."""

    @functools.cache
    def draw(space):
        made = demonstrations_in(space)
        with Pictures(observation_spec("default").cameras, "fast") as drawing:
            return {t: list(drawing.of(made.run, r)) for t, r in made.records.items()}

    return draw


@pytest.fixture(scope="module")
def drawn(drawn_in):
    return drawn_in("ee_delta")


@pytest.fixture
def kept(drawn):
    """Shows the pictures that were drawn above, which saves a process and its start."""

    class Kept(Pictures):
        def __init__(self, _cameras, _quality: str) -> None:
            """Nothing is opened."""

        def of(self, _run, record, rows=None):
            m = record.metadata
            shown = drawn[TrialId(m.task, m.condition, m.seed)]
            return iter(shown if rows is None else [shown[row] for row in rows])

        def stop(self) -> None:
            """Nothing is open."""

        def close(self) -> None:
            """Nothing is open."""

    return Kept


@pytest.fixture
def drawn_before(kept, monkeypatch):
    monkeypatch.setattr(job, "Pictures", kept)
    monkeypatch.setattr(check, "Pictures", kept)


def request_of(layout, row: dict) -> dict:
    """Builds the request of a frame from the columns of a data set alone, as a trainer's loader would."""
    message: dict = {}
    for column in layout.images:
        set_entry(message, column.key, row[column.name])
    for column in layout.states:
        for part in column.parts:
            set_entry(message, part.key, row[column.name][part.start : part.end])
    set_entry(message, layout.adapter.instruction.key, layout.adapter.instruction.write(row["task"]))
    return message


def require_same_request(layout, row: dict, observation, *, exact: bool = True) -> None:
    """The request of a frame is the one that the adapter makes of the observation that the policy had."""
    adapter = layout.adapter
    wanted, found = adapter.request(observation), request_of(layout, row)
    for column in layout.images:
        image = np.asarray(get_entry(wanted, column.key))
        image = image.reshape(image.shape[-3:])
        if exact:
            np.testing.assert_array_equal(get_entry(found, column.key), image)
        else:
            error = np.abs(get_entry(found, column.key).astype(int) - image.astype(int))
            assert error.mean() < 4.0, "the documented error of the codec"
    for rule in adapter.states:
        value = np.atleast_1d(get_entry(wanted, rule.key))
        stored = np.asarray(get_entry(found, rule.key))
        assert stored.dtype == value.dtype
        np.testing.assert_array_equal(stored, value.reshape(-1))
    instruction = get_entry(wanted, adapter.instruction.key)
    while isinstance(instruction, list):
        (instruction,) = instruction
    assert get_entry(found, adapter.instruction.key) == instruction


def require_same_action(layout, stored: np.ndarray, record, row: int, observation) -> None:
    """The stored action, as the policy's answer, is the applied action; of the gripper the command counts."""
    reply: dict = {}
    for part in layout.action.parts:
        set_entry(reply, part.key, stored[None, part.start : part.end])
    (action,) = layout.adapter.actions(reply, observation)
    applied = record.applied[row + 1]
    exact = layout.action.dtype == "float64"
    np.testing.assert_allclose(action[:-1], applied[:-1], rtol=0.0, atol=0.0 if exact else 2e-6)
    if layout.adapter.answer.gripper in ("closed_fraction", "open_fraction"):
        commanded = [v for v in record.applied[1 : row + 2, -1] if v != 0.0]
        assert np.sign(action[-1]) == (np.sign(commanded[-1]) if commanded else -1.0)
    else:
        assert action[-1] == applied[-1]


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=pytest.mark.slow) if n in SLOW or OTHER_ROOM.search(n) else n for n in OF_RECORDED]
)
def test_frames_of_every_preset_are_its_requests_and_answers(name, demonstrations_in, drawn_in):
    layout, space = layout_of(name), OWN_PRESETS[name].answer.space
    demonstrations, drawn = demonstrations_in(space), drawn_in(space)
    for trial, record in demonstrations.records.items():
        numbers = frame_numbers(record, layout)
        images = list(shown_images(record, layout, iter(drawn[trial])))
        for row, observation in enumerate(demonstrations.seen[trial]):
            frame = images[row] | {k: v[row] for k, v in numbers.vectors.items()} | {"task": observation.instruction}
            require_same_request(layout, frame, observation)
            require_same_action(layout, numbers.vectors[layout.action.name][row], record, row, observation)
        assert row + 1 == len(images) == len(numbers.subgoals) == record.n_steps


def test_other_cameras_and_sizes_have_the_pixels_of_an_observer(demonstrations):
    """Views beside the robot, 320 x 180, of the state in which the scene was left."""
    spec, scene = observation_spec("droid"), demonstrations.scene
    record = list(demonstrations.records.values())[-1]
    observer = Observer(spec)
    wanted = {name: view.rgb for name, view in observer.look(scene).items()}
    observer.close()
    with Pictures(spec.cameras, "fast") as drawing:
        (found,) = drawing.of(demonstrations.run, record, [record.n_steps])
    for camera in spec.cameras:
        np.testing.assert_array_equal(found[camera.name], wanted[camera.name])


def plan_of(demonstrations, out: Path, to: str, preset: str, **options) -> ExportPlan:
    runs = [demonstrations.run]
    return ExportPlan(runs, select_demonstrations(runs), layout_of(preset), to, out, **options)


def require_same_episodes(episodes, layout, demonstrations, *, exact: bool) -> None:
    assert len(episodes) == len(demonstrations.records)
    for episode, (trial, record) in zip(episodes, demonstrations.records.items(), strict=True):
        for row, observation in enumerate(demonstrations.seen[trial]):
            frame = {name: values[row] for name, values in episode.items() if name != "task"}
            require_same_request(layout, frame | {"task": episode["task"]}, observation, exact=exact)
            require_same_action(layout, frame[layout.action.name], record, row, observation)


@pytest.mark.parametrize(
    "preset",
    [
        pytest.param(n, marks=() if n == f"lerobot_{SPACE_OF_TODAY}" else pytest.mark.slow)
        for n in ("lerobot", *(f"lerobot_{space}" for space in ROBOT_ACTION_SPACES))
    ],
)
def test_a_lerobot_data_set_without_loss_is_what_was_shown(preset, demonstrations_in, tmp_path):
    demonstrations = demonstrations_in(OWN_PRESETS[preset].answer.space)
    plan = plan_of(demonstrations, tmp_path / "set", "lerobot", preset, form="png")
    export_dataset(plan)
    require_same_episodes(read_v30(plan.out), plan.layout, demonstrations, exact=True)
    assert check_export(plan.runs, plan.out).worst_error == 0.0


def test_openpi_s_columns_as_videos_are_what_the_policy_was_shown_within_the_codec_s_error(
    demonstrations, drawn_before, tmp_path
):
    plan = plan_of(demonstrations, tmp_path / "set", "lerobot-v2.1", "openpi_libero")
    export_dataset(plan)
    episodes = read_v21(plan.out)
    assert {"image", "wrist_image", "state", "actions"} < set(episodes[0])
    require_same_episodes(episodes, plan.layout, demonstrations, exact=False)
    assert check_export(plan.runs, plan.out).worst_error < 4.0


def test_gr00t_s_modality_names_the_slices_of_its_own_preset(demonstrations, drawn_before, tmp_path):
    plan = plan_of(demonstrations, tmp_path / "set", "lerobot-v2.1", "gr00t_libero_panda")
    export_dataset(plan)
    require_same_episodes(read_v21(plan.out), plan.layout, demonstrations, exact=False)
    modality = check_modality(plan.out)
    adapter = plan.layout.adapter
    assert list(modality["state"]) == [rule.key[-1] for rule in adapter.states]
    assert list(modality["action"]) == [key[-1] for key in adapter.answer.columns]
    assert list(modality["video"]) == [rule.key[-1] for rule in adapter.views]
    assert f"annotation.{next(iter(modality['annotation']))}" == adapter.instruction.key[-1]


@pytest.mark.skipif(importlib.util.find_spec("h5py") is None, reason="needs h5py (extra robomimic)")
def test_a_robomimic_file_is_what_our_own_servers_are_shown(demonstrations, drawn_before, tmp_path):
    import h5py

    plan = plan_of(demonstrations, tmp_path / "set.hdf5", "robomimic", "native")
    export_dataset(plan)
    with h5py.File(plan.out) as file:
        assert file["data"].attrs["total"] == sum(r.n_steps for r in demonstrations.records.values())
        for number, (trial, record) in enumerate(demonstrations.records.items()):
            demo = file[f"data/demo_{number}"]
            assert demo.attrs["num_samples"] == record.n_steps
            np.testing.assert_array_equal(demo["actions"], record.applied[1:])
            for row, seen in enumerate(demonstrations.seen[trial]):
                for camera, image in seen.images.items():
                    np.testing.assert_array_equal(demo["obs"][camera][row], image)
                request = plan.layout.adapter.request(seen)
                for name in ("joint_positions", "joint_velocities", "ee_position", "ee_quaternion"):
                    np.testing.assert_array_equal(demo["obs"][name][row], request[f"better/{name}"])
                assert demo["obs/gripper_width"][row] == [seen.gripper_width]
    assert check_export(plan.runs, plan.out).worst_error == 0.0


@pytest.mark.parametrize("preset", ["lerobot", *(f"lerobot_{space}" for space in ROBOT_ACTION_SPACES)])
def test_a_checkpoint_trained_on_the_lerobot_layout_derives_the_same_adapter(preset):
    layout = layout_of(preset)
    space = layout.adapter.answer.space
    option = f"?action_space={space}" if space in ROBOT_ACTION_SPACES else ""
    features = Features(
        {c.name: (c.height, c.width) for c in layout.images},
        {c.name: c.size for c in layout.states},
        layout.action.size,
    )
    derived = derive_adapter(read_address(f"lerobot:outputs/act{option}"), features)
    mine = layout.adapter
    assert (derived.views, derived.states, derived.instruction) == (mine.views, mine.states, mine.instruction)
    assert derived.answer == mine.answer


def test_six_motors_without_units_are_refused_with_both_units():
    features = Features({}, {"observation.state": 6}, 6)
    with pytest.raises(
        InvalidInputError, match=r"Add action_space=NAME to the policy address \(so101_degrees, so101_normalized\)"
    ):
        derive_adapter(read_address("lerobot:outputs/act"), features)
