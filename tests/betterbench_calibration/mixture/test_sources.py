"""Frames and questions on disk: every item has its place, and what cannot be trained on is refused."""

from __future__ import annotations

import json
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from betterbench.errors import InvalidInputError
from betterbench_calibration.mixture import MixtureSampler, mixture_of_files
from betterbench_calibration.mixture.sources import open_source

LENGTHS = (5, 3, 7, 2)


def lerobot(folder: Path, version: str, *, train: str = "0:3", frames: int = sum(LENGTHS)) -> Path:
    meta = folder / "meta"
    meta.mkdir(parents=True)
    info = {"codebase_version": version, "total_episodes": 4, "total_frames": frames, "splits": {"train": train}}
    (meta / "info.json").write_text(json.dumps(info))
    rows = [{"episode_index": i, "length": n, "tasks": ["x"]} for i, n in enumerate(LENGTHS)]
    if version == "v3.0":
        for file, some in enumerate((rows[:3], rows[3:])):
            path = meta / f"episodes/chunk-000/file-{file:03d}.parquet"
            path.parent.mkdir(parents=True, exist_ok=True)
            pq.write_table(pa.Table.from_pylist(some), path)
    else:
        (meta / "episodes.jsonl").write_text("".join(json.dumps(row) + "\n" for row in rows))
    return folder


def questions(folder: Path, purpose: str = "training") -> Path:
    folder.mkdir()
    lines = [json.dumps({"id": str(i), "conversations": []}) for i in range(6)]
    (folder / "questions.jsonl").write_text("\n".join([*lines[:3], "", *lines[3:]]))
    (folder / "summary.json").write_text(json.dumps({"purpose": purpose}))
    return folder


@pytest.mark.parametrize("version", ["v2.1", "v3.0"])
def test_frames_of_training_episodes_stand_where_they_are_said_to(tmp_path, version):
    source = open_source(lerobot(tmp_path / "set", version))
    places = [source.item(i) for i in range(len(source))]
    frames = [(e, f) for e, n in enumerate(LENGTHS[:3]) for f in range(n)]
    assert places == [{"episode": e, "frame": f, "index": i} for i, (e, f) in enumerate(frames)]
    later = open_source(lerobot(tmp_path / "later", version, train="1:4"))
    assert later.item(0) == {"episode": 1, "frame": 0, "index": 5}
    assert later.item(len(later) - 1) == {"episode": 3, "frame": 1, "index": 16}


def test_questions_are_read_by_their_number(tmp_path):
    source = open_source(questions(tmp_path / "vqa"))
    assert [source.item(i)["id"] for i in range(len(source))] == list("012345")
    assert len(open_source(tmp_path / "vqa/questions.jsonl")) == 6


def test_a_mixture_over_files(tmp_path):
    lerobot(tmp_path / "v2", "v2.1")
    lerobot(tmp_path / "v3", "v3.0", train="0:4")
    questions(tmp_path / "vqa")
    sets = [{"path": "v2"}, {"path": "v3", "weight": 3.0}]
    groups = [
        {"name": "actions", "weight": 8.0, "within": "weights", "sets": sets},
        {"name": "questions", "weight": 2.0, "sets": [{"path": "vqa", "name": "asked"}]},
    ]
    mixture = mixture_of_files({"groups": groups, "seed": 3}, where="mixture.yaml", folder=tmp_path)
    assert [(p.name, p.items, round(p.share, 9)) for p in mixture.parts] == [
        ("v2", 15, 0.2),
        ("v3", 17, 0.6),
        ("asked", 6, 0.2),
    ]
    for drawn in MixtureSampler(mixture.parts, seed=mixture.seed, draws=100):
        item = mixture.sources[drawn.part].item(drawn.item)
        assert ("conversations" in item) == (drawn.part == "asked")


@pytest.mark.parametrize(
    ("form", "said"),
    [
        ({"groups": [{"name": "g", "weight": 1.0, "sets": [{"path": "no"}]}]}, "no: does not exist"),
        ({"groups": [{"name": "g", "weight": 1.0, "sets": [{"path": "v2"}, {"path": "v2"}]}]}, "have this name"),
        ({"groups": [{"name": "g", "weight": 0.0, "sets": [{"path": "v2"}]}]}, "add up to 0"),
        ({"groups": [{"name": "g", "sets": []}]}, "weight"),
        ({"groups": [{"name": "g", "weight": 1.0, "sets": [{"path": "v2"}]}], "sead": 1}, "sead"),
        ({"groups": []}, "mixture.yaml: groups"),
        ({"groups": [{"name": "g", "weight": 1.0, "sets": []}]}, r"mixture.yaml: groups\[0\].sets"),
        ({"groups": [{"name": "g", "weight": -1.0, "sets": [{"path": "v2"}]}]}, r"mixture.yaml: groups\[0\].weight"),
        ({"groups": [{"name": "g", "weight": 1.0, "sets": [{"path": "tests"}]}]}, "questions are for test"),
        ({"groups": [{"name": "g", "weight": 1.0, "sets": [{"path": "short"}]}]}, "has 4 episodes and 17 frames"),
        ({"groups": [{"name": "g", "weight": 1.0, "sets": [{"path": "split"}]}]}, "not a range of its episodes"),
        ({"groups": [{"name": "g", "weight": 1.0, "sets": [{"path": "old"}]}]}, "its version is v1.6"),
    ],
)
def test_wrong_mixtures_are_one_line(tmp_path, form, said):
    lerobot(tmp_path / "v2", "v2.1")
    lerobot(tmp_path / "short", "v3.0", frames=18)
    lerobot(tmp_path / "split", "v3.0", train="0:9")
    lerobot(tmp_path / "old", "v1.6")
    questions(tmp_path / "tests", "test")
    with pytest.raises(InvalidInputError, match=said) as caught:
        mixture_of_files(form, where="mixture.yaml", folder=tmp_path)
    assert "\n" not in str(caught.value)
