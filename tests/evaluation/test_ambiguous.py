"""Ambiguous trials: run, labeled and shown, but neither solved nor failed in any count."""

from __future__ import annotations

import json

import pytest
from tests.evaluation.few_steps import in_few_steps
from tests.report.factory import diagnosis, trial

from betterbench.calibration.power import power_trials
from betterbench.certification.certificate import CLAUSES, Certificate, Clause, TrialCertificate
from betterbench.certification.runner import versions_in_use
from betterbench.cli.main import main
from betterbench.cli.output.certificate import print_certificate
from betterbench.cli.output.diagnosis import print_diagnosis
from betterbench.cli.tally import RunTally
from betterbench.cli.trackers import tracked_numbers
from betterbench.comparison import Side, compare
from betterbench.diagnosis import Label
from betterbench.diagnosis.findings import find_notes
from betterbench.diagnosis.until_decided import decided_of
from betterbench.evaluation import make_plan
from betterbench.evaluation.planning.power import smallest_drop_line, what_trials_show
from betterbench.evaluation.planning.schedule import Schedule
from betterbench.evaluation.running.summary import run_counts
from betterbench.learning.study.outcomes import outcomes_of
from betterbench.records import RunFolder
from betterbench.report.figures.film import failures_in_question
from betterbench.report.headline import headline_of
from betterbench.report.outcomes import variation_rows
from betterbench.report.tables.exports import trial_table
from betterbench.statistics import Rate, StoppingRule, Verdict
from betterbench.tasks import Expected, TrialId, get_task
from betterbench.tasks.interventions.resolve import resolve_condition
from betterbench.tasks.trial import Trial

TASK = "fruit_basket"
NAMES = {v.name: v.expected for v in get_task(TASK).variations}
BROKEN = {name for name, expected in NAMES.items() if expected is Expected.AMBIGUOUS}


def plan_of(*variations: str, **options):
    return make_plan("expert", tasks=[TASK], variations=variations, **options)


def run_of(label: Label, policy: str = "expert", seeds: int = 2):
    """Returns a run in which O1 succeeds, and the ambiguous O5 gets a label."""
    trials = []
    for name in ("train1", "O1", "O5"):
        setting = resolve_condition(TASK, name)
        expected = setting.condition.expected
        shown = label if expected is Expected.AMBIGUOUS else Label.SUCCESS
        variation = None if setting.variation is None else name
        trials += [
            trial(
                TASK,
                variation,
                setting.base,
                seed,
                label=shown,
                policy=policy,
                axis=setting.axis,
                expected=expected.value,
            )
            for seed in range(seeds)
        ]
    return diagnosis(trials, policy=policy)


COLLAPSE = run_of(Label.SEMANTIC_FEATURE_COLLAPSE)


def test_the_four_cells_with_a_broken_premise():
    assert {"O3", "O4", "O5", "O9"} == BROKEN
    assert {t.condition for t in plan_of(trials=1).trials if t.ambiguous} == BROKEN


@pytest.mark.physics
def test_the_last_lines_of_an_evaluation_and_its_progress(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(Trial, "resolve", in_few_steps(60))
    out = tmp_path / "run"
    words = ["eval", "--policy", "noop", "--suite", "real_world", "--variations", "T3", "O5", "--trials", "1"]
    words += ["--observation", "state_only", "--quality", "fast", "--workers", "1", "--uncertified", "--out", str(out)]
    assert main(words) == 0
    shown = capsys.readouterr().out
    assert "variations  100.0 % success (1/1" in shown
    assert "ambiguous   1 trials, which are not counted because they have no right outcome" in shown
    run = RunFolder.open(out)
    counts = run_counts(run)
    assert (counts["variations"], counts["ambiguous"]) == ({"k": 1, "n": 1}, {"n": 1})
    n = counts["training"]["n"]
    tally = RunTally(frozenset(t.id for t in plan_of("T3", "O5", trials=1).trials if t.ambiguous))
    tally.resume(run)
    assert (tally.judged, tally.successes) == (n + 1, 1), "nothing is to be done in T3"
    assert main([*words, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["ambiguous"] == {"n": 1}
    assert main(["diagnose", str(out), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    rates = {(m["name"], m["scope"]): m for m in told["metrics"]}
    assert rates["success_rate", "overall"]["n"] == 1
    assert ("success_rate", "fruit_basket/O5") not in rates
    assert {t["expected"] for t in told["trials"] if t["variation"] == "O5"} == {"ambiguous"}


def test_power_counts_pairs_that_can_be_right_or_wrong():
    assert smallest_drop_line(plan_of("T3", "O5", trials=20)) == smallest_drop_line(plan_of("T3", trials=20))
    assert what_trials_show(plan_of("T3", "O5", trials=20)) == what_trials_show(plan_of("T3", trials=20))
    assert smallest_drop_line(plan_of("O5", trials=20)).startswith("No trial tests a variation")
    assert "1 variations" in what_trials_show(plan_of("T3", "O5", trials=20, until_decided=True))


def test_the_power_matrix_has_no_ambiguous_variation():
    wanted = power_trials((TASK,))
    assert {name for _, name in wanted.chances} == NAMES.keys() - BROKEN
    assert all({name for _, name in row} == NAMES.keys() - BROKEN for row in wanted.of.values())


def test_an_ambiguous_variation_of_a_run_until_decided_runs_in_the_first_round_and_gets_no_verdict():
    plan = plan_of("T3", "O5", trials=8, until_decided=True)
    done: list[TrialId] = []
    schedule = Schedule(plan, is_done=done.__contains__, succeeded=lambda t: t.condition != "O5")
    for trials in schedule.rounds():
        done += [t.id for t in trials]
    first = StoppingRule().first
    assert sorted(t.seed for t in done if t.condition == "O5") == list(range(first))
    assert [a.question.condition for a in schedule.decisions.answers] == ["fruit_basket/T3"]
    told = decided_of(StoppingRule(), [t.id for t in plan.trials], lambda t: t.condition != "O5" if t in done else None)
    assert told.answer("fruit_basket/O5") is None
    assert told.answer("fruit_basket/T3").verdict is Verdict.NO_DROP
    assert told.waiting == frozenset()


def test_a_run_until_decided_of_ambiguous_variations_alone_ends_after_the_first_round():
    plan = plan_of("O5", trials=8, until_decided=True)
    done: list[TrialId] = []
    for trials in Schedule(plan, is_done=done.__contains__, succeeded=lambda _: True).rounds():
        done += [t.id for t in trials]
    assert {t.condition for t in done} == {"O5"}
    assert len(done) == StoppingRule().first


def test_a_comparison_leaves_them_out_and_says_so():
    refuses = run_of(Label.CORRECT_REFUSAL, "zoo:refuse")
    found = compare([Side(d.policy, d, f"runs/{d.policy}") for d in (COLLAPSE, refuses)])
    overall = found.group("success")
    assert [(r.k, r.n) for r in overall.rates] == [(2, 2), (2, 2)]
    assert found.group(Label.SEMANTIC_FEATURE_COLLAPSE.value) is None
    assert any(note.startswith("2 ambiguous trials of expert cannot be right or wrong") for note in found.notes)


def test_the_headline_sees_no_failure_in_them():
    assert headline_of(COLLAPSE).conclusion == headline_of(run_of(Label.CORRECT_REFUSAL)).conclusion
    assert "collapse" not in headline_of(COLLAPSE).conclusion


def test_tables_films_trackers_and_studies():
    assert failures_in_question(COLLAPSE) == []
    table = trial_table([COLLAPSE])
    success = table.columns.index("success")
    assert {row[success] for row in table.rows if row[2] == "O5"} == {None}
    assert {row[success] for row in table.rows if row[2] != "O5"} == {True}
    rows = {row.id: row for row in variation_rows(COLLAPSE)}
    assert rows["fruit_basket/O5"].trial.value is None
    assert rows["fruit_basket/O1"].trial.value == 1.0
    assert "labels/semantic_feature_collapse" not in tracked_numbers(COLLAPSE)
    assert {o.variation for o in outcomes_of(COLLAPSE)} == {None, "O1"}


def test_the_notes_name_them_and_miss_no_twin():
    notes = find_notes(COLLAPSE.trials, {}, (), 2)
    assert any("2 trials with a broken premise have no right or wrong outcome" in note for note in notes)
    assert not any("counterfactual twin" in note for note in notes)


def test_the_printed_table_gives_them_no_rate(capsys):
    print_diagnosis(COLLAPSE)
    (line,) = (x for x in capsys.readouterr().out.splitlines() if "fruit_basket/O5" in x)
    assert "ambiguous" in line
    assert "%" not in line


def test_a_certificate_calls_them_neither_solved_nor_unsolved(capsys):
    def examined(condition: str, *, solved: bool) -> TrialCertificate:
        clauses = {letter: Clause(passed=solved or letter != "a") for letter in CLAUSES}
        return TrialCertificate(TASK, condition, False, 0, clauses, 10, 200, 0.0, 0.0, None, None)

    versions = versions_in_use([TASK], robot="so101")
    trials = (examined("O1", solved=True), examined("T3", solved=False), examined("O5", solved=True))
    certificate = Certificate(versions, "test", trials, 1.0, 1)
    assert (certificate.solved, len(certificate.ambiguous)) == (Rate(1, 2), 1)
    print_certificate(certificate)
    assert "solves 1 of 2, 0.00 s per trial; 1 ambiguous trials have no right outcome" in capsys.readouterr().out
