"""``better mixture``: what it prints, and files of draws that go on where they stopped."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from betterbench.cli.main import main


@pytest.fixture
def mixture(tmp_path, monkeypatch) -> Path:
    monkeypatch.chdir(tmp_path)
    for name, lines in (("a", 30), ("b", 7)):
        Path(f"{name}.jsonl").write_text("".join(json.dumps({"id": i}) + "\n" for i in range(lines)))
    text = "seed: 5\ngroups:\n"
    text += "".join(
        f"- {{name: {n}, weight: {w}, sets: [{{path: {n}.jsonl, name: {n}}}]}}\n" for n, w in (("a", 3.0), ("b", 1.0))
    )
    Path("mixture.yaml").write_text(text)
    return Path("mixture.yaml")


def document(capsys, *words: str) -> dict:
    assert main(["mixture", *words, "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def test_the_papers_mixture_as_json(capsys):
    found = document(capsys, "--parameters", "2e9")
    assert [total["agrees"] for total in found["totals"]] == [True, False, True]
    assert sum(row["share"] for row in found["sets"]) == pytest.approx(1.0)
    assert {name: (b["gpus"], b["steps"]) for name, b in found["budgets"].items()} == {
        "VLA only": (16, 100_000),
        "VLA + VLM": (24, 100_000),
    }
    assert found["budgets"]["VLA only"]["gpu_hours"] > 0


def test_the_papers_mixture_as_tables(capsys):
    assert main(["mixture"]) == 0
    said = capsys.readouterr().out
    assert re.search(r"frames \[million\] +47\.69 +47\.6968", said)
    assert "cut after two decimals" in said.replace("\n", " ")


def test_draws_of_a_file(capsys, mixture):
    found = document(capsys, str(mixture), "--draws", "400", "--gpus", "2", "--steps", "10", "--tokens", "a=100")
    assert {row["name"]: row["drawn"] for row in found["sets"]} == {"a": 300, "b": 100}
    assert found["budgets"]["run"]["tokens"] == 2 * 10 * 8192


def test_a_file_of_draws_goes_on(capsys, mixture):
    words = ["mixture", str(mixture), "--draws", "90", "--shard", "1/3", "--out", "draws.jsonl"]
    assert main(words) == 0
    whole = Path("draws.jsonl").read_bytes()
    lines = [json.loads(line) for line in whole.splitlines()]
    assert [line["number"] for line in lines] == list(range(1, 90, 3))
    ids = [
        json.loads(Path(f"{line['set']}.jsonl").read_bytes()[line["byte"] :].split(b"\n")[0])["id"] for line in lines
    ]
    assert ids == [line["item"] for line in lines]
    for cut in (0, 1, len(whole) // 2, len(whole) - 1, len(whole)):
        Path("draws.jsonl").write_bytes(whole[:cut])
        assert main(words) == 0
        assert Path("draws.jsonl").read_bytes() == whole
    capsys.readouterr()
    assert main([*words, "--seed", "6"]) == 2
    assert "other data than draws of this mixture" in " ".join(capsys.readouterr().err.split())
    assert Path("draws.jsonl").read_bytes() == whole


@pytest.mark.parametrize(
    "other", ["my notes without an end", "one\ntwo\nthree", '{"number": 1', "\n", "{draws}more", "{draws}\n"]
)
def test_a_file_that_holds_something_else_is_left_alone(capsys, mixture, other):
    words = ["mixture", str(mixture), "--draws", "9", "--out", "draws.jsonl"]
    assert main(words) == 0
    draws = Path("draws.jsonl").read_text()
    Path("draws.jsonl").write_text(text := other.replace("{draws}", draws))
    assert main(words) == 2
    assert Path("draws.jsonl").read_text() == text
    assert "Choose a different file" in " ".join(capsys.readouterr().err.split())


def test_what_is_no_file_is_not_read_without_an_end(capsys, mixture):
    assert main(["mixture", str(mixture), "--draws", "9", "--out", "/dev/full"]) == 2
    assert "/dev/full is a pipe, socket or device, which is never replaced" in " ".join(capsys.readouterr().err.split())


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--shard", "2/2", "--draws", "5"], "shard: 2 is out of range"),
        (["--shard", "x"], "is not a shard"),
        (["--out", "x.jsonl"], "there are no draws to write"),
        (["--gpus", "3"], "only one of --gpus and --steps is given"),
        (["--tokens", "DROIT=3"], "Unknown data set in --tokens"),
        (["--tokens", "DROID=x"], "expected NAME=NUMBER"),
        (["no.yaml"], "no.yaml"),
        (["list.yaml"], "the file contains no fields"),
        (["alias.yaml"], "the file uses a YAML alias"),
        (["broken.yaml"], "is not YAML"),
        (["deep.yaml"], "nested too deep"),
        (["field.yaml"], "field.yaml: grups"),
        (["twice.yaml"], "twice.yaml: weight is given twice (line 4)"),
        (["number.yaml"], "number.yaml: groups[0].sets: "),
    ],
)
def test_wrong_input_is_one_line(capsys, tmp_path, monkeypatch, words, said):
    monkeypatch.chdir(tmp_path)
    texts = {"list": "[1]", "alias": "a: &x 1\nb: *x\n", "broken": "a: [", "deep": "a: " + "[" * 50 + "]" * 50}
    texts |= {"twice": "groups:\n- name: g\n  weight: 1\n  weight: 2\n  sets: []\n"}
    texts |= {"number": "groups: [{name: g, weight: 1e-3, sets: []}]\n"}
    for name, text in (texts | {"field": "groups: [{name: g, weight: 1, sets: [{path: x}]}]\ngrups: []\n"}).items():
        Path(f"{name}.yaml").write_text(text)
    assert main(["mixture", *words]) == 2
    assert said in " ".join(capsys.readouterr().err.split())
