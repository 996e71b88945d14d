"""The premise check of all initial states: what is broken is named, and what is known is not run again."""

import json
from dataclasses import replace

import pytest
from tests.looping import each

from betterbench.errors import InvalidInputError
from betterbench.json_form import sealed_lines
from betterbench.sim.worlds import WorldError, WorldProcess
from betterbench.sim.worlds.installation import Installation
from betterbench.sim.worlds.premises import PremiseEntry, check_premises, entries_bytes, read_entries


def test_broken_states_and_jumps_are_named(fake_command):
    with WorldProcess(fake_command) as process:
        first = next(check_premises(process, "libero_object"))
    assert (first.task, first.states, first.broken_states) == (0, 50, (40,))
    assert first.broken == {"on(cube_1, tray_1)": [40]}
    assert first.jumps == {"plate_1": [2]}


def test_a_simulator_that_fails_is_an_error(fake_command):
    with WorldProcess(fake_command) as process, pytest.raises(WorldError, match="the tray is gone"):
        list(check_premises(process, "libero_object"))


def test_what_is_known_for_this_engine_is_not_run_again(fake_command, monkeypatch):
    with WorldProcess(fake_command) as process:
        first = next(check_premises(process, "libero_object"))
        monkeypatch.setattr(WorldProcess, "premises", lambda *_: pytest.fail("it was asked again"))
        assert next(check_premises(process, "libero_object", known=[first])) == first
        other = replace(first, engine={"fake": "another"})
        with pytest.raises(pytest.fail.Exception):
            next(check_premises(process, "libero_object", known=[other]))


def test_the_command_goes_on_where_it_was_interrupted(fake_command, tmp_path, monkeypatch, capsys):
    from betterbench.cli.verbs.premise import premise_command

    monkeypatch.setattr(Installation, "command", lambda _: fake_command)
    out = tmp_path / "premises.jsonl"
    for _ in range(2):
        with pytest.raises(WorldError):
            premise_command("libero", suites=("libero_object",), out=out)
        assert [e.task for e in read_entries(out)] == list(range(7))
    assert "libero_object task 6: 1 of 50 states broken" in capsys.readouterr().err


ENTRY = {
    "suite": "libero_object",
    "task": 0,
    "instruction": "pick up the soup",
    "states": 50,
    "broken": {"on(cube_1, tray_1)": [40]},
    "jumps": {},
    "engine": {"fake": "1"},
    "bddl_sha256": "0" * 64,
}


@each("field", ENTRY)
@each("value", [None, True, 1.5, -1, 10**400, "x", [], [[]], {"a": 5}, {"a": ["x"]}, ...])
def test_a_damaged_file_is_refused_with_a_cure(tmp_path, field, value):
    file = tmp_path / "p.jsonl"
    entry = {k: v for k, v in ENTRY.items() if k != field} if value is ... else {**ENTRY, field: value}
    file.write_bytes(sealed_lines(f"{json.dumps(ENTRY)}\n{json.dumps(entry)}\n".encode()))
    if (field, value) in (("suite", "x"), ("instruction", "x"), ("bddl_sha256", "x")):
        assert len(read_entries(file)) == 2
        return
    with pytest.raises(InvalidInputError, match=r"line 2.*--out") as caught:
        read_entries(file)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("text", ["[" * 100_000, "{", "\0", "5", "[]", '{"suite": 1}', '{"suite": "a", "suite": "b"}'])
def test_a_file_that_is_no_table_of_premises_is_refused(tmp_path, text):
    (tmp_path / "p.jsonl").write_bytes(sealed_lines(f"{text}\n".encode()))
    with pytest.raises(InvalidInputError, match=r"line 1.*--out"):
        read_entries(tmp_path / "p.jsonl")


def test_a_changed_table_is_refused_and_one_of_an_earlier_version_too(tmp_path):
    file = tmp_path / "p.jsonl"
    entries = [PremiseEntry(**{**ENTRY, "task": number}) for number in range(3)]
    file.write_bytes(entries_bytes(entries))
    assert read_entries(file) == tuple(entries)
    whole = file.read_bytes()
    lines = whole.splitlines(keepends=True)
    for changed in (whole.replace(b'"task": 1', b'"task": 9'), b"".join(lines[1:]), b"".join(lines[:-1]), whole[:-1]):
        file.write_bytes(changed)
        with pytest.raises(
            InvalidInputError, match=r"its last line is not a valid seal: .* Pass a different file with --out"
        ):
            read_entries(file)
