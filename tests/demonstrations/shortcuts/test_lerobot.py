"""A stranger's dataset: the planted confound is found and nothing else, whatever its version and columns."""

from __future__ import annotations

import json

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from tests.daily import others_slow
from tests.looping import each

from betterbench.cli.main import main
from betterbench.demonstrations.shortcuts.examine import audit_dataset
from betterbench.demonstrations.shortcuts.lerobot import facts_of_lerobot, read_lerobot
from betterbench.errors import BetterError, InvalidInputError, RecordError

CUPS, VERBS, TARGETS = ("red", "blue"), ("put", "move"), ("box", "tray")
STEPS = 40


def made_up(
    path, *, version="v3.0", planted=True, names=("x", "y", "z", "gripper"), joints=False, episodes=120, blips=False
):
    """Write a dataset in which the cup's color goes with where it is picked, if that is planted, and nothing else."""
    draw = np.random.default_rng(7)
    texts = [f"{verb} the {cup} cup into the {target}" for cup in CUPS for verb in VERBS for target in TARGETS]
    rows = {"episode_index": [], "frame_index": [], "task_index": [], "observation.state": [], "action": []}
    mix = draw.normal(size=(3, 6)) if joints else None
    for episode in range(episodes):
        task = int(draw.integers(len(texts)))
        red = texts[task].split()[2] == "red"
        left = red if planted else bool(draw.integers(2))
        pick = np.array([0.4, 0.2 if left else -0.2, 0.1]) + draw.normal(0, 0.01, 3)
        drop = np.array([0.6, 0.3 if draw.integers(2) else -0.3, 0.1]) + draw.normal(0, 0.01, 3)
        home = np.array([0.5, 0.0, 0.3])
        about = home + 0.1 * np.array([*np.eye(2)[draw.integers(2)] * draw.choice([-1, 1]), 0.0])  # sets out anywhere
        way = np.concatenate(
            [np.linspace(a, b, 10) for a, b in ((home, about), (about, pick), (pick, drop))] + [[drop] * 10]
        )
        closed = np.r_[np.zeros(20), np.ones(10), np.zeros(10)]
        if blips:
            at = int(draw.integers(1, 18))
            closed[[at, at + 1]] = 1.0
            closed[[24, 25]] = 0.0
        state = np.column_stack([way @ mix, closed]) if joints else np.column_stack([way, closed])
        rows["episode_index"] += [episode] * STEPS
        rows["frame_index"] += list(range(STEPS))
        rows["task_index"] += [task] * STEPS
        rows["observation.state"] += state.astype(np.float32).tolist()
        rows["action"] += np.column_stack([np.gradient(way, axis=0), closed]).astype(np.float32).tolist()
    size = len(rows["observation.state"][0])
    features = {
        "observation.state": {"dtype": "float32", "shape": [size], "names": None if joints else list(names)},
        "action": {"dtype": "float32", "shape": [4], "names": ["dx", "dy", "dz", "gripper"]},
        "observation.images.top": {"dtype": "video", "shape": [64, 64, 3], "names": None},
    }
    (path / "meta").mkdir(parents=True)
    info = {"codebase_version": version, "fps": 10, "total_episodes": episodes, "features": features}
    (path / "meta" / "info.json").write_text(json.dumps(info))
    table = pa.table(rows)
    if version.startswith("v3"):
        index = pa.table({"task_index": list(range(len(texts))), "__index_level_0__": texts})
        pq.write_table(index, path / "meta" / "tasks.parquet")
        file = path / "data" / "chunk-000" / "file-000.parquet"
        file.parent.mkdir(parents=True)
        pq.write_table(table, file)
    else:
        lines = (json.dumps({"task_index": i, "task": text}) for i, text in enumerate(texts))
        (path / "meta" / "tasks.jsonl").write_text("\n".join(lines) + "\n")
        for episode in range(episodes):
            file = path / "data" / "chunk-000" / f"episode_{episode:06d}.parquet"
            file.parent.mkdir(parents=True, exist_ok=True)
            pq.write_table(table.slice(episode * STEPS, STEPS), file)
    return path


@pytest.mark.parametrize(("version", "joints"), others_slow([("v3.0", False), ("v2.1", False), ("v3.0", True)], 3))
def test_the_planted_confound_is_found_and_nothing_else(tmp_path, version, joints):
    found = audit_dataset("made up", facts_of_lerobot(made_up(tmp_path / "set", version=version, joints=joints)))
    (group,) = found.groups
    assert group.episodes == 120
    assert {(f.question, f.subject) for f in group.shortcuts} == {
        ("words_first_place", "blue"),
        ("words_first_place", "red"),
    }
    assert all(f.strength > 0.95 and f.p_adjusted < 0.01 for f in group.shortcuts)


def test_a_gripper_that_flickers_on_the_way_grasps_nothing(tmp_path):
    plain, flickering = (
        audit_dataset("made up", facts_of_lerobot(made_up(tmp_path / n / "set", blips=blips)))
        for n, blips in (("plain", False), ("flickering", True))
    )
    told = [[(f.subject, f.rules) for f in audit.groups[0].shortcuts] for audit in (plain, flickering)]
    assert len(told[0]) == 2
    assert {subject for subject, _ in told[0]} == {subject for subject, _ in told[1]}


@pytest.mark.parametrize("version", ["v1.6", "v4.0", "", 3])
def test_a_version_that_is_not_read_is_one_clear_line(tmp_path, version):
    path = made_up(tmp_path / "set", episodes=12)
    info = json.loads((path / "meta" / "info.json").read_text())
    (path / "meta" / "info.json").write_text(json.dumps({**info, "codebase_version": version}))
    with pytest.raises(InvalidInputError, match=r"codebase_version is .* only 2\.0 to 3\.0 are supported"):
        facts_of_lerobot(path)


def test_one_instruction_tells_nothing_about_words(tmp_path, capsys):
    path = made_up(tmp_path / "set", episodes=12)
    table = pq.read_table(path / "meta" / "tasks.parquet")
    one = table.set_column(1, "__index_level_0__", pa.array(["tidy up"] * len(table)))
    pq.write_table(one, path / "meta" / "tasks.parquet")
    assert main(["shortcuts", str(path)]) == 0
    assert "has only one instruction, so it cannot show whether a policy follows instructions" in " ".join(
        capsys.readouterr().err.split()
    )


def test_nothing_is_found_where_nothing_is_planted(tmp_path):
    found = audit_dataset("made up", facts_of_lerobot(made_up(tmp_path / "set", planted=False)))
    assert found.groups[0].shortcuts == ()
    outcomes = {"words_first_place", "words_last_place", "words_heading"}
    assert {f.question for f in found.groups[0].findings} == outcomes | {f"{name}_whole" for name in outcomes}


def test_names_in_a_list_of_their_own_are_names_too(tmp_path):
    plain, nested = (facts_of_lerobot(made_up(tmp_path / n, names=names)) for n, names in (
        ("set", ("x", "y", "z", "gripper")), ("nested/set", (["x", "y", "z", "gripper"],)),
    ))  # fmt: skip
    assert nested == plain


def test_episodes_that_are_missing_or_stand_there_twice_are_told(tmp_path):
    path = made_up(tmp_path / "set", version="v2.1", episodes=12)
    first, last = (path / "data" / "chunk-000" / f"episode_{number:06d}.parquet" for number in (0, 11))
    kept = last.read_bytes()
    last.unlink()
    reading = read_lerobot(path).reading
    assert (reading.episodes, reading.of) == (11, 12)
    assert reading.left_out == ("1 episode whose frames are not in the folder",)
    last.write_bytes(first.read_bytes())
    with pytest.raises(RecordError, match=r"episode_000011\.parquet: episode 0 occurs twice in the data"):
        facts_of_lerobot(path)
    last.write_bytes(kept)
    assert len(facts_of_lerobot(path)) == 12
    info = json.loads((path / "meta" / "info.json").read_text())
    for total, of, told in (
        (10**6, 10**6, "left out: 999,988 episodes"),
        (5, 12, "says 5 episodes, but the files have"),
    ):
        (path / "meta" / "info.json").write_text(json.dumps({**info, "total_episodes": total}))
        reading = read_lerobot(path).reading
        assert (reading.episodes, reading.of) == (12, of)
        assert told in reading.paragraph.replace("Left", "left")
    for total in (10**400, -3, "many", True, 2.5):
        (path / "meta" / "info.json").write_text(json.dumps({**info, "total_episodes": total}))
        assert "is not a count" in read_lerobot(path).reading.paragraph


def test_instructions_that_cannot_be_read_are_one_clear_line(tmp_path):
    old = made_up(tmp_path / "old", version="v2.1", episodes=8)
    with (old / "meta" / "tasks.jsonl").open("a") as file:
        file.write('{"task_index": 1e400, "task": 3}\n')
    with pytest.raises(RecordError, match=r"tasks\.jsonl: the instructions cannot be read \(.*infinity"):
        facts_of_lerobot(old)
    new = made_up(tmp_path / "new", episodes=8)
    pq.write_table(pa.table({"task_index": [0, 1]}), new / "meta" / "tasks.parquet")
    with pytest.raises(RecordError, match=r"tasks\.parquet: the instructions cannot be read \(it has no column"):
        facts_of_lerobot(new)


def test_the_command_writes_what_it_found(tmp_path, capsys):
    made_up(tmp_path / "set")
    assert main(["shortcuts", str(tmp_path / "set"), "--out", str(tmp_path / "audit")]) == 0
    assert "2 shortcuts in 120 demonstrations" in capsys.readouterr().out
    form = json.loads((tmp_path / "audit" / "shortcuts.json").read_text())
    assert form["groups"][0]["group"] == "LeRobot dataset set"
    assert "with “red”, first taken from (0.40, 0.20) | none" in (tmp_path / "audit" / "shortcuts.md").read_text()
    assert not (tmp_path / "audit" / "prediction.json").exists()


def test_what_cannot_be_read_is_one_clear_line(tmp_path):
    with pytest.raises(InvalidInputError, match=r"info\.json.*Use the folder of a LeRobot dataset"):
        facts_of_lerobot(tmp_path)
    path = made_up(tmp_path / "set", episodes=20)
    file = path / "data" / "chunk-000" / "file-000.parquet"
    file.write_bytes(file.read_bytes()[:1000])
    with pytest.raises(RecordError, match=r"file-000\.parquet: it cannot be read"):
        facts_of_lerobot(path)
    file.unlink()
    with pytest.raises(InvalidInputError, match="it contains no episode"):
        facts_of_lerobot(path)
    info = json.loads((path / "meta" / "info.json").read_text())
    del info["features"]["observation.state"]
    (path / "meta" / "info.json").write_text(json.dumps(info))
    with pytest.raises(InvalidInputError, match="no proprioception"):
        facts_of_lerobot(path)
    (path / "meta" / "info.json").write_bytes(b"[" * 100_000)
    with pytest.raises(InvalidInputError, match=r"info\.json: is not JSON \(it is nested too deep\)"):
        facts_of_lerobot(path)
    assert main(["shortcuts", str(tmp_path / "nothing")]) == 2


def changed(name, change):
    """Returns a table in which one column has other values."""

    def apply(table):
        values = pa.array(change(table.column(name).to_pylist()))
        return table.set_column(table.schema.get_field_index(name), name, values)

    return apply


@each(
    "change, said",
    [
        (lambda t: t.drop_columns(["action"]), "has no column action"),
        (lambda t: t.drop_columns(["task_index"]), "has no column task_index"),
        (changed("action", lambda v: [[float("nan")] * 4] * len(v)), r"not finite \(in action\)"),
        (
            changed("observation.state", lambda v: [[0.0, 0.0, float("inf"), 0.0]] * len(v)),
            r"\(in observation\.state\)",
        ),
        (changed("task_index", lambda v: [None] * len(v)), r"not finite \(in task_index"),
        (changed("episode_index", lambda v: [None, *v[1:]]), "the value of episode_index is not finite in row 0"),
        (changed("action", lambda v: [x[:1] for x in v]), "does not have 4 numbers in each row"),
        (changed("observation.state", lambda v: [x[0] for x in v]), "800 numbers in 800 rows, expected 4"),
        (changed("action", lambda v: [[*v[0], *v[1][:2]], v[1][2:], *v[2:]]), "does not have 4 numbers in each row"),
        (changed("action", lambda v: ["a"] * len(v)), "it cannot be read"),
        (lambda t: t.slice(0, 0), "it contains no episode"),
        (lambda t: t.filter(pa.array(np.arange(len(t)) % STEPS == 0)), "it contains no episode"),
    ],
    lambda _, said: said,
)
def test_columns_that_are_missing_or_hold_no_numbers_are_one_clear_line(tmp_path_factory, change, said):
    path = made_up(tmp_path_factory.mktemp("set") / "set", episodes=20)
    file = path / "data" / "chunk-000" / "file-000.parquet"
    pq.write_table(change(pq.read_table(file)), file)
    with pytest.raises(BetterError, match=said):
        facts_of_lerobot(path)


def test_features_that_say_something_else_than_the_data_are_one_clear_line(tmp_path):
    path = made_up(tmp_path / "set", episodes=20)
    file = path / "meta" / "info.json"
    known = json.loads(file.read_text())
    for change, said in (
        ({"shape": [10**7]}, "no proprioception"),
        ({"shape": [400]}, "not have 400 numbers in each row"),
        ({"names": ["grip"] * 4}, "belong to the gripper"),
    ):
        features = {**known["features"], "observation.state": {**known["features"]["observation.state"], **change}}
        file.write_text(json.dumps({**known, "features": features}))
        with pytest.raises(BetterError, match=said):
            facts_of_lerobot(path)
