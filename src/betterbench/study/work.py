"""What a study lets others do: make a training set, train a learner, evaluate and diagnose it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from betterbench.datasets.build import make_dataset
from betterbench.datasets.recipe import SetRecipe
from betterbench.diagnosis import diagnose_run, stored
from betterbench.evaluation import Progress, evaluate, make_plan
from betterbench.learned.address import PREFIX, require_torch
from betterbench.learned.recipe import TrainingRecipe
from betterbench.recording.parquet import file_digest
from betterbench.study.outcomes import TrialOutcome, outcomes_of

OnWork = Callable[[int, int, str], None]
"""Called with how much of a piece of work is done, of how much, and a note."""


@dataclass(frozen=True, slots=True)
class TrainedPolicy:
    """A learner that is ready.

    Attributes:
        address: Address of the policy.
        digest: Hash of what it is.
    """

    address: str
    digest: str


@dataclass(frozen=True, slots=True)
class Workshop:
    """Who does the work of a study; each goes on where it was interrupted.

    Attributes:
        make_set: Makes the set of a recipe in a folder and returns its hash.
        train: Trains by a recipe in a folder.
        evaluate: Evaluates a policy on a task, so many trials per variation, in a folder, and diagnoses it.
    """

    make_set: Callable[[SetRecipe, Path, OnWork], str]
    train: Callable[[TrainingRecipe, Path, OnWork], TrainedPolicy]
    evaluate: Callable[[TrainedPolicy, str, int, Path, OnWork], tuple[TrialOutcome, ...]]


def usual_workshop(*, workers: int = 1, device: str = "cpu") -> Workshop:
    """Return the workshop of this machine; MissingDependencyError if torch is not installed."""
    require_torch("better study")

    def make_set(recipe: SetRecipe, out: Path, tell: OnWork) -> str:
        made = make_dataset(
            recipe, out, workers=workers, pictures=False, on_progress=lambda stage, d, n, _: tell(d, n, stage)
        )
        return made.sha256

    def evaluated(policy: TrainedPolicy, task: str, trials: int, out: Path, tell: OnWork) -> tuple[TrialOutcome, ...]:
        plan = make_plan(policy.address, tasks=(task,), trials=trials, observation="state_only", quality="fast")

        def on_progress(progress: Progress) -> None:
            tell(progress.done, progress.planned, "trials")

        run = evaluate(plan, out, workers=workers, on_progress=on_progress)
        found = diagnose_run(run, on_progress=lambda done, of: tell(done, of, "diagnosis"))
        stored.store_diagnosis(run, found)
        return outcomes_of(found)

    return Workshop(make_set, _trainer(device), evaluated)


def _trainer(device: str) -> Callable[[TrainingRecipe, Path, OnWork], TrainedPolicy]:
    def trained(recipe: TrainingRecipe, out: Path, tell: OnWork) -> TrainedPolicy:
        from betterbench.training.data import read_training_set  # noqa: PLC0415 - needs torch
        from betterbench.training.loop import train  # noqa: PLC0415

        data = read_training_set(recipe, on_read=lambda done, of: tell(done, of, "reading"))
        result = train(
            recipe, data, out, device=device, on_progress=lambda p: tell(p.step, p.steps, f"loss {p.loss:.4f}")
        )
        return TrainedPolicy(f"{PREFIX}{out}", file_digest(result.checkpoint))

    return trained
