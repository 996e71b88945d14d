"""Laws of records: nothing is lost, nothing is added, nothing depends on anything else."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import subprocess
import sys

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from betterbench.errors import InvalidInputError, RecordError, StorageError
from betterbench.interface.state import WorldState
from betterbench.records import RecordBuilder, parquet, read_record, record_bytes, write_record
from betterbench.records.parquet import seal


@pytest.mark.parametrize(("rows", "objects"), [(1, 3), (2, 0), (40, 1), (600, 3)])
def test_written_and_read_is_equal_in_every_bit(make_record, tmp_path, rows, objects) -> None:
    record, states = make_record(rows=rows, objects=objects)
    write_record(record, tmp_path / "deep" / "er" / "7.parquet")
    again = read_record(tmp_path / "deep" / "er" / "7.parquet")
    assert again.same_bits(record)
    assert len(again) == rows == again.n_steps + 1
    assert list(again.states()) == states == [again.state(i) for i in range(rows)]
    assert record_bytes(again) == record_bytes(record)


def test_states_keep_signed_zeros_and_subnormals(make_record) -> None:
    record, _ = make_record(rows=3)
    for value, expected in zip(record.state(1).joint_velocities, (-0.0, 5e-324), strict=False):
        assert value.hex() == expected.hex()


def test_states_hold_plain_python_values(make_record) -> None:
    def leaves(value: object) -> set[type]:
        if isinstance(value, tuple):
            return set().union(*(leaves(v) for v in value)) if value else set()
        if dataclasses.is_dataclass(value):
            return set().union(*(leaves(getattr(value, f.name)) for f in dataclasses.fields(value)))
        return {type(value)}

    state = next(s for s in make_record(rows=20)[0].states() if s.held and s.contacts)
    fields = [f.name for f in dataclasses.fields(WorldState) if f.name != "info"]
    assert set().union(*(leaves(getattr(state, name)) for name in fields)) == {int, float, str}


def test_the_same_episode_gives_the_same_bytes_in_another_process(make_record, tmp_path) -> None:
    record, _ = make_record(rows=30)
    write_record(record, tmp_path / "a.parquet")
    code = (
        "import sys; from pathlib import Path; from betterbench.records import read_record, write_record;"
        "write_record(read_record(Path(sys.argv[1])), Path(sys.argv[2]))"
    )
    subprocess.run([sys.executable, "-c", code, str(tmp_path / "a.parquet"), str(tmp_path / "b.parquet")], check=True)
    assert (tmp_path / "a.parquet").read_bytes() == (tmp_path / "b.parquet").read_bytes()
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.parquet", "b.parquet"]


def test_every_bit_counts_in_the_comparison(make_record) -> None:
    record, _ = make_record(rows=5)
    changed = record.qpos.copy()
    changed[3, 4] = np.nextafter(changed[3, 4], 9.0)
    assert not record.same_bits(dataclasses.replace(record, qpos=changed))
    assert not record.same_bits(dataclasses.replace(record, metadata=dataclasses.replace(record.metadata, seed=8)))
    assert record.same_bits(dataclasses.replace(record, qpos=record.qpos.copy()))


def test_row_zero_has_no_action_and_the_others_have_theirs(make_record) -> None:
    record, _ = make_record(rows=5)
    assert np.isnan(record.action[0]).all()
    assert np.isnan(record.applied[0]).all()
    assert np.array_equal(record.applied[1:], record.action[1:].clip(-1, 1))


def test_arrays_are_copies_and_read_only(make_metadata, make_state) -> None:
    meta = make_metadata()
    builder, qpos = RecordBuilder(meta), np.zeros(5)
    builder.append(
        make_state(meta.scene, 0, np.random.default_rng(0)),
        qpos=qpos,
        qvel=qpos,
        ctrl=qpos,
        predicates=(True, False),
        subgoals=(True, False),
        goal=True,
    )
    qpos[:] = 1.0
    record = builder.finish(termination="success", success=True)
    assert not record.qpos.any()
    with pytest.raises(ValueError, match="read-only"):
        record.qpos[0, 0] = 2.0
    assert record.predicates.tolist() == [[True, False]]


@pytest.mark.parametrize("kind", ["float32", "int64", ">f8"])
def test_numbers_of_any_type_are_recorded_as_they_are(make_metadata, make_state, kind) -> None:
    meta, rng = make_metadata(), np.random.default_rng(0)
    builder, some = RecordBuilder(meta), np.array([1.0, 2.0, 3.0]).astype(kind)
    action = np.arange(len(meta.action_components)).astype(kind)
    rest = {"qvel": np.zeros(2), "ctrl": np.zeros(0), "predicates": (0, 0), "subgoals": (0, 0), "goal": False}
    assert builder.actions.shape == (0, len(action))
    builder.append(make_state(meta.scene, 0, rng), qpos=some, **rest)
    assert builder.actions.shape == (0, len(action))
    builder.append(make_state(meta.scene, 1, rng), qpos=some, action=action, applied=action[::-1], **rest)
    assert builder.actions.tolist() == [action.tolist()]
    record = builder.finish(termination="step_limit", success=False)
    assert record.qpos.tolist() == [[1.0, 2.0, 3.0]] * 2
    assert record.action[1].tolist() == action.tolist()
    assert record.applied[1].tolist() == action.tolist()[::-1]


def test_rows_are_those_of_the_arrays_that_were_given_whether_they_are_the_same_ones_or_others(
    make_metadata, make_state
) -> None:
    meta, rng = make_metadata(), np.random.default_rng(0)
    builder, kept, action = RecordBuilder(meta), np.zeros(3), np.zeros(7)
    wide = np.arange(12.0).reshape(6, 2)
    given = [kept, kept, wide[3:, 1], kept, np.ones(3), kept]
    due = []
    for step, qpos in enumerate(given):
        kept += 1.0
        actions = {} if step == 0 else {"action": action, "applied": action}
        builder.append(
            make_state(meta.scene, step, rng), qpos=qpos, qvel=kept, ctrl=kept,
            predicates=(0, 0), subgoals=(0, 0), goal=False, **actions,
        )  # fmt: skip
        due.append((qpos.tolist(), kept.tolist()))
    record = builder.finish(termination="step_limit", success=False)
    assert list(zip(record.qpos.tolist(), record.qvel.tolist(), strict=True)) == due


def test_metadata_and_outcome_come_back(make_record, tmp_path) -> None:
    record, _ = make_record(rows=2, termination="policy_error", error="answer took 12 s", invalid_actions=1)
    write_record(record, tmp_path / "r.parquet")
    again = read_record(tmp_path / "r.parquet")
    assert again.metadata == record.metadata
    assert again.outcome == record.outcome
    assert again.outcome.error == "answer took 12 s"


def test_any_parquet_reader_understands_the_file(make_record, tmp_path) -> None:
    record, states = make_record(rows=8)
    write_record(record, tmp_path / "r.parquet")
    rows = pq.read_table(tmp_path / "r.parquet").to_pylist()
    assert rows[3]["qpos"] == record.qpos[3].tolist()
    pairs = [(record.bodies[c["a"]], record.bodies[c["b"]], c["force"]) for c in rows[5]["contacts"]]
    assert pairs == [(c.a, c.b, c.force_n) for c in states[5].contacts]


def test_rows_count_from_both_ends(make_record) -> None:
    record, states = make_record(rows=4)
    assert record.state(-1) == states[3]
    for row in (4, -5):
        with pytest.raises(IndexError, match="4 rows"):
            record.state(row)


def test_a_second_at_20_hz_of_a_busy_scene_stays_within_60_kilobytes(make_record) -> None:
    # Random bits do not compress, so this is the worst case of 3 moving objects; a real scene has 15, mostly at rest.
    record, _ = make_record(rows=201)
    assert len(record_bytes(record)) / 10 < 60_000


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"step": 3}, "state.step: expected 1, got 3"),
        ({"qpos": np.zeros(1)}, r"qpos: has the shape \(1,\), expected \(50,\)"),
        ({"qvel": np.zeros((47, 1))}, r"qvel: has the shape \(47, 1\)"),
        ({"action": np.zeros(3)}, r"action: has the shape \(3,\), expected \(7,\)"),
        ({"applied": np.zeros((1, 7))}, r"applied: has the shape \(1, 7\), expected \(7,\)"),
        ({"applied": None}, "action: is missing in row 1, or given in row 0"),
        ({"predicates": (True,)}, "Pass 2 predicates and 2 subgoals"),
        ({"other_scene": True}, "state.info: differs from the scene"),
    ],
)
def test_a_row_that_does_not_fit_is_refused(make_metadata, make_state, changes, message) -> None:
    meta, rng = make_metadata(), np.random.default_rng(0)
    builder = RecordBuilder(meta)
    arrays = {"qpos": np.zeros(50), "qvel": np.zeros(47), "ctrl": np.zeros(8)}
    truths = {"predicates": (True, True), "subgoals": (True, True), "goal": False}
    builder.append(make_state(meta.scene, 0, rng), **arrays, **truths)
    changes = dict(changes)
    info = make_metadata(objects=2).scene if changes.pop("other_scene", False) else meta.scene
    state = make_state(info, changes.pop("step", 1), rng)
    row = {**arrays, "action": np.zeros(7), "applied": np.zeros(7), **truths, **changes}
    with pytest.raises(InvalidInputError, match=message):
        builder.append(state, **row)
    assert len(builder) == 1


def test_what_holds_may_be_told_later_but_of_every_row(make_metadata, make_state) -> None:
    meta, rng = make_metadata(), np.random.default_rng(0)
    arrays = {"qpos": np.zeros(3), "qvel": np.zeros(3), "ctrl": np.zeros(2)}
    actions = {"action": np.zeros(7), "applied": np.zeros(7)}
    truths = [{"predicates": (i, 1 - i), "subgoals": (1 - i, i), "goal": bool(i)} for i in range(2)]
    builder, at_once = RecordBuilder(meta), RecordBuilder(meta)
    states = [make_state(meta.scene, i, rng) for i in range(2)]
    for state, truth, given in zip(states, truths, ({}, actions), strict=True):
        builder.append_state(state, **arrays, **given)
        at_once.append(state, **arrays, **given, **truth)
    builder.append_truth(**truths[0])
    with pytest.raises(InvalidInputError, match="predicates, subgoals: only 1 of 2 rows have"):
        builder.finish(termination="step_limit", success=False)
    with pytest.raises(InvalidInputError, match="Pass 2 predicates and 2 subgoals"):
        builder.append_truth(predicates=(True,), subgoals=(), goal=False)
    builder.append_truth(**truths[1])
    with pytest.raises(InvalidInputError, match="all 2 rows already have their predicates and subgoals"):
        builder.append_truth(**truths[1])
    found = [b.finish(termination="step_limit", success=False) for b in (builder, at_once)]
    assert found[0].same_bits(found[1])


def test_what_cannot_be_a_record_is_refused(make_metadata, make_state) -> None:
    meta = make_metadata()
    with pytest.raises(InvalidInputError, match="record: has no rows"):
        RecordBuilder(meta).finish(termination="success", success=True)
    with pytest.raises(InvalidInputError, match=r"metadata: .*JSON compliant"):
        RecordBuilder(make_metadata(control_rate_hz=float("nan")))
    with pytest.raises(InvalidInputError, match="schema_version"):
        RecordBuilder(make_metadata(schema_version=2))
    builder = RecordBuilder(meta)
    state = dataclasses.replace(make_state(meta.scene, 0, np.random.default_rng(0)), held="nothing known")
    some = np.zeros(3)
    builder.append(state, qpos=some, qvel=some, ctrl=some, predicates=(0, 0), subgoals=(0, 0), goal=False)
    with pytest.raises(InvalidInputError, match=r"state\.held: 'nothing known' is not an object"):
        builder.finish(termination="success", success=True)
    with pytest.raises(InvalidInputError, match=r"success: is True although the episode ended by policy_error"):
        builder.finish(termination="policy_error", success=True)
    with pytest.raises(InvalidInputError, match="Use one of success, failure"):
        builder.finish(termination="boredom", success=False)


def test_a_missing_or_damaged_file_is_named(make_record, tmp_path) -> None:
    path = tmp_path / "7.parquet"
    with pytest.raises(RecordError, match=r"7\.parquet: the record does not exist"):
        read_record(path)
    good = record_bytes(make_record(rows=30)[0])
    for bad in (b"", b"not parquet", good[: len(good) // 2], good[:-4] + b"XXXX", b"PAR1" * 5):
        path.write_bytes(bad)
        with pytest.raises(
            RecordError, match=r"7\.parquet: the (file|record) is damaged .*Repeat the command of the run to record"
        ):
            read_record(path)
    with pytest.raises(RecordError, match=r"is a folder and not a file\. Use a record of a run"):
        read_record(tmp_path)


def test_a_record_that_was_cut_short_or_changed_is_to_be_copied_again(make_record, tmp_path) -> None:
    path = tmp_path / "7.parquet"
    good = record_bytes(make_record(rows=30)[0])
    for bad in (good[: len(good) // 2], good[:-1], good[:500] + bytes([good[500] ^ 255]) + good[501:]):
        for digest in (None, hashlib.sha256(good).hexdigest()):  # named by a user, or listed by a journal
            path.write_bytes(bad)
            with pytest.raises(
                RecordError, match=r"7\.parquet: the (file|record) is damaged \(.*\)\. Copy it again"
            ) as problem:
                read_record(path, digest=digest)
            assert "Use a record" not in str(problem.value)
    for bad in (b"", b"not parquet", b"PAR1" * 5):
        path.write_bytes(bad)
        with pytest.raises(RecordError, match=r"is damaged \(.*\)\. Copy it again"):
            read_record(path, digest=hashlib.sha256(good).hexdigest())


def test_flipped_bytes_never_change_a_record_unnoticed(make_record, tmp_path) -> None:
    good = record_bytes(make_record(rows=5)[0])
    rng, path = np.random.default_rng(0), tmp_path / "7.parquet"
    noticed = 0
    for _ in range(200):
        bad = bytearray(good)
        bad[rng.integers(len(bad))] ^= 1 << rng.integers(8)
        path.write_bytes(bytes(bad))
        try:
            read_record(path)
        except RecordError:
            noticed += 1
    assert noticed == 200


def rewritten(record, path, change) -> None:
    """Write a record whose JSON document was changed."""
    write_record(record, path)
    table = pq.read_table(path)
    form = json.loads(table.schema.metadata[b"betterbench"])
    change(form)
    reseal(table, path, json.dumps(form).encode())


def reseal(table, path, document: bytes | None = None) -> None:
    """Write a table with the seal of a record, as a stranger with bad intent could."""
    metadata = {**table.schema.metadata, b"betterbench.sha256": b"0" * 64}
    if document is not None:
        metadata[b"betterbench"] = document
    pq.write_table(table.replace_schema_metadata(metadata), path)
    path.write_bytes(seal(path.read_bytes()))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            lambda f: f["metadata"].update(schema_version=99),
            "schema version 99, but .* reads 1.* the version that wrote it",
        ),
        (lambda f: f["metadata"].pop("schema_version"), r"metadata\.schema_version: is missing"),
        (lambda f: f["metadata"].pop("interventions"), r"metadata\.interventions: is missing"),
        (lambda f: f["metadata"].update(task_version=True), r"metadata\.task_version: Input should be a valid integer"),
        (lambda f: f["metadata"].update(control_rate_hz=float("nan")), r"metadata\.control_rate_hz: Input should be"),
        (lambda f: f["metadata"].update(control_rate_hz=0), r"metadata\.control_rate_hz: Input should be greater"),
        (
            lambda f: f["metadata"]["engine"].update(mujoco=3),
            r"metadata\.engine\.mujoco: Input should be",
        ),
        (lambda f: f["metadata"]["scene"].update(home_position=[0.1, 0.2]), r"metadata\.scene\.home_position"),
        (lambda f: f["bodies"].append(3), r"bodies\[\d+\]: Input should be a valid string"),
        (lambda f: f["widths"].pop("nq"), "widths: are not nq"),
        (lambda f: f["metadata"].pop("seed"), "metadata: metadata.seed: is missing. Record the trial again"),
        (lambda f: f["metadata"].update(seed="7"), r"metadata\.seed: Input should be a valid integer, not '7'"),
        (lambda f: f["metadata"].update(surprise=1), r"metadata\.surprise: is unknown"),
        (lambda f: f["metadata"]["scene"].pop("objects"), r"metadata\.scene\.objects: is missing"),
        (lambda f: f.pop("outcome"), "outcome: is missing"),
        (lambda f: f["outcome"].update(success="yes"), r"outcome\.success: Input should be a valid boolean"),
        (lambda f: f["outcome"].update(termination="boredom"), "boredom"),
        (lambda f: f["bodies"].clear(), "a contact refers to a body that the record does not list"),
        (lambda f: f["widths"].update(nq=51), "the columns \\(qpos\\) do not match the metadata"),
        (lambda f: f["widths"].update(nq=-1), r"widths\.nq: Input should be greater than or equal to 0, not -1"),
        (lambda f: f["widths"].update(objects=2), r"widths\.objects: is 2, but the metadata lists 3"),
        (lambda f: f.update(metadata=[1]), r"metadata: metadata: is not a JSON object"),
    ],
)
def test_a_changed_document_is_refused(make_record, tmp_path, change, message) -> None:
    rewritten(make_record(rows=20)[0], tmp_path / "r.parquet", change)
    with pytest.raises(RecordError, match=rf"r\.parquet: .*{message}"):
        read_record(tmp_path / "r.parquet")


def test_other_parquet_files_are_refused(make_record, tmp_path) -> None:
    path = tmp_path / "r.parquet"
    pq.write_table(pa.table({"a": [1, 2]}), path)
    with pytest.raises(RecordError, match=r"is damaged or not a record\. Use a record of a run"):
        read_record(path)
    reseal(pa.table({"a": [1, 2]}, metadata={"other": "x"}), path)
    with pytest.raises(RecordError, match="is a Parquet file but not a record"):
        read_record(path)
    write_record(make_record(rows=3)[0], path)
    table = pq.read_table(path)
    reseal(table.drop_columns(["goal"]), path)
    with pytest.raises(RecordError, match="the columns \\(goal\\) do not match the metadata"):
        read_record(path)
    reseal(table.slice(0, 0), path)
    with pytest.raises(RecordError, match="has no rows"):
        read_record(path)


def test_a_file_that_unpacks_to_too_much_is_refused(make_record, tmp_path, monkeypatch) -> None:
    path = tmp_path / "r.parquet"
    write_record(make_record(rows=200)[0], path)
    monkeypatch.setattr(parquet, "MAX_UNPACKED_BYTES", 100_000)
    with pytest.raises(RecordError, match=r"r\.parquet: the file unpacks to more than 100000 bytes"):
        read_record(path)
    monkeypatch.setattr(parquet, "MAX_FILE_BYTES", 1000)
    with pytest.raises(RecordError, match="is larger than 1000 bytes"):
        read_record(path)


def test_damaged_files_with_a_fitting_seal_still_end_in_an_error_or_a_record(make_record, tmp_path) -> None:
    # A stranger can compute the seal too. Whatever the reader makes of such a file, it must not bring the process down.
    good, path = record_bytes(make_record(rows=5)[0]), tmp_path / "r.parquet"
    rng, refused = np.random.default_rng(0), 0
    for _ in range(300):
        bad = bytearray(good)
        bad[rng.integers(len(bad))] ^= 1 << rng.integers(8)
        try:
            path.write_bytes(seal(bytes(bad)))
            read_record(path)
        except RecordError:
            refused += 1
    assert 50 < refused < 300


def test_a_failed_write_leaves_the_old_file_and_no_part(make_record, tmp_path, monkeypatch) -> None:
    path = tmp_path / "r.parquet"
    old, new = make_record(rows=3)[0], make_record(rows=4)[0]
    write_record(old, path)

    def full(_: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.fsync", full)
    with pytest.raises(StorageError, match=r"r\.parquet: No space left on device.*free disk space"):
        write_record(new, path)
    assert read_record(path).same_bits(old)
    assert [p.name for p in tmp_path.iterdir()] == ["r.parquet"]
