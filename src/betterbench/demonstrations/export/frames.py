"""Frames of an episode: the observation and the action label of each control step."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from betterbench.demonstrations.export.actions import actions_in, commands
from betterbench.demonstrations.export.layout import DatasetLayout
from betterbench.episodes import observation_of
from betterbench.interface import Observation
from betterbench.interface.actions import action_space
from betterbench.policies.conventions.answers import get_entry
from betterbench.records import Record, subgoal_segments
from betterbench.tasks.interventions import resolve_condition

DONE = "done"
"""Name of the subgoal in frames after the last subgoal has been met."""


@dataclass(frozen=True, slots=True, eq=False)
class Numbers:
    """Numeric columns of all frames in an episode, i.e. all columns except the images.

    Attributes:
        vectors: Values (N, size) of each state column and of the action column.
        subgoals: (N,) name of the current subgoal in each frame.
    """

    vectors: Mapping[str, np.ndarray]
    subgoals: tuple[str, ...]


def frame_numbers(record: Record, layout: DatasetLayout) -> Numbers:
    """Return the numeric columns of all frames.

    The last state of the record is left out, because no action follows this state.

    Raises InvalidInputError if the motion cannot be expressed in the preset's action space.
    """
    adapter = layout.adapter
    actions = actions_in(record, action_space(adapter.answer.space))
    if adapter.answer.gripper in ("closed_fraction", "open_fraction"):
        actions = np.concatenate([actions[:, :-1], commands(actions[:, -1])[:, None]], axis=1)
    rules = {rule.key: rule for rule in adapter.states}
    rows: dict[str, list[np.ndarray]] = {column.name: [] for column in (*layout.states, layout.action)}
    for seen, action in zip(_observations(record), actions, strict=True):
        for column in layout.states:
            values = [np.atleast_1d(adapter.state(rules[part.key], seen)) for part in column.parts]
            rows[column.name].append(np.concatenate(values))
        reply = adapter.reply(action[None], seen)
        parts = [np.asarray(get_entry(reply, part.key))[0] for part in layout.action.parts]
        rows[layout.action.name].append(np.concatenate(parts))
    vectors = {
        column.name: np.array(rows[column.name], dtype=column.dtype).reshape(-1, column.size)
        for column in (*layout.states, layout.action)
    }
    return Numbers(vectors, active_subgoals(record))


def shown_images(
    record: Record,
    layout: DatasetLayout,
    pictures: Iterator[Mapping[str, np.ndarray]],
    rows: Collection[int] | None = None,
) -> Iterator[dict[str, np.ndarray]]:
    """Convert camera images to the images that the policy receives, and yield the images of each frame by column name.

    Args:
        record: Record of the episode.
        layout: Columns of the data set.
        pictures: Rendered images by camera, for each frame.
        rows: Frames to convert; None for all frames.
    """
    observed = (o for o in _observations(record) if rows is None or o.step in rows)
    for seen, views in zip(observed, pictures, strict=True):
        by_key = layout.adapter.images(replace(seen, images=views))
        images = {column.name: by_key[column.key] for column in layout.images}
        yield images | {name: images[other] for name, other in layout.copies.items()}


def active_subgoals(record: Record) -> tuple[str, ...]:
    """Return the current subgoal of each frame in words ("pack burger"), or :data:`DONE` after the last subgoal.

    The subgoal segments are taken from the record or, if it contains none, computed from its states. Raises
    UnknownNameError if they must be computed, but the task or the condition is unknown.
    """
    meta = record.metadata
    segments = meta.segments or subgoal_segments(record, resolve_condition(meta.task, meta.condition).condition)
    shown = [DONE] * record.n_steps
    for segment in segments:
        for row in range(segment.start, min(segment.stop, record.n_steps)):
            shown[row] = segment.subgoal.replace("_", " ") or DONE
    return tuple(shown)


def _observations(record: Record) -> Iterator[Observation]:
    """Yield the observation, without images, that the policy would receive before each action."""
    for state in record.states():
        if state.step < record.n_steps:
            yield observation_of(state, record.metadata.instruction, {})
