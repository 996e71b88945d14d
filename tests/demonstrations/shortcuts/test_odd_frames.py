"""Strangers' frames that are not in order, not finite or far too large, and arms that are idle."""

from __future__ import annotations

import json
import re

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from tests.demonstrations.shortcuts.strangers import STEPS, make
from tests.looping import each

from betterbench.demonstrations.shortcuts.lerobot import Choices, read_lerobot
from betterbench.errors import InvalidInputError, RecordError


def files_of(path):
    return sorted((path / "data").rglob("*.parquet"))


def change_rows(path, change, files=None):
    """Rewrites the tables of a dataset as ``change(table)`` returns them."""
    for file in files or files_of(path):
        pq.write_table(change(pq.read_table(file)), file)


def change_numbers(path, name, change):
    """Rewrites a column (rows, width): ``change(values, episodes)`` changes it in place."""

    def apply(table):
        values = np.array(table[name].to_pylist(), dtype=np.float64)
        change(values, np.array(table["episode_index"].to_pylist()))
        column = pa.FixedSizeListArray.from_arrays(pa.array(values.ravel(), pa.float64()), values.shape[1])
        return table.set_column(table.schema.get_field_index(name), name, column)

    change_rows(path, apply)


def info_of(path, **changes):
    file = path / "meta" / "info.json"
    file.write_text(json.dumps(json.loads(file.read_text()) | changes))


def facts_by_name(read):
    return {(f.group, f.episode): f for f in read.facts}


def permuted(table):
    return table.take(np.random.default_rng(3).permutation(len(table)))


def interleaved(table):
    return table.take(np.argsort(np.tile(np.arange(STEPS), len(table) // STEPS), kind="stable"))


@each(
    "change",
    [permuted, interleaved, lambda t: t.take(np.arange(len(t))[::-1]), lambda t: t.sort_by("task_index")],
)
@each("key", ["frame_index", "timestamp"])
def test_the_order_of_the_rows_in_a_file_does_not_matter(tmp_path_factory, change, key):
    path = make(tmp_path_factory.mktemp("set") / "set", "segments", "word", count=24)
    if key == "timestamp":
        change_rows(path, lambda t: t.rename_columns([{"frame_index": key}.get(n, n) for n in t.column_names]))
    plain = read_lerobot(path)
    assert "Order of the frames" not in plain.reading.paragraph
    change_rows(path, change)
    mixed = read_lerobot(path)
    assert facts_by_name(mixed) == facts_by_name(plain)
    told = f"Order of the frames: the rows of 2 files had to be sorted, by episode_index and {key}."
    assert told in mixed.reading.paragraph


def test_without_a_column_for_the_order_it_is_that_of_the_file(tmp_path):
    path = make(tmp_path / "set", "plain", "word", count=24)
    change_rows(path, lambda t: t.drop_columns(["frame_index"]))
    plain = read_lerobot(path)
    change_rows(path, interleaved)
    mixed = read_lerobot(path)
    assert facts_by_name(mixed) == facts_by_name(plain)
    assert "by episode_index only: no column contains the order of the frames" in mixed.reading.paragraph


def test_an_episode_in_two_files_is_one_if_its_frames_differ(tmp_path):
    path = make(tmp_path / "set", "plain", "word", count=24)
    plain, (first, second) = read_lerobot(path), files_of(path)
    one, two = pq.read_table(first), pq.read_table(second)
    late = pa.compute.greater_equal(one["frame_index"], 20)
    pq.write_table(pa.concat_tables([two, one.filter(late)]), first)
    pq.write_table(one.filter(pa.compute.invert(late)), second)
    read = read_lerobot(path)
    assert facts_by_name(read) == facts_by_name(plain)
    assert "12 episodes with frames in several files had to be joined" in read.reading.paragraph
    pq.write_table(one, second)
    with pytest.raises(RecordError, match=r"file-001\.parquet: episode 0 occurs twice in the data"):
        read_lerobot(path)


def test_a_frame_that_stands_there_twice_is_refused(tmp_path):
    path = make(tmp_path / "set", "plain", "clean", count=12)
    change_rows(path, lambda t: pa.concat_tables([t, t.slice(3, 1)]), files_of(path)[:1])
    with pytest.raises(
        RecordError, match=r"episode 0 occurs twice in the data \(frame_index 3\)\. .*remove the duplicate rows"
    ):
        read_lerobot(path)


def refusal(path, choices=None):
    with pytest.raises(InvalidInputError) as refused:
        read_lerobot(path, choices)
    return str(refused.value)


@each("layout, last", [("humanoid with hands", 27), ("no names", 3)], lambda layout, _: layout)
def test_the_advice_about_a_gripper_guesses_no_number(tmp_path_factory, layout, last):
    said = refusal(make(tmp_path_factory.mktemp("set") / "set", layout, "clean", count=12))
    assert f"--gripper 'action[N]', where N is the index of the component that closes the gripper (0 to {last})" in said
    assert not re.search(r"--(gripper|place) '?(action|observation\.state)(\[\d|:[a-z])", said)


def test_numbers_that_may_be_the_gripper_are_listed_and_none_is_advised(tmp_path):
    path = make(tmp_path / "set", "plain", "clean", count=12)
    feature = {"dtype": "float32", "shape": [4], "names": ["gripper", "x", "y", "gripper"]}
    info = json.loads((path / "meta" / "info.json").read_text())
    info_of(path, features=info["features"] | {"action": feature})
    said = refusal(path)
    assert "gripper (0), gripper (3)" in said
    assert "--gripper 'action[N]', where N is its index in brackets" in said
    assert "action[N], where N is one of 0, 3" in refusal(path, Choices(grippers=("action:gripper",)))
    assert "as COLUMN[N], where N is its index (0, 1, 2, 3)" in refusal(path, Choices(grippers=("action",)))
    assert "action[ ] has 0 components. Write an index" in refusal(path, Choices(grippers=("action[ ]",)))


def test_the_advice_about_places_lists_numbers_of_that_arm(tmp_path):
    path = make(tmp_path / "set", "two arms, interleaved", "clean", count=12)
    info = json.loads((path / "meta" / "info.json").read_text())
    state = info["features"]["observation.state"]
    names = ["left_x", "right_wrist", "left_y", "right_x", "left_z", "a", "left_gripper", "right_gripper"]
    info_of(path, features=info["features"] | {"observation.state": state | {"names": names}})
    said = refusal(path, Choices(grippers=("action:right_gripper",)))
    assert "no component has a name for the position of the right arm" in said
    assert "observation.state has observation.state:right_wrist, observation.state:right_x" in said
    assert "left" not in said
    assert "--place 'COLUMN[0,1,2]', with your column and the indices of x, y and z, counted from 0" in said


@each("layout", ["ALOHA", "two arms, interleaved", "two arms, nested", "humanoid"])
@each("side", ["left", "right"])
def test_a_named_gripper_keeps_the_place_of_its_arm(tmp_path_factory, layout, side):
    path = make(tmp_path_factory.mktemp("set") / "set", layout, "word", count=24)
    usual = read_lerobot(path)
    name = next(g.source.split()[0] for g in usual.reading.grippers if g.arm == side)
    read = read_lerobot(path, Choices(grippers=(name,)))
    assert [g.arm for g in read.reading.grippers] == [side]
    assert read.reading.places == tuple(p for p in usual.reading.places if p.arm == side)
    assert [f.steps for f in read.facts] == [f.steps for f in usual.facts if f.group.endswith(f"{side} arm")]


def noisy_arm(path, noise, column=13):
    """Puts numbers (rows,) in the place of the right gripper of the layout ALOHA."""

    def change(values, episodes):
        values[:, column] = noise(np.random.default_rng(5), episodes)

    change_numbers(path, "action", change)


IDLE = {
    "normal": lambda draw, e: draw.normal(0, 0.008, len(e)),
    "even": lambda draw, e: draw.uniform(-0.02, 0.02, len(e)),
    "two steps of a sensor": lambda draw, e: draw.choice([0.0, 0.02], len(e)),
    "an offset by episode": lambda draw, e: draw.choice([0.0, 0.05], e.max() + 1)[e],
    "constant": lambda _, e: np.zeros(len(e)),
}


@each("kind", IDLE)
def test_the_gripper_of_an_idle_arm_is_left_out(tmp_path_factory, kind):
    path = make(tmp_path_factory.mktemp("set") / "set", "ALOHA", "word", count=40)
    noisy_arm(path, IDLE[kind])
    read = read_lerobot(path)
    assert [g.arm for g in read.reading.grippers] == ["left"]
    assert {f.group for f in read.facts} == {"LeRobot dataset set, left arm"}
    (told,) = read.reading.left_out
    assert re.match(r"the gripper action:right_gripper, which never moves \(range \S+ to \S+", told)
    assert ("under 10 % of that of action:left_gripper" in told) == (kind != "constant")


def test_a_small_gripper_that_is_held_at_two_ends_is_no_idle_one(tmp_path):
    path = make(tmp_path / "set", "ALOHA", "word", count=40)
    change_numbers(path, "action", lambda values, _: values.__setitem__((..., 13), 0.08 * values[:, 13]))
    assert [g.arm for g in read_lerobot(path).reading.grippers] == ["left", "right"]


def test_an_arm_is_idle_beside_a_gripper_in_meters_too(tmp_path):
    path = make(tmp_path / "set", "ALOHA", "word", count=40)
    change_numbers(path, "action", lambda values, _: values.__setitem__((..., 6), 0.08 * values[:, 6]))
    noisy_arm(path, lambda draw, e: draw.normal(0.04, 0.001, len(e)))
    assert "which never moves (range 0.03" in read_lerobot(path).reading.paragraph
    noisy_arm(path, lambda draw, e: draw.uniform(-0.02, 0.02, len(e)))
    told = r"never moves \(range -0.0\d+ to 0.0\d+, smaller than that of action:left_gripper, and it alternates"
    assert re.search(told, read_lerobot(path).reading.paragraph)


@each("value, reason", [
    (float("nan"), "a number that is not finite"),
    (float("inf"), "a number that is not finite"),
    (-3e38, "a number with an absolute value above 1,000,000"),
    (1.1e6, "a number with an absolute value above 1,000,000"),
], lambda value, _: value)  # fmt: skip
@each("name", ["action", "observation.state"])
def test_an_episode_with_a_number_that_cannot_be_used_is_left_out(tmp_path_factory, name, value, reason):
    path = make(tmp_path_factory.mktemp("set") / "set", "no names", "word", count=24)
    chosen = Choices(grippers=("action[3]",), places=("observation.state[0,1,2]",))
    plain = facts_by_name(read_lerobot(path, chosen))
    change_numbers(
        path, name, lambda v, e: v.__setitem__((np.flatnonzero(e == 12)[5:6], 3 if name == "action" else 1), value)
    )
    read = read_lerobot(path, chosen)
    assert {f.episode for f in read.facts} == {episode for _, episode in plain} - {"episode 12"}
    assert (read.reading.episodes, read.reading.of) == (23, 24)
    assert f"Left out: 1 episode with {reason} (in {name}): episode 12." in read.reading.paragraph
    change_numbers(path, name, lambda v, e: v.__setitem__((e < 12, slice(None)), value))
    said = refusal(path, chosen)
    assert f"13 of 24 episodes cannot be used: episode 0 has {reason} (in {name})" in said
    assert "Choose other columns with --gripper, --place or --instruction, or correct these numbers" in said


def test_numbers_that_are_not_read_may_be_anything(tmp_path):
    path = make(tmp_path / "set", "plain", "word", count=24)
    change_numbers(path, "action", lambda values, _: values.__setitem__((..., 0), np.nan))
    assert read_lerobot(path).reading.left_out == ()


@each("name", ["task_index", "frame_index"])
def test_an_episode_without_number_of_task_or_frame_is_left_out(tmp_path_factory, name):
    path = make(tmp_path_factory.mktemp("set") / "set", "plain", "word", count=24)

    def change(table):
        values = table[name].to_pylist()
        values[45] = None
        return table.set_column(table.schema.get_field_index(name), name, pa.array(values))

    change_rows(path, change, files_of(path)[1:])
    told = "1 episode with a number that is not finite (in task_index or the order of the frames): episode 13"
    assert read_lerobot(path).reading.left_out == (told,)


@each("fps, told", [
    (None, "is missing"), (0, "is 0,"), ("10", "is '10',"), (float("nan"), "is nan,"), (True, "is True,"),
    (-5, "is -5,"), (10**400, "is 1000"),
], lambda fps, _: repr(fps))  # fmt: skip
def test_a_rate_that_is_assumed_is_told(tmp_path_factory, fps, told):
    path = make(tmp_path_factory.mktemp("set") / "set", "plain", "word", count=12)
    plain = read_lerobot(path)
    info_of(path, fps=fps)
    read = read_lerobot(path)
    assert read.facts == plain.facts
    assert f"Warning: fps in meta/info.json {told}" in read.reading.paragraph
    assert "; 10 frames per second were assumed." in read.reading.paragraph


def test_a_number_with_too_many_digits_is_one_line_without_advice_about_python(tmp_path):
    path = make(tmp_path / "set", "pretty JSON, width", "clean", count=12)
    tasks, info = path / "meta" / "tasks.jsonl", path / "meta" / "info.json"
    kept = tasks.read_text()
    tasks.write_text(f'{{"task_index": {"9" * 5000}, "task": "a"}}')
    with pytest.raises(RecordError, match=r"an integer of more than 4,300 digits"):
        read_lerobot(path)
    tasks.write_text(kept)
    info.write_text(info.read_text().replace('"total_episodes": 12', f'"total_episodes": {"9" * 5000}'))
    said = refusal(path)
    assert said.endswith("it contains an integer of more than 4,300 digits. Correct this number.")


@each("text", ["action[" + "9" * 5000 + "]", "action[4]"])
def test_a_number_that_there_is_not_is_one_short_line(tmp_path_factory, text):
    path = make(tmp_path_factory.mktemp("set") / "set", "plain", "clean", count=12)
    said = refusal(path, Choices(grippers=(text,)))
    assert "action has 4 components, so " in said
    assert len(said) < 200


def test_one_episode_is_no_plural(tmp_path):
    path = make(tmp_path / "set", "plain", "clean", count=2)
    change_rows(path, lambda t: t.slice(0, 1), files_of(path)[:1])
    paragraph = read_lerobot(path).reading.paragraph
    assert paragraph.startswith("Read: 1 of 2 episodes.")
    assert "Left out: 1 episode of fewer than two frames." in paragraph
    info_of(path, total_episodes=1)
    assert "meta/info.json says 1 episode, but the files have 2." in read_lerobot(path).reading.paragraph
