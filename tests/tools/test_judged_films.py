"""Films of learned policies for blind judges: which trials are drawn, and how answers are read."""

from __future__ import annotations

import importlib
from pathlib import Path
from types import SimpleNamespace

import pytest

from betterbench.errors import UnknownNameError
from betterbench.learning.study.outcomes import TrialOutcome

TOOLS = Path(__file__).resolve().parents[2] / "tools"


@pytest.fixture
def films(monkeypatch):
    monkeypatch.syspath_prepend(str(TOOLS))
    return importlib.import_module("judged_films")


def trials(solved, failed):
    return [
        TrialOutcome(None, "train1", seed, seed < solved, "success" if seed < solved else "timeout", None, None)
        for seed in range(solved + failed)
    ]


@pytest.mark.parametrize(("solved", "failed", "wanted", "drawn"), [(12, 26, 19, 19), (12, 26, 40, 25), (30, 8, 19, 8)])
def test_a_run_gives_its_share_of_films_with_the_failures_that_it_has(films, solved, failed, wanted, drawn):
    chosen = films.choose(trials(solved, failed), 25, wanted, "run", 43)
    assert len({t.seed for t in chosen}) == 25
    assert sum(not t.success for t in chosen) == drawn


def test_films_are_drawn_by_seed_and_run(films):
    found = trials(12, 26)
    assert films.choose(found, 25, 19, "run", 43) == films.choose(found, 25, 19, "run", 43)
    assert films.choose(found, 25, 19, "run", 43) != films.choose(found, 25, 19, "run", 44)
    assert films.choose(found, 25, 19, "run", 43) != films.choose(found, 25, 19, "another run", 43)


def test_an_answer_has_the_kind_of_its_label(films, tmp_path):
    table = tmp_path / "judge.csv"
    table.write_text("id,label,kind,sure,remark\n7,timeout,reasoning,unsure,holds it\n8,success,right,sure,\n")
    read = films.judgments_in(table)
    assert read[7] == films.Judgment("timeout", "execution", sure=False, remark="holds it")
    assert (read[8].kind, read[8].sure) == ("none", True)


def test_an_answer_without_a_known_label_names_the_closest(films, tmp_path):
    table = tmp_path / "judge.csv"
    table.write_text("id,label,kind,sure,remark\n7,time_out,execution,sure,\n")
    with pytest.raises(UnknownNameError, match="timeout"):
        films.judgments_in(table)


def test_trials_of_a_single_run_have_the_names_of_their_variations(films, monkeypatch, tmp_path):
    found = [
        SimpleNamespace(variation=None, condition="train1", seed=0, success=True),
        SimpleNamespace(variation="L1", condition="train1", seed=0, success=False),
    ]
    monkeypatch.setattr(films, "diagnose_run", lambda _: SimpleNamespace(trials=found))
    ((folder, trials),) = films.runs_of(tmp_path)
    assert folder == tmp_path
    assert trials == [films.Outcome("train1", 0, success=True), films.Outcome("L1", 0, success=False)]
