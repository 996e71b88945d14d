"""What the pool of a run on Ray does with what Ray reports; Ray's processes and its clock are simulated here."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any

import pytest

from betterbench.errors import BetterError, InvalidInputError, PolicyUnavailableError, PremiseError, WorkerError
from betterbench.evaluation.ray_engine import pool, session
from betterbench.evaluation.ray_engine.cluster import PLACING_S, Cluster
from betterbench.evaluation.ray_engine.pool import ray_entries
from betterbench.evaluation.ray_engine.remote_worker import Delivery, Turn, versions_here
from betterbench.evaluation.ray_engine.session import RaySession
from betterbench.evaluation.trials.trial import WorkerSettings
from betterbench.jobs.retries import MAX_DEATHS_IN_A_ROW
from betterbench.records import JournalEntry
from betterbench.tasks.trial import Trial

pytestmark = pytest.mark.skipif(importlib.util.find_spec("ray") is None, reason="needs ray")


class _Errors:
    """The errors of Ray, which takes 0.3 s of CPU to import; every process of the tests imports this file."""

    def __getattr__(self, name: str) -> Any:
        if not name[:1].isupper():  # pytest looks for marks and fixtures while it collects
            raise AttributeError(name)
        return getattr(importlib.import_module("ray").exceptions, name)


errors = _Errors()

NEVER = float("inf")
TRIALS = tuple(Trial("fast_food", "T1", "T1", "T", "train", seed, "solve") for seed in range(2))


def raised(cause: Exception) -> Exception:
    """What Ray raises where a method of an actor has raised."""
    trace = f"Traceback (most recent call last):\n  File x\n{cause}"
    return errors.RayTaskError("f", trace, cause, "ray::RemoteWorker", 1, "127.0.0.1").as_instanceof_cause()


LOST = {
    "ActorDiedError": (),
    "ObjectLostError": ("00", None, "somewhere"),
    "OwnerDiedError": ("00", None, "somewhere"),
    "NodeDiedError": ("gone",),
    "OutOfMemoryError": ("too much",),
    "RaySystemError": ("what it answered cannot be read",),
}
"""Arguments of the errors that a lost worker raises, by their names."""


def lost(name: str) -> Exception:
    return getattr(errors, name)(*LOST[name])


@dataclass(eq=False)
class Call:
    """A call under way: what comes of it, and when [s]."""

    outcome: Any
    at: float


@dataclass
class Actor:
    """An actor as a test wants it.

    Attributes:
        placed: How long it takes until it has a place [s].
        loads: How long it loads what it needs, when it has one [s].
        works: How long one of its turns takes [s].
        prepared: What comes of preparing it, as a worker.
        fails: What comes of its first turn, if that is no trial that has ended.
        started: What comes of starting it, as a replica.
        up: What it answers when it is asked whether it serves.
    """

    placed: float = 0.0
    loads: float = 0.0
    works: float = 0.0
    prepared: Any = field(default_factory=versions_here)
    fails: Any = None
    started: Any = ("openpi://127.0.0.1:1", None)
    up: Any = True


class FakeRay:
    """Plays Ray: actors are made in the order in which a test lists them, and time passes while they are waited for."""

    exceptions = errors

    def __init__(self, *actors: Actor) -> None:
        self.now = 1000.0
        self.gone: Exception | None = None
        self._actors = iter(actors)
        self.alive: list[SimpleNamespace] = []

    def remote(self, **_: Any) -> Callable[[type], SimpleNamespace]:
        return lambda _: method(lambda *_: self._make())

    def _make(self) -> SimpleNamespace:
        actor = next(self._actors)
        ready = self.now + actor.placed
        fails = [actor.fails] if actor.fails else []

        def turn(trials: tuple[Trial, ...]) -> Call:
            entries = [JournalEntry(t.task, t.condition, t.variation, t.seed, "done", "") for t in trials]
            outcome = fails.pop() if fails else Turn(tuple(Delivery(entry, None) for entry in entries))
            return Call(outcome, self.now + actor.works)

        made = SimpleNamespace(
            __ray_ready__=method(lambda: Call(True, ready)),
            prepare=method(lambda _: Call(actor.prepared, ready + actor.loads)),
            start=method(lambda *_: Call(actor.started, ready + actor.loads)),
            is_up=method(lambda: Call(actor.up, self.now)),
            close=method(lambda: Call(None, self.now)),
            turn=method(turn),
        )
        self.alive.append(made)
        return made

    def wait(self, calls: list[Call], *, num_returns: int, timeout: float) -> tuple[list[Call], list[Call]]:
        if self.gone:
            raise self.gone
        until = min(self.now + timeout, sorted(call.at for call in calls)[num_returns - 1])
        self.now = max(self.now, until)
        done = [call for call in calls if call.at <= self.now][:num_returns]
        return done, [call for call in calls if call not in done]

    def get(self, call: Call, **_: Any) -> Any:
        assert call.at < NEVER
        self.now = max(self.now, call.at)
        if isinstance(call.outcome, Exception):
            raise call.outcome
        return call.outcome

    def kill(self, actor: SimpleNamespace) -> None:
        self.alive.remove(actor)
        if self.gone:
            raise self.gone

    def available_resources(self) -> dict[str, float]:
        return {"CPU": 0.0}


def method(call: Callable[..., Call]) -> SimpleNamespace:
    return SimpleNamespace(remote=call)


@pytest.fixture
def play(tmp_path, monkeypatch):
    """Returns a function that runs two trials on a played Ray and returns the lines of the journal."""
    (tmp_path / "run.json").write_text("{}", encoding="utf-8")
    settings = WorkerSettings(str(tmp_path), "mine", "ee_delta", "state_only", "fast", "panda", 1)

    def run(
        ray: FakeRay, *, replicas: int = 0, workers: int = 1, rounds: Iterable[Sequence[Trial]] = (TRIALS,)
    ) -> list[JournalEntry]:
        monkeypatch.setattr(pool, "time", SimpleNamespace(monotonic=lambda: ray.now))
        cluster = Cluster(replicas=replicas or 1)
        made = RaySession.__new__(RaySession)
        made.ray, made.cluster, made._workers, made._owned = ray, cluster, workers, False
        made.replica_gpus = lambda: 1.0
        folder = SimpleNamespace(path=tmp_path)
        try:
            return list(ray_entries(made, folder, settings, rounds, served=bool(replicas)))
        finally:
            assert not ray.alive, "every actor is ended"

    return run


def one_line(error: BetterError) -> str:
    text = str(error)
    assert "\n" not in text
    assert "Traceback" not in text
    return text


def seeds(entries: list[JournalEntry]) -> list[int]:
    assert {entry.status for entry in entries} == {"done"}
    return sorted(entry.seed for entry in entries)


def test_a_cluster_without_a_place_for_a_worker_is_named_in_time(play):
    ray = FakeRay(Actor(placed=NEVER))
    with pytest.raises(InvalidInputError, match=r"no free CPU core for a worker \(free: CPU 0\)"):
        play(ray)
    assert PLACING_S < ray.now - 1000.0 < PLACING_S + 10.0


def test_the_clock_begins_again_when_the_last_worker_has_died(play):
    ray = FakeRay(Actor(works=2 * PLACING_S, fails=errors.ActorDiedError()), Actor(placed=0.9 * PLACING_S))
    assert seeds(play(ray)) == [0, 1]


def test_the_clock_begins_again_when_all_workers_are_replaced_with_their_replica(play):
    noticed = Turn(problem=PolicyUnavailableError("no server"))
    ray = FakeRay(
        Actor(up=errors.ActorDiedError()),
        Actor(works=2 * PLACING_S, fails=noticed),
        Actor(loads=2 * PLACING_S),
        Actor(placed=0.9 * PLACING_S),
    )
    assert seeds(play(ray, replicas=1)) == [0, 1]


def test_a_place_that_is_not_found_again_is_named_too(play):
    ray = FakeRay(Actor(works=2 * PLACING_S, fails=errors.ActorDiedError()), Actor(placed=NEVER))
    with pytest.raises(InvalidInputError, match="no free CPU core for a worker"):
        play(ray)
    assert 3 * PLACING_S < ray.now - 1000.0 < 3 * PLACING_S + 10.0


def test_the_workers_stay_for_the_next_round_and_one_that_died_is_replaced(play):
    assert seeds(play(FakeRay(Actor()), rounds=[TRIALS[:1], TRIALS[1:]])) == [0, 1]
    ray = FakeRay(Actor(fails=errors.ActorDiedError()), Actor())
    assert seeds(play(ray, rounds=[TRIALS[:1], TRIALS[1:]])) == [0, 1]
    assert seeds(play(FakeRay(Actor(), Actor()), workers=2, rounds=[TRIALS[:1], [], TRIALS[1:]])) == [0, 1]


def test_a_worker_that_loads_for_long_has_its_place(play):
    assert seeds(play(FakeRay(Actor(loads=5 * PLACING_S)))) == [0, 1]


def test_one_worker_with_a_place_is_enough(play):
    ray = FakeRay(Actor(works=2 * PLACING_S), Actor(placed=NEVER))
    assert seeds(play(ray, workers=2)) == [0, 1]


def test_replicas_that_load_for_long_have_their_place(play):
    ray = FakeRay(Actor(loads=5 * PLACING_S), Actor(loads=7 * PLACING_S), Actor())
    assert seeds(play(ray, replicas=2)) == [0, 1]


def test_replicas_without_a_place_are_counted(play):
    ray = FakeRay(Actor(loads=5 * PLACING_S), Actor(placed=NEVER))
    with pytest.raises(InvalidInputError, match="no free resources for 1 of 2 replicas with 1 GPUs each"):
        play(ray, replicas=2)


@pytest.mark.parametrize("name", [*LOST, "FileNotFoundError"])
def test_what_a_lost_worker_was_at_is_done_again(play, name, caplog):
    error = lost(name) if name in LOST else raised(FileNotFoundError("no record"))
    assert seeds(play(FakeRay(Actor(fails=error), Actor()))) == [0, 1]
    assert "a worker of the cluster died" in caplog.text


def test_workers_that_are_lost_again_and_again_are_one_line(play):
    ray = FakeRay(*[Actor(prepared=lost("ActorDiedError"))] * MAX_DEATHS_IN_A_ROW)
    with pytest.raises(WorkerError, match="12 workers of the cluster died one after another") as caught:
        play(ray)
    one_line(caught.value)


def test_a_worker_that_raises_while_it_is_prepared_is_one_line(play):
    with pytest.raises(WorkerError, match="worker on the cluster cannot start: RuntimeError: CUDA out") as caught:
        play(FakeRay(Actor(prepared=raised(RuntimeError("CUDA out of memory.\nTried to allocate")))))
    assert "run the same command again" in one_line(caught.value)


def test_an_error_of_ours_is_raised_as_it_is(play):
    with pytest.raises(PremiseError, match=r"^a stranger stands in the slot$"):
        play(FakeRay(Actor(fails=raised(PremiseError("a stranger stands in the slot")))))


@pytest.mark.parametrize(
    ("outcome", "text"),
    [
        (
            lambda: raised(RuntimeError("CUDA out of memory")),
            "A replica cannot load mine: RuntimeError: CUDA out of memory",
        ),
        (lambda: lost("ActorDiedError"), r"A replica died while it loaded mine \(The actor died"),
        (lambda: raised(WorkerError("no disk")), "^no disk$"),
        (lambda: ("", WorkerError("no weights")), "^no weights$"),
    ],
)
def test_a_replica_that_cannot_load_is_one_line(play, outcome, text):
    with pytest.raises(WorkerError, match=text) as caught:
        play(FakeRay(Actor(), Actor(started=outcome())), replicas=2)
    one_line(caught.value)


@pytest.mark.parametrize(
    "error", [lambda: errors.RaySystemError("no raylet\nat all"), lambda: ConnectionError("no channel")]
)
def test_a_cluster_that_is_gone_is_one_line(play, error):
    ray = FakeRay(Actor())
    ray.gone = error()
    with pytest.raises(WorkerError, match="The Ray cluster no longer answers") as caught:
        play(ray)
    one_line(caught.value)


def test_a_cluster_that_is_gone_before_the_run_is_one_line(monkeypatch):
    def gone():
        raise errors.RaySystemError("no raylet")

    ray = SimpleNamespace(exceptions=errors, is_initialized=lambda: True, cluster_resources=gone)
    monkeypatch.setattr(session, "import_ray", lambda: ray)
    with RaySession(Cluster("local"), None) as connected, pytest.raises(WorkerError, match="no longer answers"):
        assert connected.workers


@pytest.mark.parametrize(
    ("error", "expected"), [(KeyboardInterrupt(), KeyboardInterrupt), (ValueError("odd"), InvalidInputError)]
)
def test_what_was_half_started_is_ended(monkeypatch, error, expected):
    ended: list[str] = []

    def init(*arguments, **options):
        raise error

    ray = SimpleNamespace(is_initialized=lambda: False, init=init, shutdown=lambda: ended.append("all"))
    monkeypatch.setattr(session, "import_ray", lambda: ray)
    with pytest.raises(expected), RaySession(Cluster("local"), 1):
        pass
    assert ended == ["all"]
