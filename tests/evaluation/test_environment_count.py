"""The number of environments that a warm-up chooses, on a virtual clock."""

from __future__ import annotations

import statistics

import pytest
from tests.daily import others_slow
from tests.evaluation.closed_queue import Queue, Server

from betterbench.evaluation.workers.environment_count import LONGEST_QUEUE_S, EnvironmentCount, Window
from betterbench.evaluation.workers.worker import MAX_ENVS, MOST_CHOSEN, envs_between
from betterbench.sim.worlds import world_named

CHUNKS = 68


def ratio(kind: str, latency_s: float, *, envs: tuple[int, int] = (8, 48), at_once: int = 10**6, **options) -> float:
    """Return the median over some seeds of run ÷ max(policy, simulation), as in the row `policy` of `make bench`."""
    found = []
    for seed in range(3):
        queue = Queue(Server(latency_s, kind), envs=envs, **options)
        took_s, worked_s, _ = queue.run(seed)
        asked = queue.questions
        found.append(took_s / max(worked_s, latency_s * max(sum(asked) / at_once, *asked)))
    return statistics.median(found)


def chosen(kind: str, latency_s: float, **options) -> list[int]:
    return Queue(Server(latency_s, kind, **options), trials=200).run()[2]


@pytest.mark.parametrize("latency_s", others_slow([0.03, 0.1, 0.3], 3))
def test_a_run_takes_hardly_longer_than_its_simulation_or_its_policy(latency_s):
    assert ratio("free", latency_s) <= 1.05
    assert ratio("batches", latency_s, at_once=16, trials=96) <= 1.08
    # Trials of the two conditions of the row `policy` end after so many chunks.
    assert ratio("free", latency_s, chunks=(27, 66)) <= 1.12
    assert ratio("batches", latency_s, at_once=16, trials=96, chunks=(27, 66), worker_s=0.02) <= 1.12


def test_eight_environments_were_too_few():
    assert ratio("free", 0.1, envs=(8, 8)) > 1.08
    assert ratio("free", 0.3, envs=(8, 8)) > 2.0
    assert ratio("batches", 0.1, envs=(8, 8), at_once=16) > 1.8


@pytest.mark.parametrize(("latency_s", "least", "most"), [(0.002, 8, 8), (0.03, 8, 10), (0.1, 13, 26), (0.3, 36, 48)])
def test_about_twice_the_knee_is_chosen(latency_s, least, most):
    assert all(least <= number <= most for number in chosen("free", latency_s))


@pytest.mark.parametrize("latency_s", others_slow([0.03, 0.1, 0.3, 1.0], 4))
def test_a_server_that_answers_one_at_a_time_gets_no_longer_queue_for_long(latency_s):
    # One of several workers may take a larger share of the server, which costs nobody anything.
    assert Queue(Server(latency_s, "serial"), trials=200, workers=1).run()[2] == [8]
    assert min(chosen("serial", latency_s)) == 8
    assert ratio("serial", latency_s, at_once=1, trials=200) <= 1.02


def test_a_model_that_compiles_for_a_minute_does_not_decide():
    assert all(13 <= number <= 26 for number in chosen("free", 0.1, first_s=60.0))
    assert chosen("free", 0.002, first_s=60.0) == [8, 8]


def test_connections_that_break_at_the_beginning_do_not_decide():
    assert all(13 <= n <= 26 for n in Queue(Server(0.1), trials=200, unclean=20).run()[2])


def test_a_plan_without_enough_trials_is_run_as_it_began():
    took_s, _, numbers = Queue(Server(0.3), trials=6).run()
    assert numbers == [8, 8]
    assert took_s < 1.2 * CHUNKS * (0.3 + 0.015)


def test_no_trial_is_left_over_for_the_end():
    count = EnvironmentCount(8, 48, left=lambda: 20)
    feed(count, latency_s=0.1)
    assert count.number == 20, "19 are wanted, and one would be left"


def feed(count: EnvironmentCount, *, latency_s: float, worker_s: float = 0.015, answers: int = 60) -> None:
    """Answer questions one after the other, so that the worker has just enough to do."""
    before, now = count.number, 0.0
    for i in range(answers):
        now += worker_s
        count.worked(worker_s, on_setup=False)
        count.answered(i % before, asked_at=now - latency_s, now=now, took_s=latency_s, clean=True)
        if count.number != before:
            return


@pytest.mark.parametrize(("room", "number"), [(100, 20), (12, 12), (9, 8), (3, 8)])
def test_memory_and_a_settled_number_limit_it(room, number):
    count = EnvironmentCount(8, 48, room=lambda _: room)
    feed(count, latency_s=0.1)
    assert count.number == number
    fixed = EnvironmentCount(3, 3)
    feed(fixed, latency_s=0.3)
    assert (fixed.number, fixed.settled) == (3, True)


def test_a_queue_is_answered_before_the_deadline_even_one_by_one():
    count = EnvironmentCount(8, 1000)
    feed(count, latency_s=4.0, answers=400)
    assert count.number <= 8 * LONGEST_QUEUE_S / 4.0
    impatient = EnvironmentCount(8, 1000, longest_queue_s=0.1)
    feed(impatient, latency_s=0.1)
    assert impatient.number == 8


def test_a_policy_that_takes_no_further_connection_limits_it_for_good():
    count = EnvironmentCount(8, 48)
    feed(count, latency_s=0.1)
    assert count.number > 8
    count.limit(11)
    feed(count, latency_s=0.3, answers=500)
    assert (count.number, count.settled) == (11, True)


def test_a_window_says_how_long_the_worker_waited():
    window = Window(8, 0.1, 0.01, 50.0)
    assert window.idle == pytest.approx(0.5)
    assert window.wanted == 28


@pytest.mark.parametrize(
    ("envs", "workers", "world", "between"),
    [
        (1, 1, "betterbench", (1, 1)),
        (1, 40, "libero", (1, 1)),
        (8, 1, "betterbench", (8, 96)),
        (8, 2, "betterbench", (8, 48)),
        (8, 16, "betterbench", (2, 6)),
        (8, 256, "betterbench", (1, 1)),
        (8, 2, "libero", (2, 48)),
    ],
)
def test_all_workers_together_stay_within_what_a_server_takes(envs, workers, world, between):
    assert envs_between(envs, workers, world=world_named(world)) == between
    assert between[1] <= MAX_ENVS
    assert between[1] * min(workers, MOST_CHOSEN) <= MOST_CHOSEN
