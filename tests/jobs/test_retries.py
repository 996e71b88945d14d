"""The retry ledger: what is done again, what is given up, and when the whole work ends."""

from __future__ import annotations

import pytest

from betterbench.errors import WorkerError
from betterbench.jobs import RetryLedger
from betterbench.jobs.retries import MAX_DEATHS, MAX_DEATHS_IN_A_ROW


def ledger(items=range(6)):
    return RetryLedger(items, workers="helpers", cure="Ask for fewer.")


def test_items_are_taken_in_order_and_put_back_in_front():
    book = ledger()
    assert book.take(2) == [0, 1]
    book.put_back([0, 1])
    assert (book.take(3), book.waiting, book.left) == ([0, 1, 2], 3, 3)
    assert book.take(99) == [3, 4, 5]
    assert book.left == 0


def test_the_items_of_a_worker_that_died_run_alone_and_only_the_one_to_blame_is_given_up():
    book = ledger()
    held, given_up, done = book.take(3), [], []
    assert book.worker_died(held, "SIGKILL") == []
    assert (book.suspects, book.waiting) == (3, 3)
    while book.suspects:
        item = book.take_suspect()
        if item == 1:
            given_up += book.worker_died([item], "SIGKILL")
        else:
            book.item_ended()
            done.append(item)
    assert (done, given_up) == ([0, 2], [1])
    assert book.reason("SIGKILL") == (
        f"{MAX_DEATHS} helpers died while running it (SIGKILL); run the same command again to retry it"
    )


def test_workers_that_die_one_after_the_other_end_the_work():
    book = ledger()
    for _ in range(MAX_DEATHS_IN_A_ROW - 1):
        assert book.worker_died([], "exit status 3") == []
    with pytest.raises(WorkerError, match=r"^12 helpers died one after another \(exit status 3\)\. Ask for fewer\.$"):
        book.worker_died([], "exit status 3")


def test_an_item_that_ends_or_is_given_up_begins_the_row_again():
    book = ledger()
    for i in range(4 * MAX_DEATHS_IN_A_ROW):
        book.worker_died([], "x")
        if i % (MAX_DEATHS_IN_A_ROW - 1) == 0:
            book.item_ended()
    book = ledger(["bad"] * 1)
    book.take(1)
    assert [book.worker_died(["bad"], "x") for _ in range(MAX_DEATHS)] == [[], [], ["bad"]]
    for _ in range(MAX_DEATHS_IN_A_ROW - 1):
        book.worker_died([], "x")
