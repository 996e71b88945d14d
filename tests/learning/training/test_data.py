"""From records to what a learner is trained on."""

from __future__ import annotations

import dataclasses
import shutil

import numpy as np
import pytest
from demonstrating import STEPS, add_record, start_run
from short_records import TRIALS, short_records
from small_recipes import tiny

from betterbench.errors import InvalidInputError, RecordError
from betterbench.learning.training.data import PHASES, moving_rows, read_training_set, scales_of
from betterbench.policies.learned.tokens import moment_of


@pytest.fixture(scope="module")
def records():
    return short_records()


@pytest.fixture
def run_of(records, tmp_path):
    def make(**changes):
        run = start_run(tmp_path / "run", TRIALS, action_space=changes.get("action_space", "ee_delta"))
        for record in records:
            add_record(run, dataclasses.replace(record, metadata=dataclasses.replace(record.metadata, **changes)))
        return run

    return make


def test_each_frame_shows_its_state_and_is_answered_by_its_action(run_of, records):
    data = read_training_set(tiny(data=[str(run_of().path)], validation=0.0, longest_pause=None))
    assert data.trials == tuple(TRIALS)
    assert len(data.actions) == 2 * STEPS
    for number, record in enumerate(records):
        rows = np.flatnonzero(data.episodes == number)
        assert (data.first[number], data.last[number]) == (rows[0], rows[-1])
        for row, state in zip(rows, record.states(), strict=False):
            tool, poses = moment_of(state)
            assert np.array_equal(data.tools[row], tool)
            assert np.array_equal(data.poses[row][: len(poses)], poses)
        assert np.array_equal(data.actions[rows][:, :6], record.applied[1:, :6].astype(np.float32))
        assert set(data.actions[rows][:, 6]) <= {-1.0, 1.0}
    assert {PHASES[i] for i in data.phases} <= set(PHASES)


def test_a_record_that_is_exchanged_while_others_are_read_is_not_trained_on(run_of, records):
    run = run_of()

    def exchange(done, _):
        if done == 1:
            run.journal_path.unlink()
            for record in (records[0], dataclasses.replace(records[1], action=-records[1].action)):
                add_record(run, record)

    recipe = tiny(data=[str(run.path)], validation=0.0)
    with pytest.raises(RecordError, match="is not the record that the journal lists"):
        read_training_set(recipe, on_read=exchange)


def test_a_start_knows_all_that_the_data_show_and_may_know_more(records, tmp_path):
    """Numbers of words are those of the checkpoint; one that lacks a word is refused by its name."""
    train = pytest.importorskip("betterbench.learning.training.loop", reason="needs torch", exc_type=ImportError).train
    other = dataclasses.replace(records[1].metadata, instruction="Fetch the mug")
    both = (records[0], dataclasses.replace(records[1], metadata=other))
    data = {}
    for name, count in (("wide", 2), ("narrow", 1)):
        run = start_run(tmp_path / name, TRIALS[:count])
        for record in both[:count]:
            add_record(run, record)
        recipe = tiny(data=[str(run.path)], validation=0.0)
        data[name] = recipe, read_training_set(recipe)
        train(*data[name], tmp_path / f"{name} learner")
    (_, whole), (narrow, alone) = data["wide"], data["narrow"]
    assert set(alone.vocabulary.words) < set(whole.vocabulary.words)
    recipe = dataclasses.replace(narrow, start=str(tmp_path / "wide learner"))
    begun = read_training_set(recipe)
    assert begun.vocabulary == whole.vocabulary
    assert np.array_equal(begun.words[0], whole.words[0][: begun.words.shape[1]])
    train(recipe, begun, tmp_path / "begun")
    unfit = dataclasses.replace(data["wide"][0], start=str(tmp_path / "narrow learner"))
    with pytest.raises(InvalidInputError, match="narrow learner: its vocabulary lacks the word 'fetch' of the data"):
        read_training_set(unfit)


@pytest.fixture
def pausing(records):
    """A record whose arm moves 1 mm a step and rests in rows 4 to 8, as do its fingers."""
    record = records[0]
    steps = np.arange(record.n_steps + 1)
    position = np.zeros((len(steps), 3))
    position[1:, 0] = 1e-3 * np.where(steps < 4, steps, np.maximum(4, steps - 4))[:-1]
    applied = np.array(record.applied)
    applied[:, -1] = -1.0
    return dataclasses.replace(
        record,
        applied=applied,
        commanded_position=position,
        commanded_quaternion=np.tile([1.0, 0.0, 0.0, 0.0], (len(steps), 1)),
        finger_width=np.full(len(steps), 0.08),
    )


@pytest.mark.parametrize("most", [0, 1, 3])
def test_of_a_pause_the_first_steps_are_kept(pausing, most):
    left_out = set(range(pausing.n_steps)) - set(moving_rows(pausing, most).tolist())
    assert left_out == set(range(5 + most, 9)) & set(range(pausing.n_steps))
    assert len(moving_rows(pausing, None)) == pausing.n_steps


def test_fingers_that_move_are_no_pause(pausing):
    width = pausing.finger_width - 1e-3 * np.arange(pausing.n_steps + 1)
    assert len(moving_rows(dataclasses.replace(pausing, finger_width=width), 0)) == pausing.n_steps
    gripper = np.array(pausing.applied)
    gripper[7, -1] = 1.0  # the action of row 6
    assert {6, 7} <= set(moving_rows(dataclasses.replace(pausing, applied=gripper), 0).tolist())


def test_whole_seeds_are_held_out(run_of):
    data = read_training_set(tiny(data=[str(run_of().path)], validation=0.5))
    assert data.held_out.sum() == 1
    assert set(data.frames(held_out=True)).isdisjoint(data.frames(held_out=False))


def test_a_limit_takes_the_lowest_seeds(run_of):
    data = read_training_set(tiny(data=[str(run_of().path)], validation=0.0, demonstrations=1))
    assert data.trials == (TRIALS[0],)


def test_scales_have_floors(run_of):
    scales = scales_of(read_training_set(tiny(data=[str(run_of().path)], validation=0.0)))
    assert scales["tool_scale"].min() >= 0.01
    assert scales["action_scale"].min() >= 0.02
    assert (scales["action_mean"][6], scales["action_scale"][6]) == (0.0, 1.0)


def test_a_dataset_of_another_action_space_is_one_line(run_of):
    run = run_of(action_space="ee_pose")
    with pytest.raises(InvalidInputError, match="its action space is 'ee_pose'") as caught:
        read_training_set(tiny(data=[str(run.path)]))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("place", ["", "empty", "nowhere"])
def test_a_folder_without_a_run_is_one_line_that_names_the_field(tmp_path, monkeypatch, place):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "empty").mkdir()
    with pytest.raises(
        InvalidInputError, match=f"data: '{place}' contains no demonstrations.*better dataset"
    ) as caught:
        read_training_set(tiny(data=[place]))
    assert "\n" not in str(caught.value)


def test_a_demonstration_does_not_count_twice(run_of, tmp_path):
    run = run_of().path
    shutil.copytree(run, tmp_path / "copy")
    for data in ([run, run], [run, tmp_path / "copy"]):
        with pytest.raises(InvalidInputError, match=r"the same record is also in .*Pass each run only once"):
            read_training_set(tiny(data=[str(place) for place in data]))


def test_the_folder_in_which_one_stands_is_a_place_too(run_of, monkeypatch):
    run = run_of().path
    whole = read_training_set(tiny(data=[str(run)]))
    monkeypatch.chdir(run)
    assert read_training_set(tiny(data=["."])).sha256 == whole.sha256
