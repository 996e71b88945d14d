"""Thousands of mutations of every kind of file that is read: refused in one line, or the same as before."""

from __future__ import annotations

import json
import shutil
import time
from dataclasses import asdict
from importlib import resources
from io import BytesIO

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import yaml
from tests.evaluation.conftest import FEW_STEPS, in_few_steps, tiny
from tests.evaluation.mutating import (
    agree,
    json_bytes,
    mutated_bytes,
    mutated_form,
    mutated_json,
    mutated_lines,
    mutated_sealed,
    unique,
)

from betterbench import json_form
from betterbench.certification import load_coverage
from betterbench.cli.run_file import read_run_file, with_run_file
from betterbench.comparison import read_submission, submission_of
from betterbench.diagnosis import diagnose_run, stored
from betterbench.diagnosis.measures.confusion import Calibration
from betterbench.diagnosis.measures.power_matrix import PowerMatrix
from betterbench.errors import BetterError
from betterbench.evaluation import check_record, evaluate
from betterbench.evaluation.planning.repeat import repeated_plan
from betterbench.json_form import SEAL, dump_json, sealed_form
from betterbench.policies.conventions.adapter import Adapter
from betterbench.policies.conventions.presets import preset
from betterbench.records import RunFolder, read_record
from betterbench.records.parquet import METADATA_KEY, SEAL_KEY, seal
from betterbench.records.scene_archive import read_scene, write_scene
from betterbench.tasks.trial import Trial
from betterbench_calibration.audit import load_tables

pytestmark = [pytest.mark.physics, pytest.mark.slow]

COUNT = 5000
LONGEST_S = 60.0
"""Longest time of one reading [s], on a busy machine."""
LONGEST_LINE = 1200


class WrongError(Exception):
    """What was read is neither the same as before nor what the file says."""


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A short run, its diagnosis and its submission."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Trial, "resolve", in_few_steps(FEW_STEPS))
        made = evaluate(tiny(trials=2), tmp_path_factory.mktemp("mutations") / "run")
    stored.store_diagnosis(made, diagnose_run(made))
    (made.path / "submission.json").write_bytes(submission_of(made).file_bytes())
    return made


def numbers(diagnosis):
    """Returns what a diagnosis proves."""
    form = diagnosis.to_json()
    return json.loads(dump_json({key: form[key] for key in ("trials", "metrics", "findings")}))


def attack(mutate, read, *, seed, count=COUNT, least=0.25):
    """Returns what is wrong after so many mutations; ``read`` raises WrongError or whatever the reader does."""
    wrong, refused = [], 0
    for number in range(count):
        data = mutate(np.random.default_rng([seed, number]))
        began = time.perf_counter()
        try:
            read(data)
        except BetterError as problem:
            refused += 1
            text = str(problem)
            if "\n" in text.strip() or not text.strip() or len(text) > LONGEST_LINE:
                wrong.append((number, "lines", text[:300]))
        except Exception as problem:  # noqa: BLE001 - what is counted here
            wrong.append((number, type(problem).__name__, str(problem)[:400]))
        if time.perf_counter() - began > LONGEST_S:
            wrong.append((number, "slow", f"{time.perf_counter() - began:.1f} s"))
    assert refused > least * count, refused
    return wrong


def of_json(data):
    return lambda draw: mutated_json(data, draw)


# ------------------------------------------------------------------------------------------------------ files of a run


def records(run):
    return sorted((run.path / "records").rglob("*.parquet"))


def forged(data, draw):
    """Returns a record with other metadata or other numbers, sealed again."""
    table = pq.read_table(BytesIO(data))
    document = table.schema.metadata[METADATA_KEY]
    if draw.uniform() < 0.5:
        document = json_bytes(mutated_form(json.loads(document), draw))
    else:
        name = table.column_names[draw.integers(len(table.column_names))]
        column = table.column(name).combine_chunks()
        rows = column.to_pylist()
        place = int(draw.integers(len(rows)))
        rows[place], rows[place - 1] = rows[place - 1], rows[place]
        if isinstance(rows[place], bool):
            rows = [not row for row in rows]
        elif isinstance(rows[place], float):
            rows[place] += 0.25
        field = table.schema.field(name)
        table = table.set_column(table.column_names.index(name), field, pa.array(rows, field.type))
    buffer = BytesIO()
    table = table.replace_schema_metadata({METADATA_KEY: document, SEAL_KEY: b"0" * 64})
    pq.write_table(table, buffer, compression="zstd", use_dictionary=False, write_statistics=False)
    return seal(buffer.getvalue())


@pytest.mark.parametrize("how", ["damaged", "forged"])
def test_mutated_records(run, how, tmp_path):
    shutil.copytree(run.path, tmp_path / "run")
    mine = RunFolder.open(tmp_path / "run")
    path = records(mine)[0]
    data, known = path.read_bytes(), read_record(path)
    trial = known.metadata

    def read(mutated):
        path.write_bytes(mutated)
        if how == "forged" and mutated != data:
            for told in read_record(path).states():
                assert told.positions
                break
        try:
            found = mine.read_record(trial.task, trial.condition, trial.seed)
            brief = mine.succeeded(mine.entries()[0].key)
        except BetterError:
            pass
        else:
            if not found.same_bits(known) or brief != known.outcome.success:
                raise WrongError("another record than the journal lists")
        if not (how == "damaged" and mutated != data):
            return
        if not read_record(path).same_bits(known):
            raise WrongError("another record than was sealed")

    assert attack(lambda draw: (forged if how == "forged" else mutated_bytes)(data, draw), read, seed=11) == []


def test_forged_records_do_not_replay(run, tmp_path):
    """A record alone, sealed again, of which no journal tells: what does not follow from its actions is named."""
    data, known = records(run)[0].read_bytes(), read_record(records(run)[0])
    path = tmp_path / "record.parquet"
    wrong = []
    for number in range(60):
        path.write_bytes(forged(data, np.random.default_rng([12, number])))
        try:
            found = check_record(path)
        except BetterError:
            continue
        again = read_record(path)
        if found.identical and found.verdict_agrees and not again.same_bits(known):
            wrong.append(
                (
                    number,
                    [f for f in asdict(known.metadata) if getattr(known.metadata, f) != getattr(again.metadata, f)],
                )
            )
    # Versions of what is installed are no part of what follows from the actions.
    left = {"package_version", "suite_version", "engine", "render_quality"}
    assert [w for w in wrong if not w[1] or set(w[1]) - left] == []


def test_mutated_scenes(run, tmp_path, caplog):
    scene = next((run.path / "scenes").glob("*.zip"))
    whole = read_scene(scene)
    small = {name: content[:3000] for name, content in whole.items()}
    write_scene(tmp_path / "scene.zip", small)
    data = (tmp_path / "scene.zip").read_bytes()

    def read(mutated):
        json_form._SAID.clear()
        caplog.clear()
        (tmp_path / "scene.zip").write_bytes(mutated)
        if read_scene(tmp_path / "scene.zip") != small and "without a seal" not in caplog.text:
            raise WrongError("another scene")

    assert attack(lambda draw: mutated_bytes(data, draw), read, seed=13) == []


@pytest.mark.parametrize("kind", ["run.json", "run.json, sealed again", "journal.jsonl"])
def test_mutated_descriptions_and_journals(run, kind, tmp_path):
    shutil.copytree(run.path, tmp_path / "run")
    path = tmp_path / "run" / kind.partition(",")[0]
    data, known, plan = path.read_bytes(), numbers(diagnose_run(run)), dict(run.plan)
    lines = run.journal_path.read_bytes()
    count = [0]

    def read(mutated):
        path.write_bytes(mutated)
        mine = RunFolder.open(tmp_path / "run")
        mine.entries()
        same = (dict(mine.plan), mine.journal_path.read_bytes()) == (plan, lines)
        count[0] += 1
        if same and count[0] % 50:
            return  # the diagnosis reads nothing else that has changed
        found = diagnose_run(mine)
        if numbers(found) != known and not found.notes:
            raise WrongError("other numbers without a note")
        repeated_plan(tmp_path / "run", allow_other_versions=True)

    mutate = {"run.json": mutated_json, "journal.jsonl": mutated_lines}.get(kind, mutated_sealed)
    least = 0.1 if "again" in kind else 0.25  # much of a context may be anything
    assert attack(lambda draw: mutate(data, draw), read, seed=14, least=least) == []


def test_mutated_stored_diagnoses(run, tmp_path):
    data = (run.path / "diagnosis.json").read_bytes()
    where = stored.stored_path(run)

    def read(mutated):
        where.write_bytes(mutated)
        found = stored.read_stored(run)
        form = json.loads(mutated, object_pairs_hook=unique)
        told = {t["key"]: (t["label"], t["success"], t["steps"]) for t in form["trials"]}
        if told != {k: (t.label, t.success, t.steps) for k, t in found.trials.items()}:
            raise WrongError("other trials than the file has")
        metrics = [[m["name"], m["scope"], m["k"], m["n"], m["value"]] for m in form["metrics"]]
        if metrics != [[m.name, m.scope, m.k, m.n, m.value] for m in found.metrics.values()]:
            raise WrongError("other metrics than the file has")

    try:
        assert attack(of_json(data), read, seed=15) == []
    finally:
        where.write_bytes(data)


@pytest.mark.parametrize("how", ["damaged", "resealed"])
def test_mutated_submissions(run, how, tmp_path):
    data = (run.path / "submission.json").read_bytes()
    path = tmp_path / "submission.json"
    path.write_bytes(data)
    known = read_submission(path)

    def mutate(draw):
        mutated = mutated_json(data, draw)
        if how == "resealed":
            try:
                form = json.loads(mutated)
                form.pop("sha256", None)
                form["sha256"] = __import__("hashlib").sha256(dump_json(form)).hexdigest()
                return json_bytes(form)
            except (ValueError, AttributeError, TypeError, BetterError, RecursionError):
                return mutated
        return mutated

    def read(mutated):
        path.write_bytes(mutated)
        found = read_submission(path)
        if how == "damaged":
            if found != known:
                raise WrongError("another submission with the same hash")
        elif not agree(json.loads(mutated, object_pairs_hook=unique), found.to_json()):
            raise WrongError("another submission than the file")
        found.diagnosis()

    assert attack(mutate, read, seed=16) == []


# ------------------------------------------------------------------------------------------------ files given by a path


def test_mutated_certificates(tmp_path):
    data = resources.files("betterbench.certification").joinpath("data/better60.json").read_bytes()
    path = tmp_path / "certificate.json"

    def read(mutated):
        path.write_bytes(mutated)
        found = load_coverage(path)
        if not agree(json.loads(mutated, object_pairs_hook=unique), json.loads(json.dumps(found.to_json()))):
            raise WrongError("another certificate than the file")

    assert attack(of_json(data), read, seed=17) == []


@pytest.mark.parametrize(("name", "kind"), [("calibration.json", Calibration), ("power.json", PowerMatrix)])
def test_mutated_measurements(name, kind):
    data = resources.files("betterbench.diagnosis").joinpath("data", name).read_bytes()
    if "cells" in (whole := json.loads(data)):  # all alike, and every mutation copies and reads them
        data = json_bytes(sealed_form({**whole, "cells": dict(list(whole["cells"].items())[:2])}))
        assert kind.from_json(data, where=name).cells

    def read(mutated):
        found = kind.from_json(mutated, where=name)
        form = json.loads(json.dumps(found.to_json()))
        mine = json.loads(mutated, object_pairs_hook=unique)
        mine["counts"] = form["counts"] = []  # in an order of their own
        mine.pop(SEAL, None), form.pop(SEAL, None)
        if not agree(mine, form):
            raise WrongError("other numbers than the file has")

    assert attack(of_json(data), read, seed=18) == []
    assert attack(lambda draw: mutated_sealed(data, draw), read, seed=19) == []


def test_mutated_adapters(tmp_path):
    data = json_bytes(preset("openpi_libero").to_json())
    path = tmp_path / "adapter.json"

    def longer(form):
        if isinstance(form, dict):
            return {
                k: [v] if k in ("key", "episode_key") and isinstance(v, str) else longer(v) for k, v in form.items()
            }
        return [longer(v) for v in form] if isinstance(form, list | tuple) else form

    def read(mutated):
        path.write_bytes(mutated)
        found = Adapter.load(path)
        mine = longer(json.loads(mutated, object_pairs_hook=unique))
        if not agree(mine, longer(json.loads(json.dumps(found.to_json())))):
            raise WrongError("another adapter than the file")

    assert attack(of_json(data), read, seed=19) == []


def test_mutated_tables(tmp_path):
    form = json.loads(resources.files("betterbench_calibration.audit").joinpath("data/paper_tables.json").read_bytes())
    data = json_bytes({**form, "tables": form["tables"][:2]})  # every mutation reads all
    path = tmp_path / "tables.json"

    def read(mutated):
        path.write_bytes(mutated)
        json.loads(mutated, object_pairs_hook=unique) if load_tables(path) else None

    assert attack(of_json(data), read, seed=20) == []


RUN_FILE = b"""# an experiment
policy: openpi://127.0.0.1:8000
out: runs/mine
suite: better60
tasks: [fast_food, morning_coffee]
variations:
  - T1
  - fast_food/L1
trials: 20
seed: 3
action_space: ee_delta
quality: 'fast'
until_decided: false
workers: 2
envs: 4
engine: local
policy_timeout: 30.5
uncertified: true
"""


def test_mutated_run_files(tmp_path):
    path = tmp_path / "run.yaml"
    lines = RUN_FILE.splitlines()

    def mutate(draw):
        if draw.uniform() < 0.5:
            return mutated_bytes(RUN_FILE, draw)
        form = mutated_form(yaml.safe_load(RUN_FILE), draw)
        if draw.uniform() < 0.3:
            return b"\n".join([*lines, lines[draw.integers(1, len(lines))].replace(b"fast", b"slow")])
        try:
            return yaml.safe_dump(form, allow_unicode=True).encode("utf-8", "surrogatepass")
        except (yaml.YAMLError, RecursionError, ValueError):
            return json_bytes(form)

    def read(mutated):
        path.write_bytes(mutated)
        found = read_run_file(path)
        said = {str(k).replace("-", "_"): v for k, v in yaml.safe_load(mutated).items()}
        if not agree(said, json.loads(json.dumps(asdict(found)))):
            raise WrongError("other options than the file")
        with_run_file(["--run-file", str(path), "--trust"])

    assert attack(mutate, read, seed=21) == []
