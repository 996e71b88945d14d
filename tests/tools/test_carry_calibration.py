"""The script that carries a calibration over to a new version of a task: only if no record has changed."""

from __future__ import annotations

import dataclasses
import importlib
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from tests.diagnosis.conftest import Stage

from betterbench.diagnosis import Calibration, Judged, Label
from betterbench.records import write_record
from betterbench.tasks import get_task

TOOLS = Path(__file__).resolve().parents[2] / "tools"
OLD = {"suite_version": "2.0", "task_version:fast_food": "7"}
NEW = {"suite_version": "2.0", "task_version:fast_food": "8"}


@pytest.fixture(autouse=True)
def carry_calibration(monkeypatch):
    monkeypatch.syspath_prepend(str(TOOLS))
    return importlib.import_module("carry_calibration")


def judged(label: Label = Label.SUCCESS, policy: str = "expert", trial: str = "fast_food/T1/0") -> Judged:
    return Judged(policy, trial, Label.SUCCESS, label, "", "a_rule", "It did something.")


def write(folder: Path, versions: dict[str, str], value: float = 0.0, trial: Judged | None = None) -> None:
    path = folder / "expert-100" / "records" / "fast_food" / "T1" / "0.parquet"
    path.parent.mkdir(parents=True, exist_ok=True)
    pq.write_table(pa.table({"time": pa.array([value], pa.float64())}), path)
    found = Calibration.of([trial or judged()], versions=versions)
    (folder / "calibration.json").write_bytes(found.file_bytes())


@pytest.fixture
def carry(tmp_path, carry_calibration):
    """Runs the script on two folders and a packaged file with trials of another task, too."""
    file = tmp_path / "packaged.json"
    packaged = Calibration.of(
        [judged(), judged(Label.TIMEOUT, trial="tidy_desk/L1/0")], versions={**OLD, "task_version:tidy_desk": "7"}
    )
    file.write_bytes(packaged.file_bytes())
    write(tmp_path / "before", OLD)
    write(tmp_path / "after", NEW)

    def run() -> int:
        return carry_calibration.main([str(tmp_path / "before"), str(tmp_path / "after"), "--file", str(file)])

    run.file, run.packaged, run.folder = file, packaged, tmp_path
    return run


def test_the_versions_change_and_nothing_else(carry):
    assert carry() == 0
    found = Calibration.from_json(carry.file.read_bytes(), where="packaged")
    assert found == dataclasses.replace(carry.packaged, versions={**NEW, "task_version:tidy_desk": "7"})


@pytest.mark.parametrize(
    ("folder", "change", "text"),
    [
        ("after", {"versions": NEW, "value": 1e-300}, "0.parquet: time differs from the old version"),
        ("after", {"versions": NEW, "trial": judged(Label.TIMEOUT)}, "labels differ"),
        ("after", {"versions": {**NEW, "suite_version": "3.0"}}, "suite_version is 3.0, expected 2.0"),
        ("before", {"versions": {**OLD, "task_version:fast_food": "6"}}, "fast_food is 6, packaged: 7"),
        ("before", {"versions": OLD, "trial": judged(policy="noop")}, "policies differ: expert, noop"),
    ],
)
def test_what_differs_is_refused_and_the_file_stays(carry, capsys, folder, change, text):
    before = carry.file.read_bytes()
    write(carry.folder / folder, **change)
    assert carry() == 2
    assert text in capsys.readouterr().err
    assert carry.file.read_bytes() == before


def test_a_record_that_neither_folder_has_is_not_called_the_same(carry, capsys):
    for folder in ("before", "after"):
        (carry.folder / folder / "expert-100" / "records" / "fast_food" / "T1" / "0.parquet").unlink()
    assert carry() == 2
    assert "it has 0 records, but 1 trials were judged" in capsys.readouterr().err


@pytest.fixture
def carry_judged(tmp_path, carry_calibration):
    """Runs the script on a folder alone, which holds a record; named columns are set to true."""
    file, before = tmp_path / "packaged.json", tmp_path / "before"
    packaged = Calibration.of([judged()], versions=OLD)
    file.write_bytes(packaged.file_bytes())

    def run(*columns: str) -> int:
        record = Stage("fast_food", "train1").wait(1.0).end()
        ones = {name: np.ones_like(getattr(record, name)) for name in columns}
        write(before, OLD)
        path = before / "expert-100" / "records" / "fast_food" / "T1" / "0.parquet"
        write_record(dataclasses.replace(record, **ones), path)
        return carry_calibration.main([str(before), "--file", str(file)])

    run.file, run.packaged, run.folder = file, packaged, before
    return run


def test_without_new_records_the_old_ones_are_judged_again(carry_judged):
    assert carry_judged() == 0
    found = Calibration.from_json(carry_judged.file.read_bytes(), where="packaged")
    assert found.versions == {**OLD, "task_version:fast_food": str(get_task("fast_food").version)}
    assert dataclasses.replace(found, versions=OLD) == carry_judged.packaged


@pytest.mark.parametrize("column", ["predicates", "subgoals", "goal", "forbidden"])
def test_a_record_that_is_judged_differently_now_is_refused(carry_judged, capsys, column):
    before = carry_judged.file.read_bytes()
    assert carry_judged(column) == 2
    assert "0.parquet: its states are judged differently with the new version" in capsys.readouterr().err
    assert carry_judged.file.read_bytes() == before


def test_every_judged_trial_needs_a_record_that_is_judged_again(carry_judged, carry_calibration, capsys):
    carry_judged.folder.mkdir()
    (carry_judged.folder / "calibration.json").write_bytes(carry_judged.file.read_bytes())
    assert carry_calibration.main([str(carry_judged.folder), "--file", str(carry_judged.file)]) == 2
    assert "it has 0 records, but 1 trials were judged" in capsys.readouterr().err


@pytest.fixture
def carry_sample(tmp_path, carry_calibration):
    """Runs the script on two trials and on a sample of them, whose instructions are worded anew."""
    file, before, sample = tmp_path / "packaged.json", tmp_path / "before", tmp_path / "sample"
    trials = [judged(trial="fast_food/train1/0"), judged(trial="fast_food/train2/0")]
    found = Calibration.of(trials, versions=OLD)
    file.write_bytes(found.file_bytes())

    def place(folder: Path, name: str) -> Path:
        path = folder / "expert-100" / "records" / "fast_food" / name / "0.parquet"
        path.parent.mkdir(parents=True, exist_ok=True)
        return path

    def run(new: dict[str, str], *, old: dict[str, str] | None = None, change: bool = False) -> int:
        for name in ("train1", "train2"):
            record = Stage("fast_food", name).wait(1.0).end()
            was = dataclasses.replace(record.metadata, instruction=(old or {}).get(name, record.metadata.instruction))
            write_record(dataclasses.replace(record, metadata=was), place(before, name))
            if name in new:
                now = dataclasses.replace(record.metadata, instruction=new[name])
                time = record.time + 1.0 if change else record.time
                write_record(dataclasses.replace(record, metadata=now, time=time), place(sample, name))
        (before / "calibration.json").write_bytes(found.file_bytes())
        return carry_calibration.main([str(before), "--sample", str(sample), "--file", str(file)])

    run.file = file
    return run


def test_a_sample_with_a_new_wording_is_enough(carry_sample):
    assert carry_sample({"train1": "Pack both.", "train2": "Pack two."}) == 0
    versions = Calibration.from_json(carry_sample.file.read_bytes(), where="packaged").versions
    assert versions["task_version:fast_food"] == str(get_task("fast_food").version)


@pytest.mark.parametrize(
    ("new", "options", "text"),
    [
        ({"train1": "Pack both."}, {}, "no trial of fast_food/train2"),
        ({"train1": "Pack.", "train2": "Pack."}, {}, "two instructions correspond to one: 'fast_food: Pack.'"),
        (
            {"train1": "Pack both.", "train2": "Pack two."},
            {"old": {"train1": "Same.", "train2": "Same."}},
            "two instructions correspond to one: 'fast_food: Same.'",
        ),
        ({"train1": "Pack both.", "train2": "Pack two."}, {"change": True}, "time differs from the old version"),
    ],
)
def test_a_sample_that_differs_in_more_than_the_wording_is_refused(carry_sample, capsys, new, options, text):
    before = carry_sample.file.read_bytes()
    assert carry_sample(new, **options) == 2
    assert text in capsys.readouterr().err
    assert carry_sample.file.read_bytes() == before
