"""The verb ``better generate``: files, table, JSON and errors."""

from __future__ import annotations

import json

import pytest
from tests.generation.examples import GOOD, text

from betterbench.cli.main import main
from betterbench.generation.scenario_form import scenario_from_json


def files(folder):
    return {path.name: path.read_bytes() for path in (folder / "scenarios").iterdir()}


def test_the_same_command_gives_the_same_files_and_a_larger_number_adds_some(capsys, tmp_path):
    command = ["generate", "loose_packing", "--num", "3", "--seed", "4", "--out"]
    assert main([*command, str(tmp_path / "a")]) == 0
    assert main([*command, str(tmp_path / "b")]) == 0
    first = files(tmp_path / "a")
    assert files(tmp_path / "b") == first
    assert len(first) == 3
    shown = capsys.readouterr().out
    for name, content in first.items():
        scenario = scenario_from_json(content)
        assert name[:3].isdigit()
        assert scenario.instruction.split()[0] in shown
    command[3] = "5"
    assert main([*command, str(tmp_path / "a")]) == 0
    more = files(tmp_path / "a")
    assert len(more) == 5
    assert first.items() <= more.items()


def test_a_sentence_makes_one_scenario_with_its_objects(capsys, tmp_path):
    sentence = "Pack an apple, an orange and a lemon into the lunchbox"
    assert main(["generate", sentence, "--out", str(tmp_path / "fruit"), "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["template"] == "loose_packing"
    ((path, form),) = document["scenarios"].items()
    assert path.startswith(str(tmp_path))
    queries = [o["asset_query"].split()[-1] for o in form["instantiation"]["items"]]
    assert sorted(queries) == ["apple", "lemon", "orange"]


@pytest.mark.parametrize(
    ("sentence", "said"),
    [
        ("Grab the fruit and put it into the lunchbox", "which begins with 'Grab', which is not a known verb"),
        ("Pack an apple, an orange and a lemon into the lunchbox", "which lists all 3 objects of the group 'items'."),
        ("Put the fruit into the lunchbox", ""),
    ],
)
def test_it_is_said_why_a_sentence_is_not_the_instruction(capsys, tmp_path, sentence, said):
    assert main(["generate", sentence, "--out", str(tmp_path / "fruit")]) == 0
    shown = " ".join("".join(capsys.readouterr()).split())
    assert ("The instruction differs from your sentence" in shown) == bool(said)
    assert said in shown


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["loose_paking"], "Unknown template 'loose_paking'. Did you mean 'loose_packing'"),
        (["do my taxes"], "fits no template"),
        (["loose_packing", "--num", "0"], "--num: 0 is out of range"),
        (["recursive_stacking", "--num", "31"], "has 30 different scenarios"),
        (["loose_packing", "--model", "gpt"], "--model: 'gpt' is not an address with a model"),
        (["loose_packing", "--model", "ftp://x#m"], "is not an HTTP address"),
        (["loose_packing", "--model", "http://localhost:1/v1#m", "--tries", "0"], "--tries: 0 is out of range"),
        (["loose_packing", "--replay", "absent.jsonl"], "absent.jsonl is not a file"),
    ],
)
def test_wrong_input_is_one_line_and_leaves_no_folder(capsys, tmp_path, arguments, said):
    assert main(["generate", *arguments, "--out", str(tmp_path / "out")]) == 2
    error = capsys.readouterr().err
    assert said in " ".join(error.split())
    assert not (tmp_path / "out" / "scenarios").exists()


def test_a_model_without_a_good_answer_ends_with_status_2_and_the_reason(capsys, monkeypatch, tmp_path):
    from betterbench.generation import folder
    from betterbench.vqa.llm import ScriptedChat

    monkeypatch.setattr(folder, "endpoint_of", lambda _: ScriptedChat(lambda _: "I cannot.", name="shy"))
    command = ["generate", "loose_packing", "--num", "1", "--model", "http://localhost:1/v1#shy"]
    assert main([*command, "--out", str(tmp_path / "out")]) == 2
    error = " ".join(capsys.readouterr().err.split())
    assert "is not JSON: 'I cannot.'" in error
    assert "exchanges.jsonl" in error
    assert len((tmp_path / "out/exchanges.jsonl").read_text().splitlines()) == 3


def test_a_replay_of_the_command_line_needs_no_model(capsys, monkeypatch, tmp_path):
    from betterbench.generation import folder
    from betterbench.vqa.llm import ScriptedChat

    with monkeypatch.context() as patched:
        patched.setattr(folder, "endpoint_of", lambda _: ScriptedChat(lambda _: text(GOOD), name="good"))
        command = ["generate", "loose_packing", "--num", "1", "--model", "http://localhost:1/v1#good"]
        assert main([*command, "--out", str(tmp_path / "out")]) == 0
    replay = ["--replay", str(tmp_path / "out/exchanges.jsonl"), "--num", "1"]
    assert main(["generate", "loose_packing", *replay, "--out", str(tmp_path / "again")]) == 0
    assert files(tmp_path / "again") == files(tmp_path / "out")
    assert "hiking" in capsys.readouterr().out
