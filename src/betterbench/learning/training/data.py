"""Training data from demonstration records: arrays over all frames, and constants per episode."""

from __future__ import annotations

import hashlib
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from betterbench.demonstrations.export.actions import actions_in, commands
from betterbench.demonstrations.export.job import validation_seeds
from betterbench.demonstrations.export.selection import ChosenTrial, select_demonstrations
from betterbench.errors import InvalidInputError
from betterbench.interface.actions import EE_DELTA, EE_POSE
from betterbench.jobs import OnCount
from betterbench.learning.training.frames import SUFFIX, FrameStore, WantedFrames, drawn_frames
from betterbench.learning.training.questions import (
    AskedQuestions,
    TrainingQuestions,
    read_questions,
    training_questions,
)
from betterbench.policies.learned.recipe import TrainingRecipe
from betterbench.policies.learned.tokens import pose_numbers, things_of, tool_numbers
from betterbench.policies.learned.vocabulary import Vocabulary
from betterbench.records import Record, RunFolder, subgoal_segments
from betterbench.tasks import TrialId
from betterbench.tasks.interventions import resolve_condition

PHASES = ("move", "pick", "carry", "place", "slide", "miss")
"""Phases of a demonstration, which are defined by the activity of the gripper."""

_STILL_M, _STILL_RAD = 2e-4, 2e-3
"""Motion per control step below which the demonstrator counts as pausing [m, rad].

It applies to the tool and the fingers.
"""


@dataclass(frozen=True, slots=True, eq=False)
class TrainingSet:
    """Frames of all demonstrations, concatenated. There are F frames from E episodes with at most n objects each.

    Attributes:
        vocabulary: Words, categories and colors that occur in the training demonstrations.
        trials: Trial of each episode.
        sha256: Hash of the records.
        words: (E, w) int64 words of the instruction; ABSENT after the last word.
        sizes: (E, n, 3) float32 object sizes [m]; zero for missing objects.
        categories: (E, n) int64 object categories; ABSENT for missing objects.
        colors: (E, n) int64 object colors.
        held_out: (E,) bool mask of the validation episodes.
        tools: (F, 10) float32 tool pose and gripper opening.
        poses: (F, n, 9) float32 object poses.
        actions: (F, 7) float32 in ``ee_delta``, with gripper commands of -1 or +1.
        episodes: (F,) int64 index of each frame's episode.
        first: (E,) int64 index of each episode's first frame.
        last: (E,) int64 index of each episode's last frame.
        phases: (F,) int64 indices into :data:`PHASES`.
        at_gripper: (F,) bool mask of the frames with an action chunk that contains a gripper change.
        shown: (F,) bool mask of the frames that are used as observations; other frames only occur in action chunks.
            None if all frames are used.
        frames_of: Images of the frames in ``shown``, in order. None for the family ``objects``.
        questions: Questions about the demonstrations; None if there is no co-training.
    """

    vocabulary: Vocabulary
    trials: tuple[TrialId, ...]
    sha256: str
    words: np.ndarray
    sizes: np.ndarray
    categories: np.ndarray
    colors: np.ndarray
    held_out: np.ndarray
    tools: np.ndarray
    poses: np.ndarray
    actions: np.ndarray
    episodes: np.ndarray
    first: np.ndarray
    last: np.ndarray
    phases: np.ndarray
    at_gripper: np.ndarray
    shown: np.ndarray | None = None
    frames_of: FrameStore | None = None
    questions: TrainingQuestions | None = None

    def frames(self, *, held_out: bool) -> np.ndarray:
        """Return the indices (int64) of the frames in the training demonstrations or in the held-out demonstrations."""
        found = self.held_out[self.episodes] == held_out
        return np.flatnonzero(found if self.shown is None else found & self.shown)

    def asked(self, *, held_out: bool) -> np.ndarray:
        """Return the indices (int64) of the questions about the training demonstrations or about the held-out ones."""
        if self.questions is None:
            return np.zeros(0, dtype=np.int64)
        return np.flatnonzero(self.held_out[self.questions.episodes] == held_out)


@dataclass(frozen=True, slots=True, eq=False)
class _Episode:
    trial: TrialId
    record: Record
    rows: np.ndarray
    actions: np.ndarray


def read_training_set(
    recipe: TrainingRecipe,
    *,
    on_read: OnCount | None = None,
    frames: Path | None = None,
    workers: int = 1,
    on_drawn: OnCount | None = None,
) -> TrainingSet:
    """Read the demonstrations and questions of a recipe.

    For the family ``pixels``, also render images that are missing.

    Args:
        recipe: The recipe.
        on_read: Called after each record with the number of records read so far and the total number.
        frames: Folder for the rendered images. The default is a folder next to each data folder, with the suffix
            ``.frames``.
        workers: Number of rendering processes.
        on_drawn: Called after each rendered demonstration with the number of demonstrations so far and the total
            number.

    Raises:
        RunConflictError: If a folder is not a run.
        RecordError: If a record or a question set is missing or damaged.
        UnknownNameError: If no run has a requested task.
        InvalidInputError: If no demonstrations are left, a record has another action space, or no question is about a
            demonstration.
        StorageError: If the disk has no space for the images. Images that are already complete are kept.
    """
    runs, chosen = _chosen(recipe)
    held_out = validation_seeds({d.trial.seed for d in chosen}, recipe.validation)
    episodes = list(_episodes(runs, chosen, recipe.longest_pause, on_read))
    if all(episode.trial.seed in held_out for episode in episodes):
        raise InvalidInputError(
            "validation", "all demonstrations are held out", "Use more demonstrations, or set validation: 0"
        )
    digest = hashlib.sha256("".join(f"{d.trial} {d.digest}\n" for d in chosen).encode()).hexdigest()
    asked = _asked(recipe, chosen)
    data = _joined(episodes, held_out, digest, recipe, asked)
    beside = [_frames_beside(place) if frames is None else frames for place in recipe.data]

    def draw(rows_of: Sequence[np.ndarray]) -> FrameStore:
        wanted = [
            WantedFrames(runs[d.run], episode.record, d.digest, rows, beside[d.run].absolute())
            for d, episode, rows in zip(chosen, episodes, rows_of, strict=True)
            if len(rows)
        ]
        return drawn_frames(wanted, recipe.eyes, workers=workers, on_drawn=on_drawn)

    if seeing := recipe.sees == "pixels":
        data = _with(data, draw([episode.rows[:: recipe.every] for episode in episodes]))
    if asked is None:
        return data
    questions = training_questions(
        asked,
        [episode.record for episode in episodes],
        data.held_out,
        recipe,
        data.vocabulary,
        objects=data.poses.shape[1],
        draw=draw if seeing else None,
    )
    digest = hashlib.sha256(" ".join([data.sha256, *asked.sha256]).encode()).hexdigest()
    return replace(data, sha256=digest, questions=questions)


def require_questions(recipe: TrainingRecipe) -> None:
    """Check that the question sets of a recipe are about its demonstrations, without reading the demonstrations.

    Raises:
        BetterError: If a question set is not about the demonstrations. The types of error are those of
            :func:`read_training_set`.
    """
    _asked(recipe, _chosen(recipe)[1])


def _chosen(recipe: TrainingRecipe) -> tuple[list[RunFolder], list[ChosenTrial]]:
    """Return the runs and the selected demonstrations of a recipe."""
    runs = [_opened(place) for place in recipe.data]
    selection = select_demonstrations(runs, tasks=recipe.tasks, variations=recipe.variations)
    return runs, _fewer(selection.demonstrations, recipe.demonstrations)


def _asked(recipe: TrainingRecipe, chosen: Sequence[ChosenTrial]) -> AskedQuestions | None:
    return read_questions(recipe, [(d.trial, d.digest) for d in chosen])


def _episodes(
    runs: Sequence[RunFolder], chosen: Sequence[ChosenTrial], longest_pause: int | None, on_read: OnCount | None
) -> Iterator[_Episode]:
    for number, demonstration in enumerate(chosen, 1):
        trial, run = demonstration.trial, runs[demonstration.run]
        record = run.read_record(trial.task, trial.condition, trial.seed, digest=demonstration.digest)
        rows = moving_rows(record, longest_pause)
        yield _Episode(trial, record, rows, _actions(record, trial, run.path)[rows])
        if on_read is not None:
            on_read(number, len(chosen))


def _with(data: TrainingSet, drawn: FrameStore) -> TrainingSet:
    """Return the training set with the rendered images added."""
    digest = hashlib.sha256(f"{data.sha256} {drawn.sha256}".encode()).hexdigest()
    return replace(data, sha256=digest, frames_of=drawn)


def run_folder(place: Path) -> Path:
    """Return the run folder with the demonstrations if the given folder is a training set of ``better dataset``.

    Any other folder is returned unchanged.
    """
    return place / "demonstrations" if (place / "dataset.json").is_file() else place


def _frames_beside(place: str) -> Path:
    folder = Path(place).resolve()
    return folder.with_name(folder.name + SUFFIX)


def _opened(place: str) -> RunFolder:
    """Open the run at a path that the recipe contains."""
    folder = run_folder(Path(place))
    if not place or not (folder / "run.json").is_file():
        problem = f"{place!r} contains no demonstrations"
        raise InvalidInputError(
            "data",
            problem,
            "Use folders of `better dataset`, or runs of `better collect`, `amplify` or `teleop`",
        )
    return RunFolder.open(folder)


def _fewer(chosen: Sequence[ChosenTrial], most: int | None) -> list[ChosenTrial]:
    """Return at most ``most`` demonstrations per condition, preferring low seeds.

    If ``most`` is None, return all of them.
    """
    by_condition = defaultdict(list)
    for demonstration in chosen:
        by_condition[demonstration.trial.task, demonstration.trial.condition].append(demonstration)
    return [d for found in by_condition.values() for d in found[:most]]


def _actions(record: Record, trial: TrialId, run: Path) -> np.ndarray:
    """Return the executed actions without the noise that was added to them, as an (n_steps, 7) array."""
    space = record.metadata.action_space
    if space != EE_DELTA.name:
        where = f"{run}: {trial}"
        problem = f"its action space is {space!r}, but training needs {EE_DELTA.name!r}"
        raise InvalidInputError(where, problem, f"Record the demonstrations with --action-space {EE_DELTA.name}")
    meant = actions_in(record, EE_DELTA)
    meant[:, -1] = np.sign(commands(meant[:, -1]))
    return meant


def moving_rows(record: Record, most: int | None) -> np.ndarray:
    """Return the indices (int64) of the rows of a record that are used for training.

    The demonstrator is pausing while neither the commanded pose nor the fingers change. Only the first ``most`` rows of
    each pause are used. A single state does not show how long a pause has lasted, so a policy that was trained on long
    pauses would prolong them, possibly forever.
    """
    if most is None or record.n_steps == 0:
        return np.arange(record.n_steps)
    poses = actions_in(record, EE_POSE)
    moved = np.linalg.norm(np.diff(poses[:, :3], axis=0), axis=1)
    turned = 2.0 * np.arccos(np.abs((poses[1:, 3:7] * poses[:-1, 3:7]).sum(axis=1)).clip(0.0, 1.0))
    fingers = np.abs(np.diff(record.finger_width[: record.n_steps]))
    still = (moved < _STILL_M) & (turned < _STILL_RAD) & (fingers < _STILL_M) & (np.diff(poses[:, -1]) == 0.0)
    rows = np.arange(record.n_steps)
    last_moving = np.maximum.accumulate(np.where(np.concatenate([[False], still]), 0, rows))
    return rows[rows - last_moving <= most]


def _joined(
    episodes: Sequence[_Episode],
    held_out: set[int],
    digest: str,
    recipe: TrainingRecipe,
    asked: AskedQuestions | None,
) -> TrainingSet:
    """Concatenate the arrays of all episodes."""
    apart = np.array([e.trial.seed in held_out for e in episodes])
    trained = [e.record.metadata for e, out in zip(episodes, apart, strict=True) if not out]
    vocabulary = Vocabulary.of(
        [meta.instruction for meta in trained] + ([] if asked is None else asked.texts(apart)),
        (o.category for meta in trained for o in meta.scene.objects),
        (o.color for meta in trained for o in meta.scene.objects),
    )
    if asked is not None:
        vocabulary = replace(vocabulary, answers=asked.answers(apart))
    if recipe.start is not None:
        vocabulary = _of_start(recipe.start, vocabulary)
    most = max(len(e.record.metadata.scene.objects) for e in episodes)
    things = [things_of(e.record.metadata.instruction, e.record.metadata.scene.objects, vocabulary) for e in episodes]
    longest = max(len(t.words) for t in things)
    steps = np.array([len(e.actions) for e in episodes])
    ends = np.cumsum(steps)
    return TrainingSet(
        vocabulary=vocabulary,
        trials=tuple(e.trial for e in episodes),
        sha256=digest,
        words=np.stack([_padded(t.words, longest) for t in things]),
        sizes=np.stack([_padded(t.sizes, most) for t in things]),
        categories=np.stack([_padded(t.categories, most) for t in things]),
        colors=np.stack([_padded(t.colors, most) for t in things]),
        held_out=apart,
        tools=np.concatenate([_tools(e.record)[e.rows] for e in episodes]),
        poses=np.concatenate([_poses(e.record, most)[e.rows] for e in episodes]),
        actions=np.concatenate([e.actions for e in episodes]).astype(np.float32),
        episodes=np.repeat(np.arange(len(episodes)), steps),
        first=ends - steps,
        last=ends - 1,
        phases=np.concatenate([_phases(e.record)[e.rows] for e in episodes]),
        at_gripper=np.concatenate([_at_gripper(e.actions[:, -1], recipe.chunk) for e in episodes]),
        shown=np.concatenate([np.arange(len(e.actions)) % recipe.every == 0 for e in episodes]),
    )


def _of_start(start: str, shown: Vocabulary) -> Vocabulary:
    """Return the vocabulary of the initial checkpoint.

    Check that it contains all words, categories and colors of the data.
    """
    from betterbench.policies.learned.checkpoint import checkpoint_file, read_vocabulary  # noqa: PLC0415 - needs torch

    known = read_vocabulary(checkpoint_file(start))
    for what, theirs, ours in (
        ("word", known.words, shown.words),
        ("category", known.categories, shown.categories),
        ("color", known.colors, shown.colors),
    ):
        strange = sorted(set(ours) - set(theirs))
        if strange:
            problem = f"its vocabulary lacks the {what} {strange[0]!r} of the data"
            raise InvalidInputError(
                f"start: {start}", problem, "Start from a checkpoint whose training data contain all of them"
            )
    if known.answers != shown.answers:
        problem = "its answers differ from those of co_training"
        raise InvalidInputError(f"start: {start}", problem, "Start from a checkpoint with the same co_training")
    return known


def _padded(values: np.ndarray, most: int) -> np.ndarray:
    """Pad the values of objects or words, (n, ...), with zeros to the length ``most``."""
    filled = np.zeros((most, *values.shape[1:]), dtype=values.dtype)
    filled[: len(values)] = values
    return filled


def _tools(record: Record) -> np.ndarray:
    rows = slice(0, record.n_steps)
    return tool_numbers(record.ee_position[rows], record.ee_quaternion[rows], record.finger_width[rows])


def _poses(record: Record, most: int) -> np.ndarray:
    rows = slice(0, record.n_steps)
    poses = pose_numbers(record.object_positions[rows], record.object_quaternions[rows])
    filled = np.zeros((len(poses), most, poses.shape[-1]), dtype=np.float32)
    filled[:, : poses.shape[1]] = poses
    return filled


def _phases(record: Record) -> np.ndarray:
    """Return the phase of each frame: the skill that is executed, or the motion between two skills.

    The skills are taken from the record. If the record does not contain them, they are computed from its states.
    """
    meta = record.metadata
    segments = meta.segments or subgoal_segments(record, resolve_condition(meta.task, meta.condition).condition)
    closed = record.gripper_command[: record.n_steps] > 0.0
    phases = np.where(closed, PHASES.index("carry"), PHASES.index("move"))
    for segment in segments:
        for skill in segment.skills:
            phases[skill.start : skill.stop] = PHASES.index(skill.kind)
    return phases.astype(np.int64)


def _at_gripper(gripper: np.ndarray, chunk: int) -> np.ndarray:
    """Return an (n,) bool mask of the frames with an action chunk that contains a gripper change."""
    found = np.zeros(len(gripper), dtype=bool)
    for change in np.flatnonzero(np.diff(gripper)) + 1:
        found[max(0, change - chunk + 1) : change + 1] = True
    return found


def scales_of(data: TrainingSet) -> dict[str, np.ndarray]:
    """Return the mean and the scale of tool poses, object positions and actions over the training frames, float32.

    For actions, the mean and the scale map the 1st and 99th percentiles to -1 and 1. The scales have lower limits, so
    that values that are nearly constant are not amplified.
    """
    frames = data.frames(held_out=False)
    tools, actions = data.tools[frames].astype(np.float64), data.actions[frames].astype(np.float64)
    there = data.categories[data.episodes[frames]] != 0
    positions = data.poses[frames][there][:, :3].astype(np.float64)
    low, high = np.quantile(actions, [0.01, 0.99], axis=0)
    middle, half = (low + high) / 2.0, np.maximum((high - low) / 2.0, 0.1)
    middle[-1], half[-1] = 0.0, 1.0
    found = {
        "tool_mean": tools.mean(axis=0),
        "tool_scale": np.maximum(tools.std(axis=0), 0.01),
        "position_mean": positions.mean(axis=0),
        "position_scale": np.maximum(positions.std(axis=0), 0.05),
        "action_mean": middle,
        "action_scale": half,
    }
    return {name: values.astype(np.float32) for name, values in found.items()}


def epochs_of(data: TrainingSet, recipe: TrainingRecipe) -> float:
    """Return the number of epochs, i.e. how many times training uses each frame on average."""
    return recipe.steps * recipe.batch / len(data.frames(held_out=False))
