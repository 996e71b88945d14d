"""Planned trials that a stopped run has not reached: in the denominator, and no failure of the policy."""

import json

import pytest

from betterbench.cli.main import main
from betterbench.comparison import compare
from betterbench.comparison.side import load_sides
from betterbench.comparison.submission import submission_of
from betterbench.diagnosis import diagnose_run
from betterbench.evaluation import evaluate
from betterbench.evaluation.planning.plan import make_plan
from betterbench.records import RunFolder
from betterbench.report import write_report
from betterbench.tasks.labels import Kind, Label

pytestmark = pytest.mark.physics


@pytest.fixture(scope="module")
def stopped(tmp_path_factory):
    """A run of which Ctrl-C has left two trials, the last of a variation and its twin among them."""

    def stop(progress):
        if progress.done == 2:
            raise KeyboardInterrupt

    out = tmp_path_factory.mktemp("stopped") / "run"
    plan = make_plan("noop", tasks=["morning_coffee"], variations=["L1"], trials=2, quality="fast")
    with pytest.raises(KeyboardInterrupt):
        evaluate(plan, out, workers=1, on_progress=stop)
    return RunFolder.open(out)


def _left(run):
    done = {f"{e.task}/{e.variation or e.condition}/{e.seed}" for e in run.entries()}
    return [f"{t['task']}/{t['variation'] or t['condition']}/{t['seed']}" for t in run.plan["trials"]], done


def test_an_unfinished_trial_is_no_failure_and_stays_in_the_denominator(stopped):
    planned, done = _left(stopped)
    found = diagnose_run(stopped)
    assert [t.key for t in found.trials] == planned
    assert {t.key for t in found.trials if t.label is Label.UNFINISHED} == set(planned) - done
    assert {t.kind for t in found.unfinished} == {Kind.UNFINISHED}
    assert not any(t.kind is Kind.SYSTEM for t in found.trials)
    system, apart = found.metric("system_failure_rate", "overall"), found.metric("unfinished_rate", "overall")
    everything = [t for t in found.trials if t.variation]
    assert (system.k, system.n) == (0, len(everything))
    assert (apart.k, apart.n) == (sum(t.kind is Kind.UNFINISHED for t in everything), len(everything))
    assert found.metric("success_rate", "overall").n == len(everything)
    gap = found.metric("illusion_gap", "overall")
    ended = {t.key for t in everything if t.key in done and t.twin_key in done}
    assert (0 if gap is None else gap.n) == len(ended)
    assert any("planned trials are unfinished" in note for note in found.notes)
    assert not any("policy_error" in note for note in found.notes)


def test_every_way_out_says_unfinished(stopped, tmp_path, capsys):
    planned, done = _left(stopped)
    assert main(["diagnose", str(stopped.path), "--json", "--keep"]) == 0
    document = json.loads(capsys.readouterr().out)
    told = {t["key"]: (t["label"], t["kind"], t["success"]) for t in document["trials"]}
    assert told.keys() == set(planned)
    assert {told[key] for key in set(planned) - done} == {("unfinished", "unfinished", False)}
    page = write_report([diagnose_run(stopped)], tmp_path / "report").read_text(encoding="utf-8")
    assert f"{len(done)} of {len(planned)} trials have ended" in page
    assert "policy failed to run" not in page
    trials = (tmp_path / "report" / "tables" / "trials.csv").read_text(encoding="utf-8")
    assert trials.count(",unfinished,unfinished,") == len(planned) - len(done)
    assert "policy_error" not in trials
    assert "policy" in (tmp_path / "report" / "tables" / "trials.tex").read_text(encoding="utf-8")
    submitted = submission_of(stopped)
    assert {t.label for t in submitted.trials if t.status == "unfinished"} == {"unfinished"}


def test_a_comparison_counts_them_apart(stopped, tmp_path):
    path = tmp_path / "s.json"
    path.write_bytes(submission_of(stopped, name="other").file_bytes())
    sides = load_sides([stopped.path, path])
    planned, done = _left(stopped)
    assert all(side.unfinished == set(planned) - done for side in sides)
    found = compare(sides).to_json()
    groups = {(g["measure"], g["scope"]) for g in found["groups"]}
    assert ("unfinished", "overall") not in groups
    assert ("policy_error", "overall") not in groups


def test_a_run_that_has_ended_has_no_such_rate(tmp_path):
    plan = make_plan("noop", tasks=["morning_coffee"], variations=["T1"], trials=1, quality="fast")
    run = evaluate(plan, tmp_path / "run", workers=1)
    found = diagnose_run(run)
    assert found.metric("unfinished_rate", "overall") is None
    assert not found.unfinished
