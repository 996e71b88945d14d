"""The border of the program: whatever a file holds, reading it gives a value or one line, and soon."""

from __future__ import annotations

import copy
import json
import os
import shutil
import time
import zipfile
from importlib import resources
from io import BytesIO
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from tests.evaluation.mutating import deep, places

from betterbench.certification import load_coverage
from betterbench.cli.main import main
from betterbench.comparison.side import load_sides
from betterbench.diagnosis import diagnose_records, diagnose_run, stored
from betterbench.errors import BetterError, InvalidInputError, system_error_text
from betterbench.evaluation.planning.manifest import policy_difference
from betterbench.evaluation.planning.repeat import repeated_plan
from betterbench.json_form import read_bounded
from betterbench.policies.conventions.adapter import Adapter
from betterbench.policies.conventions.presets import preset
from betterbench.records import Journal, RunFolder, read_record
from betterbench.records.parquet import METADATA_KEY, SEAL_KEY, seal
from betterbench.records.scene_archive import read_scene
from betterbench.tasks.user_files import TaskFile
from betterbench_calibration.audit import load_tables

LONGEST_S = 20.0
"""Longest time of one mutated artifact [s], on a busy machine; a hang is an hour."""


def some_now(values, *quick):
    """Returns the parameters of a test, those that are not quick with the marker for slow tests."""
    marks = {True: (), False: (pytest.mark.slow,)}
    return [pytest.param(value, id=name, marks=marks[name in quick]) for name, value in values.items()]


HOSTILE = [
    *(None, True, False, -1, 0, 3, 10**400, -(10**25), 1e308, 0.1, float("nan"), float("inf"), "", "1", "300"),
    *(
        "x" * 100_000,
        "../../../etc/passwd",
        "\x1b[31mred",
        "\ud800",
        "a\x00b",
        [],
        {},
        [[]],
        {"": {}},
        deep(150),
        deep(290),
    ),
]


def mutated_form(form, draw):
    """Returns a copy of a JSON value with one or two places replaced, left out, doubled or added."""
    form = copy.deepcopy(form)
    for _ in range(int(draw.integers(1, 3))):
        all_places = list(places(form))[1:]
        if not all_places:
            return form
        *way, last = all_places[draw.integers(len(all_places))]
        inner = form
        for key in way:
            inner = inner[key]
        value = copy.deepcopy(HOSTILE[draw.integers(len(HOSTILE))])
        how = draw.integers(4)
        if how == 0:
            del inner[last]
        elif how == 1 and isinstance(inner, list):
            inner.append(copy.deepcopy(inner[last]))
        elif how == 1:
            inner["more"] = value
        else:
            inner[last] = value
    return form


def text_of(form):
    return json.dumps(form).encode()


def mutated_bytes(data, draw):
    """Returns bytes of which some are changed, left out, doubled or put in."""
    data = bytearray(data)
    for _ in range(int(draw.integers(1, 4))):
        at = int(draw.integers(max(1, len(data))))
        more = int(draw.integers(1, 40))
        match draw.integers(5):
            case 0:
                data[at : at + 1] = bytes([draw.integers(256)])
            case 1:
                del data[at : at + more]
            case 2:
                data[at:at] = data[at : at + more]
            case 3:
                data[at:at] = [b"\x00", b"9" * 400, b"[" * 3000, b"\xff\xfe", b"\n", b'"'][draw.integers(6)]
            case _:
                del data[at:]
    return bytes(data)


def mutated_text(data, draw):
    """Returns JSON with a mutated value, or with mutated bytes."""
    return text_of(mutated_form(json.loads(data), draw)) if draw.uniform() < 0.7 else mutated_bytes(data, draw)


def mutated_lines(data, draw):
    lines = data.splitlines()
    at = draw.integers(len(lines))
    lines[at] = mutated_text(lines[at], draw)
    return b"\n".join(lines) + b"\n"


def mutated_record(data, draw):
    """Returns a record with a mutated document, sealed again, or with mutated bytes."""
    if draw.uniform() < 0.2:
        return mutated_bytes(data, draw)
    table = pq.read_table(BytesIO(data))
    form = mutated_form(json.loads(table.schema.metadata[METADATA_KEY]), draw)
    buffer = BytesIO()
    table = table.replace_schema_metadata({METADATA_KEY: text_of(form), SEAL_KEY: b"0" * 64})
    pq.write_table(table, buffer, compression="zstd", use_dictionary=False, write_statistics=False)
    return seal(buffer.getvalue())


def mutated_scene(data, draw):
    """Returns an archive of a scene with other members, in any compression, or with mutated bytes."""
    if draw.uniform() < 0.5:
        return mutated_bytes(data, draw)
    buffer = BytesIO()
    kinds = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED, zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA)
    with zipfile.ZipFile(BytesIO(data)) as whole, zipfile.ZipFile(buffer, "w", kinds[draw.integers(4)]) as archive:
        for name in whole.namelist():
            archive.writestr(
                name if draw.uniform() < 0.7 else f"../{name}", mutated_bytes(whole.read(name)[:5000], draw)
            )
    return buffer.getvalue() if draw.uniform() < 0.5 else mutated_bytes(buffer.getvalue(), draw)


@pytest.fixture(scope="module")
def finished(uninterrupted, tmp_path_factory):
    """A run with a stored diagnosis."""
    path = tmp_path_factory.mktemp("border") / "run"
    shutil.copytree(uninterrupted.path, path)
    run = RunFolder.open(path)
    stored.store_diagnosis(run, diagnose_run(run))
    return path


def read_run(path):
    run = RunFolder.open(path)
    policy_difference(run, {"address": "x", "metadata": {}})
    run.entries()
    diagnose_run(run)
    repeated_plan(path)


def read_sides(path):
    load_sides([path, path.with_name("run")], allow_mixed=True)


def read_journal_of(path):
    run = RunFolder.open(path)
    Journal(run.journal_path).close()
    list(run.records())


def read_one(path):
    record = read_record(path)
    for _ in record.states():
        break
    diagnose_records([record])


def kinds(finished):
    """Returns every kind of artifact: where it lies in a run or beside it, its mutation and its readers."""
    run = RunFolder.open(finished)
    record = run.record_path("morning_coffee", "T1", 0)
    scene = run.scene_path(read_record(record).metadata.scene_hash)
    certificate = resources.files("betterbench.certification").joinpath("data/better60.json").read_bytes()
    tables = resources.files("betterbench_calibration.audit").joinpath("data/paper_tables.json").read_bytes()
    adapter = text_of(preset("openpi_libero").to_json())

    def stored_of(path):
        stored.read_stored(RunFolder.open(path))

    return {
        "run.json": ("run.json", (finished / "run.json").read_bytes(), mutated_text, (read_run, read_sides)),
        "journal": ("journal.jsonl", run.journal_path.read_bytes(), mutated_lines, (read_journal_of,)),
        "diagnosis": ("diagnosis.json", (finished / "diagnosis.json").read_bytes(), mutated_text, (stored_of,)),
        "record": (None, record.read_bytes(), mutated_record, (read_one,)),
        "scene": (None, scene.read_bytes()[:200_000], mutated_bytes, (read_scene,)),
        "archive": (None, small_scene(), mutated_scene, (read_scene,)),
        "certificate": (None, certificate, mutated_text, (load_coverage,)),
        "tables": (None, tables, mutated_text, (load_tables,)),
        "adapter": (None, adapter, mutated_text, (Adapter.load,)),
    }


def small_scene():
    buffer = BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("model.mjb", bytes(range(256)) * 10)
        archive.writestr("scene.json", b'{"mujoco": "3"}')
    return buffer.getvalue()


KINDS = ("run.json", "journal", "diagnosis", "record", "scene", "archive", "certificate", "tables", "adapter")
FEW = {"run.json": 5, "record": 6, "certificate": 3, "tables": 3}


def attack(kind, count, finished, folder, seed):
    """Reads so many mutations of one kind of artifact, and returns what was neither a value nor one line."""
    place, data, mutate, readers = kinds(finished)[kind]
    shutil.copytree(finished, folder / "run", dirs_exist_ok=True)
    shutil.copytree(finished, folder / "mutated", dirs_exist_ok=True)
    target = folder / "mutated" / place if place else folder / f"artifact-{kind.replace('.', '-')}"
    wrong = []
    for number in range(count):
        target.write_bytes(mutate(data, np.random.default_rng([seed, number])))
        for reader in readers:
            began = time.perf_counter()
            try:
                reader(folder / "mutated" if place else target)
            except BetterError as problem:
                text = str(problem)
                if "\n" in text.strip() or not text.strip():
                    wrong.append((kind, number, "lines", text[:300]))
            except Exception as problem:  # noqa: BLE001 - what is counted here
                wrong.append((kind, number, type(problem).__name__, str(problem)[:300]))
            if time.perf_counter() - began > LONGEST_S:
                wrong.append((kind, number, "hang", reader.__name__))
    return wrong


@pytest.mark.parametrize("kind", KINDS)
def test_a_mutated_artifact_is_a_value_or_one_line(kind, finished, tmp_path):
    assert attack(kind, FEW.get(kind, 10), finished, tmp_path, seed=1) == []


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_many_mutated_artifacts_are_values_or_one_line_each(kind, finished, tmp_path):
    assert attack(kind, 560, finished, tmp_path, seed=2) == []


def folder_there(path):
    path.mkdir()


def pipe_there(path):
    os.mkfifo(path)


def dangling(path):
    path.symlink_to("nowhere")


def loop(path):
    path.symlink_to(path.name)


ODD = {"a folder": folder_there, "a pipe": pipe_there, "a dangling link": dangling, "a loop": loop}
FILES = ("run.json", "journal.jsonl", "diagnosis.json", ".lock")


@pytest.mark.parametrize("file", FILES)
@pytest.mark.parametrize("odd", some_now(ODD, "a pipe"))
def test_what_is_no_file_is_one_line_and_no_hang(odd, file, finished, tmp_path, capsys):
    shutil.copytree(finished, tmp_path / "run")
    (tmp_path / "run" / file).unlink(missing_ok=True)
    odd(tmp_path / "run" / file)
    status = main(["diagnose", str(tmp_path / "run")])
    said = capsys.readouterr()
    assert "Traceback" not in said.err
    if file == ".lock":
        assert status == 0
    else:
        assert status in (0, 2)
        assert (status == 2) == ("error:" in said.err)


OPTIONS = [
    ["report", "{}"],
    ["diagnose", "{}"],
    ["replay", "{}", "--check"],
    ["compare", "{}", "{}"],
    ["eval", "--from", "{}"],
    ["eval", "--policy", "noop", "--out", "{}", "--tasks", "morning_coffee", "--uncertified", "--trials", "1"],
    ["eval", "--policy", "noop", "--certificate", "{}", "--tasks", "morning_coffee"],
    ["audit-paper", "--tables", "{}"],
    ["list", "tasks", "--task-file", "{}"],
]
PATHS = {
    "missing": lambda p: p / "none",
    "too long": lambda p: p / ("n" * 300),
    "much too long": lambda p: p / "/".join(["folder"] * 1000),
    "a loop": lambda p: (loop(p / "loop"), p / "loop")[1],
    "a dangling link": lambda p: (dangling(p / "dangling"), p / "dangling")[1],
    "a pipe": lambda p: (pipe_there(p / "pipe"), p / "pipe")[1],
    "below a file": lambda p: ((p / "file").write_text("x"), p / "file" / "x")[1],
    "a device": lambda _: Path("/dev/null"),
}


@pytest.mark.parametrize("place", some_now(PATHS, "a pipe", "much too long", "a loop"))
def test_a_path_that_cannot_be_used_is_one_line(place, tmp_path, capsys):
    path = str(place(tmp_path))
    for number, option in enumerate(OPTIONS):
        if option[0] == "eval" and "--out" in option and path.endswith(("none", "dangling")):
            continue  # which would run
        arguments = [path if part == "{}" else part for part in option]
        try:
            status = main(arguments)
        except SystemExit as left:
            status = left.code
        said = capsys.readouterr()
        assert status == 2, (number, arguments[0], status, said.out[-200:])
        assert "Traceback" not in said.err
        assert said.err.strip()
        assert "elete" not in said.err


def test_reading_waits_for_no_pipe_and_follows_no_loop(tmp_path):
    for name, odd in ODD.items():
        odd(tmp_path / name)
        with pytest.raises(InvalidInputError):
            read_bounded(tmp_path / name, max_bytes=10, cure="Give a file")
        with pytest.raises(InvalidInputError):
            TaskFile.read(tmp_path / name)
    with pytest.raises(InvalidInputError, match="cannot be read"):
        read_bounded(tmp_path / "a\x00b", max_bytes=10, cure="Give a file")


def test_what_the_system_refuses_is_one_short_line():
    text = system_error_text(OSError(36, "File name too long", "/x" + "y" * 10_000 + "\nz"))
    assert len(text) < 600
    assert "\n" not in text
    assert "File name too long" in system_error_text(OSError(36, "File name too long"))
