"""What `better eval` says about the length of a run: before it, after its first seconds, and while it goes on."""

from __future__ import annotations

import shlex
from pathlib import Path
from types import SimpleNamespace

import pytest
from tests.evaluation.conftest import in_few_steps

from betterbench.cli.main import main
from betterbench.cli.outlook import FEW, Outlook
from betterbench.cli.verbs import evaluate as module
from betterbench.cli.verbs.evaluate import TrialOptions, _print_expert, smaller_command
from betterbench.evaluation import Progress, make_plan
from betterbench.evaluation.planning.power import smallest_drop_line
from betterbench.tasks import TrialId
from betterbench.tasks.trial import Trial


def trial(seed):
    return TrialId("fast_food", "T1", seed)


def progress(done, planned=100, *, started_with=0):
    return Progress(done, planned, 60.0, started_with, None)


def test_time_is_estimated_from_steps_before_a_trial_has_ended():
    outlook = Outlook({trial(seed): 500 for seed in range(100)})
    outlook.begin({trial(0), trial(1)})
    assert outlook.note(progress(2, started_with=2)) == ""
    outlook.see(10, now_s=100.0)
    assert outlook.note(progress(2, started_with=2)) == "10 steps"
    outlook.see(110, now_s=104.0)
    assert outlook.rate == 25.0
    assert outlook.most_left_s == 98 * 500 / 25.0
    assert outlook.note(progress(2, started_with=2)) == "at most 33 min left · 110 steps"
    said = outlook.first_estimate()
    assert said is not None
    for part in ("At most 33 min", "from the first 4 s", "25 steps per second", "49,000 more steps"):
        assert part in said
    outlook.end(trial(2))
    outlook.end(trial(2))
    assert outlook.most_left_s == 97 * 500 / 25.0


def test_the_pace_of_the_trials_counts_once_some_have_ended():
    outlook = Outlook({trial(seed): 500 for seed in range(100)})
    outlook.begin(set())
    outlook.see(10, now_s=0.0)
    outlook.see(1234, now_s=60.0)
    assert outlook.note(progress(FEW - 1)).startswith("at most ")
    assert outlook.note(progress(FEW)) == "8.0/min, 12 min left · 1,234 steps"


def test_a_short_run_says_nothing_more():
    outlook = Outlook({trial(0): 500})
    outlook.begin(set())
    outlook.see(1, now_s=0.0)
    outlook.see(101, now_s=1.0)
    assert outlook.first_estimate() is None


def test_limits_are_those_of_the_conditions():
    plan = make_plan("expert", tasks=["morning_coffee"], trials=1)
    limits = plan.world.step_limits(plan.trials)
    assert limits.keys() == {t.id for t in plan.trials}
    found = plan.trials[0].resolve()
    assert limits[plan.trials[0].id] == found.task.step_limit(found.condition)


def said_before(monkeypatch, capsys, tmp_path, *words):
    """What `better eval` says before the run itself."""
    monkeypatch.setattr(module, "run_with_bar", lambda *_, **__: (_ for _ in ()).throw(KeyboardInterrupt))
    main(["eval", *words, "--out", str(tmp_path / "my run")])
    return capsys.readouterr().err.splitlines()


def test_a_large_plan_names_its_trials_and_a_smaller_command(monkeypatch, capsys, tmp_path):
    (tmp_path / "my policy.py").touch()
    policy = f"python:{tmp_path / 'my policy.py'}:Policy"
    lines = said_before(
        monkeypatch, capsys, tmp_path, "--policy", policy, "--observation", "state_only", "--quality", "fast"
    )
    assert lines[0].startswith("2,560 trials. They can show an overall drop of 0.7 points (details: --explain-power")
    assert lines[1].startswith("To begin with, 38 trials: ")
    command = shlex.split(lines[1].partition("trials: ")[2])
    assert Path(command[0]).name == "better"
    given = dict(zip(command[2::2], command[3::2], strict=True))
    assert given == {
        "--policy": policy, "--observation": "state_only", "--quality": "fast", "--tasks": "morning_coffee",
        "--trials": "3",
        "--out": f"{tmp_path / 'my run'}-first",
    }  # fmt: skip
    again = said_before(monkeypatch, capsys, tmp_path, *command[2:-2])
    assert again[0].startswith("38 trials. ")
    assert len([line for line in again if "To begin with" in line]) == 0


def test_the_long_form_about_power_is_behind_an_option(monkeypatch, capsys, tmp_path):
    words = ("--policy", "noop", "--tasks", "fast_food", "--trials", "3")
    short = said_before(monkeypatch, capsys, tmp_path, *words)
    assert len(short[0]) <= 100
    long = said_before(monkeypatch, capsys, tmp_path, *words, "--explain-power")
    assert "With 80 % power" in long[0]
    assert "within an axis" in long[0]


def test_few_trials_say_that_they_show_nothing():
    one = make_plan("expert", tasks=["fast_food"], variations=["L1"], trials=1)
    assert smallest_drop_line(one) == "They are too few to show any drop (details: --explain-power)."


def test_a_task_of_the_plan_is_named_to_begin_with():
    plan = make_plan("noop", tasks=["fast_food"], trials=20)
    assert "--tasks fast_food --trials 3" in smaller_command(plan, Path("runs/noop"), TrialOptions())
    small = make_plan("noop", tasks=["fast_food"], trials=3)
    assert not smaller_command(small, Path("runs/noop"), TrialOptions())


@pytest.mark.physics
def test_resuming_says_at_once_what_is_done(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(Trial, "resolve", in_few_steps(24))
    words = ["eval", "--policy", "noop", "--tasks", "morning_coffee", "--variations", "T1", "--trials", "1"]
    words += ["--observation", "state_only", "--workers", "1", "--out", str(tmp_path / "run")]
    assert main(words) == 0
    assert "done already" not in capsys.readouterr().err
    assert main(words) == 0
    lines = capsys.readouterr().err.splitlines()
    assert lines[1] == "2 of 2 trials are done already; 0 are left."
    assert lines[2].startswith("2/2 trials")


def test_an_error_of_the_experts_code_is_not_called_a_failure_without_an_obstacle(capsys):
    """The line before it names the error, so that no advice on obstacles follows."""
    entry = SimpleNamespace(
        status="done", key=("t", "train1", 0), task="t", condition="train1", seed=0, ground_truth={}, message=None
    )
    failing = SimpleNamespace(
        entries=lambda: [entry], outcome=lambda _: SimpleNamespace(success=False), record_path=lambda *_: "r.npz"
    )
    _print_expert(failing, set())
    assert "no obstacle was found" in capsys.readouterr().out
    entry.message = "TypeError: _goals() takes 3 positional arguments"
    _print_expert(failing, set())
    assert capsys.readouterr().out == ""
