"""``better audit-paper``: what holds and what does not, worst first, as text and as JSON."""

from __future__ import annotations

import json

import pytest

from betterbench.cli.main import main


def run(capsys, *arguments):
    status = main(arguments)
    captured = capsys.readouterr()
    return status, captured.out, captured.err


def test_it_prints_what_does_not_hold_first(capsys):
    status, out, err = run(capsys, "audit-paper")
    assert status == 0
    assert not err
    flat = " ".join(out.split())
    assert flat.index("38.37 = 155/404") < flat.index("13/20 cannot be distinguished from")
    assert "167 checks: 11 do not hold, 10 are not supported by their trials, 8 cannot be checked, 138 hold." in flat


def test_json_holds_every_finding(capsys):
    status, out, _ = run(capsys, "audit-paper", "--json")
    document = json.loads(out)
    found = [f for table in document["tables"] for f in table["findings"]]
    assert status == 0
    assert document["checks"] == len(found) == sum(document["summary"].values())
    assert {"table", "rule", "row", "cell", "printed", "recomputed", "verdict", "why", "support"} <= set(found[0])
    assert document["summary"]["does not hold"] == sum(f["verdict"] == "does not hold" for f in found)


def test_another_file_is_audited_as_it_is(capsys, tmp_path):
    path = tmp_path / "mine.json"
    table = {
        "name": "[bold]mine[/]",
        "title": "ours [red]",
        "columns": ["SR"],
        "rows": {"[/x]": [33.3]},
        "rules": [{"rule": "grid", "trials": 20}],
    }
    path.write_text(json.dumps({"source": "[blink]us", "tables": [table]}))
    status, out, _ = run(capsys, "audit-paper", "--tables", str(path))
    assert status == 0
    assert "[bold]mine[/]" in out
    assert "[/x], SR: printed 33.3" in out
    assert "1 checks: 1 do not hold" in out


@pytest.mark.parametrize("content", [None, "{", '{"source": "s", "tables": 3}'])
def test_a_bad_file_is_one_clear_error(capsys, tmp_path, content):
    path = tmp_path / "bad.json"
    if content is not None:
        path.write_text(content)
    status, out, err = run(capsys, "audit-paper", "--tables", str(path))
    assert status == 2
    assert not out
    assert "error:" in err
    assert "bad.json" in err.replace("\n", "")
    assert "Traceback" not in err
