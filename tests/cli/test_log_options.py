"""Every verb says as much about itself as it is asked to, and the shell completes the options of all of them."""

from __future__ import annotations

import logging
import os
import subprocess
import sys

import pytest
from tests.cli.helps import help_of
from tests.looping import each

from betterbench.cli.main import VERBS, main
from betterbench.jobs.worker_process import prepare_process

WRONG = ("diagnose", "no/such/run")


@pytest.fixture(autouse=True)
def level_kept(monkeypatch):
    monkeypatch.setenv("BETTERBENCH_LOG_LEVEL", "WARNING")  # so that it is put back
    ours = logging.getLogger("betterbench")
    before = ours.level
    yield
    ours.setLevel(before)


def test_an_error_shows_where_it_was_raised_only_if_asked(capsys):
    assert main(WRONG) == 2
    assert "Traceback" not in capsys.readouterr().err
    assert main([*WRONG, "--traceback"]) == 2
    err = capsys.readouterr().err
    assert "Traceback (most recent call last)" in err
    assert "in diagnose_command" in err
    assert "error: no/such/run: contains no run" in err.replace("\n", " ")


def test_workers_log_at_the_level_of_the_command_line(capsys):
    ours = logging.getLogger("betterbench")
    assert main([*WRONG, "--log-level", "debug"]) == 2
    assert ours.level == logging.DEBUG
    assert os.environ["BETTERBENCH_LOG_LEVEL"] == "DEBUG"
    ours.setLevel(logging.ERROR)
    prepare_process()
    assert ours.level == logging.DEBUG


def test_a_level_that_does_not_exist_is_refused_by_the_verb_and_ignored_by_a_worker(capsys, monkeypatch):
    with pytest.raises(SystemExit) as stop:
        main([*WRONG, "--log-level", "loud"])
    assert stop.value.code == 2
    assert "debug" in capsys.readouterr().err
    monkeypatch.setenv("BETTERBENCH_LOG_LEVEL", "loud")
    prepare_process()
    assert logging.getLogger("betterbench").level == logging.WARNING


@pytest.mark.slow
def test_a_run_logs_its_trials_if_asked(tmp_path):
    arguments = ["eval", "--policy", "noop", "--tasks", "fast_food", "--variations", "L1", "--trials", "1"]
    more = ["--observation", "state_only", "--log-level", "info", "--workers", "1", "--out", str(tmp_path / "run")]
    done = subprocess.run(
        [sys.executable, "-m", "betterbench.cli", *arguments, *more],
        capture_output=True,
        text=True,
        check=True,
    )
    assert "fast_food/train1/0: 2 of 2 trials done" in done.stderr


@each("verb", VERBS)
def test_every_verb_has_the_options(verb):
    assert "--log-level" in help_of(verb)
    assert "--traceback" in help_of(verb)


COMPLETIONS = [
    (["better", "ev"], {"eval"}),
    (["better", "eval", "--until"], {"--until-decided"}),
    (["better", "eval", "--engine", ""], {"local", "ray"}),
    (["better", "report", "--fil"], {"--films"}),
]


def test_bash_completes_verbs_and_their_options(capsys):
    """All in one process of bash, which takes 0.2 s to read the script."""
    with pytest.raises(SystemExit):
        main(["--tyro-print-completion", "bash"])
    script = [capsys.readouterr().out]
    for typed, _ in COMPLETIONS:
        words = " ".join(f"'{word}'" for word in typed)
        script += [f"COMP_WORDS=({words}); COMP_CWORD={len(typed) - 1}; COMPREPLY=(); _tyro_better"]
        script += ['printf "%s\\n" "${COMPREPLY[@]}" END']
    done = subprocess.run(["/bin/bash", "-c", "\n".join(script)], capture_output=True, text=True, check=False)
    *answers, rest = done.stdout.split("END\n")
    assert not rest
    for (typed, offered), answer in zip(COMPLETIONS, answers, strict=True):
        assert offered <= {line.strip() for line in answer.splitlines()}, (typed, done.stderr)
