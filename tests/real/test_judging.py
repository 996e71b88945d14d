"""The judge's queue and page: blind, in an order of the judge's own, resumable, with undo."""

import http.client
import json
import shutil
import urllib.parse

import pytest
from tests.real.protocols import POLICIES, judge, protocol

from betterbench.errors import InvalidInputError, RecordError
from betterbench.real.judge_page import JudgePage
from betterbench.real.judging import JudgeDesk
from betterbench.real.outcomes import OUTCOMES
from betterbench.real.plan import RealPolicy, make_plan, write_plan
from betterbench.real.record import RealJournal, enter, read_run


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """A protocol whose operator has entered an outcome for every trial. Tests change copies of it."""
    made = tmp_path_factory.mktemp("finished")
    protocol(made, conditions=("train1", "O1", "O2", "T1", "T5"))
    judge(made, "olga", lambda _: "done", role="operator")
    return made


@pytest.fixture
def folder(finished, tmp_path):
    return shutil.copytree(finished, tmp_path, dirs_exist_ok=True)


def votes(folder, person="ada"):
    standing = [(t.code, e) for t in read_run(folder).trials for e in t.seen_by("judge") if e.author == person]
    return {code: entry.decision.outcome for code, entry in standing}


def test_each_judge_has_an_order_of_its_own_and_keeps_it(folder):
    ada, again, ben = (JudgeDesk(folder, name) for name in ("ada", "ada", "ben"))
    codes = [[t.code for t in desk.trials] for desk in (ada, again, ben)]
    assert codes[0] == codes[1] != codes[2]
    assert sorted(codes[0]) == sorted(codes[2]) == sorted(t.code for t in read_run(folder).trials)
    assert codes[0] != [t.code for t in read_run(folder).trials]


def test_entries_are_written_at_once_and_work_is_resumed(folder):
    desk = JudgeDesk(folder, "ada")
    for outcome in ("done", "froze", "missed"):
        desk.choose(outcome)
    assert desk.index == desk.done == 3
    resumed = JudgeDesk(folder, "ada")
    assert (resumed.index, resumed.done) == (3, 3)
    assert list(votes(folder).values()).count("froze") == 1
    while resumed.done < len(resumed.trials):
        resumed.choose("done")
    assert "this was the last video" in resumed.message
    assert len(votes(folder)) == 10


def test_undo_takes_back_the_last_entry_and_a_later_entry_replaces_an_earlier_one(folder):
    desk = JudgeDesk(folder, "ada")
    desk.undo()
    assert desk.is_problem
    first = desk.at_hand.code
    desk.choose("done")
    desk.choose("froze")
    desk.undo()
    assert (desk.index, desk.chosen, list(votes(folder))) == (1, None, [first])
    desk.step(-1)
    assert desk.chosen == "done"
    desk.choose("part")
    assert votes(folder) == {first: "part"}
    resumed = JudgeDesk(folder, "ada")
    resumed.step(-1)
    resumed.undo()  # an entry of an earlier session, on its own film
    assert (votes(folder), resumed.chosen) == ({first: "done"}, "done")  # what it replaced stands again


def test_a_note_is_needed_for_something_else(folder):
    desk = JudgeDesk(folder, "ada")
    desk.choose("other")
    assert desk.is_problem
    assert desk.done == 0
    desk.choose("other", "it waved")
    assert list(votes(folder).values()) == ["other"]


def test_the_operator_is_no_judge_and_an_empty_protocol_has_no_films(folder, tmp_path_factory):
    with pytest.raises(InvalidInputError, match="'olga' is the operator of this protocol"):
        JudgeDesk(folder, "olga")
    empty = tmp_path_factory.mktemp("empty")
    write_plan(empty, make_plan((RealPolicy("a", "noop"),), conditions=["O1"]))
    with pytest.raises(InvalidInputError, match="has no finished trial"):
        JudgeDesk(empty, "ada")


def test_a_protocol_of_damaged_trials_is_not_called_empty(folder):
    for header in (folder / "trials").glob("*/trial.json"):
        header.write_text("[]")
    with pytest.raises(
        RecordError, match=r"none of the \d+ trials that are finished can be shown: .*Restore the folder"
    ):
        JudgeDesk(folder, "ada")


@pytest.fixture
def page(folder):
    made = JudgePage(JudgeDesk(folder, "ada"), host="127.0.0.1", port=0)
    yield made
    made.server.close()


def ask(page, path="", form=None):
    parts = urllib.parse.urlsplit(page.server.url)
    connection = http.client.HTTPConnection("127.0.0.1", parts.port, timeout=20)
    body = None if form is None else json.dumps(form)
    connection.request("GET" if body is None else "POST", parts.path + path, body=body)
    answer = connection.getresponse()
    data = answer.read()
    connection.close()
    return answer.status, answer.headers["Content-Type"], data


def test_the_page_tells_nothing_but_films_instruction_and_definitions(folder, page):
    enter(folder, JudgeDesk(folder, "ben").at_hand.code, 1, author="ben", role="judge", outcome="undid")
    run = read_run(folder)
    told = b"".join(ask(page, path)[2] for path in ("", "judge.js", "judge.css", "state"))
    secrets = [p.name for p in POLICIES] + [p.address for p in POLICIES] + list(run.plan.conditions)
    secrets += [t.code for t in run.trials] + ["olga", "ben", "stay_still", "expected"]
    for secret in secrets:
        assert f'"{secret}"'.encode() not in told, secret
        assert len(secret) < 4 or secret.encode() not in told, secret
    state = json.loads(ask(page, "state")[2])
    assert [o["key"] for o in state["outcomes"]] == [o.key for o in OUTCOMES]
    assert state["instruction"].startswith("Put ")


def test_the_page_serves_the_films_of_the_judges_order(page, folder):
    desk = JudgeDesk(folder, "ada")
    for number in (0, 3):
        for place, camera in enumerate(("front", "wrist")):
            status, kind, data = ask(page, f"film/{number}/{place}")
            assert (status, kind) == (200, "video/mp4")
            assert data == f"{camera} of {desk.trials[number].code}".encode()
    assert ask(page, "film/0/2")[0] == ask(page, "film/10/0")[0] == 404


def test_keys_of_the_page_enter_undo_and_step(page, folder):
    state = json.loads(ask(page, "do", {"name": "enter", "film": 0, "value": "froze"})[2])
    assert (state["film"], state["judged"], state["message"]) == (1, 1, "video 1: stood still; 9 videos left")
    late = json.loads(ask(page, "do", {"name": "enter", "film": 0, "value": "done"})[2])  # a key pressed twice
    assert (late["film"], late["judged"]) == (1, 1)
    assert list(votes(folder).values()) == ["froze"]
    state = json.loads(ask(page, "do", {"name": "undo", "film": 1})[2])
    assert (state["film"], state["judged"]) == (0, 0)
    assert json.loads(ask(page, "do", {"name": "previous", "film": 0})[2])["film"] == 9
    assert "error" in json.loads(ask(page, "do", {"name": "enter", "film": 9, "value": "perfect"})[2])
    assert "error" in json.loads(ask(page, "do", {"name": "steal", "film": 9})[2])


def test_two_judges_work_at_the_same_time(folder):
    ada, ben = JudgeDesk(folder, "ada"), JudgeDesk(folder, "ben")
    for _ in range(3):
        ada.choose("done")
        ben.choose("froze")
    assert len(votes(folder)) == len(votes(folder, "ben")) == 3


def test_whoever_was_an_operator_is_no_judge_however_the_name_is_written(tmp_path):
    """An operator whose entries were taken back or discarded, or who wrote the name in another way, could judge."""
    plan = protocol(tmp_path, conditions=("O1",))
    code = plan.trials[0].code
    enter(tmp_path, code, 1, author="olga", role="operator", outcome="done")
    enter(tmp_path, code, 1, author="olga", role="operator", outcome=None)
    with RealJournal(tmp_path) as journal:
        journal.repeat(plan.trials[1].code, "a cat on the table", "Otto")
        journal.begin(plan.trials[1].code, "oscar")
    for name in ("olga", "Olga ", "OLGA", "otto", "oscar"):
        with pytest.raises(InvalidInputError, match="is the operator of this protocol"):
            JudgeDesk(tmp_path, name)
    assert len(JudgeDesk(tmp_path, "ada").trials) == 1


def test_one_judge_with_two_spellings_is_not_counted_as_two(folder):
    JudgeDesk(folder, "Ada").choose("done")
    with pytest.raises(InvalidInputError, match="'ada' differs only in spelling from 'Ada', who already judged here"):
        JudgeDesk(folder, "ada")
    assert JudgeDesk(folder, "Ada").done == 1
    JudgeDesk(folder, "Adam").choose("done")


def test_a_trial_that_is_discarded_while_it_is_judged_gets_no_entry(folder):
    """The entry went to the discarded attempt, and the judge was told that it counts."""
    desk = JudgeDesk(folder, "ada")
    code = desk.at_hand.code
    with RealJournal(folder) as journal:
        journal.repeat(code, "the lamp fell", "olga")
    desk.choose("done")
    assert desk.is_problem
    assert "video 1: the operator has discarded this trial" in desk.message
    assert (desk.done, votes(folder)) == (0, {})
    desk.step(1)
    desk.choose("done")
    assert desk.done == 1


def test_a_damaged_film_is_told_without_the_code_and_cannot_be_judged(folder, page, caplog):
    """The request ended with a traceback in the terminal, and a key entered an outcome nobody had seen."""
    trial = JudgeDesk(folder, "ada").at_hand
    (trial.folder / "wrist.mp4").write_bytes(b"another film")
    status, kind, data = ask(page, "film/0/1")
    assert (status, kind.split(";")[0]) == (500, "text/plain")
    assert data.startswith(b"video 1: cannot be shown, because its file is missing or was changed")
    state = json.loads(ask(page, "do", {"name": "enter", "film": 0, "value": "done"})[2])
    assert state["is_problem"]
    assert (state["judged"], state["film"]) == (0, 0)
    for told in (data.decode(), json.dumps(state)):
        assert trial.code not in told
        assert str(folder) not in told
    assert str(trial.folder / "wrist.mp4") in caplog.text
    (trial.folder / "front.mp4").unlink()
    assert ask(page, "film/0/0")[0] == 500


@pytest.mark.parametrize(
    "path",
    [
        *("film/0/0/../../state", "film/../../plan.json", "film/0/%2e%2e%2fplan.json", "../state", "film/-1/0"),
        *("film/0/00", "film//", "..%2f..%2fetc%2fpasswd", "film/0/0%00"),
    ],
)
def test_no_path_leads_out_of_the_list_of_films(page, path):
    assert ask(page, path)[0] in (403, 404)


def test_an_entry_on_a_folder_that_cannot_be_written_is_told_to_the_judge(folder, page, monkeypatch):
    import errno

    from betterbench.jobs import line_journal

    def full(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(line_journal.os, "fsync", full)
    told = json.loads(ask(page, "do", {"name": "enter", "film": 0, "value": "done"})[2])
    assert "No space left on device" in told["error"]
    monkeypatch.undo()
    state = json.loads(ask(page, "state")[2])
    assert (state["judged"], state["film"], votes(folder)) == (0, 0, {})
    assert json.loads(ask(page, "do", {"name": "enter", "film": 0, "value": "done"})[2])["judged"] == 1
