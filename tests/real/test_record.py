"""The folder of a protocol: what is complete stays, what was cut off is marked, and damage is named."""

import dataclasses
import json
import shutil

import numpy as np
import pytest

from betterbench.errors import InvalidInputError, RecordError, RunConflictError, UnknownNameError
from betterbench.real.outcomes import OUTCOMES
from betterbench.real.plan import RealPolicy, make_plan, write_plan
from betterbench.real.record import (
    ENTRIES_NAME,
    HEADER_NAME,
    JOURNAL_NAME,
    SAMPLES_NAME,
    Film,
    RealJournal,
    Samples,
    TrialHeader,
    enter,
    read_run,
    repeat_damaged,
    write_attempt,
)


def samples_of(steps):
    arm = np.arange(6.0 * steps).reshape(steps, 6)
    asked = arm + 1.0
    asked[-1] = np.nan
    late = np.arange(steps) % 2 == 0
    return Samples(np.arange(steps) / 20.0, arm, arm + 0.5, asked, np.full((steps, 6), np.nan), late, ~late)


def header_of(code, attempt, steps):
    return TrialHeader(
        1, code, attempt, "mock", "Put the lemon into the fruit basket.", "degrees", 20.0, "2026-11-29T10:00:00+00:00",
        "time_limit", steps, 1, 1, 2, {"front": Film(64, 48, steps)}, {},
    )  # fmt: skip


def run_one(journal, code, steps=4):
    folder = journal.begin(code)
    attempt = journal.state(code).attempt
    write_attempt(folder, header_of(code, attempt, steps), samples_of(steps), {"front": b"a film"})
    journal.end(code, "time_limit")


@pytest.fixture
def folder(tmp_path):
    write_plan(tmp_path, make_plan((RealPolicy("a", "noop"), RealPolicy("b", "random")), conditions=["O1", "T1"]))
    return tmp_path


@pytest.fixture
def codes(folder):
    return [t.code for t in read_run(folder).plan.trials]


def test_samples_are_read_back_bit_by_bit(folder, codes):
    with RealJournal(folder) as journal:
        run_one(journal, codes[0])
    trial = read_run(folder).trial(codes[0])
    read, written = trial.samples(), samples_of(4)
    for field in dataclasses.fields(Samples):
        np.testing.assert_array_equal(getattr(read, field.name), getattr(written, field.name))
    assert read.held.tolist() == [False, False, False, True]
    assert trial.film("front").read_bytes() == b"a film"
    assert trial.header.films["front"] == Film(64, 48, 4)


def test_the_order_of_the_plan_is_followed_and_resumed(folder, codes):
    with RealJournal(folder) as journal:
        for code in codes[:2]:
            assert journal.next_trial.code == code
            run_one(journal, code)
    with RealJournal(folder) as journal:
        assert journal.next_trial.code == codes[2]
    run = read_run(folder)
    assert [t.code for t in run.trials] == codes[:2]
    assert [run.states[c].state for c in codes] == ["done", "done", "open", "open"]


def test_an_attempt_that_was_cut_off_is_marked_at_the_next_start_and_its_files_are_kept(folder, codes):
    with RealJournal(folder) as journal:
        run_one(journal, codes[0])
        (journal.begin(codes[1]) / "note.txt").write_text("half a trial")
    assert read_run(folder).states[codes[1]].state == "running"
    with RealJournal(folder) as journal:
        assert journal.settle() == [codes[1]]
        assert journal.settle() == []
        assert journal.next_trial.code == codes[1]
        run_one(journal, codes[1])
    assert (folder / "aborted" / f"{codes[1]}-1" / "note.txt").read_text() == "half a trial"
    run = read_run(folder)
    assert run.trial(codes[1]).header.attempt == 2
    assert [(e.code, e.attempt, e.event) for e in run.aborted] == [(codes[1], 1, "aborted")]


def test_files_that_a_kill_left_between_line_and_move_are_put_away(folder, codes, monkeypatch):
    with RealJournal(folder) as journal:
        (journal.begin(codes[0]) / "note.txt").write_text("half")
        monkeypatch.setattr(RealJournal, "_put_away", lambda *_: None)
        journal.abort(codes[0], "the cable came out")
    monkeypatch.undo()
    with RealJournal(folder) as journal:
        journal.settle()
        run_one(journal, codes[0])
    assert (folder / "aborted" / f"{codes[0]}-1" / "note.txt").exists()


@pytest.mark.parametrize("left", [0, 1, 2])
def test_a_journal_that_lost_lines_does_not_put_trials_away(folder, codes, left):
    with RealJournal(folder) as journal:
        for code in codes[:2]:
            run_one(journal, code)
        enter(folder, codes[1], 1, author="ada", role="operator", outcome="froze")
    path = folder / JOURNAL_NAME
    lines = path.read_bytes().splitlines(keepends=True)
    path.write_bytes(b"".join(lines[:left]))
    if not left:
        path.unlink()
    kept = {p: p.read_bytes() for p in (folder / "trials").rglob("*.*")}
    for read in (read_run, RealJournal):
        with pytest.raises(
            RecordError, match=r"journal\.jsonl: the journal has no line about attempt 1 of .*Restore the file"
        ):
            read(folder)
    assert {p: p.read_bytes() for p in (folder / "trials").rglob("*.*")} == kept
    path.write_bytes(b"".join(lines))
    assert [t.code for t in read_run(folder).trials] == codes[:2]
    path.write_bytes(b"".join(lines[:2]))
    (folder / "trials" / codes[1]).rename(folder / "kept")  # the other cure
    (folder / ENTRIES_NAME).rename(folder / "entries")
    with RealJournal(folder) as journal:
        assert journal.settle() == []
        assert journal.next_trial.code == codes[1]


def test_a_repeated_trial_keeps_its_first_record_and_loses_its_entries(folder, codes):
    with RealJournal(folder) as journal:
        run_one(journal, codes[0])
        enter(folder, codes[0], 1, author="ada", role="operator", outcome="froze")
        with pytest.raises(InvalidInputError, match="needs a reason"):
            journal.repeat(codes[0], " ", "ada")
        journal.repeat(codes[0], "a cat on the table", "ada")
        with pytest.raises(InvalidInputError, match="is not finished"):
            journal.repeat(codes[0], "again", "ada")
        assert journal.next_trial.code == codes[0]
        run_one(journal, codes[0])
    run = read_run(folder)
    assert run.trial(codes[0]).entries == ()
    assert run.aborted[0].reason == "a cat on the table"
    assert (folder / "aborted" / f"{codes[0]}-1" / HEADER_NAME).exists()


@pytest.mark.parametrize("damage", ["samples", "film", "header", "folder", "link"])
def test_a_damaged_trial_can_be_repeated_and_what_is_left_is_kept(folder, codes, damage):
    with RealJournal(folder) as journal:
        run_one(journal, codes[0])
        run_one(journal, codes[1])
    place = folder / "trials" / codes[0]
    match damage:
        case "samples":
            (place / SAMPLES_NAME).write_bytes(b"")
        case "film":
            (place / "front.mp4").unlink()
        case "header":
            (place / HEADER_NAME).write_text("[]")
        case _:
            shutil.rmtree(place)
    if damage == "link":
        place.symlink_to("/nowhere")
    with pytest.raises(InvalidInputError, match=rf"--repeat: {codes[1]} is not damaged"):
        repeat_damaged(folder, codes[:2], "ada")  # neither of both then
    with pytest.raises(InvalidInputError, match=rf"{codes[2]} is not finished"):
        repeat_damaged(folder, [codes[2]], "ada")
    assert read_run(folder).states[codes[0]].state == "done"
    repeat_damaged(folder, [codes[0]], "ada")
    run = read_run(folder)
    assert run.damaged == ()
    assert "Restore the folder from a copy, or repeat the trial (`better real run --repeat`)" in run.aborted[0].reason
    assert not place.exists()
    if damage not in ("folder", "link"):
        assert (folder / "aborted" / f"{codes[0]}-1").is_dir()
    with RealJournal(folder) as journal:
        assert journal.next_trial.code == codes[0]
        run_one(journal, codes[0])
    assert read_run(folder).trial(codes[0]).header.attempt == 2


def test_two_processes_on_one_protocol_are_refused(folder):
    with RealJournal(folder), pytest.raises(RunConflictError, match="is writing here"):
        RealJournal(folder)


def test_the_last_entry_of_a_person_counts_and_can_be_undone(folder, codes):
    with RealJournal(folder) as journal:
        run_one(journal, codes[0])
        enter(folder, codes[0], 1, author="ada", role="operator", outcome="froze")  # while the protocol runs
    enter(folder, codes[0], 1, author="ada", role="operator", outcome="missed", note="twice")
    enter(folder, codes[0], 1, author="bob", role="judge", outcome="air_grasp")
    trial = read_run(folder).trial(codes[0])
    assert [(e.author, e.decision.outcome) for e in trial.entries] == [("ada", "missed"), ("bob", "air_grasp")]
    assert [e.author for e in trial.seen_by("judge")] == ["bob"]
    enter(folder, codes[0], 1, author="ada", role="operator", outcome=None)
    seen = read_run(folder).trial(codes[0]).seen_by("operator")
    assert [e.decision.outcome for e in seen] == ["froze"]
    enter(folder, codes[0], 1, author="ada", role="operator", outcome=None)
    assert read_run(folder).trial(codes[0]).seen_by("operator") == ()
    with pytest.raises(InvalidInputError, match="has no entry"):
        enter(folder, codes[0], 1, author="ada", role="operator", outcome=None)


def test_bad_entries_are_refused(folder, codes):
    with pytest.raises(UnknownNameError, match="Did you mean 'air_grasp'"):
        enter(folder, codes[0], 1, author="ada", role="operator", outcome="air_grap")
    with pytest.raises(InvalidInputError, match="needs a note"):
        enter(folder, codes[0], 1, author="ada", role="operator", outcome="other")
    assert not (folder / ENTRIES_NAME).exists() or (folder / ENTRIES_NAME).read_bytes() == b""


def test_each_outcome_has_its_own_key():
    assert len({o.key for o in OUTCOMES}) == len({o.name for o in OUTCOMES}) == len(OUTCOMES)


def test_damaged_files_are_named(folder, codes):
    with RealJournal(folder) as journal:
        run_one(journal, codes[0])
    place = folder / "trials" / codes[0]
    good = {path.name: path.read_bytes() for path in place.iterdir()}

    def read_all():
        read_run(folder).trial(codes[0]).samples()
        read_run(folder).trial(codes[0]).film("front")

    def told(name, data):
        if data is None:
            (place / name).unlink()
        else:
            (place / name).write_bytes(data)
        with pytest.raises(RecordError) as error:
            read_all()
        (place / name).write_bytes(good[name])
        assert str(place / name) in str(error.value)
        return str(error.value)

    assert "not found" in told(HEADER_NAME, None)
    assert "changed after it was written" in told(HEADER_NAME, good[HEADER_NAME].replace(b"mock", b"sock"))
    other = dataclasses.replace(header_of(codes[0], 1, 5), files={})
    assert "is not the file that" in told(HEADER_NAME, other.to_bytes())
    assert "not found" in told(SAMPLES_NAME, None)
    assert "changed after it was recorded" in told(SAMPLES_NAME, good[SAMPLES_NAME][:-1])
    assert "changed after it was recorded" in told("front.mp4", b"another film")
    assert len(read_run(folder).trial(codes[0]).samples()) == 4


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"time_s": np.array([0.0, 0.1, 0.1])}, "column 'time_s' do not increase"),
        ({"state": np.full((3, 6), np.nan)}, "'state' contains a non-finite value"),
        ({"command": np.full((3, 6), np.inf)}, "'command' contains a non-finite value"),
    ],
)
def test_impossible_samples_are_refused(tmp_path, change, says):
    path = tmp_path / SAMPLES_NAME
    path.write_bytes(dataclasses.replace(samples_of(3), **change).to_bytes())
    with pytest.raises(RecordError, match=says):
        Samples.read(path)


def test_samples_that_unpack_to_too_much_are_refused(tmp_path, monkeypatch):
    monkeypatch.setattr("betterbench.records.arrays.MAX_UNPACKED_BYTES", 1 << 10)
    path = tmp_path / SAMPLES_NAME
    path.write_bytes(samples_of(100).to_bytes())
    with pytest.raises(RecordError, match="unpacks to more than 1024 bytes"):
        Samples.read(path)


def test_samples_that_are_no_samples_are_refused(tmp_path):
    path = tmp_path / SAMPLES_NAME
    path.write_bytes(b"PAR1 nothing PAR1")
    with pytest.raises(RecordError, match="is not readable as Parquet"):
        Samples.read(path)
    from betterbench.records.arrays import array_bytes

    path.write_bytes(array_bytes({"time_s": ("number", 0)}, {"time_s": np.zeros(2)}))
    with pytest.raises(RecordError, match="has no column 'state'"):
        Samples.read(path)
    wide = {"time_s": ("number", 0), "state": ("number", 7)}
    path.write_bytes(array_bytes(wide, {"time_s": np.zeros(2), "state": np.zeros((2, 7))}))
    with pytest.raises(RecordError, match="'state' is not of type"):
        Samples.read(path)


def test_a_changed_journal_is_refused_and_a_torn_line_is_not(folder, codes):
    with RealJournal(folder) as journal:
        run_one(journal, codes[0])
        run_one(journal, codes[1])
    path = folder / JOURNAL_NAME
    lines = path.read_bytes().splitlines(keepends=True)
    path.write_bytes(b"".join(lines) + b'{"event": "beg')
    assert len(read_run(folder).trials) == 2
    path.write_bytes(b"".join([lines[0], *lines[2:]]))
    with pytest.raises(RecordError, match="line 2 does not match the lines before it"):
        read_run(folder)


def test_an_event_that_does_not_fit_the_plan_is_refused(folder, codes):
    from betterbench.jobs.line_journal import LINK, link_after
    from betterbench.json_form import dump_json

    form = {"event": "ended", "code": codes[0], "attempt": 1, "time": "2026-11-29T10:00:00+00:00", "reason": "",
            "person": "", "record": None}  # fmt: skip
    (folder / JOURNAL_NAME).write_bytes(dump_json(form | {LINK: link_after("", form)}) + b"\n")
    with pytest.raises(RecordError, match=r"line 1: attempt 1 of .* is ended, but attempt 0 is open"):
        read_run(folder)
    form["code"] = "???"
    (folder / JOURNAL_NAME).write_bytes(dump_json(form | {LINK: link_after("", form)}) + b"\n")
    with pytest.raises(RecordError, match=r"the plan has no trial '\?\?\?'"):
        read_run(folder)
    assert json.loads((folder / JOURNAL_NAME).read_bytes())["event"] == "ended"


def test_a_plan_that_was_replaced_is_refused_although_its_codes_are_the_same(folder, codes):
    """Codes depend on seed and number only, so that trials of one policy were read as those of another."""
    with RealJournal(folder) as journal:
        run_one(journal, codes[0])
    good = (folder / "plan.json").read_bytes()
    for policies, conditions in (
        ((RealPolicy("a", "random"), RealPolicy("b", "noop")), ["O1", "T1"]),
        ((RealPolicy("a", "noop"), RealPolicy("b", "random")), ["O2", "T5"]),
    ):
        (folder / "plan.json").unlink()
        other = make_plan(policies, conditions=conditions)
        assert [t.code for t in other.trials] == codes
        write_plan(folder, other)
        with pytest.raises(RecordError, match="line 1: the trial was started under a plan other than"):
            read_run(folder)
        with pytest.raises(RecordError, match="Restore the plan from a copy"):
            RealJournal(folder)
    (folder / "plan.json").write_bytes(good)
    assert len(read_run(folder).trials) == 1


def test_a_journal_of_an_earlier_version_without_plan_is_read(folder, codes, monkeypatch):
    from betterbench.jobs.line_journal import LINK, link_after
    from betterbench.json_form import dump_json

    with RealJournal(folder) as journal:
        run_one(journal, codes[0])
    path, link, lines = folder / JOURNAL_NAME, "", []
    for line in path.read_bytes().splitlines():
        form = {k: v for k, v in json.loads(line).items() if k not in (LINK, "plan")}
        link = link_after(link, form)
        lines.append(dump_json(form | {LINK: link}) + b"\n")
    path.write_bytes(b"".join(lines))
    assert [t.code for t in read_run(folder).trials] == [codes[0]]


def test_entries_of_another_protocol_or_of_an_attempt_that_never_began_are_refused(folder, codes, tmp_path_factory):
    """They were left out without a word, so that people's work seemed to be lost."""
    with RealJournal(folder) as journal:
        run_one(journal, codes[0])
    other = tmp_path_factory.mktemp("other")
    write_plan(other, make_plan((RealPolicy("a", "noop"),), conditions=["O1"], seed=9))
    enter(other, read_run(other).plan.trials[0].code, 1, author="ada", role="judge", outcome="done")
    (folder / ENTRIES_NAME).write_bytes((other / ENTRIES_NAME).read_bytes())
    with pytest.raises(RecordError, match=r"entries.jsonl: line 1: the plan has no trial '...', so this file belongs"):
        read_run(folder)
    (folder / ENTRIES_NAME).unlink()
    enter(folder, codes[0], 2, author="ada", role="judge", outcome="done")
    with pytest.raises(RecordError, match=f"line 1: attempt 2 of {codes[0]} never began"):
        read_run(folder)


@pytest.mark.parametrize("change", ["key", "outcome", "role", "undo", "author"])
def test_lines_of_entries_that_were_made_by_hand_are_named(folder, codes, change):
    from betterbench.jobs.line_journal import LINK, link_after
    from betterbench.json_form import dump_json

    with RealJournal(folder) as journal:
        run_one(journal, codes[0])
    enter(folder, codes[0], 1, author="ada", role="judge", outcome="done")
    path = folder / ENTRIES_NAME
    first = json.loads(path.read_bytes())
    form = {k: v for k, v in first.items() if k != LINK}
    if change == "key":
        form["certainty"] = 1.0
    elif change == "outcome":
        form["decision"] = form["decision"] | {"outcome": "great"}
    elif change == "role":
        form["role"] = "boss"
    elif change == "undo":
        form["decision"] = {"line": 7, "kind": "undo"}
    else:
        form["author"] = ""
    path.write_bytes(path.read_bytes() + dump_json(form | {LINK: link_after(first[LINK], form)}) + b"\n")
    with pytest.raises(RecordError, match=r"entries.jsonl: line 2"):
        read_run(folder)


def test_two_trials_whose_folders_were_swapped_are_noticed(folder, codes):
    with RealJournal(folder) as journal:
        run_one(journal, codes[0])
        run_one(journal, codes[1], steps=5)
    first, second, spare = (folder / "trials" / name for name in (codes[0], codes[1], "spare"))
    first.rename(spare)
    second.rename(first)
    spare.rename(second)
    damaged = read_run(folder).damaged
    assert [trial.code for trial in damaged] == [codes[0], codes[1]]
    assert all("is not the file that" in trial.problem for trial in damaged)


def test_a_header_of_another_trial_is_noticed_although_the_journal_names_it(folder, codes):
    with RealJournal(folder) as journal:
        place = journal.begin(codes[0])
        write_attempt(place, header_of(codes[1], 1, 4), samples_of(4), {"front": b"a film"})
        journal.end(codes[0], "time_limit")
    with pytest.raises(RecordError, match=f"is the header of attempt 1 of {codes[1]}, not 1 of {codes[0]}"):
        read_run(folder).trial(codes[0])


def test_files_that_a_person_put_in_the_way_are_kept(folder, codes):
    """The session ended with a traceback, and the trial could never be run again."""
    stray = folder / "trials" / codes[0]
    stray.mkdir(parents=True)
    (stray / "mine.txt").write_text("notes")
    with RealJournal(folder) as journal:
        journal.begin(codes[0])
        (folder / "aborted" / f"{codes[0]}-1").mkdir()
        (folder / "aborted" / f"{codes[0]}-1" / "copy.txt").write_text("a copy")
        journal.abort(codes[0], "the cable came out")
        run_one(journal, codes[0])
    assert (folder / "aborted" / f"{codes[0]}-0" / "mine.txt").exists()
    assert (folder / "aborted" / f"{codes[0]}-1" / "copy.txt").exists()
    assert (folder / "aborted" / f"{codes[0]}-1.2").exists()
    assert read_run(folder).trial(codes[0]).header.attempt == 2


@pytest.mark.parametrize("name", ["plan.json", JOURNAL_NAME, ENTRIES_NAME])
def test_a_file_cut_anywhere_is_refused_or_read_as_what_was_complete(folder, codes, name):
    with RealJournal(folder) as journal:
        run_one(journal, codes[0])
        run_one(journal, codes[1])
    enter(folder, codes[0], 1, author="ada", role="judge", outcome="done")
    enter(folder, codes[1], 1, author="ben", role="judge", outcome="froze")
    path = folder / name
    whole = path.read_bytes()
    read = refused = 0
    for cut in range(0, len(whole), max(1, len(whole) // 60)):
        path.write_bytes(whole[:cut])
        try:
            run = read_run(folder)
        except RecordError as problem:
            refused += 1
            assert str(folder) in str(problem)  # noqa: PT017 - both ends are right
        else:
            read += 1
            assert len(run.trials) <= 2
    path.write_bytes(whole)
    assert refused > 50 if name == "plan.json" else read + refused > 50
    assert len(read_run(folder).trials) == 2
