"""Runs until decided: which trials come next follows from the journal, whoever runs them and however often it stops."""

from __future__ import annotations

import dataclasses
import json
import shutil
from collections import Counter
from pathlib import Path

import pytest
from tests.evaluation.few_steps import in_few_steps, worker_of_few_steps
from tests.resealing import rewrite

from betterbench.cli.main import main
from betterbench.comparison import compare, load_sides
from betterbench.diagnosis import diagnose_run
from betterbench.errors import InvalidInputError, RecordError, RunConflictError
from betterbench.evaluation import ExternalRun, Plan, evaluate, make_plan
from betterbench.evaluation.planning.power import what_trials_show
from betterbench.evaluation.planning.repeat import repeated_plan
from betterbench.evaluation.planning.schedule import Schedule
from betterbench.evaluation.workers import pool
from betterbench.evaluation.workers.worker import Worker
from betterbench.records import JournalEntry, RunFolder
from betterbench.report.pages.page import write_report
from betterbench.statistics import StoppingRule, Verdict
from betterbench.tasks import TrialId, get_task, suite_tasks
from betterbench.tasks.trial import Trial

QUICK = StoppingRule(level=0.3, first=2)
"""A rule that two pairs satisfy; the laws of the statistics are tested elsewhere."""


@pytest.fixture(scope="module", autouse=True)
def short():
    """Ends the trials early, but late enough for success where nothing is to be done."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(pool, "work", worker_of_few_steps(60))
        patch.setattr(Trial, "resolve", in_few_steps(60))
        yield


def small(policy: str = "noop", *, rule: StoppingRule = QUICK, trials: int = 5) -> Plan:
    """Returns a plan of the shortest variation of the suite and its twin."""
    plan = make_plan(
        policy,
        tasks=["morning_coffee"],
        variations=["T1"],
        trials=trials,
        observation="state_only",
        quality="fast",
        until_decided=True,
    )
    return dataclasses.replace(plan, until_decided=rule)


class Play:
    """A journal without a simulator: what succeeds is given, and some trials break down the first time."""

    def __init__(self, plan: Plan, *, lost: set[tuple[str, str]], breaking: set[TrialId] = frozenset()) -> None:
        self.plan, self.lost, self.breaking = plan, lost, set(breaking)
        self.done: list[TrialId] = []

    def schedule(self) -> Schedule:
        return Schedule(self.plan, is_done=self.done.__contains__, succeeded=self.succeeded)

    def succeeded(self, trial: TrialId) -> bool:
        return (trial.task, trial.condition) not in self.lost

    def run(self, *, stop_after: int = 10_000) -> Schedule:
        """Plays the rounds; trials end in another order than they are given."""
        schedule = self.schedule()
        for trials in schedule.rounds():
            for trial in trials[::-1]:
                if trial.id in self.breaking:
                    self.breaking.discard(trial.id)
                elif stop_after > 0:
                    self.done.append(trial.id)
                    stop_after -= 1
                else:
                    return schedule
        return schedule


# ------------------------------------------------------------------------------------------------------------- the plan


@pytest.mark.parametrize("names", [[], ["T1"], ["fast_food/L1", "morning_coffee/O1"]])
def test_the_plan_holds_every_pair_and_nothing_that_a_plain_plan_lacks(names):
    plan = make_plan("noop", variations=names, trials=6, seed=5, until_decided=True)
    keys = Counter(t.id for t in plan.trials)
    assert set(keys.values()) == {1}
    varied = [t for t in plan.trials if t.variation is not None]
    twins = {TrialId(t.task, str(t.base_condition), t.seed) for t in varied}
    assert {t.id for t in plan.trials if t.variation is None} == twins
    assert set(keys) <= {t.id for t in make_plan("noop", variations=names, trials=6, seed=5).trials}


def test_the_rule_is_part_of_the_plan_and_a_plain_plan_is_as_it_was():
    plan = make_plan("noop", tasks=["fast_food"], until_decided=True)
    assert plan.to_json()["until_decided"] == {"level": 0.05, "margin": 0.5, "first": 5}
    assert "until_decided" not in make_plan("noop", tasks=["fast_food"]).to_json()


def test_a_plan_comes_back_with_its_rule_and_a_broken_rule_is_refused(tmp_path):
    plan = small()
    run = RunFolder.start(tmp_path / "run", plan.to_json())
    assert repeated_plan(run.path) == plan
    rewrite(run.path / "run.json", lambda form: form["plan"]["until_decided"].update(margin=2.0))
    with pytest.raises(RecordError, match="margin"):
        repeated_plan(run.path)


def test_too_few_trials_for_any_verdict_are_refused():
    with pytest.raises(InvalidInputError, match=r"--trials: 4 are too few .* Use 5 or more"):
        make_plan("noop", trials=4, until_decided=True)


def test_a_plan_without_a_twin_is_refused():
    plan = small()
    with pytest.raises(InvalidInputError, match="morning_coffee/train1/4 is missing"):
        dataclasses.replace(plan, trials=tuple(t for t in plan.trials if t.id.seed < 4 or t.variation))
    with pytest.raises(InvalidInputError, match="a variation is missing"):
        dataclasses.replace(plan, trials=tuple(t for t in plan.trials if not t.variation))


def test_a_run_until_decided_says_what_it_decides_before_it_starts():
    said = what_trials_show(make_plan("expert", tasks=["fast_food"], trials=20, until_decided=True))
    assert "Each of the 6 variations gets 5 to 20" in said
    assert "does not drop by 50 points" in said
    assert "at most 5 % are expected to be wrong" in said


# --------------------------------------------------------------------------------------------------------- the schedule


LOST = {("fast_food", "T1"), ("morning_coffee", "O1"), ("office_drawer", "train2")}


@pytest.fixture(scope="module")
def suite() -> Plan:
    return make_plan("noop", trials=12, until_decided=True)


def test_a_suite_that_is_clear_takes_less_than_half_of_its_trials(suite):
    play = Play(suite, lost=LOST)
    decisions = play.run().decisions
    assert decisions is not None
    assert (
        decisions.decided
        == len(decisions.answers)
        == sum(len(get_task(name).variations) for name in suite_tasks("better60"))
    )
    drops = {a.question.condition for a in decisions.answers if a.verdict is Verdict.DROP}
    unlearned = {a.question.twin for a in decisions.answers if a.verdict is Verdict.NOT_LEARNED}
    assert drops == {"fast_food/T1", "morning_coffee/O1"}
    assert unlearned == {"office_drawer/train2"}
    assert len(play.done) == len(set(play.done)) < 0.5 * len(suite.trials)


@pytest.mark.parametrize("stop_after", [1, 100, 440, 470])
def test_a_run_that_was_stopped_goes_on_with_the_same_trials(suite, stop_after):
    whole, stopped = Play(suite, lost=LOST), Play(suite, lost=LOST)
    whole.run()
    stopped.run(stop_after=stop_after)
    assert len(stopped.done) == min(stop_after, len(whole.done))
    stopped.run()
    assert Counter(stopped.done) == Counter(whole.done)


def test_a_trial_that_breaks_down_ends_the_run_after_its_round_and_is_run_again_by_the_next(suite):
    whole, broken = Play(suite, lost=LOST), Play(suite, lost=LOST, breaking={TrialId("fast_food", "L1", 2)})
    whole.run()
    decisions = broken.run().decisions
    assert decisions is not None
    assert decisions.waiting == (("fast_food/L1", 2),)
    first_round = {t.id for t in suite.trials if t.seed < 5}
    assert set(broken.done) == first_round - {TrialId("fast_food", "L1", 2)}
    broken.run()
    assert Counter(broken.done) == Counter(whole.done)


def test_a_plain_plan_is_one_round_of_what_is_not_done():
    plan = make_plan("noop", tasks=["fast_food"], trials=2)
    done = {t.id for t in plan.trials[::2]}
    schedule = Schedule(plan, is_done=done.__contains__, succeeded=lambda _: pytest.fail("no outcome is needed"))
    assert [list(trials) for trials in schedule.rounds()] == [list(plan.trials[1::2])]
    assert schedule.decisions is None


# -------------------------------------------------------------------------------------------------------- with a world


@pytest.fixture(scope="module")
def decided(tmp_path_factory) -> RunFolder:
    """Whoever does nothing solves `T1`, where the mug stands on its ring already, and fails its twin."""
    return evaluate(small(), tmp_path_factory.mktemp("until") / "run")


def keys(run: RunFolder) -> set[TrialId]:
    return {e.key for e in run.entries()}


@pytest.mark.physics
def test_the_trials_that_a_verdict_needs_are_run_and_no_more(decided):
    assert keys(decided) == {t.id for t in small().trials if t.seed < 2}
    assert all(e.status == "done" for e in decided.entries())


@pytest.mark.physics
def test_a_killed_run_is_resumed_to_the_same_bytes_with_any_number_of_environments(decided, tmp_path, run_content):
    def interrupt(progress):
        if progress.done == 3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        evaluate(small(), tmp_path / "run", on_progress=interrupt)
    told = []
    again = evaluate(small(), tmp_path / "run", envs=2, on_progress=told.append)
    assert run_content(again.path) == run_content(decided.path)
    assert len(again.journal_path.read_text().splitlines()) == len(keys(decided)) == len(keys(again))
    assert [p.done for p in told] == [3, 4]
    assert [p.decisions.decided for p in told] == [0, 1]


@pytest.mark.physics
@pytest.mark.slow
def test_two_workers_run_the_same_trials(decided, tmp_path, run_content):
    plan = small(rule=StoppingRule(level=0.2, first=1))
    one, two = (evaluate(plan, tmp_path / str(n), workers=n) for n in (1, 2))
    assert run_content(one.path) == run_content(two.path)
    assert 2 < len(keys(one)) < len(plan.trials)


@pytest.mark.physics
def test_the_same_command_again_runs_nothing_and_another_rule_is_another_run(decided, monkeypatch):
    monkeypatch.setattr(Worker, "start", lambda *_: pytest.fail("a trial was run that nobody needs"))
    assert keys(evaluate(small(), decided.path)) == keys(decided)
    with pytest.raises(RunConflictError, match=r"until_decided\.first"):
        evaluate(small(rule=StoppingRule(level=0.3, first=1)), decided.path)


@pytest.mark.physics
def test_your_own_loop_gets_the_same_trials(decided, tmp_path):
    plan = dataclasses.replace(small(), policy="mine")
    with ExternalRun(plan, tmp_path / "run", needs_images=False) as run:
        played = []
        for trial in run.waiting():
            played.append(trial.id)
            _store(run, trial, decided)
        assert set(played) == keys(decided)
        assert len(played) == len(keys(decided))


def _store(run: ExternalRun, trial, source: RunFolder) -> None:
    """Puts the record of another run in the place of a trial, as one of its policy, and its line into the journal."""
    record = source.read_record(trial.task, trial.condition, trial.seed)
    mine = dataclasses.replace(record.metadata, policy=run.plan.policy)
    run.folder.write_record(dataclasses.replace(record, metadata=mine))
    with run.folder.journal() as journal:
        journal.append(JournalEntry(trial.task, trial.condition, trial.variation, trial.seed))


@pytest.mark.physics
def test_the_diagnosis_counts_what_was_run_and_gives_the_verdict(decided):
    found = diagnose_run(decided)
    assert {t.trial_id for t in found.trials} == keys(decided), "spared trials are nowhere"
    assert not found.pending
    assert found.until_decided is not None
    (answer,) = found.until_decided.decisions.answers
    assert answer.verdict is Verdict.NOT_LEARNED, "the twin fails, so there is nothing to lose"
    one, all_of_them = found.metric("success_rate", "morning_coffee/T1"), found.metric("success_rate", "overall")
    assert (one.k, one.n, one.method) == (2, 2, "anytime-valid")
    assert (all_of_them.k, all_of_them.n, all_of_them.method) == (2, 2, "wilson")
    assert one.low < all_of_them.low
    gap = found.metric("illusion_gap", "morning_coffee/T1")
    assert (gap.value, gap.p_value) == (-1.0, 1.0)
    assert gap.method.startswith("anytime-valid")
    assert "continued until its variations were decided" in found.notes[0]
    assert found.to_json()["until_decided"]["verdicts"][0]["verdict"] == "not_learned"


@pytest.mark.physics
def test_a_round_that_was_not_finished_is_missing_and_later_ones_are_not(decided, tmp_path):
    kept = decided.journal_path.read_text().splitlines()[:3]
    place = tmp_path / "run"
    place.mkdir()
    (place / "run.json").write_bytes((decided.path / "run.json").read_bytes())
    (place / "records").symlink_to(decided.path / "records")
    (place / "journal.jsonl").write_text("".join(f"{line}\n" for line in kept))
    found = diagnose_run(_unlinked(place, decided))
    assert {t.trial_id for t in found.trials} == keys(decided)
    assert sum(t.record is None for t in found.trials) == 1
    assert found.until_decided.decisions.decided == 0


def _unlinked(place: Path, source: RunFolder) -> Path:
    """Replaces the link by files: a record must lie inside its run."""
    (place / "records").unlink()
    for record in (source.path / "records").rglob("*.parquet"):
        copy = place / record.relative_to(source.path)
        copy.parent.mkdir(parents=True, exist_ok=True)
        copy.write_bytes(record.read_bytes())
    return place


@pytest.mark.physics
def test_report_and_comparison_say_that_the_run_stopped_itself(decided, tmp_path):
    page = write_report([diagnose_run(decided)], tmp_path / "report").read_text(encoding="utf-8")
    assert "biased toward the verdict" in page
    assert "<dt>Verdict</dt><dd>not learned</dd>" in page
    table = (tmp_path / "report" / "tables" / "variations.csv").read_text().splitlines()
    assert table[0].endswith(",verdict")
    assert table[1].endswith(",not learned")


@pytest.mark.physics
def test_the_command_line_repeats_it_and_says_what_is_decided(decided, capsys):
    arguments = ["eval", "--from", str(decided.path), "--out", str(decided.path), "--workers", "1", "--uncertified"]
    assert main(arguments) == 0
    said = capsys.readouterr()
    out, err = " ".join(said.out.split()), " ".join(said.err.split())
    assert "1 of 1 variation are decided" in out
    assert "It took 4 trials." in out
    assert "At most 10 trials." in err
    assert "1/1 variations decided" in err
    assert main([*arguments, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["until_decided"]["verdicts"][0]["pairs"] == 2


@pytest.mark.physics
def test_a_comparison_leaves_out_what_outcomes_have_chosen(tmp_path, decided):
    place = tmp_path / "other"
    shutil.copytree(decided.path, place)
    rewrite(place / "run.json", lambda form: form["plan"]["until_decided"].update(first=1))
    result = compare(load_sides([decided.path, place]))
    assert [len(side) for side in result.matching.trials] == [2, 2], "one variation and its twin with the first seed"
    (note,) = [note for note in result.notes if "of its first 1 seed are compared" in note]
    assert "2 trials whose selection depended on outcomes are left out" in note


def test_options_that_contradict_each_other_are_refused(tmp_path, capsys):
    arguments = ["eval", "--from", str(tmp_path), "--until-decided"]
    assert main(arguments) == 2
    assert "--until-decided" in capsys.readouterr().err
