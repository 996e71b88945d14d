"""What the formats demand, written down from their sources and not from our writers: an independent reader of each."""

from __future__ import annotations

import io
import json
from pathlib import Path

import av
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from PIL import Image

COUNTERS = {"timestamp": "float32", "frame_index": "int64", "episode_index": "int64", "index": "int64"}
COUNTERS |= {"task_index": "int64"}
STATS_V30 = {"min", "max", "mean", "std", "count", "q01", "q10", "q50", "q90", "q99"}
STATS_V21 = {"min", "max", "mean", "std", "count"}


def video_frames(path: Path) -> list[tuple[float, np.ndarray]]:
    with av.open(str(path)) as container:
        return [(float(f.pts * f.time_base), f.to_ndarray(format="rgb24")) for f in container.decode(video=0)]


def column(table: pa.Table, name: str) -> np.ndarray:
    chunk = table.column(name).combine_chunks()
    if pa.types.is_fixed_size_list(chunk.type):
        return chunk.flatten().to_numpy().reshape(len(table), -1)
    return chunk.to_numpy(zero_copy_only=False).reshape(len(table), -1)


def check_features(info: dict, table: pa.Table) -> None:
    """Every feature but videos is a column of its type and size, and no column is undeclared."""
    features = info["features"]
    stored = {name for name, feature in features.items() if feature["dtype"] != "video"}
    assert set(table.column_names) == stored
    for name in stored:
        feature, kind = features[name], table.schema.field(name).type
        assert "/" not in name
        if feature["dtype"] == "image":
            assert {kind.field(i).name: kind.field(i).type for i in range(kind.num_fields)} == {
                "bytes": pa.binary(),
                "path": pa.string(),
            }
        elif feature["dtype"] != "language":
            size, inner = (kind.list_size, kind.value_type) if pa.types.is_fixed_size_list(kind) else (1, kind)
            assert [size] == feature["shape"]
            assert str(inner) == {"float32": "float", "float64": "double", "int64": "int64"}[feature["dtype"]]
            assert feature["names"] is None or len(feature["names"]) == size
    for name, dtype in COUNTERS.items():
        assert features[name] == {"dtype": dtype, "shape": [1], "names": None}


def check_stats(stats: dict, info: dict, wanted: set[str], arrays: dict[str, np.ndarray]) -> None:
    """The statistics are those of the numbers, and images have one number per channel in [0, 1]."""
    for name, feature in info["features"].items():
        if feature["dtype"] == "language":
            continue
        found = stats[name]
        assert set(found) >= wanted
        if feature["dtype"] in ("image", "video"):
            assert all(np.shape(found[what]) == (3, 1, 1) for what in wanted - {"count"})
            assert 0.0 <= np.min(found["min"]) <= np.mean(found["mean"]) <= np.max(found["max"]) <= 1.0
            continue
        values = arrays[name].astype(np.float64)
        assert found["count"] == [len(values)]
        for what in ("min", "max", "mean", "std"):
            np.testing.assert_allclose(found[what], getattr(values, what)(axis=0), rtol=1e-9, atol=1e-12)
        for what in wanted - STATS_V21:
            np.testing.assert_allclose(found[what], np.quantile(values, int(what[1:]) / 100, axis=0), rtol=1e-9)


def read_v30(folder: Path) -> list[dict]:
    """Reads version 3.0 as LeRobot's reader does, checks all that it relies on, and returns the episodes."""
    info = json.loads((folder / "meta/info.json").read_text())
    assert info["codebase_version"] == "v3.0"
    assert isinstance(info["fps"], int)
    tasks = pq.read_table(folder / "meta/tasks.parquet")
    pandas = json.loads(tasks.schema.metadata[b"pandas"])
    assert pandas["index_columns"] == ["task"]
    words = dict(zip(tasks["task_index"].to_pylist(), tasks["task"].to_pylist(), strict=True))
    subtasks = pq.read_table(folder / "meta/subtasks.parquet")
    subgoals = dict(zip(subtasks["subtask_index"].to_pylist(), subtasks["subtask"].to_pylist(), strict=True))
    rows = pq.read_table(folder / "meta/episodes/chunk-000/file-000.parquet").to_pylist()
    assert [row["episode_index"] for row in rows] == list(range(info["total_episodes"]))
    assert sum(row["length"] for row in rows) == info["total_frames"]
    episodes, arrays, begun = [], {}, 0
    for row in rows:
        place = {"chunk_index": row["data/chunk_index"], "file_index": row["data/file_index"]}
        table = pq.read_table(folder / info["data_path"].format(**place))
        check_features(info, table)
        table = table.filter(pa.compute.equal(table["episode_index"], row["episode_index"]))
        assert len(table) == row["length"] == row["dataset_to_index"] - row["dataset_from_index"]
        assert row["dataset_from_index"] == begun
        begun = row["dataset_to_index"]
        episode = _episode(table, info)
        np.testing.assert_array_equal(episode["index"][:, 0], np.arange(row["dataset_from_index"], begun))
        for name, feature in info["features"].items():
            if feature["dtype"] != "video":
                continue
            place = {f"{w}_index": row[f"videos/{name}/{w}_index"] for w in ("chunk", "file")}
            shown = video_frames(folder / info["video_path"].format(video_key=name, **place))
            first, last = row[f"videos/{name}/from_timestamp"], row[f"videos/{name}/to_timestamp"]
            mine = [(t - first, p) for t, p in shown if first - 1e-6 < t < last - 1e-6]
            assert np.allclose([t for t, _ in mine], episode["timestamp"][:, 0], atol=1e-4)
            episode[name] = np.array([p for _, p in mine])
        assert row["tasks"] == list(dict.fromkeys(words[i] for i in episode["task_index"][:, 0]))
        episode |= {"task": row["tasks"][0], "subgoal": [subgoals[i] for i in episode["subtask_index"][:, 0]]}
        stats = {}
        for key, value in row.items():
            if key.startswith("stats/"):
                stats.setdefault(key.split("/")[1], {})[key.split("/")[2]] = value
        check_stats(stats, info, STATS_V30, episode)
        episodes.append(episode)
    for name, feature in info["features"].items():
        if feature["dtype"] != "language":
            arrays[name] = np.concatenate([e[name] for e in episodes])
    check_stats(json.loads((folder / "meta/stats.json").read_text()), info, STATS_V30, arrays)
    return episodes


def read_v21(folder: Path) -> list[dict]:
    """Reads version 2.1 likewise."""
    info = json.loads((folder / "meta/info.json").read_text())
    assert info["codebase_version"] == "v2.1"

    def lines(name: str) -> list[dict]:
        return [json.loads(line) for line in (folder / "meta" / name).read_text().splitlines()]

    words = {line["task_index"]: line["task"] for line in lines("tasks.jsonl")}
    stats = {line["episode_index"]: line["stats"] for line in lines("episodes_stats.jsonl")}
    episodes = []
    for line in lines("episodes.jsonl"):
        number = line["episode_index"]
        place = {"episode_chunk": number // info["chunks_size"], "episode_index": number}
        table = pq.read_table(folder / info["data_path"].format(**place))
        # Older readers take the types from here and from nowhere else.
        declared = json.loads(table.schema.metadata[b"huggingface"])["info"]["features"]
        assert set(declared) == set(table.column_names)
        check_features(info, table)
        episode = _episode(table, info)
        assert len(table) == line["length"]
        for name, feature in info["features"].items():
            if feature["dtype"] == "video":
                shown = video_frames(folder / info["video_path"].format(video_key=name, **place))
                assert np.allclose([t for t, _ in shown], episode["timestamp"][:, 0], atol=1e-4)
                episode[name] = np.array([p for _, p in shown])
        check_stats(stats[number], info, STATS_V21, episode)
        episode["task"] = words[int(episode["task_index"][0, 0])]
        assert line["tasks"] == [episode["task"]]
        episodes.append(episode)
    videos = sum(feature["dtype"] == "video" for feature in info["features"].values())
    assert info["total_episodes"] == len(episodes)
    assert info["total_videos"] == videos * len(episodes)
    assert info["total_chunks"] == 1
    whole = {name: np.concatenate([e[name] for e in episodes]) for name in info["features"]}
    check_stats(json.loads((folder / "meta/stats.json").read_text()), info, STATS_V21 | {"q01", "q99"}, whole)
    return episodes


def check_modality(folder: Path) -> dict:
    """GR00T's slices cover state and action without gaps, and every name leads to something that is there."""
    modality = json.loads((folder / "meta/modality.json").read_text())
    features = json.loads((folder / "meta/info.json").read_text())["features"]
    assert set(modality) == {"state", "action", "video", "annotation"}
    for kind, name in (("state", "observation.state"), ("action", "action")):
        spans = sorted((entry["start"], entry["end"]) for entry in modality[kind].values())
        assert spans[0][0] == 0
        assert [end for _, end in spans] == [*(start for start, _ in spans[1:]), features[name]["shape"][0]]
    for entry in modality["video"].values():
        assert features[entry["original_key"]]["dtype"] == "video"
    for name, entry in modality["annotation"].items():
        assert name.count(".") >= 1
        assert features[entry["original_key"]]["dtype"] == "int64"
    return modality


def _episode(table: pa.Table, info: dict) -> dict:
    rows, episode = len(table), {}
    for name in table.column_names:
        dtype = info["features"][name]["dtype"]
        if dtype == "image":
            files = table[name].combine_chunks().field("bytes").to_pylist()
            episode[name] = np.array([np.asarray(Image.open(io.BytesIO(data))) for data in files])
        elif dtype == "language":
            episode[name] = table[name].to_pylist()
        else:
            episode[name] = column(table, name)
    np.testing.assert_array_equal(episode["frame_index"][:, 0], np.arange(rows))
    np.testing.assert_allclose(episode["timestamp"][:, 0], np.arange(rows) / info["fps"], atol=1e-5)
    return episode
