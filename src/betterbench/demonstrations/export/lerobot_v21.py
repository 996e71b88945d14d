"""Writer of LeRobot data sets of version 2.1, with ``modality.json`` for GR00T. openpi and GR00T read this version.

Source of the format: huggingface/lerobot at the commit that openpi pins (0cf86487), and Isaac-GR00T,
``getting_started/data_preparation.md``.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from betterbench.demonstrations.export.episodes import Dataset, splits, starts
from betterbench.demonstrations.export.layout import ACTION, STATE, DatasetLayout
from betterbench.demonstrations.export.lerobot import (
    CHUNK_FILES,
    Totals,
    counters,
    episode_stats,
    features,
    frame_table,
    json_bytes,
)
from betterbench.demonstrations.export.numbers import Stats, without_quantiles
from betterbench.demonstrations.export.part import parquet_bytes
from betterbench.jobs import write_durably
from betterbench.policies.conventions.modality import name_of
from betterbench.quoting import json_text
from betterbench.sim.robots import robot

EPISODES_FILE, EPISODES_STATS_FILE = "meta/episodes.jsonl", "meta/episodes_stats.jsonl"
MODALITY_FILE = "meta/modality.json"

_ANNOTATION = "annotation."
_TASK_DESCRIPTION = "human.action.task_description"


def write_v21(folder: Path, dataset: Dataset) -> dict[str, Stats]:
    """Write a data set of version 2.1 into an empty folder, and return the statistics of its columns.

    Raises RecordError if the content of an episode is damaged, and OSError if a file cannot be written.
    """
    first, totals = starts(dataset.episodes), Totals()
    episodes, stats = [], []
    for number, part in enumerate(dataset.parts()):
        counted = counters(dataset, number, part, first=first[number])
        totals.add(part, counted)
        table = frame_table(dataset, number, part, first=first[number])
        write_durably(folder / frames_file(number), parquet_bytes(table))
        for column, video in part.videos.items():
            write_durably(folder / video_file(column, number), video)
        episodes.append(episode_line(dataset, number))
        stats.append(stats_line(number, episode_stats(dataset, part, counted)))
    write_durably(folder / EPISODES_FILE, _lines(episodes))
    write_durably(folder / EPISODES_STATS_FILE, _lines(stats))
    for file, lines in index_lines(dataset).items():
        write_durably(folder / file, _lines(lines))
    whole = totals.stats()
    write_durably(folder / "meta/stats.json", json_bytes(kept_stats(whole)))
    described = modality(dataset.layout)
    if described is not None:
        write_durably(folder / MODALITY_FILE, json_bytes(described))
    write_durably(folder / "meta/info.json", json_bytes(info_v21(dataset)))
    return whole


def frames_file(number: int) -> str:
    """Return the name of the file that contains the frames of an episode."""
    return f"data/chunk-{number // CHUNK_FILES:03d}/episode_{number:06d}.parquet"


def video_file(column: str, number: int) -> str:
    """Return the name of the video of an episode."""
    return f"videos/chunk-{number // CHUNK_FILES:03d}/{column}/episode_{number:06d}.mp4"


def episode_line(dataset: Dataset, number: int) -> dict[str, Any]:
    """Return the line of an episode in ``meta/episodes.jsonl``."""
    episode = dataset.episodes[number]
    return {"episode_index": number, "tasks": [episode.about["instruction"]], "length": len(episode)}


def stats_line(number: int, stats: Mapping[str, Stats]) -> dict[str, Any]:
    """Return the line of an episode in ``meta/episodes_stats.jsonl``. Quantiles are left out."""
    return {"episode_index": number, "stats": without_quantiles(stats)}


def index_lines(dataset: Dataset) -> dict[str, list[dict[str, Any]]]:
    """Return the files in ``meta`` that list the instructions and the subgoals by index."""
    words = {"task": dataset.instructions, "subtask": dataset.subgoals}
    return {
        f"meta/{name}s.jsonl": [{f"{name}_index": i, name: text} for i, text in enumerate(said)]
        for name, said in words.items()
    }


def kept_stats(whole: Mapping[str, Stats]) -> dict[str, Stats]:
    """Return the content of ``meta/stats.json``. It contains only the two quantiles that openpi and GR00T read."""
    return without_quantiles(whole, kept=("q01", "q99"))


def modality(layout: DatasetLayout) -> dict[str, Any] | None:
    """Return the content of GR00T's ``meta/modality.json``, which gives names to ranges of state and action components.

    Return None if the layout lacks a column that GR00T's loader needs (``observation.state`` or ``action``).
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


def info_v21(dataset: Dataset) -> dict[str, Any]:
    """Return the content of ``meta/info.json``."""
    total, videos = len(dataset.episodes), len(dataset.layout.all_images) if dataset.form == "video" else 0
    return {
        "codebase_version": "v2.1",
        "robot_type": robot(dataset.layout.robot).dataset_type,
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
    return "".join(json_text(form, allow_nan=False) + "\n" for form in forms).encode()
