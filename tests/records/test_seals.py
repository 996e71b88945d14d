"""Every kind of file that counts, with bits and characters changed: refused in one line, or read as it was before."""

from __future__ import annotations

import json
import logging
import os
from collections.abc import Callable
from dataclasses import asdict, dataclass
from importlib import resources
from pathlib import Path

import numpy as np
import pytest
from tests.daily import others_slow
from tests.evaluation.mutating import mutated_bytes

from betterbench.certification import load_coverage
from betterbench.certification.certificate import CertificateVersions
from betterbench.certification.journal import JournalHeader
from betterbench.demonstrations.export.job import SOURCE_FILE, stored_source
from betterbench.demonstrations.making.attempt import AttemptNote
from betterbench.demonstrations.making.production import ATTEMPTS, AttemptJournal, StartOutcome, attempts_of
from betterbench.diagnosis.measures.confusion import Calibration
from betterbench.diagnosis.measures.power_matrix import PowerMatrix
from betterbench.diagnosis.stored import StoredDiagnosis, store_diagnosis
from betterbench.diagnosis.verdict import Metric, RunDiagnosis
from betterbench.errors import BetterError, InvalidInputError, RecordError
from betterbench.json_form import open_seal, read_bounded, sealed_form
from betterbench.learning.study.stages import _Done, _read
from betterbench.learning.training.frames import _EpisodeFrames, frames_bytes
from betterbench.records import Journal, JournalEntry, RunFolder, read_journal
from betterbench.records.modalities import header as headers
from betterbench.records.modalities.columns import view_columns
from betterbench.records.modalities.file import ModalityFile, ModalityWriter
from betterbench.records.modalities.spec import ViewSpec
from betterbench.records.twins import PAIRS_FILE, TwinPair, pairs_bytes, read_pairs
from betterbench.sim.modalities.folder import SETTINGS_FILE, ModalityFolder, Wanted, read_settings
from betterbench.tasks.demonstrated import read_demonstrations
from betterbench.vqa.asking import AnswersHead, ModelAnswer, _AnswerFile, read_answers
from betterbench.vqa.blind import Baseline
from betterbench.vqa.dataset import read_set, write_set
from betterbench.vqa.difficulty import Difficulty
from betterbench.vqa.question import Form, FrameSource, Question, QuestionType

COUNT = int(os.environ.get("BETTERBENCH_MUTATIONS", "120"))
"""Mutations of each kind, beside the single bits of each byte of a small file."""
ALL_BITS_BELOW = 600


@dataclass(frozen=True)
class Kind:
    """A kind of file: makes one in a folder and returns its path, and reads what counts in it.

    ``loses`` tells that whole lines at its end may be missing, where it is an append-only file whose readers go on.
    """

    make: Callable[[Path], Path]
    read: Callable[[Path], object]
    loses: bool = False


def outcome(seed):
    return StartOutcome("fruit_lunch", "train1", seed, (AttemptNote(0, "", "", 90 + seed, ("a", "b"), "a"),))


def described_run(folder):
    trials = [{"task": "fast_food", "condition": "L1", "variation": "L1", "seed": seed} for seed in range(3)]
    plan = {"policy": "random", "trials": trials, "action_space": "ee_delta"}
    return RunFolder.start(folder / "run", plan, context={"policy": {"name": "random"}}).path / "run.json"


def description(path):
    run = RunFolder.open(path.parent)
    return run.plan, run.context


def pairs(folder):
    path = described_run(folder).with_name(PAIRS_FILE)
    said = ("Put the fries into the box.", "Put the drink into the box.")
    path.write_bytes(
        pairs_bytes(TwinPair(f"p{i}", "fast_food", i, ("L1", "L2"), said, 20 + i, (90, 91)) for i in range(3))
    )
    return path


def attempts(folder):
    versions = CertificateVersions("0.1.0", "2.0", "3.17.0", {"fruit_lunch": 4})
    path = folder / ATTEMPTS / "journal.jsonl"
    with AttemptJournal(path, versions) as journal:
        for seed in range(3):
            journal.append(outcome(seed))
    return path


def entry(seed, **more):
    return JournalEntry("fast_food", "L1", "L1", seed, "done", None, {"duration_s": 1.25}, {}, "1e" * 32, **more)


def run_journal(folder):
    with Journal(folder / "journal.jsonl") as journal:
        for seed in range(3):
            journal.append(entry(seed))
    return folder / "journal.jsonl"


def stage(folder):
    known = {"variation": None, "condition": "train1", "label": "success", "intention": True, "target": "near"}
    trials = [{**known, "seed": i, "success": i < 1} for i in range(4)]
    path = folder / "runs-a.json"
    path.write_bytes(json.dumps(sealed_form(asdict(_Done("ab" * 32, {"trials": trials}, 12.5))), indent=1).encode())
    return path


def question(number):
    source = FrameSource("fruit_lunch", "train1", 1_000_000, number, 0.05 * number, "front")
    return Question(
        f"q{number}", QuestionType.STATE, Form.YES_NO, "f", f"Is the mug {number} held?", (), "No",
        f"images/{number}.jpg", 64, 64, Difficulty.EASY, (), (), (), {}, 0.5, source,
    )  # fmt: skip


def question_set(folder):
    (folder / "images").mkdir()
    for number in range(3):
        (folder / "images" / f"{number}.jpg").write_bytes(bytes([number]) * 40)
    plan = {"schema_version": 2, "kind": "balanced", "records": {"fruit_lunch/train1/1000000": "ab" * 32}}
    (folder / "set.json").write_text(json.dumps(sealed_form(plan)))
    return write_set(folder, [question(n) for n in range(3)], [Baseline("state", 3, 2, 2, 0.5)], "training").path


def asked(path):
    found = read_set(path.parent if path.is_file() else path)
    return found, [found.image(f"images/{n}.jpg") for n in range(3)]


def of_set(name):
    return lambda folder: question_set(folder) / name


def answers(folder):
    made = read_set(question_set(folder))
    with _AnswerFile(folder / "answers.jsonl", AnswersHead("model", made.sha256)) as file:
        for number in range(3):
            file.append(ModelAnswer(f"q{number}", "No"))
    return folder / "answers.jsonl"


def modality(folder):
    view, modalities = ViewSpec("front", 8, 6), ("depth",)
    columns = view_columns(view, modalities, 1)
    draw = np.random.default_rng(0)
    header = headers.ViewHeader(
        task="fruit_lunch", condition="train1", seed=0, policy="expert", record_sha256="ab" * 32, scene_hash="cd" * 32,
        view=view, quality="fast", modalities=modalities, control_rate_hz=20.0, focal_px=104.3,
        objects=(headers.BoxedObject("apple", "apple", 10, 3, (0.03, 0.03, 0.03)),), renderer={"gl": "x"}, stage={},
    )  # fmt: skip
    with ModalityWriter(folder / "front.parquet", columns) as writer:
        for _ in range(40):
            rows = {c.name: draw.uniform(0.1, 2.0, c.shape).astype(c.kind) for c in columns if c.name != "row"}
            writer.append(rows)
        return writer.finish(header)


def seen(path):
    with ModalityFile(path) as file:
        return file.header, [{name: value.tobytes() for name, value in row.items()} for row in file.rows()]


def frames(folder):
    shown = np.random.default_rng(0).integers(0, 4, (3, 1, 8, 8, 3)).astype(np.uint8)
    (folder / "a.bin").write_bytes(frames_bytes(shown))
    return folder / "a.bin"


def frames_of(path):
    found = _EpisodeFrames.open(path)
    if found is None:
        raise RecordError("is rendered again")
    out = np.empty((1, 8, 8, 3), np.uint8)
    return found.shape, [(found.into(row, out), out.tobytes())[1] for row in range(3)]


def exported(folder):
    form = {
        "export_version": 1,
        "version": 2,
        "identity": "ab" * 32,
        "quality": "fast",
        "files": {"a": 3},
        "sha256": {"a": "12" * 32},
    }
    (folder / "meta").mkdir()
    (folder / SOURCE_FILE).write_text(json.dumps(sealed_form(form), indent=4))
    return folder / SOURCE_FILE


def diagnosed(folder):
    known = RunDiagnosis(
        "random", (), (Metric("success_rate", "overall", 1, 3, 1 / 3, 0.1, 0.8),), (), (), {"halt_time": 3.0}, {}
    )
    run = RunFolder.start(folder / "run", {"policy": "random", "trials": []})
    return store_diagnosis(run, known)


def modality_settings(folder):
    views = tuple(ViewSpec(name, 8, 6) for name in ("front", "wrist"))
    ModalityFolder(folder / "m", Wanted(views, ("depth",), "fast", {"gl": "x"}))
    return folder / "m" / SETTINGS_FILE


def packaged(package, name):
    def make(folder):
        (folder / name).write_bytes(resources.files(package).joinpath("data", name).read_bytes())
        return folder / name

    return make


KINDS = {
    "journal of a run": Kind(run_journal, read_journal, loses=True),
    "run.json": Kind(described_run, description),
    "pairs.jsonl": Kind(pairs, lambda p: read_pairs(RunFolder.open(p.parent))),
    "journal of attempts": Kind(attempts, lambda p: attempts_of(p.parent.parent), loses=True),
    "stage of a study": Kind(stage, lambda p: asdict(_read(p, "runs") or _Done("", {}, 0.0))),
    "set.json": Kind(of_set("set.json"), asked),
    "summary.json": Kind(of_set("summary.json"), asked),
    "questions.jsonl": Kind(of_set("questions.jsonl"), asked),
    "image of a question": Kind(of_set("images/1.jpg"), lambda p: asked(p.parent.parent)),
    "answers": Kind(answers, lambda p: read_answers(p, read_set(p.parent)).answers, loses=True),
    "modalities": Kind(modality, seen),
    "frames": Kind(frames, frames_of),
    "diagnosis.json": Kind(
        diagnosed, lambda p: StoredDiagnosis.from_json(read_bounded(p, max_bytes=1 << 20, cure="x"), where=p.name)
    ),
    "materialize.json": Kind(modality_settings, lambda p: read_settings(p.parent)),
    "origin of an export": Kind(exported, lambda p: stored_source(p.parent.parent)),
    "calibration": Kind(
        packaged("betterbench.diagnosis", "calibration.json"),
        lambda p: Calibration.from_json(p.read_bytes(), where=p.name),
    ),
    "power": Kind(packaged("betterbench.diagnosis", "power.json"), lambda p: PowerMatrix.from_json(p.read_bytes())),
    "certificate": Kind(packaged("betterbench.certification", "better60.json"), load_coverage),
    "demonstrations": Kind(
        packaged("betterbench.tasks", "demonstrations.json"),
        lambda p: read_demonstrations(p.read_bytes().decode(errors="surrogateescape"), p.name),
    ),
}


def mutations(data, count, seed):
    """Yield one changed bit of each byte of a small file, and of a sample of a large one; then other changes."""
    draw = np.random.default_rng(seed)
    places = range(len(data)) if len(data) < ALL_BITS_BELOW else draw.integers(len(data), size=count)
    for place in places:
        changed = bytearray(data)
        changed[place] ^= 1 << int(draw.integers(8))
        yield bytes(changed)
    for _ in range(count // 2):
        yield mutated_bytes(data, draw)


def same_or_fewer(kind, before, found):
    if not kind.loses or found == before:
        return found == before
    some = dict(enumerate(before)) if isinstance(before, tuple) else before
    fewer = dict(enumerate(found)) if isinstance(found, tuple) else found
    return isinstance(fewer, dict) and list(fewer.items()) == list(some.items())[: len(fewer)]


@pytest.mark.parametrize("name", others_slow(KINDS, 4))
def test_a_change_is_refused_or_changes_nothing(name, tmp_path, caplog):
    caplog.set_level(logging.CRITICAL)
    kind = KINDS[name]
    path = kind.make(tmp_path)
    data, before = path.read_bytes(), kind.read(path)
    count = COUNT if len(data) < 300_000 else max(1, COUNT // 12)
    refused = same = 0
    for changed in mutations(data, count, len(name)):
        path.write_bytes(changed)
        try:
            found = kind.read(path)
        except BetterError as problem:
            text = str(problem)
            assert len(text.splitlines()) == 1, text
            assert len(text) < 1500, text
            refused += 1
        else:
            assert same_or_fewer(kind, before, found), changed
            same += 1
    path.write_bytes(data)
    assert kind.read(path) == before
    assert refused > same
    logging.getLogger(__name__).critical("%s: %d mutations, %d refused", name, refused + same, refused)


@pytest.mark.parametrize("name", ["journal of a run", "journal of attempts"])
def test_a_lost_last_line_break_is_a_lost_tail_and_is_said(name, tmp_path, caplog):
    kind = KINDS[name]
    path = kind.make(tmp_path)
    (tmp_path / "run.json").write_text(json.dumps({"schema_version": 1, "plan": {}, "context": {}}))
    path.write_bytes(path.read_bytes()[:-1])
    found = RunFolder.open(tmp_path).entries() if name == "journal of a run" else kind.read(path)
    assert len(found) == 2
    assert [r.getMessage() for r in caplog.records if "is incomplete" in r.getMessage()]


def test_records_that_a_journal_has_lost_are_told(tmp_path, caplog):
    path = run_journal(tmp_path)
    trials = [{"task": "fast_food", "condition": "L1", "variation": "L1", "seed": seed} for seed in range(3)]
    form = {"schema_version": 2, "plan": {"trials": trials}, "context": {}}
    (tmp_path / "run.json").write_text(json.dumps(sealed_form(form)))
    run = RunFolder.open(tmp_path)
    for seed in range(3):
        place = run.record_path("fast_food", "L1", seed)
        place.parent.mkdir(parents=True, exist_ok=True)
        place.touch()
    assert len(run.entries()) == 3
    assert caplog.records == []
    path.write_bytes(b"".join(path.read_bytes().splitlines(keepends=True)[:2]))
    assert len(run.entries()) == 2
    assert "does not list 1 existing records (fast_food/L1/2" in caplog.text


def test_lines_of_an_earlier_version_are_read_and_that_is_said(tmp_path, caplog):
    path = attempts(tmp_path)
    header = {**asdict(JournalHeader("betterbench attempts journal", "0.1.0", "2.0", "3.17.0")), "version": 1}
    old = [json.dumps(header), *(json.dumps(asdict(outcome(seed))) for seed in range(2))]
    path.write_text("\n".join(old) + "\n")
    assert len(attempts_of(tmp_path)) == 2
    assert "written by an earlier version without a seal" in caplog.text
    with AttemptJournal(path, CertificateVersions("0.1.0", "2.0", "3.17.0", {"fruit_lunch": 4})) as journal:
        journal.append(outcome(2))
    assert list(attempts_of(tmp_path).values()) == [outcome(seed) for seed in range(3)]
    path.write_bytes(path.read_bytes().replace(b'"steps":92', b'"steps":93'))
    with pytest.raises(RecordError, match="line 4 does not match"):
        attempts_of(tmp_path)


def test_a_document_without_its_seal_is_refused_where_every_document_has_one():
    whole = json.dumps(sealed_form({"version": 2, "a": 1}))
    assert open_seal(whole, where="f", cure="Restore it", since=("version", 2)) == {"version": 2, "a": 1}
    for text in ('{"version": 2, "a": 1}', '{"version": true}', '{"version": "1"}', "[]", "", whole.replace("1", "2")):
        with pytest.raises(InvalidInputError, match="Restore it"):
            open_seal(text, where="f", cure="Restore it", since=("version", 2))
    assert open_seal('{"version": 1}', where="old", cure="", since=("version", 2)) == {"version": 1}
    with pytest.raises(InvalidInputError, match="has no seal"):
        open_seal('{"version": 1}', where="f", cure="Restore it")
