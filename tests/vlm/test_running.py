"""Runs of a model over the benchmarks, from data on disk to result.json, also after kills."""

from __future__ import annotations

import json
import re
import subprocess
import sys
import threading
from collections import Counter
from typing import get_args

import pytest
from tests.vlm import published
from tests.vlm.published import pictures_of, texts_of

from betterbench.cli.main import main
from betterbench.cli.verbs.vqa import CoordinateNames
from betterbench.errors import ModelError, RunConflictError
from betterbench.vlm import RunSettings, evaluate_model, find_benchmark
from betterbench.vlm.prompts import find_prompt
from betterbench.vlm.running import SHOWN_NAME
from betterbench.vqa.coordinates import CONVENTIONS, Coordinates
from betterbench.vqa.llm import RefusedError

CASES = [(name, form) for name, forms in published.FORMS.items() for form in forms]


class Scripted:
    """A model that answers with a function of the prompt and the pictures."""

    def __init__(self, answer, name="scripted"):
        self.name, self.reply, self.asked = name, answer, []

    def answer(self, prompt, pictures):
        self.asked.append(prompt)
        return self.reply(prompt, pictures)


def run(name, folder, out, model, *, prompt=None, extractor=None, **settings):
    benchmark = find_benchmark(name)
    chosen = RunSettings(find_prompt(name, prompt), **settings)
    return evaluate_model(benchmark, benchmark.load(folder), model, out, chosen, extractor=extractor)


def words(name, folder, url, out, *more):
    return ["vlm", name, "--data", str(folder), "--model", f"{url}#tiny", "--out", str(out), *more]


@pytest.mark.parametrize(("name", "form"), CASES, ids=[form.__name__ for _, form in CASES])
def test_each_form_runs_from_end_to_end(name, form, tmp_path, serve, capsys):
    folder, out = form(tmp_path / "data"), tmp_path / "run"
    server = serve(lambda _: "[(0.625, 0.375)]" if name == "refspatial" else "B")
    line = words(name, folder, server.url, out, "--scoring", "official", "--json", "--no-probe")
    assert main(line) == 0
    found = json.loads(capsys.readouterr().out)
    items = find_benchmark(name).load(folder).items
    assert len(server.asked) == len(items) == found["n"]
    expected = 1.0 if name == "refspatial" else 0.25
    assert found["headline"]["strict"] == found["headline"]["parsed"] == expected
    assert found["upstream"][0]["value"] == expected
    shown = pictures_of(server.asked[0])
    assert len(shown) == len(items[0].pictures)
    assert shown[0].startswith(b"\x89PNG")
    assert server.asked[0]["messages"][0]["content"][0]["image_url"]["url"].startswith("data:image/png;base64,")
    assert {p["kind"] for p in found["parts"]} == {"all", *items[0].groups}
    stored = json.loads((out / "result.json").read_text())
    assert stored.pop("seal")
    assert stored == {k: v for k, v in found.items() if k != "run"}
    assert main(line) == 0
    assert json.loads(capsys.readouterr().out) == found
    assert len(server.asked) == len(items)


def test_pictures_stand_where_the_prompt_puts_them(tmp_path, serve):
    folder = published.egoplan2_frames(tmp_path / "data")
    server = serve(lambda _: "A")
    assert main(words("egoplan2", folder, server.url, tmp_path / "run", "--prompt", "egoplan2-official")) == 0
    content = server.asked[0]["messages"][0]["content"]
    assert [part["type"] for part in content] == ["text", "image_url"] * 8 + ["text"]
    assert content[0]["text"] == "Image-1: "
    assert content[-1]["text"].startswith("\nSelect the best answer")
    assert "A. fill the kettle\nB. open the drawer" in content[-1]["text"]


def test_an_interrupted_run_asks_only_what_is_left(tmp_path):
    folder = published.embspatial_json(tmp_path / "data")
    left = iter(["B"] * 3)

    def breaks(_prompt, _pictures):
        try:
            return next(left)
        except StopIteration:
            raise ModelError("gone") from None

    with pytest.raises(ModelError):
        run("embspatial", folder, tmp_path / "run", Scripted(breaks), at_once=1)
    model = Scripted(lambda *_: "B")
    found = run("embspatial", folder, tmp_path / "run", model, at_once=3)
    assert len(model.asked) == 5
    assert found.score.all.answered == 8
    again = Scripted(lambda *_: "A")
    assert run("embspatial", folder, tmp_path / "run", again).score.headline == found.score.headline
    assert again.asked == []


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"model": "other"}, "run.model"),
        ({"prompt": "embspatial-lmms-eval"}, "run.prompt"),
        ({"coordinates": "fractions"}, "run.coordinates"),
        ({"data": True}, "run.data"),
    ],
)
def test_another_run_in_the_folder_is_named(change, says, tmp_path):
    folder, out = published.embspatial_json(tmp_path / "data"), tmp_path / "run"
    run("embspatial", folder, out, Scripted(lambda *_: "B"))
    if change.pop("data", False):
        file = folder / "embspatial_bench.json"
        file.write_text(file.read_text().replace("nearest", "farthest"))
    model = Scripted(lambda *_: "B", change.pop("model", "scripted"))
    with pytest.raises(RunConflictError, match=re.escape(says)):
        run("embspatial", folder, out, model, **change)
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "notes.txt").write_text("mine")
    with pytest.raises(RunConflictError, match="other files"):
        run("embspatial", folder, tmp_path / "full", model)


def test_a_changed_answer_is_found(tmp_path):
    folder, out = published.embspatial_json(tmp_path / "data"), tmp_path / "run"
    run("embspatial", folder, out, Scripted(lambda *_: "B"))
    file = out / "answers.jsonl"
    file.write_text(file.read_text().replace('"text":"B"', '"text":"A"', 1))
    assert main(words("embspatial", folder, "http://127.0.0.1:9/v1", out)) == 2


def test_refusals_and_hostile_answers_stay_in_the_denominator(tmp_path):
    folder = published.embspatial_json(tmp_path / "data")

    def answers(prompt, _pictures):
        number = len(model.asked)
        if number == 1:
            raise RefusedError("HTTP 400: image too large")
        return {2: "", 3: "\ud800 I refuse", 4: "x" * 1_000_000 + " The answer is D."}.get(number, "B")

    model = Scripted(answers)
    found = run("embspatial", folder, tmp_path / "run", model, at_once=1)
    assert (found.refused, found.score.all.n, found.score.all.answered) == (1, 8, 6)
    assert found.score.items[3].value == "D"
    assert found.score.all.means["parsed"].total == 2  # D of 4, and B of 6
    assert found.score.all.if_dropped == found.score.all.means["parsed"].total / 6
    assert (tmp_path / "run" / "answers.jsonl").stat().st_size < 200_000


def test_the_extractor_reads_only_what_the_parser_cannot(tmp_path):
    folder = published.embspatial_json(tmp_path / "data")
    confused = "Either A or C. I settle on the third, C, in the end."
    model = Scripted(lambda *_: confused if len(model.asked) % 2 else "B")
    reader = Scripted(lambda *_: '{"copied": ["C"]}', "reader")
    out = tmp_path / "run"
    first = run("embspatial", folder, out, model, at_once=1)
    found = run("embspatial", folder, out, model, extractor=reader, at_once=1)
    assert len(model.asked) == 8
    assert len(reader.asked) == 4
    assert all(confused in prompt and "mug" in prompt and "nearest" not in prompt for prompt in reader.asked)
    assert found.score.headline["parsed"] == first.score.headline["parsed"]
    assert found.score.changed == 2  # items 3 and 7 have the answer C
    assert found.score.headline["extracted"] - found.score.headline["parsed"] == found.score.changed / 8
    stages = Counter(item.stage for item in found.score.items)
    assert stages == {"strict": 4, "extractor": 4}
    run("embspatial", folder, out, model, extractor=reader)
    assert len(reader.asked) == 4


def test_coordinates_in_a_wrong_convention_are_pointed_at(tmp_path, serve, capsys):
    folder = published.refspatial_raw(tmp_path / "data")
    server = serve(lambda _: "[(625, 375)]")
    assert main(words("refspatial", folder, server.url, tmp_path / "run")) == 0
    assert "9 answers contain a point outside the image in the declared convention (fractions)" in (
        capsys.readouterr().out.replace("\n", " ").replace("  ", " ")
    )
    assert "between 0 and 1" not in texts_of(server.asked[0])
    assert "from 0 to 1" in texts_of(server.asked[0])


def test_the_command_line_knows_every_convention():
    assert get_args(CoordinateNames) == get_args(Coordinates) == tuple(CONVENTIONS)


@pytest.mark.parametrize(
    ("line", "says"),
    [
        (["vlm"], "--model: this option is required"),
        (["vlm", "embspatal", "--model", "u#m"], "Did you mean 'embspatial'"),
        (["vlm", "embspatial", "--model", "http://h/v1"], "--out: this option is required"),
        (["vlm", "embspatial", "--model", "http://h/v1", "--out", "o"], "--model: 'http://h/v1' is not an address"),
        (["vlm", "embspatial", "--model", "http://h/v1#m", "--out", "o"], "better vlm fetch embspatial"),
        (["vlm", "probe", "--model", "http://h/v1#m", "--max-tokens", "-1"], "--max-tokens: -1 is out of range"),
        (["vlm", "probe", "--model", "http://h/v1#m", "--max-tiles", "0"], "--max-tiles: 0 is out of range"),
        (["vlm", "embspatial", "x", "--model", "http://h/v1#m"], "unexpected argument 'x'"),
        (
            ["vlm", "refspatial", "--model", "http://h/v1#m", "--out", "o", "--prompt", "direct"],
            "Unknown prompt of refspatial 'direct'. Did you mean 'direct-points'?",
        ),
        (
            [
                *["vlm", "refspatial", "--model", "http://h/v1#m", "--out", "o"],
                *["--prompt", "refspatial-gemini", "--coordinates", "pixels"],
            ],
            "asks for thousandths-yx-json",
        ),
    ],
)
def test_wrong_command_lines_are_one_clear_error(line, says, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(line) == 2
    assert says in " ".join(capsys.readouterr().err.split())
    assert not list(tmp_path.iterdir())


def test_two_processes_on_one_run_are_refused(tmp_path, serve, capsys):
    folder, out = published.embspatial_json(tmp_path / "data"), tmp_path / "run"
    begun, goes_on = threading.Event(), threading.Event()

    def waits(_body):
        begun.set()
        goes_on.wait(60)
        return "B"

    line = words("embspatial", folder, serve(waits).url, out)
    other = subprocess.Popen([sys.executable, "-m", "betterbench.cli", *line], stderr=subprocess.PIPE, text=True)
    try:
        assert begun.wait(120)
        assert main(line) == 2
        assert str(out) in capsys.readouterr().err.replace("\n", "")
    finally:
        goes_on.set()
        _, said = other.communicate(timeout=120)
    assert other.returncode == 0, said


@pytest.mark.slow
def test_a_run_killed_at_ten_moments_asks_no_answered_item_again(tmp_path, serve):
    folder, out = tmp_path / "data", tmp_path / "run"
    folder.mkdir()
    rows = [
        row | {"question": f"Question number {i}?", "image": published.base64.b64encode(published.picture(i)).decode()}
        for i, row in enumerate(published.embspatial_rows(66))
    ]
    (folder / "questions.json").write_text(json.dumps(rows))
    served, stop_at, reached, earlier = Counter(), [0], threading.Event(), Counter()

    def answer(body):
        number = int(re.search(r"number (\d+)", texts_of(body))[1])
        served[number] += 1
        if served.total() >= stop_at[0]:
            reached.set()
        return "ABCD"[number % 4]

    line = words("embspatial", folder, serve(answer).url, out, "--at-once", "2")
    for kill in range(10):
        stop_at[0] = served.total() + 1 + kill % 7
        reached.clear()
        process = subprocess.Popen(
            [sys.executable, "-m", "betterbench.cli", *line], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )
        assert reached.wait(120)
        process.kill()
        process.wait()
        lines = (out / "answers.jsonl").read_bytes().split(b"\n")[1:-1] if (out / "answers.jsonl").exists() else []
        known = {int(json.loads(text)["id"][1:]) for text in lines}
        assert all(served[n] == times for n, times in earlier.items()), "an answered item was asked again"
        earlier = Counter({n: served[n] for n in known})
    assert main(line) == 0
    assert all(served[n] == times for n, times in earlier.items())
    result = json.loads((out / "result.json").read_text())
    assert result["headline"]["strict"] == 1.0
    assert set(served) == set(range(66))


@pytest.mark.parametrize(
    ("data", "says"), [(b"<html>", "is not an image."), ("cut", "is not an image ("), ("large", "pixels")]
)
def test_a_picture_that_cannot_be_shown_is_named(data, says, tmp_path, capsys, serve):
    folder = published.embspatial_folder(tmp_path / "data")
    if data == "large":
        data = published.large_picture()
    elif data == "cut":
        data = published.noise()[:-3000]
    (folder / "images" / "0.png").write_bytes(data)
    server = serve(lambda _: "B")
    for eyes in ("native", "blur-224"):
        assert main(words("embspatial", folder, server.url, tmp_path / eyes, "--eyes", eyes)) == 2
        said = " ".join(capsys.readouterr().err.split())
        assert "embspatial, item q0:" in said
        assert says in said
        assert "0x" not in said
        assert not (tmp_path / eyes / SHOWN_NAME).exists(), "an image that is refused is not decoded for the sheet"


def test_a_server_that_rejects_everything_gets_no_score_and_is_asked_again(tmp_path):
    folder = published.embspatial_json(tmp_path / "data")

    def rejects(_prompt, _pictures):
        raise RefusedError("HTTP 400: max_tokens is not supported")

    with pytest.raises(ModelError, match="rejected all 8 requests, so there is no score: HTTP 400: max_tokens"):
        run("embspatial", folder, tmp_path / "run", Scripted(rejects))
    assert not (tmp_path / "run" / "result.json").exists()
    found = run("embspatial", folder, tmp_path / "run", Scripted(lambda *_: "B"))
    assert (found.refused, found.score.all.answered) == (0, 8)
