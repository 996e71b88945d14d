"""A peer's figure is believed only if its images are new at every step and two processes agree on it."""

from __future__ import annotations

import importlib
import sys
import textwrap
from pathlib import Path

import pytest
from tests.daily import others_slow

from betterbench.episodes import POLICY_BOUNDARY

BENCHMARKS = Path(__file__).resolve().parents[2] / "benchmarks"

FAKE = f"""
import sys, types
from pathlib import Path
sys.path.insert(0, {str(BENCHMARKS)!r})
import numpy as np
import peer_loop
from peer_loop import serve

CLOCK = [0.0]  # what a step takes does not depend on the machine
peer_loop.time = types.SimpleNamespace(perf_counter=lambda: CLOCK[0])

STARTS = Path(__file__).with_name("starts")
START = len(STARTS.read_text()) if STARTS.exists() else 0
STARTS.write_text("." * (START + 1))

COLUMNS = np.arange(256)[None, :, None]

class Fake:
    steps = 0

    def make(self, *, everything):
        print("words of a package on standard output")

    def reset(self):
        return self.step(None)

    def step(self, draw):
        self.steps += 1
        CLOCK[0] += SECONDS[START]
        shift = 0 if FROZEN[START] else self.steps
        front = np.broadcast_to((COLUMNS + shift) % 256, (256, 256, 3)).astype(np.uint8)
        return {{"front": self.front(front), "wrist": front if SWAPPED else front[:, ::-1] // 2 + self.steps % 64}}

    def front(self, image):
        return image

    def versions(self):
        return {{"fake": "1.0"}}

SECONDS, FROZEN, SWAPPED = (0.002,) * 9, (False,) * 9, False
"""


@pytest.fixture
def peer(monkeypatch):
    monkeypatch.syspath_prepend(BENCHMARKS)
    return importlib.import_module("peer")


@pytest.fixture
def rows(monkeypatch, peer):
    """The rows of the peers, without an episode: ours takes 1 ms a step."""
    module = importlib.import_module("peer_rows")
    pacing = importlib.import_module("pacing")

    def play(_rehearsal, reference, *, every, limit, observer):
        mind = pacing.PacedMind([], reference, every, limit)
        for first in range(0, limit, every):
            mind.own_s.append(0.001 * every)
            mind.reference_s.append(reference(first, first + every))
        return mind

    monkeypatch.setattr(module, "rehearse", lambda *_: None)
    monkeypatch.setattr(module, "play", play)
    monkeypatch.setattr(module, "installed", lambda _: Path(sys.executable))
    return module


@pytest.fixture
def script(tmp_path):
    """Write a peer's script; its lines replace what the fake would do."""

    def write(lines: str = "", *, after: str = "serve(Fake())") -> Path:
        path = tmp_path / "fake_peer.py"
        path.write_text(FAKE + textwrap.dedent(lines) + "\n" + textwrap.dedent(after) + "\n", encoding="utf-8")
        return path

    return write


@pytest.fixture
def compared(rows, peer, script):
    """Run a row against a peer's script and return its figures, for both qualities."""

    def run(lines: str = "", **options):
        rows.LIBERO = peer.PeerPackage("LIBERO", script(lines, **options))
        fast, standard = rows.PeerRows().libero(quick=True)
        return fast, standard

    return run


# ---------------------------------------------------------------------------------------------------------- the process


def test_a_peer_that_draws_has_its_figures(peer, script):
    with peer.Peer(script(), python=Path(sys.executable)) as fake:
        fake.make(everything=False)
        assert fake.versions == {"fake": "1.0"}
        assert fake.step(3) == pytest.approx(0.006)
        assert fake.reset() == pytest.approx(0.002)
        assert fake.take_doubt() == ""


@pytest.mark.parametrize(
    ("lines", "doubt"),
    [
        ("FROZEN = (True,) * 9", "front did not change in 4 of 4 measurements"),
        ("Fake.front = lambda self, image: np.zeros_like(image)", "front was of one color in 4 of 4 measurements"),
        (
            "Fake.front = lambda self, image: np.random.default_rng().integers(0, 256, image.shape, np.uint8)",
            "front was noise in 4 of 4 measurements",
        ),
        ("SWAPPED = True", "front did not change in 4 of 4 measurements, wrist did not change in 4 of 4 measurements"),
    ],
)
def test_images_that_do_not_change_or_show_nothing_are_said(peer, script, lines, doubt):
    with peer.Peer(script(lines), python=Path(sys.executable)) as fake:
        fake.make(everything=False)
        fake.step(3)
        fake.reset()
        assert fake.take_doubt() == doubt
        assert fake.take_doubt() == ""


@pytest.mark.parametrize(
    ("after", "reason"),
    [
        ("raise ImportError('no EGL device')", "status 1 on 'make': ImportError: no EGL device"),
        ("import os; os.kill(os.getpid(), 9)", "status -9 on 'make'"),
        ("print('Hello from a package')", "no answer to 'make' as agreed, but 'Hello from a package'"),
        ("print('[]')", "no answer to 'make' as agreed"),
        ("print('{}')", "no answer to 'make' as agreed"),
        ('print(\'{"seconds": [0.1], "images": [{}], "versions": {}}\')', "no answer to 'make' as agreed"),
        ('print(\'{"seconds": [NaN], "images": [{"a": "b"}], "versions": {}}\')', "no answer to 'make' as agreed"),
        ('print(\'{"seconds": [-1.0], "images": [{"a": "b"}], "versions": {}}\')', "no answer to 'make' as agreed"),
        ('print(\'{"seconds": [], "images": [], "versions": {}}\')', "no answer to 'make' as agreed"),
        ('print(\'{"seconds": [0.1], "images": [{"a": "b"}]}\')', "no answer to 'make' as agreed"),
        ("sys.stdout.write('x' * 2_000_000); sys.stdout.flush(); time.sleep(60)", "no answer to 'make' as agreed"),
        ("sys.stdout.write('half'); sys.stdout.flush(); time.sleep(60)", "no answer to 'make' within 1 s"),
    ],
)
def test_a_process_that_dies_or_talks_nonsense_is_named(peer, script, after, reason):
    path = script(after=after)
    path.write_text("import sys, time\n" + path.read_text(encoding="utf-8").removeprefix(FAKE), encoding="utf-8")
    with (
        peer.Peer(path, python=Path(sys.executable), answer_limit_s=1.0 if "within" in reason else 180.0) as fake,
        pytest.raises(peer.PeerUnavailableError) as caught,
    ):
        fake.make(everything=False)
    assert reason in str(caught.value)


def test_an_environment_that_cannot_be_built_is_no_peer(peer, monkeypatch, tmp_path):
    uv = tmp_path / "uv"
    uv.write_text("#!/bin/sh\necho 'No solution found: fake was not found in the registry' >&2\nexit 1\n")
    uv.chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}:/bin:/usr/bin")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    with pytest.raises(peer.PeerUnavailableError, match=r"uv venv failed: No solution found"):
        peer.installed(peer.ROBOSUITE)


# ----------------------------------------------------------------------------------------------------------- the blocks


@pytest.mark.parametrize(
    ("seconds", "pair"),
    [
        ((0.30, 0.31), (0, 1)),
        ((0.30, 0.39), (0, 1)),
        ((0.30, 0.40), None),
        ((0.029, 0.30, 0.31), (1, 2)),
        ((0.30, 0.029, 0.31), (0, 2)),
        ((0.03, 0.1, 0.3), None),
        ((0.30,), None),
        ((), None),
        ((0.30, -0.31, 0.31), (0, 2)),
        ((-0.30, -0.31, 0.31), None),
    ],
)
def test_two_blocks_agree_or_none_is_believed(peer, seconds, pair):
    """A negative number stands for a block whose images did not change."""
    blocks = [peer.Block((0.01,), (abs(s),), "front did not change" if s < 0 else "") for s in seconds]
    assert peer.agreeing(blocks) == (None if pair is None else tuple(blocks[i] for i in pair))


# ------------------------------------------------------------------------------------------------------------- the rows


def test_a_row_divides_what_two_processes_agree_on(compared):
    fast, standard = compared()
    assert (fast.row, fast.text, fast.bound) == ("libero-rgb", "two cameras, colors, fast_food, fast", 10.0)
    assert standard.bound == 4.0
    assert fast.values == pytest.approx((2.0,) * 6)
    assert fast.note == "1e+03 [1e+03-1e+03] / 500 [500-500] steps/s"


@pytest.mark.parametrize(
    ("lines", "believed", "said"),
    others_slow(
        [
            ("FROZEN = (True,) * 9", False, "front did not change in 3 of 3 measurements"),
            ("SECONDS = (0.002, 0.02, 0.1)", False, "of 3 processes no two agree"),
            ("SECONDS = (0.002, 0.03, 0.03)", True, "not believed and left out: 0.002 s"),
            ("FROZEN = (True, False, False)", True, "left out: 0.002 s (front did not change in 3 of 3 measurements)"),
        ],
        2,
    ),
)
def test_a_row_that_cannot_be_believed_gives_no_ratio(compared, lines, believed, said):
    for figure in compared(lines):
        assert bool(figure.values) is believed
        assert said in figure.note
        if not believed:
            assert figure.reached is None
            assert "peer not believed" in figure.note


def test_a_peer_that_dies_in_the_middle_of_a_row_gives_no_ratio(compared):
    die = """
    class Dying(Fake):
        def step(self, draw):
            if self.steps == 5:
                raise RuntimeError("GL context lost")
            return super().step(draw)
    """
    for figure in compared(die, after="serve(Dying())"):
        assert figure.values == ()
        assert figure.note.startswith("peer not available: its process has ended with status 1 on 'step'")
        assert "GL context lost" in figure.note


def test_what_fails_in_the_reference_is_not_taken_for_the_policys_fault(monkeypatch, peer):
    pacing = importlib.import_module("pacing")

    def run_episode(_scene, policy, **_):
        while True:
            with POLICY_BOUNDARY:
                policy.act(None)

    def reference(_first, _last):
        raise peer.PeerUnavailableError("it died")

    class Rehearsal:
        scene, actions = None, [[0.0] * 7] * 9

    monkeypatch.setattr(pacing, "run_episode", run_episode)
    with pytest.raises(peer.PeerUnavailableError, match="it died"):
        pacing.play(Rehearsal, reference, every=2, limit=8, observer=None)
