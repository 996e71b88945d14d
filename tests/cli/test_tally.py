"""What `better eval` shows while it runs: pace, time left, successes, errors, and how the policy answers."""

from __future__ import annotations

import dataclasses
import json

import numpy as np
import pytest
from tests.evaluation.conftest import in_few_steps
from websockets.exceptions import ConnectionClosedError

from betterbench.cli.main import main
from betterbench.cli.tally import RunTally, duration, pace, service_text
from betterbench.errors import RecordError
from betterbench.evaluation import Progress
from betterbench.evaluation.running.summary import policy_service
from betterbench.policies.clients.connection import ConnectionLimits, PolicyConnection
from betterbench.policies.serving.server import PolicyServer
from betterbench.records import JournalEntry, RunFolder, read_outcome, read_record
from betterbench.tasks.trial import Trial


def progress(done: int, planned: int, elapsed_s: float, *, started_with: int = 0) -> Progress:
    return Progress(done, planned, elapsed_s, started_with, None)


@pytest.mark.parametrize(
    ("state", "text"),
    [
        (progress(0, 100, 0.0), ""),
        (progress(40, 100, 12.0, started_with=40), ""),
        (progress(10, 100, 60.0), "10/min, 9 min left"),
        (progress(50, 100, 60.0, started_with=40), "10/min, 5 min left"),
        (progress(1, 1200, 40.0), "1.5/min, 13 h 19 min left"),
        (progress(100, 100, 30.0), "200/min, 0 s left"),
    ],
)
def test_pace_counts_this_session_only(state, text):
    assert pace(state) == text


@pytest.mark.parametrize(
    ("seconds", "text"), [(0.2, "0 s"), (89.4, "89 s"), (90.0, "2 min"), (5399.0, "1 h 30 min"), (7260.0, "2 h 01 min")]
)
def test_durations_are_for_people(seconds, text):
    assert duration(seconds) == text


def entry(seed: int, **wall: float) -> JournalEntry:
    return JournalEntry("morning_coffee", "T1", "T1", seed, wall=wall)


class Flaky:
    """A channel of a server that loses the connection twice before it answers."""

    failures = 2

    def close(self):
        pass

    def answer(self, timeout_s):
        if Flaky.failures:
            Flaky.failures -= 1
            raise ConnectionError("reset by peer")
        return timeout_s


def test_service_says_how_the_policy_answered():
    """The figures are those that a connection writes, under its own names."""
    Flaky.failures = 2
    connection = PolicyConnection("a flaky server", lambda _: Flaky(), ConnectionLimits(timeout_s=5.0, seed=1))
    connection.request(lambda channel, timeout_s: channel.answer(timeout_s))
    figures = connection.figures
    assert figures["policy_retries"] == 2.0
    connection.count_anew()
    connection.request(lambda channel, timeout_s: channel.answer(timeout_s))
    entries = [
        entry(0, policy_latency_p50_s=0.1, policy_latency_max_s=0.2, policy_s=10.0, **figures),
        entry(1, policy_latency_p50_s=0.12, policy_latency_max_s=3.4, policy_s=20.0, **connection.figures),
        entry(2, policy_latency_p50_s=0.14, policy_latency_max_s=0.3, policy_s=10.0),
        entry(3),
    ]
    text = service_text(policy_service(entries, 20.0))
    assert text == "120 ms per answer (slowest 3400 ms), 2.0 simultaneous requests on average, 2 retries, 2 reconnects"
    assert service_text(policy_service([entry(0)], 1.0)) == ""
    quick = service_text(policy_service([entry(0, policy_latency_p50_s=1e-5)], 1.0))
    assert quick == "under 1 ms per answer (slowest under 1 ms)"


class FailsOnce:
    """Answers with an action that holds still; the first request of all drops the connection."""

    failed = False

    def answer(self, _request):
        if not FailsOnce.failed:
            FailsOnce.failed = True
            raise ConnectionClosedError(None, None)
        return {"actions": np.array([[0.0] * 6 + [-1.0]] * 50)}

    def close(self):
        pass


@pytest.fixture(scope="module")
def short_trials():
    """Ends trials after 24 steps, because only the answers of the policy matter here."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Trial, "resolve", in_few_steps(24))
        yield


@pytest.mark.usefixtures("short_trials")
def test_retries_of_a_run_are_shown(tmp_path, capsys):
    """A run against a local server that loses one request."""
    FailsOnce.failed = False
    with PolicyServer(FailsOnce, metadata={}, port=0) as server:
        address = f"{server.address}?preset=openpi_libero"
        arguments = ["--policy", address, "--tasks", "morning_coffee", "--variations", "T1", "--trials", "1"]
        arguments += ["--quality", "fast", "--workers", "1", "--envs", "1", "--out", str(tmp_path / "run")]
        assert main(["eval", *arguments]) == 0
    assert ", 1 retry, 1 reconnect" in " ".join(capsys.readouterr().err.split())


@pytest.fixture(scope="module")
def run(short_trials, tmp_path_factory):
    folder = tmp_path_factory.mktemp("tally")
    (folder / "plugin.py").write_text(
        "import numpy as np\n"
        "from betterbench.interface import PolicyInfo, episode_number\n"
        "class Policy:\n"
        "    info = PolicyInfo('sometimes', needs_images=False)\n"
        "    def reset(self, start):\n"
        "        self.last = start.episode == episode_number(1)\n"
        "    def act(self, observation):\n"
        "        if self.last:\n"
        "            raise RuntimeError('out of memory')\n"
        "        return np.zeros(7)\n",
        encoding="utf-8",
    )
    arguments = ["--policy", f"python:{folder / 'plugin.py'}:Policy", "--tasks", "morning_coffee"]
    arguments += ["--variations", "T1", "--trials", "2", "--observation", "state_only", "--workers", "1"]
    assert main(["eval", *arguments, "--envs", "2", "--out", str(folder / "run")]) == 0
    return folder / "run"


def test_a_tally_is_that_of_the_records(run):
    folder = RunFolder.open(run)
    tally = RunTally()
    tally.resume(folder)
    records = list(folder.records())
    assert tally.judged == len(records) == 4
    assert tally.successes == sum(r.outcome.success for r in records)
    assert tally.policy_errors == 2
    tally.add(folder, dataclasses.replace(entry(0), status="error", message="no memory"))
    assert tally.broken == 1
    note = tally.note(progress(4, 8, 60.0))
    assert note == f"4.0/min, 60 s left · {tally.successes}/4 succeeded · 2 errors · 1 could not be run"


def test_better_eval_ends_with_how_the_policy_answered(run, capsys, monkeypatch):
    monkeypatch.setattr("betterbench.cli.verbs.evaluate.LOG_EVERY_S", 0.0)
    policy = json.loads((run / "run.json").read_bytes())["plan"]["policy"]
    (run / "journal.jsonl").write_text(
        "".join(f"{line}\n" for line in (run / "journal.jsonl").read_text(encoding="utf-8").splitlines()[:3]),
        encoding="utf-8",
    )
    arguments = ["--policy", policy, "--tasks", "morning_coffee", "--variations", "T1", "--trials", "2"]
    assert main(["eval", *arguments, "--observation", "state_only", "--workers", "1", "--out", str(run)]) == 0
    shown = capsys.readouterr()
    assert "per answer (slowest" in shown.err
    assert "\n4/4 trials · " in shown.err, "a log has lines where a terminal has a bar"
    assert "success" in shown.out


def test_an_outcome_is_read_without_the_rest(run):
    folder = RunFolder.open(run)
    for e in folder.entries():
        path = folder.record_path(e.task, e.condition, e.seed)
        assert read_outcome(path) == read_record(path).outcome


def test_a_damaged_record_has_no_outcome(run, tmp_path):
    with pytest.raises(RecordError, match="record does not exist"):
        read_outcome(tmp_path / "none.parquet")
    data = bytearray(next((run / "records").rglob("*.parquet")).read_bytes())
    data[len(data) // 2] ^= 1
    (tmp_path / "bad.parquet").write_bytes(bytes(data))
    with pytest.raises(RecordError, match="digest"):
        read_outcome(tmp_path / "bad.parquet")
