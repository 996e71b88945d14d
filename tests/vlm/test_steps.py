"""Runs compared step by step: rows, paired tests, and what is refused."""

from __future__ import annotations

import base64
import json

import numpy as np
import pytest
from tests.vlm import published

from betterbench.cli.main import main
from betterbench.errors import InvalidInputError, RecordError, RunConflictError
from betterbench.statistics import PairedTable, mcnemar_p
from betterbench.vlm import RunSettings, evaluate_model, find_benchmark
from betterbench.vlm.models.eyes import Eyes
from betterbench.vlm.prompts import find_prompt
from betterbench.vlm.steps import step_table
from betterbench.vlm.stored import is_static_run, read_static_run
from betterbench.vqa.llm import RefusedError

COUNT = 60


class Knowing:
    """A model that answers a share of the questions correctly, always the same ones."""

    def __init__(self, items, share, *, seed=0, name="model"):
        drawn = np.random.default_rng(seed).random(len(items)) < share
        self.name = name
        self.right = {item.question: (item.gold.text, bool(knows)) for item, knows in zip(items, drawn, strict=True)}

    def answer(self, prompt, _pictures):
        gold, knows = next(v for q, v in self.right.items() if q in prompt)
        return gold if knows else "ABCD"[("ABCD".index(gold) + 1) % 4]


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    """Sixty questions, each with a picture of its own and different words."""
    folder = tmp_path_factory.mktemp("data") / "embspatial"
    folder.mkdir()
    rows = [
        row
        | {
            "question": f"Which of these is near mug {i}?",
            "scene_id": f"scene-{i}",
            "image": base64.b64encode(published.picture(i)).decode(),
        }
        for i, row in enumerate(published.embspatial_rows(COUNT))
    ]
    (folder / "embspatial_bench.json").write_text(json.dumps(rows))
    return folder


def run_of(data, out, share, *, name="model", eyes=Eyes.NATIVE, benchmark="embspatial", seed=0, prompt=None):
    chosen = find_benchmark(benchmark)
    items = chosen.load(data)
    model = Knowing(items.items, share, name=name, seed=seed)
    evaluate_model(chosen, items, model, out, RunSettings(find_prompt(benchmark, prompt), eyes=eyes))
    return out


def test_a_large_loss_is_supported_and_a_small_one_is_not(data, tmp_path):
    runs = [run_of(data, tmp_path / n, s, name=n) for n, s in (("8B", 0.9), ("4B", 0.85), ("2B", 0.2))]
    table = step_table(runs)
    assert [row.name for row in table.rows] == ["8B", "4B", "2B"]
    small, large = table.steps
    assert not small.is_supported
    assert large.is_supported
    assert "2B has" in large.sentence
    assert "less than 4B" in large.sentence
    assert large.changed == ("model",)
    first, second = (read_static_run(path).items for path in runs[1:])
    pairs = [(first[i].score == "1", second[i].score == "1") for i in first]
    if large.test.startswith("McNemar"):
        assert large.p == mcnemar_p(PairedTable.from_outcomes(pairs))
    assert large.difference.value == pytest.approx(np.mean([a - b for a, b in np.array(pairs, int)]))


def test_the_same_answers_are_no_step(data, tmp_path):
    runs = [run_of(data, tmp_path / n, 0.5, name=n) for n in ("a", "b")]
    (step,) = step_table(runs).steps
    assert (step.difference.value, step.p, step.is_supported) == (0.0, 1.0, False)
    assert "the same score" in step.sentence


def test_an_equal_score_is_said_in_a_sentence(data, tmp_path):
    runs = [run_of(data, tmp_path / n, 0.5, name=n) for n in ("8B", "2B")]
    assert "2B has the same score as 8B (" in step_table(runs).steps[0].sentence


def test_eyes_are_a_row_of_their_own_and_named_as_the_change(data, tmp_path):
    runs = [
        run_of(data, tmp_path / "native", 0.9),
        run_of(data, tmp_path / "myopic", 0.1, eyes=Eyes.NATIVE_224),
    ]
    table = step_table(runs)
    assert [row.name for row in table.rows] == ["model", "model, native-224"]
    assert table.steps[0].changed == ("eyes",)
    assert table.steps[0].is_supported


def test_two_changes_in_one_step_are_said(data, tmp_path):
    runs = [run_of(data, tmp_path / "a", 0.9, name="a"), run_of(data, tmp_path / "b", 0.1, name="b", eyes=Eyes.TILE_1)]
    assert "model and eyes changed together" in step_table(runs).steps[0].sentence


def test_a_step_of_the_prompt_alone_is_said(data, tmp_path):
    runs = [run_of(data, tmp_path / str(i), 0.5, prompt=p) for i, p in enumerate((None, "embspatial-lmms-eval"))]
    table = step_table(runs)
    assert [row.name for row in table.rows] == ["model, direct", "model, embspatial-lmms-eval"]
    assert table.steps[0].sentence.endswith(" Only the prompt changed, so the step does not compare models.")
    repeated = step_table([runs[0], run_of(data, tmp_path / "again", 0.5)], names=["a", "b"])
    assert repeated.steps[0].sentence.endswith(" No setting changed, so the second run repeats the first.")
    eyes = step_table([runs[0], run_of(data, tmp_path / "eyes", 0.5, eyes=Eyes.TILE_1)])
    assert eyes.steps[0].sentence.endswith("supported).")


def test_the_order_of_two_equal_models_is_rarely_supported(data, tmp_path):
    """The correction over all steps keeps chance differences of nine steps unsupported."""
    runs = [run_of(data, tmp_path / str(i), 0.5, name=str(i), seed=i) for i in range(10)]
    assert sum(step.is_supported for step in step_table(runs).steps) == 0


def test_items_of_one_picture_are_kept_together(data, tmp_path):
    """Sixty answers about two pictures support nothing, whatever their number."""
    folder = tmp_path / "two"
    folder.mkdir()
    rows = json.loads((data / "embspatial_bench.json").read_text())
    for i, row in enumerate(rows):
        row |= {"image": rows[i % 2]["image"], "scene_id": f"scene-{i % 2}", "data_source": "mp3d"}
    (folder / "embspatial_bench.json").write_text(json.dumps(rows))
    runs = [run_of(folder, tmp_path / n, s, name=n) for n, s in (("a", 1.0), ("b", 0.0))]
    (step,) = step_table(runs).steps
    assert step.test == "sign flips of clusters"
    assert step.p == 0.5
    assert step.difference.low < 1.0
    assert not step.is_supported


def test_other_data_is_refused(data, tmp_path):
    folder = tmp_path / "other"
    folder.mkdir()
    rows = json.loads((data / "embspatial_bench.json").read_text())[:50]
    (folder / "embspatial_bench.json").write_text(json.dumps(rows))
    runs = [run_of(data, tmp_path / "a", 0.5, name="a"), run_of(folder, tmp_path / "b", 0.5, name="b")]
    with pytest.raises(RunConflictError, match="different data"):
        step_table(runs)


def test_two_runs_of_one_name_are_refused(data, tmp_path):
    runs = [run_of(data, tmp_path / n, 0.5) for n in ("a", "b")]
    with pytest.raises(RunConflictError, match="--name"):
        step_table(runs)
    with pytest.raises(InvalidInputError, match="1 names are given for 2 runs"):
        step_table(runs, names=["x"])
    assert [row.name for row in step_table(runs, names=["x", "y"]).rows] == ["x", "y"]


def test_a_changed_run_is_refused(data, tmp_path):
    run = run_of(data, tmp_path / "a", 0.5)
    assert is_static_run(run)
    file = run / "items.jsonl"
    file.write_bytes(
        file.read_bytes().replace(b'"score":"0"', b'"score":"1"', 1).replace(b'"score": "0"', b'"score": "1"', 1)
    )
    with pytest.raises(RecordError, match="was changed"):
        read_static_run(run)


def test_an_unfinished_run_is_refused(data, tmp_path):
    run = run_of(data, tmp_path / "a", 0.5)
    (run / "result.json").unlink()
    with pytest.raises(RecordError, match="not finished"):
        step_table([run])


def test_the_table_has_the_columns_and_steps_of_the_papers_table(data, tmp_path, capsys):
    """Rows of falling size, co-training and eyes; columns of RefSpatial's parts and EgoPlan's domains."""
    refspatial = published.refspatial_parquet(tmp_path / "refspatial")
    egoplan = published.egoplan2_parquet(tmp_path / "egoplan2")
    runs, names = [], []
    rows = (("8B", "8B", Eyes.NATIVE), ("2B", "2B", Eyes.NATIVE), ("2B + VLM", "2B-vlm", Eyes.NATIVE))
    for name, model, eyes in (*rows, ("2B + VLM, single", "2B-vlm", Eyes.NATIVE_224)):
        for benchmark, folder in (("refspatial", refspatial), ("egoplan2", egoplan)):
            chosen, out = find_benchmark(benchmark), tmp_path / f"{benchmark}-{name}"
            answer = Always("[(0.625, 0.375)]" if benchmark == "refspatial" else "B", model)
            settings = RunSettings(find_prompt(benchmark, None), coordinates=chosen.coordinates or "pixels", eyes=eyes)
            evaluate_model(chosen, chosen.load(folder), answer, out, settings)
            runs.append(out)
            names.append(name)
    table = step_table(runs, names=names)
    assert [row.name for row in table.rows] == ["8B", "2B", "2B + VLM", "2B + VLM, single"]
    assert [(s.benchmark, s.changed) for s in table.steps[::2]] == [
        (table.steps[0].benchmark, change) for change in (("model",), ("model",), ("eyes",))
    ]
    assert len(table.steps) == 6
    cells = table.rows[0].cells
    assert {"location", "placement", "unseen"} == {name.lower() for name in cells["refspatial"].parts}
    assert len(cells["egoplan2"].parts) > 1
    arguments = [word for name in names for word in ("--name", name)]
    assert main(["compare", *map(str, runs), *arguments]) == 0
    shown = capsys.readouterr().out
    assert all(name in shown for name in cells["refspatial"].parts)
    assert all(name in shown for name in cells["egoplan2"].parts)


class Always:
    """A model with one answer."""

    def __init__(self, text, name):
        self.text, self.name = text, name

    def answer(self, _prompt, _pictures):
        return self.text


def test_better_compare_takes_static_runs(data, tmp_path, capsys):
    runs = [run_of(data, tmp_path / n, s, name=n) for n, s in (("8B", 0.9), ("2B", 0.2))]
    assert main(["compare", *map(str, runs)]) == 0
    shown = " ".join(capsys.readouterr().out.split())
    assert "8B" in shown
    assert ", supported)." in shown
    assert main(["compare", *map(str, runs), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["steps"][0]["is_supported"]
    assert main(["compare", str(runs[0]), str(tmp_path / "gone")]) == 2
    assert "gone: the path does not exist" in "".join(capsys.readouterr().err.split("\n"))
    for option in (["--fail-if-worse"], ["--sequential"], ["--allow-mixed"], ["--out", str(tmp_path / "tables")]):
        assert main(["compare", *map(str, runs), *option]) == 2
        said = " ".join(capsys.readouterr().err.split())
        assert f"{option[0]}: this option is not used for runs made with `better vlm`" in said
    assert main(["compare", *map(str, runs), "--paper"]) == 0
    shown = " ".join(capsys.readouterr().out.split())
    assert "static_bottleneck" in shown
    assert "33.38 against 31.95" in shown
    assert "coffee_case" not in shown
    assert main(["compare", *map(str, runs), "--paper", "--json"]) == 0
    assert [t["name"] for t in json.loads(capsys.readouterr().out)["paper"]["tables"]] == ["static_bottleneck"]
    (tmp_path / "other").mkdir()
    assert main(["compare", str(runs[0]), str(tmp_path / "other")]) != 0
    assert "contains no run" in " ".join(capsys.readouterr().err.split())


def test_rejected_requests_are_said(data, tmp_path):
    class Rejecting(Knowing):
        def answer(self, prompt, pictures):
            if "mug 7?" in prompt:
                raise RefusedError("HTTP 413: too large")
            return super().answer(prompt, pictures)

    chosen = find_benchmark("embspatial")
    items = chosen.load(data)
    model = Rejecting(items.items, 1.0, name="b")
    evaluate_model(chosen, items, model, tmp_path / "b", RunSettings(find_prompt("embspatial", None)))
    table = step_table([run_of(data, tmp_path / "a", 1.0, name="a"), tmp_path / "b"])
    assert table.warnings == ("b, EmbSpatial-Bench: the server rejected 1 of 60 requests, which count as wrong.",)


@pytest.mark.parametrize("verb", ["diagnose", "report"])
def test_verbs_of_policies_say_that_a_static_run_has_no_trials(verb, data, tmp_path, capsys):
    out = run_of(data, tmp_path / "a", 1.0)
    assert main([verb, str(out)]) == 2
    assert (
        "contains a static evaluation instead of trials of a policy. Pass the folder of a run made with `"
        in capsys.readouterr().err
    )
