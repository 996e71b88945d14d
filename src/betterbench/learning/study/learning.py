"""Train the learners of a study: a single learner in this process, or several learners in parallel processes.

The networks are small, so training a learner occupies a single CPU core. On two cores, training two learners in
parallel takes as long as training one.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from pathlib import Path

from betterbench.errors import BetterError, RecordError, TrainingError, described
from betterbench.jobs.lock import HeldFolder, held_folders
from betterbench.jobs.worker_process import SpawnedProcess, prepare_process
from betterbench.json_form import file_digest
from betterbench.policies.kinds.learned import LEARNED, learned_address
from betterbench.policies.learned.loading import FILE_NAME as CHECKPOINT
from betterbench.policies.learned.loading import checkpoint_of
from betterbench.policies.learned.recipe import TrainingRecipe
from betterbench.tasks.user_files import TaskFile, load_sources, loaded_files

_STOP_S = 5.0


OnWork = Callable[[int, int, str], None]
"""Callback that receives the number of finished units of work, the total number, and a note."""


@dataclass(frozen=True, slots=True)
class TrainedPolicy:
    """Trained learner that is evaluated as a policy.

    Attributes:
        address: Policy address, ``learned:FOLDER``.
        digest: SHA-256 of the checkpoint.
        observation: Observation preset for the evaluation.
        quality: Render preset for the evaluation.
    """

    address: str
    digest: str
    observation: str = "state_only"
    quality: str = "fast"

    def require(self) -> None:
        """Raise RecordError if the checkpoint has changed since the learner was trained."""
        require_weights(checkpoint_of(LEARNED.parse(self.address)), self.digest)

    @classmethod
    def of(cls, address: str, digest: str, recipe: TrainingRecipe) -> TrainedPolicy:
        """Return the policy that was trained by a recipe.

        The policy is evaluated with the same camera views as in training.
        """
        if recipe.sees != "pixels":
            return cls(address, digest)
        return cls(address, digest, recipe.eyes.observation, recipe.eyes.quality)


@dataclass(frozen=True, slots=True)
class TrainingJob:
    """Learner to train.

    Attributes:
        recipe: Training recipe.
        out: Folder for the training run.
        begins_with: SHA-256 of the checkpoint that provides the initial weights; "" if it is unknown or there is none.
    """

    recipe: TrainingRecipe
    out: Path
    begins_with: str = ""


class _Learner(SpawnedProcess):
    """Process that trains a learner, with its latest progress."""

    def __init__(self, job: TrainingJob, device: str) -> None:
        super().__init__(_learn, job, device, loaded_files(), held_folders(), name="betterbench-learner")
        self.job = job
        self.done = self.planned = 0  # numbers of training steps
        self.note = ""  # the latest message
        self.policy: TrainedPolicy | None = None


def train_learners(
    jobs: Sequence[TrainingJob], device: str, tell: OnWork, *, workers: int = 1
) -> tuple[TrainedPolicy, ...]:
    """Train learners in parallel, and return the trained policies in the order of the jobs.

    A single job is trained in this process.

    Before the training, ``workers`` processes render the frames for learners of the ``pixels`` family.

    Raises:
        TrainingError: If a process dies.
        BetterError: If a job fails. The other jobs are stopped too, and everything that was saved is kept.
    """
    for job in jobs:
        _draw(job, tell, workers)
    if len(jobs) == 1:
        return (_train(jobs[0], device, tell),)
    learners = [_Learner(job, device) for job in jobs]
    try:
        while any(learner.policy is None for learner in learners):
            at_work = {learner.connection: learner for learner in learners if learner.policy is None}
            for link in wait(list(at_work)):
                _listen(at_work[link])  # type: ignore[index]
            tell(
                sum(p.done for p in learners),
                sum(p.planned for p in learners),
                ", ".join(p.note for p in learners if p.note),
            )
    finally:
        for learner in learners:  # the processes that are still running save their state
            learner.end(_STOP_S if learner.policy is not None else 0.0)
    return tuple(learner.policy for learner in learners if learner.policy is not None)


def _listen(learner: _Learner) -> None:
    """Handle one message from a training process.

    Raise the error that the process reports, or TrainingError if the process ended without a message.
    """
    try:
        said = learner.connection.recv()
    except (EOFError, OSError):
        how = learner.end(_STOP_S)
        raise TrainingError(
            f"the process that trained {learner.job.out.name} has ended ({how}). Its saved state is kept. "
            f"Running the command again resumes the training. If the memory was full, use fewer --workers."
        ) from None
    if isinstance(said, BaseException):
        raise said
    if isinstance(said, TrainedPolicy):
        learner.policy, learner.done = said, learner.planned
    else:
        learner.done, learner.planned, learner.note = said


def _learn(
    job: TrainingJob, device: str, files: Sequence[TaskFile], held: Sequence[HeldFolder], link: Connection
) -> None:
    """Train one learner and report the progress. This is the main function of a training process."""
    prepare_process(held)
    with contextlib.suppress(BrokenPipeError, ConnectionResetError):  # the parent process has ended
        try:
            load_sources(files)
            link.send(_train(job, device, lambda *said: link.send(said)))
        except BetterError as problem:
            link.send(problem)
        except (BrokenPipeError, ConnectionResetError):
            raise
        except Exception as problem:  # noqa: BLE001 - sent to the parent process, which raises it
            link.send(TrainingError(f"{job.out.name}: {described(problem)}"))


def _draw(job: TrainingJob, tell: OnWork, workers: int) -> None:
    """Render the missing frames of a ``pixels`` learner before several processes need them."""
    if job.recipe.sees != "pixels":
        return
    from betterbench.learning.training.data import read_training_set  # noqa: PLC0415 - needs torch

    read_training_set(
        job.recipe,
        on_read=lambda done, of: tell(done, of, "reading"),
        workers=workers,
        on_drawn=lambda done, of: tell(done, of, "drawing frames"),
    )


def require_weights(place: Path, digest: str) -> None:
    """Raise RecordError if a checkpoint differs from the checkpoint that the study trained.

    Args:
        place: Checkpoint file, or the folder that contains it.
        digest: SHA-256 of the checkpoint that the study trained.
    """
    path = place / CHECKPOINT if place.is_dir() else place
    there = file_digest(path) if path.is_file() else None
    if there != digest:
        problem = "it is missing" if there is None else "it contains other weights than those trained by this study"
        raise RecordError(
            f"{path}: {problem}. Put the checkpoint back, or run a new study in another folder; nothing was deleted."
        )


def _train(job: TrainingJob, device: str, tell: OnWork) -> TrainedPolicy:
    """Train a learner in this process. Raises the errors of the training loop."""
    if job.begins_with and job.recipe.start is not None:
        require_weights(Path(job.recipe.start), job.begins_with)
    from betterbench.learning.training.data import read_training_set  # noqa: PLC0415 - needs torch
    from betterbench.learning.training.loop import train  # noqa: PLC0415

    data = read_training_set(job.recipe, on_read=lambda done, of: tell(done, of, "reading"))
    result = train(
        job.recipe, data, job.out, device=device, on_progress=lambda p: tell(p.step, p.steps, f"loss {p.loss:.4f}")
    )
    return TrainedPolicy.of(learned_address(job.out), file_digest(result.checkpoint), job.recipe)
