"""LeRobot's data sets of version 2.1, which openpi's and GR00T's trainers read, with GR00T's ``modality.json``.

Source of the format: huggingface/lerobot at the commit that openpi pins (0cf86487), and Isaac-GR00T,
``getting_started/data_preparation.md``.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from betterbench.export.episodes import Dataset, splits, starts
from betterbench.export.layout import ACTION, STATE, DatasetLayout
from betterbench.export.lerobot import (
    CHUNK_FILES,
    ROBOT_TYPE,
    Totals,
    counters,
    episode_stats,
    features,
    frame_table,
    json_bytes,
)
from betterbench.export.numbers import Stats, without_quantiles
from betterbench.export.part import parquet_bytes
from betterbench.policies.modality import name_of
from betterbench.recording import write_durably

_ANNOTATION = "annotation."
_TASK_DESCRIPTION = "human.action.task_description"


def write_v21(folder: Path, dataset: Dataset) -> dict[str, Stats]:
    """Write a data set of version 2.1 into an empty folder, and return its statistics.

    Raises RecordError if a part was damaged, OSError if something cannot be written.
    """
    first, totals = starts(dataset.episodes), Totals()
    episodes, stats = [], []
    for number, part in enumerate(dataset.parts()):
        counted = counters(dataset, number, part, first=first[number])
        totals.add(part, counted)
        chunk, name = f"chunk-{number // CHUNK_FILES:03d}", f"episode_{number:06d}"
        table = frame_table(dataset, number, part, first=first[number])
        write_durably(folder / "data" / chunk / f"{name}.parquet", parquet_bytes(table))
        for column, video in part.videos.items():
            write_durably(folder / "videos" / chunk / column / f"{name}.mp4", video)
        about = dataset.episodes[number].about
        episodes.append({"episode_index": number, "tasks": [about["instruction"]], "length": len(part)})
        found = without_quantiles(episode_stats(dataset, part, counted))
        stats.append({"episode_index": number, "stats": found})
    tasks = [{"task_index": i, "task": text} for i, text in enumerate(dataset.instructions)]
    subgoals = [{"subtask_index": i, "subtask": text} for i, text in enumerate(dataset.subgoals)]
    write_durably(folder / "meta/episodes.jsonl", _lines(episodes))
    write_durably(folder / "meta/episodes_stats.jsonl", _lines(stats))
    write_durably(folder / "meta/tasks.jsonl", _lines(tasks))
    write_durably(folder / "meta/subtasks.jsonl", _lines(subgoals))
    whole = totals.stats()
    write_durably(folder / "meta/stats.json", json_bytes(without_quantiles(whole, kept=("q01", "q99"))))
    described = modality(dataset.layout)
    if described is not None:
        write_durably(folder / "meta/modality.json", json_bytes(described))
    write_durably(folder / "meta/info.json", json_bytes(_info(dataset)))
    return whole


def modality(layout: DatasetLayout) -> dict[str, Any] | None:
    """Return GR00T's ``meta/modality.json``: which numbers of state and action have which name.

    None for a layout whose columns are not those of GR00T's loader (``observation.state`` and ``action``).
    """
    columns = {column.name: column for column in (*layout.states, layout.action)}
    if set(columns) != {STATE, ACTION}:
        return None
    spans = {
        name: {part.name: {"start": part.start, "end": part.end} for part in columns[name].parts}
        for name in (STATE, ACTION)
    }
    instruction = layout.adapter.instruction.key[-1]
    known_as = instruction.removeprefix(_ANNOTATION) if instruction.startswith(_ANNOTATION) else _TASK_DESCRIPTION
    return {
        "state": spans[STATE],
        "action": spans[ACTION],
        "video": {name_of(column.key).rpartition(".")[2]: {"original_key": column.name} for column in layout.images},
        "annotation": {known_as: {"original_key": "task_index"}},
    }


def _info(dataset: Dataset) -> dict[str, Any]:
    total, videos = len(dataset.episodes), len(dataset.layout.all_images) if dataset.form == "video" else 0
    return {
        "codebase_version": "v2.1",
        "robot_type": ROBOT_TYPE,
        "total_episodes": total,
        "total_frames": dataset.frames,
        "total_tasks": len(dataset.instructions),
        "total_videos": videos * total,
        "total_chunks": -(-total // CHUNK_FILES),
        "chunks_size": CHUNK_FILES,
        "fps": dataset.rate_hz,
        "splits": splits(dataset),
        "data_path": "data/chunk-{episode_chunk:03d}/episode_{episode_index:06d}.parquet",
        "video_path": "videos/chunk-{episode_chunk:03d}/{video_key}/episode_{episode_index:06d}.mp4"
        if videos
        else None,
        "features": features(dataset),
    }


def _lines(forms: Iterable[object]) -> bytes:
    return "".join(json.dumps(form, ensure_ascii=False, allow_nan=False) + "\n" for form in forms).encode()
