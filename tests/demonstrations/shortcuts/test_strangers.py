"""Strangers' datasets are read rightly or refused; planted shortcuts are found in all that are read, and no others."""

from __future__ import annotations

import json
import os
import re
from collections import Counter

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from tests.daily import TODAY, part_of_today
from tests.demonstrations.shortcuts.strangers import LAYOUTS, PLANTED, POINTER, STEPS, make
from tests.looping import each

from betterbench.cli.main import main
from betterbench.demonstrations.shortcuts import lerobot, lerobot_files
from betterbench.demonstrations.shortcuts.examine import audit_dataset
from betterbench.demonstrations.shortcuts.facts import EpisodeFacts, ShownStep
from betterbench.demonstrations.shortcuts.lerobot import Choices, read_lerobot
from betterbench.demonstrations.shortcuts.words import instruction_words, shown_as
from betterbench.errors import BetterError, InvalidInputError, RecordError, UnknownNameError


def command(path, name, capsys, *more):
    """Runs the command on a dataset of a layout, and returns its JSON form."""
    assert main(["shortcuts", str(path), *LAYOUTS[name].options, *more, "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def shortcuts(form):
    return [
        (group["group"], finding["question"], finding["subject"])
        for group in form["groups"]
        for finding in group["findings"]
        if finding["verdict"] == "shortcut"
    ]


@pytest.mark.usefixtures("only_findings")
@pytest.mark.parametrize("name", part_of_today([*LAYOUTS], 3))
def test_planted_shortcuts_are_found_and_no_others(tmp_path, capsys, name):
    """Every third layout with one kind of rule; nine days cover all layouts with all kinds."""
    find_planted(tmp_path, capsys, name, part_of_today(PLANTED, 3, day=TODAY // 3 + [*LAYOUTS].index(name) // 3))


@pytest.mark.usefixtures("only_findings")
@pytest.mark.slow
@pytest.mark.parametrize("name", LAYOUTS)
def test_planted_shortcuts_of_all_kinds_are_found_in_every_layout(tmp_path, capsys, name):
    find_planted(tmp_path, capsys, name, PLANTED)


def find_planted(tmp_path, capsys, name, kinds):
    layout = LAYOUTS[name]
    for planted in kinds:
        path = make(tmp_path / planted / "set", name, planted, count=96)
        if layout.refused:
            with pytest.raises(BetterError, match=layout.refused):
                read_lerobot(path)
        form = command(path, name, capsys)
        found = shortcuts(form)
        assert next(iter(form)) == "read"
        if planted == "clean":
            assert found == []
            continue
        first = f"LeRobot dataset set{', left arm' if len(layout.arms) > 1 else ''}"
        question = "words_first_place" + ("_together" if planted == "pair" else "")
        assert {(group, asked) for group, asked, _ in found} == {(first, question)}
        for words in layout.words:
            colors = [
                min(instruction_words(color), key=len) if color.isascii() else color[0] for color in words["colors"]
            ]
            colors = ["แดง", "เงิน"] if "สีแดง" in words["colors"] else colors
            for color in colors:
                about = [subject for _, _, subject in found if color in subject]
                assert about, (planted, color)
                assert all((" + " in subject) == (planted == "pair") for subject in about)


def test_every_audit_begins_with_how_the_data_were_read(tmp_path, capsys):
    path = make(tmp_path / "set", "sometimes never closed", "word")
    assert main(["shortcuts", str(path), "--out", str(tmp_path / "out")]) == 0
    told = " ".join(capsys.readouterr().out.split())
    paragraph = (
        "Read: 160 of 160 episodes. Instruction: __index_level_0__ (the index of pandas) in meta/tasks.parquet, by "
        "task_index of the frames, 16 different. Gripper: action:gripper (by names in meta/info.json); 0 to 1, closed "
        "at the high end (100 % of the episodes begin open), closed in 27 % of the frames. Places: "
        "observation.state:x, observation.state:y, observation.state:z (by names in meta/info.json). Left out: "
        "nothing. Warning: the gripper never closes in 16 of 160 episodes."
    )
    assert told.startswith(paragraph)
    form = json.loads((tmp_path / "out" / "shortcuts.json").read_text())
    assert form["read"] == paragraph
    assert form["reading"]["grippers"][0]["never"] == 16
    assert form["reading"]["grippers"][0]["closed"] == "high"
    page = (tmp_path / "out" / "shortcuts.md").read_text()
    assert page.split("\n\n")[1].replace("\\", "") == paragraph


@each("name", ["ALOHA", "two arms, interleaved", "two arms, nested", "humanoid"])
def test_the_place_of_an_arm_is_that_of_its_own_gripper(tmp_path_factory, name):
    read = read_lerobot(make(tmp_path_factory.mktemp("set") / "set", name, "word", count=24))
    for gripper, place in zip(read.reading.grippers, read.reading.places, strict=True):
        assert gripper.arm == place.arm
        assert place.arm in gripper.source.partition("(")[0]
        other = {"left": "right", "right": "left"}[place.arm]
        assert other not in place.source
        assert "waist_" not in place.source.replace("left_waist ", "").replace("right_waist ", "")


@pytest.mark.usefixtures("only_findings")
def test_the_arm_that_acts_first_is_asked_about(tmp_path):
    path = make(tmp_path / "set", "two arms, interleaved", "clean", count=80)
    file = path / "data" / "chunk-000" / "file-000.parquet"
    later = path / "data" / "chunk-000" / "file-001.parquet"
    texts = pq.read_table(path / "meta" / "tasks.parquet")["__index_level_0__"].to_pylist()
    for data in (file, later):
        table = pq.read_table(data)
        vectors = np.array(table["action"].to_pylist())
        red = np.array(["red" in texts[i] for i in table["task_index"].to_pylist()])
        vectors[red, 6:] = vectors[red, 6:][:, ::-1]  # the left gripper does in these what the right one does
        column = pa.FixedSizeListArray.from_arrays(pa.array(vectors.ravel()), vectors.shape[1])
        pq.write_table(table.set_column(table.schema.get_field_index("action"), "action", column), data)
    read = read_lerobot(path)
    found = audit_dataset("set", read.facts, read.reading)
    arms = next(group for group in found.groups if group.group == "LeRobot dataset set")
    assert {(f.question, f.subject) for f in arms.shortcuts} == {("words_arm", "red"), ("words_arm", "blue")}


def test_segments_are_compared_and_not_episodes(tmp_path):
    read = read_lerobot(make(tmp_path / "set", "segments", "word", count=20))
    assert (
        "20 of 20 episodes, compared as 30 segments, because the instruction changes within 10"
        in read.reading.paragraph
    )
    assert [f.episode for f in read.facts[:3]] == ["episode 0, from frame 0", "episode 0, from frame 6", "episode 1"]
    assert not read.facts[0].steps
    assert read.facts[1].steps[0].origin


def test_of_many_episodes_each_instruction_keeps_its_share(tmp_path, monkeypatch):
    """Two instructions in turn: to take every second episode would drop one of them."""
    path = make(tmp_path / "set", "plain", "clean", count=120)
    file = path / "meta" / "tasks.parquet"
    texts = ["put the red mug away"] * 8 + ["put the blue mug away"] * 8
    for number, data in enumerate(sorted((path / "data").rglob("*.parquet"))):
        table = pq.read_table(data)
        turn = [8 * ((row // STEPS + number) % 2) for row in range(len(table))]
        pq.write_table(table.set_column(table.schema.get_field_index("task_index"), "task_index", pa.array(turn)), data)
    pq.write_table(pa.table({"task_index": list(range(16)), "task": texts}), file)
    monkeypatch.setattr(lerobot, "MOST_EPISODES", 40)
    first, again, other = (read_lerobot(path, Choices(seed=seed)) for seed in (0, 0, 1))
    assert Counter(f.instruction for f in first.facts) == {texts[0]: 20, texts[8]: 20}
    assert first.facts == again.facts
    assert {f.episode for f in first.facts} != {f.episode for f in other.facts}
    assert "80 episodes that were not drawn (each instruction in proportion, seed 0)" in first.reading.paragraph
    assert (first.reading.episodes, first.reading.of) == (40, 120)


@each("file", ["meta/info.json", "meta/tasks.jsonl", "meta/modality.json", "data/chunk-000/episode_000000.parquet"])
def test_pointers_of_git_lfs_are_named(tmp_path_factory, file):
    path = make(tmp_path_factory.mktemp("set") / "set", "modality.json", "clean", count=12)
    (path / file).write_bytes(POINTER)
    if file.startswith("data"):
        reading = read_lerobot(path).reading
        assert (reading.episodes, reading.of) == (11, 12)
        assert "1 Git LFS pointer instead of files" in reading.paragraph
        for data in (path / "data").rglob("*.parquet"):
            data.write_bytes(POINTER)
    with pytest.raises(BetterError, match=rf"{file.rpartition('/')[2]}.*a Git LFS pointer.*git lfs pull"):
        read_lerobot(path)


@each(
    "choices, wanted",
    [
        (Choices(grippers=("action:griper",)), "Unknown component of action 'griper'. Did you mean 'gripper'"),
        (Choices(grippers=("acton[3]",)), "Unknown column in --gripper 'acton'. Did you mean 'action'"),
        (Choices(grippers=("action[9]",)), "action has 4 components, so 9 does not exist"),
        (Choices(grippers=("action",)), "action has 4 components. Choose one of them"),
        (
            Choices(places=("observation.state:x",)),
            "the number of components (1) does not fit the number of grippers (1)",
        ),
        (Choices(places=("+action:dx", "observation.state:y")), "only some components have the prefix +"),
        (Choices(instruction="langage_instruction"), "Did you mean 'language_instruction'"),
    ],
    lambda _, wanted: wanted,
)
def test_a_wrong_option_is_answered_with_the_closest_name(tmp_path_factory, choices, wanted):
    path = make(tmp_path_factory.mktemp("set") / "set", "texts by frame", "clean", count=12)
    with pytest.raises((InvalidInputError, UnknownNameError), match=re.escape(wanted)):
        read_lerobot(path, choices)


def test_steps_can_be_added_up(tmp_path):
    path = make(tmp_path / "set", "plain", "word")
    read = read_lerobot(path, Choices(places=("+action:dx", "+action:dy")))
    assert "added up from the start of each episode (by --place)" in read.reading.paragraph
    assert {f.subject for f in audit_dataset("set", read.facts).groups[0].shortcuts} == {"red", "blue"}


def test_options_of_a_run_are_refused(tmp_path, capsys):
    (tmp_path / "run.json").write_text("{}")
    assert main(["shortcuts", str(tmp_path), "--gripper", "action[3]"]) == 2
    assert "--gripper: this option applies only to LeRobot datasets" in " ".join(capsys.readouterr().err.split())


def info_of(path, **changes):
    file = path / "meta" / "info.json"
    info = json.loads(file.read_text())
    info["features"] |= changes
    file.write_text(json.dumps(info))


@pytest.mark.parametrize(
    ("names", "said"),
    [
        (["x", "y", "z", "gripper", "x", "y", "z", "gripper"], "2 components of action are named like a gripper"),
        (["left_gripper", "gripper", "x", "y", "z", "a", "b", "c"], "only some grippers name their arm"),
        (["x", "x", "y", "gripper", "a", "b", "c", "d"], "2 components have the name x"),
        (
            ["left_x", "left_y", "right_x", "right_y", "gripper", "a", "b", "c"],
            "no component has a name for the position of the gripper",
        ),
        (["j1", "j2", "j3", "j4", "j5", "j6", "waist_yaw", "thumb"], "no component has the name of a gripper"),
        ([f"motor_{i}" for i in range(8)], "no component has the name of a gripper; action was searched first"),
    ],
)
def test_names_that_do_not_tell_are_refused(tmp_path, names, said):
    path = make(tmp_path / "set", "plain", "clean", count=12)
    feature = {"dtype": "float32", "shape": [8], "names": names}
    info_of(path, **{"observation.state": feature, "action": feature})
    with pytest.raises(InvalidInputError, match=said):
        read_lerobot(path)


@each(
    "change, said",
    [
        (
            lambda t: pa.array([[("a", 1.0)]] * t.num_rows, pa.map_(pa.string(), pa.float64())),
            "it contains map<string, double",
        ),
        (lambda t: pa.array([{"a": 1.0}] * t.num_rows), "struct<a: double> instead of numbers"),
        (lambda t: pa.array([[[1.0]] * 4] * t.num_rows), "it contains list<.*> instead of numbers"),
        (lambda t: pa.array([None] * t.num_rows, pa.list_(pa.float32())), "does not have 4 numbers in each row"),
    ],
    lambda _, said: said,
)
def test_columns_of_another_kind_are_one_clear_line(tmp_path_factory, change, said):
    path = make(tmp_path_factory.mktemp("set") / "set", "plain", "clean", count=12)
    file = path / "data" / "chunk-000" / "file-000.parquet"
    table = pq.read_table(file)
    pq.write_table(table.set_column(table.schema.get_field_index("action"), "action", change(table)), file)
    with pytest.raises(RecordError, match=said):
        read_lerobot(path)


@each("file", ["meta/info.json", "meta/tasks.parquet", "meta/modality.json", "data/chunk-000/file-000.parquet"])
def test_a_pipe_in_the_place_of_a_file_is_not_waited_for(tmp_path_factory, file):
    path = make(tmp_path_factory.mktemp("set") / "set", "plain", "clean", count=12)
    (path / file).unlink(missing_ok=True)
    os.mkfifo(path / file)
    with pytest.raises(BetterError, match=r"regular file|no LeRobot dataset"):
        read_lerobot(path)


def test_a_file_that_holds_more_than_is_read_is_one_clear_line(tmp_path, monkeypatch):
    path = make(tmp_path / "set", "plain", "clean", count=12)
    assert lerobot_files.MOST_ROWS == 20_000_000
    monkeypatch.setattr(lerobot_files, "MOST_ROWS", 6 * STEPS - 1)
    with pytest.raises(RecordError, match="it declares 240 rows; at most 239 are supported"):
        read_lerobot(path)


@each(
    "text, said",
    [
        ('{"task_index": 0, "task": "a"} nonsense', "cannot be read"),
        ('{"task_index": 0, "task": ' + "[" * 100_000, "nested too deep"),
        ('[{"task_index": 0, "task": "a"}, 3]', "JSON values that are not objects"),
        ('{"task_index": 0, "task": "a"}\n{"task_index": 0, "task": "b"}', "occurs twice with different texts"),
        ('{"task_index": 0, "category": "a"}', "there is no column named task; candidates are category"),
    ],
    lambda _, said: said,
)
def test_a_file_of_tasks_that_cannot_be_read_is_one_clear_line(tmp_path_factory, text, said):
    path = make(tmp_path_factory.mktemp("set") / "set", "pretty JSON, width", "clean", count=12)
    (path / "meta" / "tasks.jsonl").write_text(text)
    with pytest.raises(RecordError, match=said):
        read_lerobot(path)


def test_words_of_scripts_with_and_without_spaces():
    assert instruction_words("Put the red_mug, CAFÉ 2nd!") == {"put", "the", "red", "mug", "café", "2nd"}
    assert instruction_words("ｒｅｄ Ｍｕｇ") == {"red", "mug"}
    assert instruction_words("नीला कप") == {"नीला", "कप"}
    assert instruction_words("🔴 cup ✨") == {"🔴", "cup", "✨"}
    assert {"红色", "色的", "红色的杯"} <= instruction_words("拿红色的杯子")
    assert shown_as({"红", "红色"}, "拿红色的杯子") == "红色"


@pytest.mark.parametrize("episodes", [12, 24, 40, 100])
def test_so_few_demonstrations_say_what_they_could_have_shown(episodes):
    draw = np.random.default_rng(0)
    facts = [
        EpisodeFacts(
            str(i),
            "LeRobot dataset few",
            f"{draw.choice(['put', 'move'])} the {draw.choice(['red', 'blue'])} cup",
            (ShownStep("", "", str(draw.choice(["left", "right"])), "there"),),
        )
        for i in range(episodes)
    ]
    (group,) = audit_dataset("few", facts).groups
    shares = {rule.question: rule.least_share for rule in group.smallest}
    assert set(shares) == {"words_first_place", "words_first_place_together", "words_first_place_whole"}
    assert (shares["words_first_place_together"] is None) == (episodes < 40)
    assert shares["words_first_place"] == {12: 1.0, 24: 1.0, 40: 0.85, 100: 0.85}[episodes]
    assert bool(group.not_shown) == (episodes < 40)
