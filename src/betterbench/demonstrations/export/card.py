"""Dataset card of an export: a README.md with counts, columns, and commands for training and evaluation."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping

import numpy as np

from betterbench.demonstrations.export.episodes import Dataset
from betterbench.demonstrations.export.numbers import Stats
from betterbench.quoting import markdown_code, markdown_table, markdown_text

_FRONT = (
    "---",
    "task_categories: [robotics]",
    "tags: [LeRobot, betterbench, manipulation, simulation]",
    "configs:",
    "  - config_name: default",
    "    data_files: data/*/*.parquet",
    "---",
    "",
)

STILL = 1e-3
"""Maximum difference between the quantiles 0.01 and 0.99 of a component that is reported as nearly constant."""


def card(dataset: Dataset, stats: Mapping[str, Stats]) -> str:
    """Return the dataset card as Markdown, with the metadata block that the Hugging Face hub reads."""
    source, layout = dataset.source, dataset.layout
    lengths = [len(episode) for episode in dataset.episodes]
    seconds = dataset.frames / dataset.rate_hz
    counts = (
        f"{len(lengths)} episodes, {dataset.frames} frames at {dataset.rate_hz} Hz ({seconds / 60:.1f} min), with "
        f"{len(dataset.instructions)} instructions. Episodes have {min(lengths)} to {max(lengths)} frames, "
        f"{int(np.median(lengths))} in the median. {dataset.train} episodes are for training, "
        f"{len(lengths) - dataset.train} for validation."
    )
    shown = (
        f"Layout: preset {markdown_code(layout.adapter.name)}, images as {dataset.form}, render quality "
        f"{markdown_code(source['quality'])}. "
        "A policy that was trained on these columns is evaluated with"
    )
    origin = (
        f"Made by betterbench {markdown_text(source['package_version'])} from the records of "
        f"{', '.join(map(markdown_text, source['policies']))}; suite {markdown_text(source['suite_version'])}, looks "
        f"{markdown_code(', '.join(source['looks']))}. `meta/betterbench.json` names the record "
        "of each episode by its SHA-256."
    )
    lines = [*_FRONT, "# Demonstrations of BeTTER tasks", "", counts, "", shown, "", "```sh", str(source["evaluate"])]
    lines += ["```", "", "## Episodes", ""]
    lines += markdown_table(("task", "condition", "episodes", "frames", "instruction"), _episodes(dataset))
    lines += ["", "## Columns", "", *markdown_table(("column", "what", "range of the data"), _columns(dataset, stats))]
    lines += [*_still(dataset, stats), "", "## Origin", "", origin, ""]
    lines += [f"- left out: {count} trials {markdown_text(reason)}" for reason, count in source["left_out"].items()]
    return "\n".join(lines).rstrip() + "\n"


def _episodes(dataset: Dataset) -> list[tuple[str, ...]]:
    count: Counter[tuple[str, ...]] = Counter()
    frames: Counter[tuple[str, ...]] = Counter()
    for episode in dataset.episodes:
        key = tuple(str(episode.about[name]) for name in ("task", "condition", "instruction"))
        count[key] += 1
        frames[key] += len(episode)
    return [tuple(map(markdown_text, (k[0], k[1], count[k], frames[k], k[2]))) for k in sorted(count)]


def _columns(dataset: Dataset, stats: Mapping[str, Stats]) -> list[tuple[str, ...]]:
    rows: list[tuple[str, ...]] = []
    for name, image in dataset.layout.all_images.items():
        rows.append(
            (markdown_code(name), f"camera {markdown_code(image.camera)}, {image.width} × {image.height}", "uint8")
        )
    for column in (*dataset.layout.states, dataset.layout.action):
        low, high = stats[column.name]["min"], stats[column.name]["max"]
        for i, component in enumerate(column.components):
            name = markdown_code(f"{column.name}[{i}]")
            rows.append((name, markdown_text(component), f"{low[i]:.4g} to {high[i]:.4g}"))
    return rows


def _still(dataset: Dataset, stats: Mapping[str, Stats]) -> list[str]:
    """Return a warning about state and action components that are nearly constant, as Markdown lines.

    The list is empty if there are no such components.
    """
    found = []
    for column in (*dataset.layout.states, dataset.layout.action):
        spans = zip(column.components, stats[column.name]["q01"], stats[column.name]["q99"], strict=True)
        found += [
            f"{markdown_code(name)} of {markdown_code(column.name)}" for name, low, high in spans if high - low < STILL
        ]
    if not found:
        return []
    said = "Normalization by range, quantiles or standard deviation amplifies nearly constant components"
    return [
        "",
        f"{said}: {', '.join(found)} (quantiles 0.01 and 0.99 less than {STILL:g} apart). Limit it in your trainer.",
    ]
