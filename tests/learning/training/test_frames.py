"""Frames of demonstrations: what is read is what was drawn, whatever happened in between."""

from __future__ import annotations

import errno
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from demonstrating import PaintedPictures, add_record, start_run
from hypothesis import given
from hypothesis import strategies as st
from short_records import TRIALS, short_records
from small_recipes import PIXELS, tiny

from betterbench.errors import RecordError, RunConflictError, StorageError
from betterbench.jobs import durable
from betterbench.jobs.line_journal import LOCK_NAME
from betterbench.jobs.lock import RunLock
from betterbench.learning.training import frames as frames_module
from betterbench.learning.training.data import read_training_set
from betterbench.learning.training.frames import FrameStore, frames_bytes, shift
from betterbench.policies.learned.eyes import looked_at

VIEWS = {"views": ["front", {"camera": "wrist", "window": [0.25, 0.25, 0.625, 0.625]}], "size": 32}


@pytest.fixture(scope="module")
def records():
    return short_records()


@pytest.fixture
def read(records, tmp_path, monkeypatch):
    monkeypatch.setattr(frames_module, "Pictures", PaintedPictures)
    run = start_run(tmp_path / "run", TRIALS)
    for record in records:
        add_record(run, record)

    def read(**options):
        changes = {"eyes": VIEWS, "longest_pause": None, **options.pop("changes", {})}
        recipe = tiny(**PIXELS | changes, data=[str(run.path)], validation=0.0)
        return read_training_set(recipe, **options)

    read.run = run
    return read


def files_of(folder):
    return {file.name: file.read_bytes() for file in folder.glob("*.bin")}


def test_each_frame_is_what_a_policy_is_shown(read, records):
    data, eyes = read(), tiny(**PIXELS | {"eyes": VIEWS}).eyes
    cameras = frames_module.observation_spec("default").cameras
    wanted = [looked_at(eyes, views) for r in records for views in PaintedPictures(cameras, "").of(None, r)]
    assert len(data.frames_of) == len(data.actions) == len(wanted)
    assert np.array_equal(data.frames_of.read(np.arange(len(wanted))), np.stack(wanted))
    assert (read.run.path.parent / "run.frames").is_dir()


def test_only_shown_frames_are_drawn_and_all_actions_stay(read):
    whole, data = read(), read(changes={"every": 3})
    assert np.array_equal(whole.actions, data.actions)
    numbers = np.flatnonzero(data.shown)
    assert len(data.frames_of) == len(numbers) < len(whole.frames_of)
    assert np.array_equal(data.frames(held_out=False), numbers)
    assert np.array_equal(data.frames_of.read(np.arange(len(numbers))), whole.frames_of.read(numbers))


def test_frames_are_drawn_once(read, monkeypatch):
    first = read()

    class Never(PaintedPictures):
        def of(self, *_args, **_options):
            raise AssertionError("drawn again")

    monkeypatch.setattr(frames_module, "Pictures", Never)
    assert read().sha256 == first.sha256


@pytest.mark.parametrize("workers", [1, 2])
def test_resumed_is_undisturbed(read, tmp_path, monkeypatch, workers):
    read(frames=tmp_path / "whole")
    before, calls = durable.DurableFile.finish, []

    def finish(self):
        calls.append(1)
        if len(calls) > 1:
            raise OSError(errno.ENOSPC, "No space left on device")
        before(self)

    with monkeypatch.context() as patched:
        patched.setattr(durable.DurableFile, "finish", finish)
        with pytest.raises(StorageError, match="free disk space"):
            read(frames=tmp_path / "parts")
    assert len(files_of(tmp_path / "parts")) == 1
    told = []
    read(frames=tmp_path / "parts", workers=workers, on_drawn=lambda done, of: told.append((done, of)))
    assert told == [(1, 2), (2, 2)]
    assert files_of(tmp_path / "parts") == files_of(tmp_path / "whole")


def test_processes_that_train_together_wait_for_who_draws_and_others_are_refused(read, tmp_path, monkeypatch):
    frames = tmp_path / "frames"
    with ThreadPoolExecutor() as pool, RunLock(frames / LOCK_NAME):
        with pytest.raises(RunConflictError, match="another run"):
            read(frames=frames)
        monkeypatch.setenv("WORLD_SIZE", "2")
        told = []
        waiting = pool.submit(read, frames=frames, on_drawn=lambda done, of: told.append((done, of)))
        read(frames=tmp_path / "elsewhere")
        assert not waiting.done()
        for name, data in list(files_of(tmp_path / "elsewhere").items())[:1]:
            (frames / name).write_bytes(data)  # as the process that held the lock would
        kept = (frames / name).stat().st_mtime_ns
    assert waiting.result().sha256 == read(frames=frames).sha256
    assert told == [(0, 2), (1, 2), (2, 2)]
    assert (frames / name).stat().st_mtime_ns == kept
    assert files_of(frames) == files_of(tmp_path / "elsewhere")


@pytest.mark.parametrize("harm", ["cut", "flipped", "empty", "text", "deep"])
def test_a_damaged_file_is_drawn_again(read, tmp_path, harm):
    read(frames=tmp_path / "frames")
    good = files_of(tmp_path / "frames")
    for name, data in good.items():
        flipped = bytearray(data)
        flipped[-9] ^= 64
        deep = (50_000).to_bytes(8, "little") + b"[" * 50_000
        bad = {"cut": data[:-40], "flipped": bytes(flipped), "empty": b"", "text": b"frames " * 99, "deep": deep}[harm]
        (tmp_path / "frames" / name).write_bytes(bad)
        with pytest.raises(RecordError, match="damaged"):
            FrameStore.open([tmp_path / "frames" / name])
    read(frames=tmp_path / "frames")
    assert files_of(tmp_path / "frames") == good


def test_other_views_are_other_files_and_other_data(read, tmp_path):
    one = read(frames=tmp_path / "frames")
    other = read(frames=tmp_path / "frames", changes={"eyes": {**VIEWS, "size": 16}})
    assert one.sha256 != other.sha256
    assert len(files_of(tmp_path / "frames")) == 2 * len(TRIALS)


@given(st.integers(-7, 7), st.integers(-7, 7))
def test_a_shift_repeats_the_edges(down, right):
    picture = np.arange(8 * 8 * 3, dtype=np.uint8).reshape(8, 8, 3)
    rows, columns = (np.clip(np.arange(8) - moved, 0, 7) for moved in (down, right))
    wanted = picture[rows][:, columns]
    shift(picture, down, right)
    assert np.array_equal(picture, wanted)


def test_frames_are_packed_without_loss(tmp_path):
    draw = np.random.default_rng(0)
    still = np.repeat(draw.integers(0, 256, (1, 1, 16, 16, 3), dtype=np.uint8), 6, axis=0)
    still[3:, 0, 2:5] += 9
    frames = np.concatenate([still, draw.integers(0, 256, still.shape, dtype=np.uint8)], axis=1)
    path = tmp_path / "x.bin"
    path.write_bytes(frames_bytes(frames))
    assert np.array_equal(FrameStore.open([path, path]).read(np.array([9, 2, 0])), frames[[3, 2, 0]])
    assert path.stat().st_size < 0.8 * frames.nbytes
