"""Work that a study delegates: making demonstrations, and training, evaluating and diagnosing learners."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from betterbench.demonstrations.making.production import set_hash
from betterbench.demonstrations.sets.build import DEMONSTRATIONS, make_dataset
from betterbench.demonstrations.sets.recipe import SetRecipe
from betterbench.diagnosis import diagnose_run, stored
from betterbench.errors import RecordError
from betterbench.evaluation import Progress, evaluate, make_plan
from betterbench.evaluation.figures.views import ViewRenderer
from betterbench.learning.study.learning import OnWork, TrainedPolicy, TrainingJob, train_learners
from betterbench.learning.study.outcomes import TrialOutcome, outcomes_of
from betterbench.learning.training.data import require_questions
from betterbench.policies.learned.loading import require_torch
from betterbench.policies.learned.recipe import TrainingRecipe
from betterbench.records import RunFolder
from betterbench.vqa import SetOptions
from betterbench.vqa import make_set as make_question_set

QUESTIONS = SetOptions(cameras=("front",), quality="fast")
"""Options of the question sets about demonstrations. They use one camera, because the questions do not name the camera.
"""


@dataclass(frozen=True, slots=True)
class Workshop:
    """Functions that do the work of a study. If one of them was interrupted, calling it again resumes the work.

    Attributes:
        make_set: Makes a demonstration set according to a recipe, writes it into a folder, and returns its hash.
        require_questions: Raises an error if the question sets of a recipe are about other demonstrations.
        ask: Writes approximately the given number of questions about a demonstration set into a folder, and returns
            their hash.
        train: Trains learners, several of them in parallel.
        evaluate: Evaluates a policy on a task, with the given number of trials per variation, writes the run into a
            folder, and diagnoses the trials. Raises an error if the weights do not match their digest.
        threads: Total number of threads for learners that are trained in parallel.
        require_set: Raises an error if the demonstration set in a folder does not match a hash.
    """

    make_set: Callable[[SetRecipe, Path, OnWork], str]
    require_questions: Callable[[TrainingRecipe], None]
    ask: Callable[[Path, int, Path, OnWork], str]
    train: Callable[[Sequence[TrainingJob], OnWork], tuple[TrainedPolicy, ...]]
    evaluate: Callable[[TrainedPolicy, str, int, Path, OnWork], tuple[TrialOutcome, ...]]
    threads: int = 1
    require_set: Callable[[Path, str], None] = lambda place, sha256: None  # noqa: ARG005 - for sets without runs


def usual_workshop(*, workers: int = 1, device: str = "cpu") -> Workshop:
    """Return the functions with which a study makes training sets, trains and evaluates on this machine.

    Raises MissingDependencyError if torch is not installed.
    """
    require_torch("better study")

    def make_set(recipe: SetRecipe, out: Path, tell: OnWork) -> str:
        made = make_dataset(
            recipe, out, workers=workers, pictures=False, on_progress=lambda stage, d, n, _: tell(d, n, stage)
        )
        return made.sha256

    def asked(source: Path, questions: int, out: Path, tell: OnWork) -> str:
        run, options = RunFolder.open(source / DEMONSTRATIONS), replace(QUESTIONS, questions=questions)
        made = make_question_set(
            run,
            out,
            options,
            open_photos=lambda: ViewRenderer(run, size=options.size, quality=options.quality),
            workers=workers,
            on_progress=lambda done, planned: tell(done, planned, "questions"),
        )
        return made.sha256

    def evaluated(policy: TrainedPolicy, task: str, trials: int, out: Path, tell: OnWork) -> tuple[TrialOutcome, ...]:
        plan = make_plan(
            policy.address, tasks=(task,), trials=trials, observation=policy.observation, quality=policy.quality
        )

        def on_progress(progress: Progress) -> None:
            tell(progress.done, progress.planned, "trials")

        policy.require()
        run = evaluate(plan, out, workers=workers, on_progress=on_progress)
        policy.require()  # checked again, because the workers read the file during the run
        _require_evaluated(run, policy)
        found = diagnose_run(run, on_progress=lambda done, of: tell(done, of, "diagnosis"))
        stored.store_diagnosis(run, found)
        return outcomes_of(found)

    def trained(jobs: Sequence[TrainingJob], tell: OnWork) -> tuple[TrainedPolicy, ...]:
        return train_learners(jobs, device, tell, workers=workers)

    # On a GPU, learners would not run in parallel but take turns.
    threads = workers if device == "cpu" else 1
    return Workshop(make_set, require_questions, asked, trained, evaluated, threads, _require_set)


def _require_set(place: Path, sha256: str) -> None:
    """Raise RecordError if the demonstrations of a set have changed since it was made."""
    if set_hash(RunFolder.open(place / DEMONSTRATIONS)) != sha256:
        raise RecordError(
            f"{place}: the set contains demonstrations that this study did not make. Restore the original set, or run "
            "a new study in another folder. Nothing was deleted."
        )


def _require_evaluated(run: RunFolder, policy: TrainedPolicy) -> None:
    """Raise RecordError if a run used other weights than those of the learner, or does not state its weights."""
    told = run.context.get("policy")
    metadata = told.get("metadata") if isinstance(told, Mapping) else None
    checkpoint = metadata.get("checkpoint") if isinstance(metadata, Mapping) else None
    if checkpoint != f"sha256 {policy.digest}" or run.context.get("policy_changes"):
        raise RecordError(
            f"{run.path}: this run did not use the weights of {policy.address} that the study trained. Rename or "
            f"delete the folder, and run the same command again to evaluate these weights."
        )
