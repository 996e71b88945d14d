"""Runs that a stranger's loop drives: every planned trial in the journal, each once, whatever the loop does."""

from __future__ import annotations

import numpy as np
import pytest
from tests.evaluation.few_steps import in_few_steps

from betterbench.diagnosis import Label, diagnose_run
from betterbench.errors import InvalidInputError, RunConflictError
from betterbench.evaluation import ExternalRun, evaluate, make_plan
from betterbench.interface import episode_number
from betterbench.records import RunFolder, record_bytes
from betterbench.tasks.trial import Trial

pytestmark = pytest.mark.physics

STILL = np.array([0.0] * 6 + [-1.0])


def plan(policy: str = "mine", *, trials: int = 1):
    return make_plan(
        policy,
        tasks=["morning_coffee"],
        variations=["morning_coffee/T1"],
        trials=trials,
        observation="state_only",
        quality="fast",
    )


def test_a_callable_leaves_the_records_of_better_eval(tmp_path, monkeypatch):
    monkeypatch.setattr(Trial, "resolve", in_few_steps(60))
    ours = evaluate(plan("noop"), tmp_path / "ours")
    with ExternalRun(plan(), tmp_path / "mine") as run:
        done = [run.play(trial, lambda _: STILL) for trial in run.waiting()]
        assert [e.status for e in done] == ["done", "done"]
        assert list(run.waiting()) == []
    theirs = RunFolder.open(tmp_path / "mine")
    by_seed = [sorted(run.records(), key=lambda r: (r.metadata.condition, r.metadata.seed)) for run in (ours, theirs)]
    for a, b in zip(*by_seed, strict=True):
        assert b.metadata.policy == "mine"
        object.__setattr__(b.metadata, "policy", "noop")
        assert record_bytes(a) == record_bytes(b)
    assert {t.label for t in diagnose_run(theirs).trials} == {Label.CORRECT_FREEZE, Label.EARLY_HALT}
    assert theirs.context["engine"]["name"] == "external"


@pytest.mark.usefixtures("short_trials")
def test_a_run_whose_folder_vanishes_goes_on_and_runs_again_what_is_gone(tmp_path):
    out = tmp_path / "run"
    with ExternalRun(plan(), out) as run:
        first, second = run.plan.trials
        run.play(first, lambda _: STILL)
        out.rename(tmp_path / "elsewhere")
        run.play(second, lambda _: STILL)
        assert [e.key for e in RunFolder.open(out).entries()] == [second.id]
        assert list(run.waiting()) == [first]
        run.play(first, lambda _: STILL)
    assert len(list(RunFolder.open(out).records())) == 2


def test_chunks_are_played_whole_and_asked_for_once(tmp_path):
    asked = []

    def act(seen):
        asked.append(seen.step)
        return np.repeat(STILL[None], 80, axis=0)

    with ExternalRun(plan(), tmp_path / "run") as run:
        trial = next(t for t in run.plan.trials if t.condition == "T1")
        run.play(trial, act)
        assert run.outcome(trial).success
    assert asked == [0, 80, 160]


def test_a_policy_that_raises_ends_its_trial_and_the_run_goes_on(tmp_path):
    def act(seen):
        if seen.step == 4:
            raise KeyError("left gripper")
        return STILL

    with ExternalRun(plan(trials=2), tmp_path / "run") as run:
        for trial in run.waiting():
            run.play(trial, act)
    entries = RunFolder.open(tmp_path / "run").entries()
    assert len(entries) == 4
    for record in RunFolder.open(tmp_path / "run").records():
        assert record.outcome.termination == "policy_error"
        assert str(record.outcome.error).startswith("KeyError: 'left gripper' (")
        assert len(record.time) == 5


@pytest.mark.usefixtures("short_trials")
def test_an_episode_given_up_is_run_again_by_the_same_run(tmp_path):
    with ExternalRun(plan(), tmp_path / "run") as run:
        first, second = run.plan.trials
        seen = run.begin(first)
        assert run.start.instruction == seen.instruction
        assert (run.start.episode, run.start.action_space) == (episode_number(first.seed), "ee_delta")
        run.act(STILL)
        run.begin(second)
        assert [(e.condition, e.status) for e in run.folder.entries()] == [(first.condition, "error")]
        run.fail("its arm fell off")
    with ExternalRun(plan(), tmp_path / "run") as run:
        assert list(run.waiting()) == [first]
        run.play(first, lambda _: STILL)
        assert run.is_done(first)
        assert run.outcome(second).error == "its arm fell off"
    entries = RunFolder.open(tmp_path / "run").entries()
    assert sorted(e.condition for e in entries if e.status == "done") == ["T1", "train1"]


def test_a_run_is_not_mixed_with_another_one(tmp_path):
    ExternalRun(plan(), tmp_path / "run").close()
    with pytest.raises(RunConflictError, match=r'plan.policy is "mine" in the folder but "yours" in the request'):
        ExternalRun(plan("yours"), tmp_path / "run")
    with pytest.raises(RunConflictError, match="checkpoint"):
        ExternalRun(plan(), tmp_path / "run", metadata={"checkpoint": "later"})
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "notes.txt").write_text("mine")
    with pytest.raises(RunConflictError, match="contains other files"):
        ExternalRun(plan(), tmp_path / "other")
    with pytest.raises(InvalidInputError, match="reserved for a built-in policy"):
        ExternalRun(plan("expert"), tmp_path / "new")
    assert not (tmp_path / "new").exists()


def test_an_answer_without_an_episode_is_refused(tmp_path):
    with ExternalRun(plan(), tmp_path / "run") as run, pytest.raises(InvalidInputError, match="Call begin first"):
        run.act(STILL)
