"""The verb ``better generate --until``: outcome, JSON, files of quotas, and errors before any work."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from tests.generation.test_building import failing, proven

from betterbench.cli.main import main
from betterbench.generation.building import attempts as attempts_module
from betterbench.tasks import read_suite_folder


@pytest.fixture(autouse=True)
def no_simulator(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Proofs without a simulator and no cards; returns the proven tasks."""
    from betterbench.cli.verbs import build

    runs: list[str] = []
    monkeypatch.setattr(attempts_module, "prove", proven(failing("L1"), runs))
    monkeypatch.setattr(attempts_module, "badly_framed", lambda *_, **__: ())
    monkeypatch.setattr(build, "draw_cards", lambda *_, **__: {})
    return runs


def command(out: Path, *more: str) -> list[str]:
    return ["generate", "--until", "2", "--workers", "1", "--seeds", "1", "--out", str(out), *more]


def test_a_suite_grows_and_the_same_command_builds_nothing(capsys, tmp_path, no_simulator):
    asked = command(tmp_path / "out", "--quota", "template=recursive_stacking:1", "axis=temporal:10%")
    assert main(asked) == 0
    shown = capsys.readouterr().out
    assert "certified  2 of 2 tasks" in shown
    assert "fulfilled" in shown
    assert all(len(line) <= 80 for line in shown.splitlines() if str(tmp_path) not in line)
    (suite,) = (tmp_path / "out").glob("generated-*")
    assert len(read_suite_folder(suite).tasks) == 2
    assert (tmp_path / "out" / "growth.html").is_file()
    assert len(no_simulator) == 2
    assert main([*asked, "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["suite"] == str(suite)
    assert document["tasks"][0]["template"] == "recursive_stacking"
    assert document["stop"] == "reached"
    assert len(no_simulator) == 2


@pytest.mark.parametrize(
    "content", ["template:\n  recursive_stacking: 1\n", '{"template": {"recursive_stacking": "1"}}']
)
def test_quotas_come_from_a_file(capsys, tmp_path, content):
    file = tmp_path / "quotas.yaml"
    file.write_text(content)
    assert main([*command(tmp_path / "out", "--quotas", str(file)), "--json"]) == 0
    (quota,) = json.loads(capsys.readouterr().out)["quotas"]
    assert (quota["quota"], quota["is_open"]) == ("template=recursive_stacking:1", False)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--until", "0"], "--until: 0 is out of range"),
        (["--until", "2", "--quota", "template=loose_paking:1"], "Did you mean 'loose_packing'"),
        (["--until", "2", "--quota", "template=loose_packing:3"], "need 3 tasks, but there are only 2"),
        (["--until", "5000"], "--until: needs 5000 tasks, but the offline author has only"),
        (["Put the fruit into the lunchbox", "--until", "2"], "a sentence describes a single scenario"),
        (["loose_paking", "--until", "2"], "Did you mean 'loose_packing'"),
        (["--until", "2", "--num", "3"], "--num: cannot be combined with --until"),
        (["--until", "2", "--build"], "--build: this option cannot be combined with --until"),
        (["--until", "2", "--unlike", "better61"], "Unknown suite 'better61'"),
        (["--until", "2", "--model", "gpt"], "'gpt' is not an address with a model"),
        (["--until", "2", "--name", "My Suite"], "'My Suite' is not a valid name"),
        (["--until", "2", "--quotas", "absent.yaml"], "absent.yaml"),
        (["loose_packing", "--quota", "axis=temporal:1%"], "--quota: this option has no effect without --until"),
        ([], "no template was given"),
    ],
)
def test_wrong_input_is_one_line_and_leaves_no_folder(capsys, tmp_path, arguments, said):
    assert main(["generate", *arguments, "--out", str(tmp_path / "out")]) == 2
    assert said in " ".join(capsys.readouterr().err.split())
    assert not (tmp_path / "out").exists()


def test_a_folder_of_scenarios_is_not_grown(capsys, tmp_path):
    assert main(["generate", "loose_packing", "--num", "1", "--out", str(tmp_path / "out")]) == 0
    assert main(command(tmp_path / "out")) == 2
    assert "a different set of scenarios" in " ".join(capsys.readouterr().err.split())
