"""``better compare`` reads runs, says the verdict first, and prints k/n beside every percentage."""

from __future__ import annotations

import json
import re

import pytest

from betterbench.cli.console import OUT
from betterbench.cli.main import main
from betterbench.evaluation import make_plan
from betterbench.evaluation.planning.power import what_trials_show
from betterbench.records import RunFolder
from betterbench.statistics import smallest_paired_difference


def run_verb(capsys, *arguments):
    try:
        status = main(arguments)
    except SystemExit as stop:
        status = stop.code or 0
    captured = capsys.readouterr()
    return status, captured.out, captured.err


@pytest.fixture
def runs(tmp_path):
    """Two runs of one plan without records, and one of another suite."""
    paths = []
    for name, suite in (("a", "1.0"), ("b", "1.0"), ("c", "9.0")):
        plan = make_plan(f"policy-{name}", tasks=["fast_food"], trials=3).to_json() | {"suite_version": suite}
        paths.append(str(RunFolder.start(tmp_path / name, plan).path))
    return paths


def test_the_verdict_comes_first_and_percentages_have_their_counts(capsys, runs):
    status, out, _ = run_verb(capsys, "compare", *runs[:2], "--sequential")
    text = " ".join(out.split())
    assert status == 0
    assert text.startswith("Not decided between policy-a and policy-b after 0 pairs")
    assert "Nothing can be concluded about which of policy-a and policy-b is better" in text
    assert "With 18 pairs, a true difference must be" in text
    assert "36/36 trials of policy-a are not finished and count as failures" in text
    counted, all_of_them = (len(re.findall(p, text)) for p in (r"\d+/\d+ \(?\d+\.\d %", r"\d+\.\d %"))
    assert counted == all_of_them > 10


def test_every_table_fits_a_terminal_of_100_columns(capsys, runs, monkeypatch):
    monkeypatch.setattr(OUT, "width", 100)
    _, out, _ = run_verb(capsys, "compare", *runs[:2])
    rows = [line for line in out.splitlines() if re.search(r"\d+/\d+ \d+\.\d % [ab]", line)]
    assert len(rows) >= 6
    assert all(len(re.findall(r"\d+/\d+ \d+\.\d % [ab]", line)) == 2 for line in rows)


def test_json_is_one_document(capsys, runs):
    status, out, _ = run_verb(capsys, "compare", *runs[:2], "--json", "--alpha", "0.1")
    document = json.loads(out)
    assert status == 0
    assert document["alpha"] == 0.1
    assert [r["name"] for r in document["runs"]] == ["policy-a", "policy-b"]
    assert document["runs"][0]["unfinished"] == document["runs"][0]["compared"] == 36
    assert document["groups"][0]["sides"][0]["rate"] | {"k": 0, "n": 18} == document["groups"][0]["sides"][0]["rate"]


def test_three_runs_are_ranked_with_letters(capsys, runs):
    status, out, _ = run_verb(capsys, "compare", *runs, "--allow-mixed")
    text = " ".join(out.split())
    assert status == 0
    assert text.startswith("Variations: policy-a 0/18 (0.0 %) a, policy-b 0/18 (0.0 %) a, policy-c 0/18 (0.0 %) a.")
    assert "suite_version differs" in text


@pytest.mark.parametrize(
    ("pick", "options", "text"),
    [
        ((0,), (), "needs at least two runs"),
        ((0, 0), (), "given twice"),
        ((0, 2), (), "suite_version differs"),
        ((0, 1), ("--alpha", "5"), "--alpha"),
    ],
)
def test_what_cannot_be_compared_is_one_error(capsys, runs, pick, options, text):
    status, out, err = run_verb(capsys, "compare", *(runs[i] for i in pick), *options)
    assert status == 2
    assert not out
    assert text in " ".join(err.split())


def test_eval_says_what_its_trials_can_show_at_every_level():
    text = what_trials_show(make_plan("expert", tasks=["fast_food"], trials=20))
    for n, name in ((20, "within a variation"), (120, "overall")):
        value = 100 * smallest_paired_difference(n).value
        assert f"{value:.{0 if value >= 10 else 1}f} points {name} ({n} pairs)" in text
    assert re.search(r"points within an axis \(20 to 40 pairs\)", text)
    usual = 100 * smallest_paired_difference(20, opposite=0.1).value
    assert re.search(rf"If 10 % of the pairs differ the other way, .* must be .* and {usual:.0f} points\.", text)


def test_eval_says_what_its_trials_cannot_show():
    text = what_trials_show(make_plan("expert", tasks=["fast_food"], trials=2))
    assert (
        "too few to show any drop within an axis (2 to 4 pairs) and within a variation (2 pairs). Use more --trials"
        in text
    )
    assert "overall (12 pairs)" in text
    one = what_trials_show(make_plan("expert", tasks=["fast_food"], variations=["L1"], trials=1))
    assert one.startswith("They are too few")
    few = what_trials_show(make_plan("expert", tasks=["fast_food"], trials=1))
    assert "96 points overall (6 pairs). If 10 % of the pairs differ the other way, no drop can be shown." in few
