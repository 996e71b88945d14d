"""The link that all clients share: pauses, patience and terms, without a socket."""

from __future__ import annotations

import pytest

from betterbench.errors import HandshakeError, InvalidInputError, PolicyError, PolicyUnavailableError
from betterbench.policies.clients import connection as connection_module
from betterbench.policies.clients.connection import FIRST_PAUSE_S, LONGEST_PAUSE_S, ConnectionLimits, PolicyConnection
from betterbench.policies.kinds import read_address


class Wire:
    """A connection that counts how often it was closed."""

    def __init__(self):
        self.closed = 0

    def close(self):
        self.closed += 1


def made(terms, *, fail=0, error=None):
    """Return a link whose first dials fail, its connections, and the pauses that it would have made."""
    wires, pauses, failures = [], [], [error or ConnectionRefusedError("refused")] * fail

    def dial(timeout_s):
        if failures:
            raise failures.pop()
        wires.append(Wire())
        return wires[-1]

    link = PolicyConnection("the server", dial, terms)
    link._closed.wait = pauses.append
    return link, wires, pauses


def raised(error):
    raise error


def broken(_, __):
    raise ConnectionResetError("gone")


def test_pauses_double_up_to_a_limit_with_a_jitter_that_a_seed_repeats():
    def pauses(seed):
        link, wires, slept = made(ConnectionLimits(patience_s=1e6, seed=seed), fail=12)
        assert link.open() is wires[0]
        return slept

    first = pauses(1)
    assert first == pauses(1)
    assert first != pauses(2)
    assert len(first) == 12
    for i, pause in enumerate(first):
        longest = min(LONGEST_PAUSE_S, FIRST_PAUSE_S * 2**i)
        assert 0.5 * longest <= pause <= longest


def test_patience_ends(monkeypatch):
    now = [0.0]
    monkeypatch.setattr(connection_module.time, "monotonic", lambda: now[0])
    link, _, pauses = made(ConnectionLimits(patience_s=3.0), fail=1000)

    def sleep(seconds):
        pauses.append(seconds)
        now[0] += seconds

    link._closed.wait = sleep
    with pytest.raises(PolicyUnavailableError, match=r"could not be reached for 3 s \(refused"):
        link.open()
    assert 3.0 <= now[0] <= 3.0 + LONGEST_PAUSE_S


def test_a_handshake_that_fails_is_not_tried_again():
    link, _, pauses = made(ConnectionLimits(), fail=1, error=HandshakeError("they differ"))
    with pytest.raises(HandshakeError, match="they differ"):
        link.open()
    assert not pauses


def test_every_broken_connection_is_closed_and_counted():
    link, wires, pauses = made(ConnectionLimits(retries=3))
    with pytest.raises(PolicyError, match=r"failed to answer 4 times\. Last reason: gone"):
        link.request(broken)
    assert [wire.closed for wire in wires] == [1] * 4
    assert len(pauses) == 3
    assert link.figures == {"policy_requests": 1.0, "policy_retries": 3.0, "policy_reconnects": 3.0}
    assert link.request(lambda *_: "fine") == "fine"
    link.count_anew()
    assert set(link.figures.values()) == {0.0}


def test_a_connection_that_works_is_kept():
    link, wires, _ = made(ConnectionLimits())
    for _ in range(3):
        link.request(lambda *_: None)
    assert len(wires) == 1
    link.close()
    assert wires[0].closed == 1
    with pytest.raises(PolicyError, match="was closed"):
        link.request(lambda *_: None)


def test_the_long_deadline_is_for_the_first_reply_and_spent_once():
    link, _, _ = made(ConnectionLimits(timeout_s=2.0, warmup_s=50.0, retries=1))
    given = []

    def note(_, deadline):
        given.append(deadline)

    def late(_, deadline):
        given.append(deadline)
        raise TimeoutError

    link.request(note, replies=False)
    with pytest.raises(PolicyError, match="no answer within 2 s"):
        link.request(late)
    link.request(note)
    assert given == [50.0, 50.0, 2.0, 2.0]


def test_the_long_deadline_comes_back_with_a_server_that_was_away():
    link, _, _ = made(ConnectionLimits(timeout_s=2.0, warmup_s=50.0, retries=1))
    given = []
    link.request(lambda _, deadline: given.append(deadline))
    link.drop()  # the connection alone broke
    link.request(lambda _, deadline: given.append(deadline))
    link.drop()
    dial, away = link._dial, [ConnectionRefusedError("refused")]
    link._dial = lambda timeout_s: dial(timeout_s) if not away else raised(away.pop())
    link.request(lambda _, deadline: given.append(deadline))
    link.request(lambda _, deadline: given.append(deadline))
    assert given == [50.0, 2.0, 50.0, 2.0]


def test_terms_that_make_no_sense_are_refused():
    for query, text in [
        ("timeout=0", "the deadline must be greater than 0"),
        ("timeout=1e9", "timeout=1e.09 is too large"),
        ("warmup=1e300", "warmup=1e.300 is too large"),
        ("patience=1e9", "patience=1e.09 is too large"),
        ("retries=1e9", "retries=1e.09 is too large"),
        ("retries=1.5", "must be a whole number"),
        ("patience=-1", "must be ≥ 0"),
        ("patience=nan", "patience: expected a number, got 'nan'"),
    ]:
        with pytest.raises(InvalidInputError, match=text):
            ConnectionLimits.of(read_address(f"openpi://host?{query}"))


def test_terms_come_from_the_address():
    usual = ConnectionLimits.of(read_address("openpi://host"), seed=4)
    assert usual == ConnectionLimits(timeout_s=30.0, warmup_s=300.0, retries=3, patience_s=60.0, seed=4)
    given = ConnectionLimits.of(read_address("openpi://host?timeout=2&retries=0&patience=0.5"))
    assert given == ConnectionLimits(timeout_s=2.0, warmup_s=2.0, retries=0, patience_s=0.5)
