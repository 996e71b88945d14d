"""Files of strangers: whatever stands in place of one ends within a second, and what is forged in it in one line."""

from __future__ import annotations

import contextlib
import gzip
import hashlib
import json
import os
import shutil
import socket
import time
from dataclasses import replace

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from tests.betterbench_calibration.mixture.test_sources import lerobot, questions
from tests.demonstrations.shortcuts.strangers import make
from tests.evaluation.mutating import HOSTILE, mutated_bytes, mutated_form
from tests.records.test_seals import KINDS, question_set

from betterbench.cli.yaml_file import read_yaml
from betterbench.comparison import read_submission
from betterbench.demonstrations.sets.recipe import read_recipe
from betterbench.demonstrations.shortcuts.lerobot import Choices, read_lerobot
from betterbench.demonstrations.shortcuts.prediction import read_prediction
from betterbench.errors import BetterError, InvalidInputError, RecordError
from betterbench.jobs import write_durably
from betterbench.jobs.outputs import LIST_NAME, OutputFolder
from betterbench.json_form import parse_json, sealed_form
from betterbench.policies.conventions.adapter import Adapter
from betterbench.real.plan import PLAN_NAME, RealPolicy, make_plan, write_plan
from betterbench.records import RunFolder, read_record
from betterbench.records.scene_archive import read_scene
from betterbench.records.twins import PAIRS_FILE, read_pairs
from betterbench.sim.modalities.folder import SETTINGS_FILE, read_settings
from betterbench.sim.worlds.premises import is_premise_file, read_entries
from betterbench.vqa import dataset
from betterbench.vqa.dataset import read_set
from betterbench.vqa.question import Candidate, Form, FrameSource, QuestionType
from betterbench_calibration.audit import load_tables
from betterbench_calibration.mixture import MixtureSampler, mixture_of_files

COUNT = int(os.environ.get("BETTERBENCH_MUTATIONS", "120"))
LONGEST_S = 1.0
"""Longest wait for a pipe, socket or device in place of a file [s]."""
LONGEST_LINE = 1500


def of_text(name, text, read):
    """A kind of file that has no seal of its own: made from a text, and read where the text is right."""

    def begun(folder):
        (folder / name).write_text(text)
        return folder / name

    return begun, read


NOOP = [RealPolicy("still", "noop")]
PLACES = {
    **{
        name: (kind.make, kind.read)
        for name, kind in KINDS.items()
        if name not in ("calibration", "power", "demonstrations")
    },
    "run.json": of_text("run.json", "{}", lambda p: RunFolder.open(p.parent)),
    "pairs": of_text(PAIRS_FILE, "", lambda p: read_pairs(RunFolder(p.parent, {}, {}))),
    "record": of_text("0.parquet", "", read_record),
    "scene": of_text("a.zip", "", read_scene),
    "submission": of_text("a.json", "", read_submission),
    "prediction": of_text("a.json", "", read_prediction),
    "adapter": of_text("a.json", "", Adapter.load),
    "plan of a real arm": of_text(PLAN_NAME, "{}", lambda p: write_plan(p.parent, make_plan(NOOP))),
    "recipe of a data set": of_text("recipe.json", "", lambda p: read_recipe(p.parent)),
    "settings of modalities": of_text(SETTINGS_FILE, "", lambda p: read_settings(p.parent)),
    "tables of a paper": of_text("a.json", "", load_tables),
    "YAML": of_text("a.yaml", "", lambda p: read_yaml(p, cure="Mend it")),
    "premises": of_text("a.jsonl", "", lambda p: (read_entries(p), is_premise_file(p))),
    "candidates": of_text("1.jsonl.gz", "", lambda p: list(dataset._read_candidates(p))),
}


@pytest.mark.parametrize("name", PLACES)
def test_what_is_no_file_ends_within_a_second(name, tmp_path):
    begun, read = PLACES[name]
    path = begun(tmp_path)
    for put in (os.mkfifo, lambda p: p.symlink_to("/dev/zero"), lambda p: p.symlink_to("/dev/stdin"), os.mkdir, bound):
        path.unlink(missing_ok=True) if not path.is_dir() else path.rmdir()
        put(path)
        began = time.perf_counter()
        with pytest.raises((BetterError, OSError)) as caught:
            read(path)
        assert len(str(caught.value).splitlines()) == 1
        assert time.perf_counter() - began < LONGEST_S


def bound(path):
    """Makes a socket, which nobody listens at."""
    with socket.socket(socket.AF_UNIX) as made, contextlib.chdir(path.parent):  # its name must be short
        made.bind(path.name)


def told(read, *given):
    """Reads what was forged; returns whether it was refused, in one line."""
    try:
        read(*given)
    except BetterError as problem:
        text = str(problem)
        assert len(text.splitlines()) == 1, text
        assert len(text) < LONGEST_LINE, text
        return True
    return False


# ------------------------------------------------------------------------------------------------ sources of mixtures

ODD_LINES = [
    *(b"[" * 100_000, b"null", b"[]", b'"x"', b"{}", b"\xff", b"1", b'{"episode_index": 0}'),
    *(f'{{"episode_index": {a}, "length": {b}}}'.encode() for a, b in (("0", "true"), ("0.0", "5"), ("null", "5"))),
    *(f'{{"episode_index": 0, "length": {n}}}'.encode() for n in ("-1", "0", "5.0", "1e400", "9" * 30, "9" * 5000)),
    b'{"episode_index": 0, "length": 5, "length": 6}',
]


@pytest.mark.parametrize("line", ODD_LINES, ids=lambda line: ascii(line[:30]))
def test_lines_of_episodes_are_read_through_their_form(tmp_path, line):
    place = lerobot(tmp_path / "set", "v2.1") / "meta/episodes.jsonl"
    place.write_bytes(b"\n".join([line, *place.read_bytes().splitlines()[1:]]))
    assert told(mixed, tmp_path)


def columns_of(n):
    yield {"episode_index": [None] * n, "length": [5] * n}
    yield {"episode_index": list(range(n)), "length": [None] * n}
    yield {"episode_index": list(range(n)), "length": ["5"] * n}
    yield {"episode_index": [{"a": i} for i in range(n)], "length": [5] * n}
    yield {"episode_index": [float(i) for i in range(n)], "length": [5] * n}
    yield {"episode_index": list(range(n)), "length": [True] * n}
    yield {"episode_index": list(range(n)), "length": [2**63 - 1] * n}
    yield {"episode_index": list(range(n))}


@pytest.mark.parametrize("number", range(8))
def test_tables_of_episodes_are_read_through_their_types(tmp_path, number):
    place = lerobot(tmp_path / "set", "v3.0") / "meta/episodes/chunk-000/file-000.parquet"
    pq.write_table(pa.table(list(columns_of(3))[number]), place)
    assert told(mixed, tmp_path)


def mixed(folder):
    sets = [{"path": "set"}, {"path": "vqa"}] if (folder / "vqa").exists() else [{"path": "set"}]
    form = {"groups": [{"name": "g", "weight": 1.0, "sets": sets}]}
    mixture = mixture_of_files(form, where="m.yaml", folder=folder)
    for drawn in MixtureSampler(mixture.parts, draws=9):
        mixture.sources[drawn.part].item(drawn.item)


@pytest.mark.parametrize("version", ["v2.1", "v3.0"])
def test_mutated_sources_of_mixtures(tmp_path, version):
    whole = lerobot(tmp_path / "whole", version)
    questions(tmp_path / "vqa")
    files = [p for p in (*whole.rglob("*"), tmp_path / "vqa/summary.json") if p.is_file()]
    shutil.copytree(whole, tmp_path / "set")
    refused, draw = 0, np.random.default_rng(3)
    for _ in range(COUNT):
        file = files[draw.integers(len(files))]
        data = file.read_bytes()
        place = tmp_path / "set" / file.relative_to(whole) if file.is_relative_to(whole) else file
        place.write_bytes(forged(data, draw) if file.suffix == ".json" else mutated_bytes(data, draw))
        refused += told(mixed, tmp_path)
        place.write_bytes(data)
    assert refused > COUNT // 3
    mixed(tmp_path)


def forged(data, draw):
    try:
        return json.dumps(mutated_form(json.loads(data), draw)).encode("utf-8", "surrogatepass")
    except (ValueError, RecursionError):
        return mutated_bytes(data, draw)


# ------------------------------------------------------------------------------------------------- LeRobot data sets


def test_a_text_that_every_row_has_takes_its_memory_once(tmp_path):
    """One long text in the dictionary of a column, for many rows: 200 kB on disk, 200 GB if each row had its own."""
    path = make(tmp_path / "set", "plain", "clean", count=12)
    text, rows = "put the red mug into the box " * 35_000, 200_000
    column = pa.DictionaryArray.from_arrays(pa.array(np.zeros(rows, np.int32)), pa.array([text]))
    tasks = pa.table({"task_index": list(range(rows)), "task": column})
    pq.write_table(tasks, path / "meta" / "tasks.parquet", store_schema=False)
    assert read_lerobot(path).facts[0].instruction.startswith("put the red mug")
    for file in (path / "data").rglob("*.parquet"):
        table = pq.read_table(file)
        said = pa.DictionaryArray.from_arrays(pa.array(np.zeros(len(table), np.int32)), pa.array([text * 40]))
        pq.write_table(table.append_column("said", said), file, store_schema=False)
    info = path / "meta" / "info.json"
    form = json.loads(info.read_text())
    form["features"]["said"] = {"dtype": "string", "shape": [1], "names": None}
    info.write_text(json.dumps(form))
    assert read_lerobot(path, Choices(instruction="said")).facts


# --------------------------------------------------------------------------------------------------- sets of questions


def candidates():
    source = [FrameSource("fruit_lunch", "train1", 1_000_000, row, 0.1, "front") for row in range(3)]
    words = {"x": "mug"}
    return [Candidate(QuestionType.STATE, Form.YES_NO, "f", ("g",), "No", "No", words, ("mug",), s) for s in source]


def test_candidates_are_what_was_written_or_refused(tmp_path):
    path, made = tmp_path / "1.jsonl.gz", candidates()
    path.write_bytes(dataset.candidates_bytes(made))
    assert list(dataset._read_candidates(path)) == made
    data, draw = path.read_bytes(), np.random.default_rng(4)
    lines = gzip.decompress(data)
    for number in range(COUNT):
        changed = mutated_bytes(lines, draw)
        path.write_bytes(gzip.compress(changed) if number % 2 else mutated_bytes(data, draw))
        if not told(lambda: list(dataset._read_candidates(path))):
            assert list(dataset._read_candidates(path)) == made
    path.write_bytes(gzip.compress(lines.replace(b'"No"', b'"Yes"')))
    with pytest.raises(RecordError, match="was changed after it was written"):
        list(dataset._read_candidates(path))


def test_candidates_that_unpack_to_too_much_are_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(dataset, "_MAX_CANDIDATE_BYTES", 1 << 20)
    (tmp_path / "1.jsonl.gz").write_bytes(gzip.compress(bytes(1 << 24)))
    with pytest.raises(RecordError, match="unpacks to more than"):
        list(dataset._read_candidates(tmp_path / "1.jsonl.gz"))


def asking_about(folder, place):
    """Returns a set of a stranger, sealed as it should be, whose questions are about a picture at a place."""
    lines = [json.loads(line) for line in (folder / "questions.jsonl").read_bytes().splitlines()]
    for line in lines:
        line["betterbench"]["image"] = place
    data = b"".join(json.dumps(line).encode() + b"\n" for line in lines)
    (folder / "questions.jsonl").write_bytes(data)
    summary = json.loads((folder / "summary.json").read_bytes())
    del summary["seal"]
    summary |= {"sha256": hashlib.sha256(data).hexdigest(), "image_sha256": {}}
    (folder / "summary.json").write_text(json.dumps(sealed_form(summary)))
    return folder


def test_a_set_shows_no_file_of_the_user_to_a_model(tmp_path):
    (tmp_path / "id_rsa").write_text("secret")
    made = tmp_path / "set"
    made.mkdir()
    question_set(made)
    for place in ("../id_rsa", str(tmp_path / "id_rsa"), "images/../../id_rsa", "x" * 2000, "", ".", "images/a\nb.jpg"):
        with pytest.raises(RecordError, match="the path does not lead to a file inside the set"):
            read_set(asking_about(made, place))
    (made / "images" / "link.jpg").symlink_to(tmp_path / "id_rsa")
    asked = read_set(asking_about(made, "images/link.jpg"))
    with pytest.raises(InvalidInputError, match="leads out of"):
        asked.image(asked.questions[0].image)


def test_an_image_that_a_sealed_set_does_not_know_is_not_shown(tmp_path):
    question_set(tmp_path)
    asked = read_set(tmp_path)
    (tmp_path / "images" / "new.jpg").write_bytes(b"new")
    with pytest.raises(RecordError, match="was changed after the question set was made"):
        asked.image("images/new.jpg")
    assert replace(asked, images={}).image("images/new.jpg") == b"new"


# ------------------------------------------------------------------------------------------------- lists of outputs


@pytest.mark.parametrize("name", [*(h for h in HOSTILE if isinstance(h, str)), "..", "a/../../x", ".", "a\nb", "a/b/c"])
def test_names_in_a_list_of_outputs(tmp_path, name):
    out = tmp_path / "out"
    with OutputFolder(out, "recipe"):
        write_durably(out / "ours.txt", b"ours")
    (out / "mine.txt").write_text("of the user")
    form = json.loads((out / LIST_NAME).read_text())
    form["files"][name] = ["ab" * 32]
    (out / LIST_NAME).write_text(json.dumps(form))
    with contextlib.suppress(BetterError, OSError), OutputFolder(out, "recipe"):
        pass
    assert (out / "mine.txt").read_text() == "of the user"


def test_numbers_of_a_text_can_be_read_as_something_else():
    assert parse_json('{"a": [1, 2.50]}', number=str) == {"a": ["1", "2.50"]}
    for text in ("NaN", "[Infinity]", '{"a": -Infinity}'):
        with pytest.raises(ValueError, match="is not a number"):
            parse_json(text, number=str)
