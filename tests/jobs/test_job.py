"""Items of a resumable job: which are worked on, in which order, and what an interruption leaves."""

from __future__ import annotations

import functools
import multiprocessing
import signal
import threading
import time
from contextlib import contextmanager

import pytest

from betterbench.errors import InvalidInputError, RunConflictError, StorageError
from betterbench.jobs import JobProgress, counts, in_processes, in_threads, job_folder, run_items
from betterbench.jobs.conflict import require_free, require_same


def test_items_that_are_not_done_are_worked_on_once_and_reported():
    kept, told = {2: "old"}, []
    number = run_items(
        [1, 2, 3, 1],
        is_done=kept.__contains__,
        work=lambda waiting: ((item, "new") for item in reversed(waiting)),
        keep=lambda found: kept.update([found]),
        on_progress=told.append,
    )
    assert number == 2
    assert kept == {1: "new", 2: "old", 3: "new"}
    assert told == [JobProgress(1, 3, None), JobProgress(2, 3, (3, "new")), JobProgress(3, 3, (1, "new"))]


def test_an_error_while_a_result_is_kept_ends_the_work_at_once():
    ended = []

    def work(waiting):
        try:
            yield from waiting
        finally:
            ended.append(True)

    def full(_):
        raise StorageError("no space")

    with pytest.raises(StorageError):
        run_items([1, 2], is_done=lambda _: False, work=work, keep=full)
    assert ended == [True]


def test_the_numbers_alone_are_passed_on():
    told = []
    run_items("ab", is_done=lambda _: False, work=list, on_progress=counts(lambda *numbers: told.append(numbers)))
    assert told == [(0, 2), (1, 2), (2, 2)]
    assert counts(None) is None


class Resource:
    """A resource whose waiting work ends when it is stopped."""

    def __init__(self):
        self.stopped = threading.Event()

    def stop(self):
        self.stopped.set()


@contextmanager
def opened():
    yield Resource()


@pytest.mark.parametrize("workers", [1, 3, 8])
@pytest.mark.parametrize("in_order", [True, False])
def test_threads_yield_every_result_once(workers, in_order):
    def work(_, item):
        time.sleep(0.002 * (item % 3))
        return item

    found = list(in_threads(range(20), work, workers=workers, open_resource=opened, in_order=in_order))
    assert sorted(found) == list(range(20))
    if in_order or workers == 1:
        assert found == list(range(20))


def test_a_resource_is_not_stopped_when_all_items_have_ended():
    used = []

    def work(resource, item):
        used.append(resource)
        return item

    assert sorted(in_threads(range(5), work, workers=2, open_resource=opened)) == list(range(5))
    assert not any(resource.stopped.is_set() for resource in used)


def test_threads_in_order_begin_no_item_far_beyond_the_last_result():
    begun = []

    def work(resource, item):
        begun.append(item)
        if item == 0:
            resource.stopped.wait(0.3)
        return item

    found = in_threads(range(20), work, workers=3, open_resource=opened, in_order=True)
    assert next(found) == 0
    assert set(begun) <= {0, 1, 2}
    assert list(found) == list(range(1, 20))


@pytest.mark.parametrize("in_order", [True, False])
def test_an_error_in_a_thread_stops_the_others_and_is_raised(in_order):
    begun = []

    def work(resource, item):
        begun.append(item)
        if item == 1:
            raise StorageError("no space")
        assert resource.stopped.wait(60.0)

    with pytest.raises(StorageError, match="no space"):
        list(in_threads(range(20), work, workers=2, open_resource=opened, in_order=in_order))
    assert sorted(begun) == [0, 1]


@pytest.mark.parametrize("in_order", [True, False])
def test_threads_end_when_their_results_are_no_longer_wanted(in_order):
    begun = []

    def work(resource, item):
        begun.append(item)
        if item:
            assert resource.stopped.wait(60.0)
        return item

    found = in_threads(range(20), work, workers=2, open_resource=opened, in_order=in_order)
    assert next(found) == 0
    found.close()
    assert len(begun) <= 3


def test_a_number_of_threads_out_of_range_is_refused():
    with pytest.raises(InvalidInputError, match="--workers"):
        list(in_threads([], lambda *_: None, workers=0, open_resource=opened))


def test_a_folder_of_a_job_has_one_writer_and_is_missed_at_the_end(tmp_path):
    place = tmp_path / "job"
    with job_folder(place):
        (place / ".a.txt.abcdefgh.part").write_text("half")
        with pytest.raises(RunConflictError, match="another run"), job_folder(place):
            pass
    with job_folder(place):
        assert [p.name for p in place.iterdir()] == [".lock"]
    with pytest.raises(StorageError, match="was removed or moved"), job_folder(place):
        place.rename(tmp_path / "moved")


def test_a_folder_with_other_files_or_another_job_is_refused(tmp_path):
    place = tmp_path / "job"
    require_free(place, "run", file="run.json")
    place.mkdir()
    (place / ".lock").touch()
    require_free(place, "run", file="run.json")
    (place / "notes.txt").touch()
    with pytest.raises(RunConflictError, match="the folder contains other files but no run"):
        require_free(place, "run", file="run.json")
    with pytest.raises(RunConflictError, match="this is a file"):
        require_free(place / "notes.txt", "run", file="run.json")
    (place / "run.json").touch()
    require_free(place, "run", file="run.json")
    same = functools.partial(require_same, place, {"a": {"b": 1}}, what="run", where="plan", cures={"c": "Try c"})
    same(asked={"a": {"b": 1}})
    with pytest.raises(
        RunConflictError,
        match=r"contains a different run: plan\.a\.b is 1 in the folder but 2 in the request\. Use the same",
    ):
        same(asked={"a": {"b": 2}})
    with pytest.raises(
        RunConflictError, match=r"plan\.c is absent in the folder but 3 in the request\. Try c, or choose"
    ):
        same(asked={"a": {"b": 1}, "c": 3})


def test_ctrl_c_while_workers_start_is_for_the_first_process_alone():
    """A worker that was interrupted while it imported printed a traceback; the mask is that of its first moment."""
    items = [(signal.SIGUSR1,), (signal.SIGUSR2,)]  # which the work blocks, to return what was blocked before
    blocked = list(in_processes(items, functools.partial(signal.pthread_sigmask, signal.SIG_BLOCK), workers=2))
    assert all(signal.SIGINT in before for before in blocked)
    assert signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, ())


def test_what_workers_are_at_is_not_waited_for_once_the_command_ends():
    """Ctrl-C, or a full disk, ended a command only when each worker had ended its trial."""
    found = in_processes([0.0, 60.0, 61.0], time.sleep, workers=2)
    next(found)
    found.close()
    until = time.monotonic() + 10.0
    while multiprocessing.active_children() and time.monotonic() < until:
        time.sleep(0.05)
    assert not multiprocessing.active_children()
