"""Results of a protocol: both matrices, numbers that add up, agreement of people, the order, and the twin beside it."""

import dataclasses
import json
import shutil

import numpy as np
import pytest
from tests.real.protocols import POLICIES, header_of, judge, packs, protocol, still

from betterbench.cli.main import main
from betterbench.errors import InvalidInputError, RecordError
from betterbench.real.judging import JudgeDesk
from betterbench.real.record import RealJournal
from betterbench.real.report_page import write_real_page
from betterbench.real.results import compare_matrices, results_of
from betterbench.tasks.authoring.condition_matrix import State

CELLS = (
    *("train1", "O1", "O2", "T1", "T2", "T3", "O3", "O4", "O5"),
    *("train3", "T4", "O6", "T5", "T6", "T7", "O7", "O8", "O9"),
)


def mixed(planned):
    """The first policy packs what is due; the second one freezes wherever the scene looks half done."""
    due = planned.condition in ("train1", "O1", "O2", "T4", "O6", "O7", "T5", "train3")
    return packs() if due and not (planned.policy == "second policy" and planned.condition == "T5") else still()


def truth(planned):
    if planned.condition in ("O3", "O4", "O5", "O9") or (planned.policy, planned.condition) == ("second policy", "T5"):
        return "froze"
    return "done"


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    folder = tmp_path_factory.mktemp("protocol") / "bench"
    folder.mkdir()
    protocol(folder, conditions=CELLS, moves=mixed, late_frames=3)
    judge(folder, "ada", truth)
    judge(folder, "ben", lambda p: "missed" if p.condition == "O7" else truth(p))
    judge(folder, "olga", lambda p: None if p.block else "done", role="operator")
    return folder


@pytest.fixture(scope="module")
def results(whole):
    return results_of(whole)


def test_both_matrices_are_those_of_the_report(results):
    first, second = results.policies
    short, long = first.matrices
    assert [short.cell(State.TABLE, column).success.k for column in State] == [1, 1, 1]
    assert short.cell(State.ABSENT, State.TABLE).ambiguous
    assert long.cell(State.TARGET, State.TABLE).success.k == 1
    frozen = second.matrices[1].cell(State.TARGET, State.TABLE)
    assert (frozen.success.k, frozen.success.n) == (0, 1)
    assert [label.value for label, _ in frozen.labels] == ["phase_conflict"]


def test_every_planned_trial_is_counted_once(results):
    for policy in results.policies:
        counts = policy.counts
        assert counts.right + counts.failed + counts.ambiguous + counts.unscored + counts.open == 18
        # The judges disagree on O7, and an ambiguous trial is no failure.
        assert (counts.ambiguous, counts.unscored, counts.open) == (4, 1, 0)
    assert results.policies[0].counts.failed == 0
    assert results.policies[1].counts.failed == 1
    assert results.policies[0].unscored == {("long_horizon_matrix", State.ABSENT, State.TABLE): 1}


def test_kappa_counts_the_trials_that_both_have_seen(results):
    blind, *with_operator = results.agreements
    assert blind.is_blind
    assert (blind.table.n, len(blind.disagreements)) == (36, 2)
    assert {(d.first, d.second) for d in blind.disagreements} == {("done", "missed")}
    kappa, interval = blind.table.kappa, blind.table.interval()
    assert 0.0 < interval.low < kappa < interval.high <= 1.0
    assert f"in 34 of 36 trials; Cohen's kappa {kappa:.2f}" in blind.sentence
    assert [str(a.second) for a in with_operator] == ["olga (operator)"] * 2


def test_late_frames_and_steps_are_summed(results):
    lateness = results.policies[0].lateness
    assert lateness.late.k == 36
    assert lateness.late.n == lateness.steps
    assert lateness.frames["front"].k == 54
    assert lateness.frames["wrist"].k == 0


def test_the_order_is_checked_against_the_plan(results, tmp_path):
    order = results.order
    assert order.follows_plan
    assert order.longest_run == order.expected_run == 2
    assert not any(order.discarded.values())
    assert "took turns as planned" in order.sentences[0]
    plan = protocol(tmp_path, conditions=("train1", "T1", "T2", "T3"))
    with RealJournal(tmp_path) as journal:  # every trial of one policy is repeated at the end
        mine = [p for p in plan.trials if p.policy == POLICIES[0].name]
        for planned in mine:
            journal.repeat(planned.code, "the light was off", "olga")
        from betterbench.real.record import write_attempt

        for planned in mine:
            samples = packs()
            place = journal.begin(planned.code)
            write_attempt(place, header_of(planned.code, 2, len(samples), instruction="x"), samples, {})
            journal.end(planned.code, "time_limit")
    bad = results_of(tmp_path).order
    assert not bad.follows_plan
    assert bad.longest_run == 4
    assert bad.middle["first policy"] > 0.7
    assert bad.discarded == {"first policy": 4, "second policy": 0}
    assert "may look like an effect of this policy" in bad.sentences[0]


def test_a_matrix_agrees_with_itself(results):
    for policy in results.policies:
        found = compare_matrices(policy.policy.name, policy.matrices, policy.matrices)
        assert found.same_side.k == found.same_side.n > 10
        assert all(c.difference is None or c.difference.value == 0.0 for c in found.cells if c.comparable)
        assert found.same_label.k == found.same_label.n
        assert not any(cell.differs for cell in found.cells)


def test_a_cell_that_the_twin_gets_wrong_is_named_with_its_interval(results):
    first, second = (policy.matrices for policy in results.policies)
    found = compare_matrices("second policy", second, first)
    (apart,) = [cell for cell in found.cells if cell.agrees is False]
    assert (apart.row, apart.column) == (State.TARGET, State.TABLE)
    assert apart.difference.value == -1.0
    assert -1.0 <= apart.difference.low <= apart.difference.value <= apart.difference.high
    assert found.same_side.k == found.same_side.n - 1
    assert f"In {found.same_side.k} of {found.same_side.n} cells" in found.sentence


def test_the_page_shows_all_of_it(results, whole, tmp_path):
    page = write_real_page(results, tmp_path / "index.html").read_text()
    for text in ("Phase conflict", "1/1", "4</td>", "ada and ben entered the same outcome in 34 of 36", "paper: "):
        assert text in page
    for trial in results.trials:
        assert f'id="{trial.trial.code}"' in page
    assert "<script" not in page
    assert "front.mp4" in page


def test_contradictions_are_listed_and_in_no_rate(tmp_path):
    protocol(tmp_path, conditions=("train1",), moves=lambda _: still())
    judge(tmp_path, "ada", lambda _: "done")
    found = results_of(tmp_path)
    assert [p.counts.contradictions for p in found.policies] == [1, 1]
    assert all(p.counts.right == p.counts.failed == 0 for p in found.policies)
    page = write_real_page(found, tmp_path / "page.html").read_text()
    assert "the arm never moved" in page


def test_the_command_prints_one_document_or_writes_a_page(whole, capsys, tmp_path):
    assert main(["real", "report", str(whole), "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["planned"] == len(document["trials"]) == 36
    assert {t["label"] for t in document["trials"]} >= {"success", "correct_freeze", "phase_conflict", "unscored"}
    assert document["agreements"][0]["n"] == 36
    out = tmp_path / "r.html"
    for _ in range(2):  # a page of ours is replaced
        assert main(["real", "report", str(whole), "--out", str(out)]) == 0
    assert "policy" in capsys.readouterr().out
    out.write_text("mine")
    assert main(["real", "report", str(whole), "--out", str(out)]) == 2
    assert "--overwrite" in capsys.readouterr().err


def damage(place, how):
    """Damage the files of a trial, and return the name of the file that is wrong."""
    name = {"samples": "samples.parquet", "film": "wrist.mp4", "gone": "front.mp4"}.get(how, "trial.json")
    path = place / name
    if how in ("gone", "no header"):
        path.unlink()
    elif how == "no folder":
        shutil.rmtree(place)
    else:
        path.write_bytes(path.read_bytes() + b" ")
    return name


@pytest.mark.parametrize("how", ["samples", "film", "gone", "header", "no header", "no folder"])
def test_a_damaged_trial_is_named_and_unscored_and_hides_no_other_one(tmp_path, how):
    """One changed file refused the whole report."""
    plan = protocol(tmp_path, conditions=("train1", "O7", "O9"))
    for person in ("ada", "ben"):
        judge(tmp_path, person, lambda _: "done")
    before = results_of(tmp_path)
    bad = next(t for t in plan.trials if (t.condition, t.policy) == ("O7", POLICIES[0].name))
    name = damage(tmp_path / "trials" / bad.code, how)
    results = results_of(tmp_path)
    (damaged,) = results.run.damaged
    assert (damaged.planned, damaged.attempt) == (bad, 1)
    assert str(tmp_path / "trials" / bad.code / name) in damaged.problem

    mine, was = results.policies[0], before.policies[0]
    assert results.to_json()["policies"][1] == before.to_json()["policies"][1]
    counts = was.counts
    assert mine.counts == dataclasses.replace(counts, right=counts.right - 1, unscored=counts.unscored + 1, damaged=1)
    assert sum(list(dataclasses.asdict(mine.counts).values())[:5]) == 3
    assert dict(mine.labels)["unscored"] == 1
    assert mine.unscored == {**was.unscored, ("long_horizon_matrix", State.ABSENT, State.TABLE): 1}
    assert mine.matrices[1].cell(State.ABSENT, State.TABLE).empty
    assert mine.lateness.steps == was.lateness.steps * 2 // 3
    assert [a.table.n for a in results.agreements] == [5]
    assert results.order == before.order  # it was run

    document = results.to_json()
    (form,) = [t for t in document["trials"] if t["code"] == bad.code]
    assert (form["label"], form["rule"], form["text"]) == ("unscored", "damaged", damaged.problem)
    assert (len(document["trials"]), [t["code"] for t in document["damaged"]]) == (6, [bad.code])
    page = write_real_page(results, tmp_path / "page.html").read_text()
    assert "1 damaged" in page
    assert f'<li id="{bad.code}">' in page
    assert "6 of 6 trials are done" in page


def test_a_damaged_trial_of_an_ambiguous_condition_is_no_ambiguous_one(tmp_path):
    plan = protocol(tmp_path, conditions=("O9",))
    judge(tmp_path, "ada", lambda _: "done")
    damage(tmp_path / "trials" / plan.trials[0].code, "film")
    hurt = next(p for p in results_of(tmp_path).policies if p.policy.name == plan.trials[0].policy)
    assert (hurt.counts.ambiguous, hurt.counts.unscored, hurt.counts.damaged) == (0, 1, 1)
    assert hurt.labels == ()


def test_every_command_goes_on_beside_a_damaged_trial(tmp_path, capsys, caplog):
    plan = protocol(tmp_path, conditions=("train1",))
    judge(tmp_path, "olga", lambda _: "done", role="operator")
    first, second = (t.code for t in plan.trials)
    damage(tmp_path / "trials" / first, "header")
    assert main(["real", "report", str(tmp_path)]) == 0
    told = "".join(capsys.readouterr())
    assert f"{first} is unscored because its files are damaged: " in told
    assert "trial.json" in told
    assert main(["real", "status", str(tmp_path)]) == 0
    assert f"{first} is damaged: " in capsys.readouterr().out
    assert main(["real", "status", str(tmp_path), "--json"]) == 0
    state = json.loads(capsys.readouterr().out)
    assert (state["done"], [t["code"] for t in state["trials"]]) == (2, [second])
    assert [t["code"] for t in state["damaged"]] == [first]
    assert [t.code for t in JudgeDesk(tmp_path, "ada").trials] == [second]
    assert str(tmp_path / "trials" / first) in caplog.text


@pytest.mark.parametrize("name", ["journal.jsonl", "entries.jsonl", "plan.json"])
def test_files_that_concern_every_trial_stay_an_error(tmp_path, name):
    protocol(tmp_path, conditions=("train1",))
    judge(tmp_path, "ada", lambda _: "done")
    path = tmp_path / name
    path.write_bytes(path.read_bytes().replace(b"2026", b"2025", 1).replace(b'"seed": 0', b'"seed": 1', 1))
    with pytest.raises(RecordError, match=name):
        results_of(tmp_path)


def test_a_run_of_another_policy_is_no_twin(results, whole, monkeypatch):
    from betterbench.real import results as module

    foreign = dataclasses.replace(results.policies[0].diagnosis, address="expert")
    monkeypatch.setattr(module.RunFolder, "open", lambda path: path)
    monkeypatch.setattr(module, "diagnose_run", lambda _: foreign)
    with pytest.raises(InvalidInputError, match="is a run of expert, but the protocol has zoo:first, zoo:second"):
        results_of(whole, [whole])
    ours = dataclasses.replace(foreign, address="zoo:second")
    monkeypatch.setattr(module, "diagnose_run", lambda _: ours)
    (twin,) = results_of(whole, [whole]).twins
    assert twin.policy == "second policy"
    assert np.isfinite(twin.same_side.low)


def agreement_of(folder, first, second, *, conditions=("train1", "O1")):
    protocol(folder, conditions=conditions, moves=lambda _: still())
    codes = [p.code for p in results_of(folder).run.plan.trials]
    judge(folder, "ada", lambda p: first.get(codes.index(p.code)))
    judge(folder, "ben", lambda p: second.get(codes.index(p.code)))
    return results_of(folder)


def test_kappa_of_judges_who_leave_nothing_to_compare(tmp_path):
    """A kappa of 0.00 or 1.00 with an interval of no width looked like certainty."""
    every = dict.fromkeys(range(4), "froze")
    two = {0: "froze", 1: "missed"}
    cases = {
        "one": (every, {}, None),
        "apart": ({0: "froze"}, {1: "froze"}, None),
        "constant": (every, every, "4 of 4 trials; kappa is undefined, because all outcomes are the same."),
        "one_constant": (every, every | {1: "missed"}, "0.00, without an interval, because their outcomes vary too"),
        "equal": (
            two,
            two,
            "2 of 2 trials; Cohen's kappa 1.00, without an interval, because they agree in all trials.",
        ),
    }
    for name, (first, second, says) in cases.items():
        (tmp_path / name).mkdir()
        results = agreement_of(tmp_path / name, first, second)
        assert [p.counts.open for p in results.policies] == [0, 0]
        page = write_real_page(results, tmp_path / name / "index.html").read_text()
        if says is None:
            assert results.agreements == ()
            assert "No trial was seen by two judges. A second judge makes an agreement" in page
        else:
            (pair,) = results.agreements
            assert says in pair.sentence
            assert (pair.to_json()["low"], pair.to_json()["high"]) == (None, None)
            assert "No trial was seen by two judges" not in page


def test_an_operator_and_one_judge_are_no_agreement_of_judges(tmp_path):
    protocol(tmp_path, conditions=("train1",), moves=lambda _: still())
    judge(tmp_path, "ada", lambda _: "froze")
    judge(tmp_path, "olga", lambda _: "froze", role="operator")
    page = write_real_page(results_of(tmp_path), tmp_path / "index.html").read_text()
    assert "No trial was seen by two judges" in page
    assert "The operator is not blind." in page


def test_a_report_before_the_first_trial_says_nothing_about_the_order(tmp_path):
    from betterbench.real.plan import make_plan, write_plan

    write_plan(tmp_path, make_plan(POLICIES, conditions=["O1"]))
    results = results_of(tmp_path)
    assert results.order.sentences == ()
    assert [p.counts.open for p in results.policies] == [1, 1]
    write_real_page(results, tmp_path / "index.html")


def test_names_in_a_report_are_text_and_no_markup(tmp_path):
    from betterbench.real.plan import RealPolicy

    evil = "<script>alert(1)</script>"
    policies = (RealPolicy(evil, "noop"), RealPolicy("b", "random"))
    protocol(tmp_path, conditions=("train1",), moves=lambda _: still(), policies=policies)
    judge(tmp_path, "<img src=x>", lambda _: "froze")
    page = write_real_page(results_of(tmp_path), tmp_path / "index.html").read_text()
    assert "<script" not in page
    assert "<img" not in page
    assert "&lt;script&gt;alert(1)" in page


def test_a_success_of_an_arm_that_never_moved_is_in_no_rate(tmp_path):
    protocol(tmp_path, conditions=("train1",), moves=lambda _: still())
    for person in ("ada", "ben", "cleo"):
        judge(tmp_path, person, lambda _: "done")
    for policy in results_of(tmp_path).policies:
        assert (policy.counts.right, policy.counts.failed, policy.counts.unscored) == (0, 0, 1)
        assert policy.counts.contradictions == 1


def test_entries_belong_to_the_attempt_that_was_seen(tmp_path):
    from betterbench.real.record import write_attempt

    plan = protocol(tmp_path, conditions=("train1",), moves=lambda _: packs())
    judge(tmp_path, "ada", lambda _: "done")
    assert [p.counts.right for p in results_of(tmp_path).policies] == [1, 1]
    code = plan.trials[0].code
    with RealJournal(tmp_path) as journal:
        journal.repeat(code, "the lamp fell", "olga")
        assert sum(p.counts.open for p in results_of(tmp_path).policies) == 1
        samples = still()
        place = journal.begin(code)
        write_attempt(place, header_of(code, 2, len(samples), instruction="x"), samples, {})
        journal.end(code, "time_limit")
    results = results_of(tmp_path)
    (again,) = [t for t in results.trials if t.trial.code == code]
    assert again.judged.votes == {}
    assert again.label.basis == "joints"  # it never moved
