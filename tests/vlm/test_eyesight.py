"""The myopic ablation as an instrument: scripted models of known eyesight get their own size back."""

from __future__ import annotations

import json
from functools import partial

import pytest
from tests.vlm import published
from tests.vlm.sighted import DETAIL, Sighted, own_set, questions

from betterbench.cli.main import main
from betterbench.cli.output.vlm import print_steps
from betterbench.statistics import fit_threshold
from betterbench.vlm import RunSettings, evaluate_model, find_benchmark, score_answers
from betterbench.vlm import eyesight as eyesight_module
from betterbench.vlm.eyesight import compare_eyes, eyesight, eyesight_sentence, readings_of
from betterbench.vlm.models.eyes import Eyes
from betterbench.vlm.prompts import find_prompt
from betterbench.vlm.steps import StepTable, step_table
from betterbench.vlm.stored import read_static_run
from betterbench.vqa.coordinates import CONVENTIONS

OWN = find_benchmark("better-vqa")
RESAMPLES = 20
"""Resamples that suffice here; tests/statistics/test_threshold.py tests the intervals with more."""


@pytest.fixture(scope="module", autouse=True)
def few_resamples():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(eyesight_module, "fit_threshold", partial(fit_threshold, resamples=RESAMPLES))
        yield


@pytest.fixture(scope="module")
def items(tmp_path_factory):
    return own_set(tmp_path_factory.mktemp("own") / "set")


def readings(items, eyes, model):
    texts = {q.id: model.reply(q) for q in model.asked.values()}
    score = score_answers(OWN, items, texts, CONVENTIONS["pixels"])
    return readings_of(items, score, Eyes(eyes), "parsed")


def run_of(items, out, model, eyes="native"):
    evaluate_model(OWN, items, model, out, RunSettings(find_prompt("better-vqa", None), eyes=Eyes(eyes)))
    return out


@pytest.mark.parametrize(("s", "eyes", "wrong"), [(12, "blur-224", 0.05), (20, "tile-1", 0.1), (40, "native", 0.05)])
def test_one_run_finds_the_size_that_a_model_reads(items, s, eyes, wrong):
    found = eyesight(readings(items, eyes, Sighted(s, eyes, wrong=wrong)), "test")
    assert found.value == pytest.approx(s, rel=0.1)
    assert eyesight_sentence(found).startswith(
        f"Eyesight: the model recognizes objects from {found.value:.1f} pixels (95 % interval"
    )


def test_a_model_that_reads_everything_has_no_size(items):
    found = eyesight(readings(items, "native", Sighted(8, "native")), "test")
    assert found.value is None
    assert eyesight_sentence(found).startswith(
        "Eyesight: 560 questions do not show the smallest readable size, because the score"
    )


def test_a_benchmark_without_sizes_has_no_eyesight(tmp_path):
    benchmark = find_benchmark("embspatial")
    items = benchmark.load(published.embspatial_json(tmp_path / "data"))
    score = score_answers(benchmark, items, {}, CONVENTIONS["pixels"])
    assert eyesight(readings_of(items, score, Eyes.NATIVE, "parsed"), "test") is None


def test_one_size_explains_two_eyes(items):
    runs = [
        (eyes, readings(items, eyes, Sighted(20, eyes, guesses=False))) for eyes in ("native", "tile-1", "blur-224")
    ]
    found = compare_eyes("scripted", "better vqa", runs)
    assert found.scores["native"] > found.scores["blur-224"]
    assert found.one.value == pytest.approx(20, rel=0.1)
    assert found.further == ()
    assert "explains the differences between the eyes" in found.sentence


def test_a_loss_of_tokens_is_not_taken_for_eyesight(items):
    runs = [
        ("blur-224", readings(items, "blur-224", Sighted(12, "blur-224"))),
        ("native-224", readings(items, "native-224", Sighted(12, "native-224", wrong=0.3, seed=1))),
    ]
    found = compare_eyes("scripted", "better vqa", runs)
    assert found.further == ("native-224",)
    assert "one size does not explain" in found.sentence
    assert "native-224 loses" in found.sentence


@pytest.fixture(scope="module")
def stored(tmp_path_factory):
    """Runs of four models: whole, weaker by one relation, equal to the first up to noise, and myopic."""
    folder = tmp_path_factory.mktemp("runs")
    items = own_set(folder / "set", 280)
    models = {
        "whole": Sighted(20, "native", name="whole"),
        "lost": Sighted(20, "native", name="lost", lost="side for robot", seed=1),
        "same": Sighted(20, "native", name="same", seed=2),
        "myopic": Sighted(20, "blur-224", name="whole"),
    }
    return {name: run_of(items, folder / name, model, model.eyes) for name, model in models.items()}


def test_the_table_names_the_only_lost_relation(stored, capsys, monkeypatch):
    table = step_table([stored["whole"], stored["lost"]])
    moved = [group for group in table.groups if group.is_supported and not group.explained_by]
    assert [(group.kind, group.name) for group in moved] == [("family", "side for robot")]
    assert moved[0].difference.value == pytest.approx(0.45, abs=0.15)
    monkeypatch.setenv("COLUMNS", "80")
    print_steps(table)
    shown = " ".join(capsys.readouterr().out.split())
    assert "family: side for robot" in shown
    assert f"A supported change was found in 1 of {len(table.groups)} groups" in shown


def test_the_table_is_silent_if_nothing_is_lost(stored):
    table = step_table([stored["whole"], stored["same"]])
    assert len(table.groups) > 10
    assert not any(group.is_supported for group in table.groups)


def test_the_run_and_the_comparison_of_eyes_say_the_size(stored, capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    result = json.loads((stored["myopic"] / "result.json").read_text())
    assert result["eyesight"]["value"] == pytest.approx(20, rel=0.1)
    item = next(iter(read_static_run(stored["myopic"]).items.values()))
    smallest = min(box[2] - box[0] for box in questions()[0].boxes)
    assert item.size_px == pytest.approx(smallest * DETAIL["blur-224"])
    assert main(["compare", str(stored["whole"]), str(stored["myopic"])]) == 0
    out = capsys.readouterr().out
    shown = " ".join(out.split())
    assert "Eyesight of whole, better vqa" in shown
    assert "reads from px" in shown
    assert main(["compare", str(stored["whole"]), str(stored["myopic"]), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)["eyesight"][0]
    assert found["one"]["value"] == pytest.approx(20, rel=0.1)
    assert abs(found["one"]["further"]["blur-224"]["value"]) < 0.1


def test_no_loss_beyond_the_sizes_is_shown_if_no_size_is_concluded(items, capsys):
    runs = [(eyes, readings(items, eyes, Sighted(10_000, eyes))) for eyes in ("native", "blur-224")]
    found = compare_eyes("blind", "better vqa", runs)
    assert found.one.value is None
    print_steps(StepTable("parsed", 0.05, (), (), (), eyesight=(found,)))
    (row,) = (line.split() for line in capsys.readouterr().out.splitlines() if line.startswith("blur-224 "))
    assert row[-2:] == ["–", "–"]
