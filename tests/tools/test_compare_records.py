"""The script that compares records: equal bytes and renamed words pass; a flipped bit and a missing record do not."""

from __future__ import annotations

import importlib
import json
import math
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

TOOLS = Path(__file__).resolve().parents[2] / "tools"


@pytest.fixture(autouse=True)
def compare_records(monkeypatch):
    monkeypatch.syspath_prepend(str(TOOLS))
    return importlib.import_module("compare_records")


def write(run: Path, name: str, values: list[float], metadata: dict[str, object]) -> None:
    path = run / "records" / f"{name}.parquet"
    path.parent.mkdir(parents=True, exist_ok=True)
    table = pa.table({"time": pa.array(values, pa.float64())})
    pq.write_table(table.replace_schema_metadata({"betterbench": json.dumps(metadata)}), path)


@pytest.fixture
def runs(tmp_path):
    before, after = tmp_path / "before", tmp_path / "after"
    for folder, word in ((before, "colour"), (after, "color")):
        write(folder, "fast_food/T1/0", [0.0, math.nan, -0.0], {"scene": {"objects": [{word: "red"}]}})
    return before, after


def test_equal_records_pass_and_not_a_number_equals_itself(runs, capsys, compare_records):
    before, after = runs
    assert compare_records.main([str(before), str(after), "--rename", "colour=>color"]) == 0
    assert capsys.readouterr().out == "before: 1 records with the same bytes in every column\n"


def test_metadata_that_differs_is_counted_by_key_and_is_no_failure(runs, capsys, compare_records):
    before, after = runs
    assert compare_records.main([str(before), str(after)]) == 0
    assert (
        "metadata scene.objects[].colour differs in 1, fast_food/T1/0.parquet: 'red' -> None" in capsys.readouterr().out
    )


@pytest.mark.parametrize("values", [[0.0, math.nan, 0.0], [0.0, math.nan], [0.0, 1e-300, -0.0]])
def test_one_other_bit_is_a_change(runs, capsys, compare_records, values):
    before, after = runs
    write(after, "fast_food/T1/0", values, {})
    assert compare_records.main([str(before), str(after)]) == 1
    assert "CHANGED fast_food/T1/0.parquet: time" in capsys.readouterr().out


def test_a_missing_record_is_named_and_folders_of_runs_are_compared_by_name(runs, capsys, compare_records):
    before, after = runs
    write(before, "fast_food/T1/1", [0.0], {})
    (before.parent / "old").mkdir()
    (before.parent / "new").mkdir()
    before.rename(before.parent / "old" / "zoo-colour")
    after.rename(after.parent / "new" / "zoo-color")
    arguments = [str(before.parent / "old"), str(after.parent / "new"), "--rename", "colour=>color"]
    assert compare_records.main(arguments) == 1
    assert "MISSING fast_food/T1/1.parquet" in capsys.readouterr().out
