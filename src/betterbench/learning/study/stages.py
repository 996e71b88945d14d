"""Stages of a study, in this order: demonstration sets, question sets, training and evaluation of the learners.

``OUT/stages/NAME.json`` marks a complete stage. It contains the outputs of the stage, a hash of its inputs, and a
checksum. Finished work is never repeated. An interrupted stage is resumed, and the interruption does not change the
resulting files. Before a stage uses the output of another stage, the output is verified against this file.
"""

from __future__ import annotations

import hashlib
import itertools
import json
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

from pydantic import TypeAdapter

from betterbench.certification.refusal import require_certified
from betterbench.demonstrations.sets.recipe import SetRecipe
from betterbench.errors import RecordError
from betterbench.evaluation import make_plan
from betterbench.jobs import job_folder, write_durably
from betterbench.jobs.durable import on_disk
from betterbench.json_form import open_form, open_seal, read_bounded, read_form, sealed_form, strict_form
from betterbench.learning.study.learning import OnWork, TrainedPolicy, TrainingJob
from betterbench.learning.study.outcomes import LearnerOutcome, TrialOutcome, read_trials, trials_form
from betterbench.learning.study.plan import PlannedLearner, StudyPlan
from betterbench.learning.study.work import Workshop
from betterbench.policies.kinds.learned import learned_address
from betterbench.policies.learned.recipe import TrainingRecipe
from betterbench.tasks import get_task
from betterbench.tasks.interventions.regimes import Regime, conditions_of
from betterbench.tasks.user_files import code_of
from betterbench.vqa import read_set

STAGES = "stages"
_MAX_BYTES = 64 << 20
_HERE = "{study}"
"""Placeholder for the study folder in stored paths, so that the folder can be moved."""
_CURE = "Delete the file to check the stage again; its output is kept"


@dataclass(frozen=True, slots=True)
class StudyProgress:
    """Progress of a study.

    Attributes:
        number: Number of the current stage, from 1.
        stages: Total number of stages.
        name: Name of the current stage.
        done: Number of finished units of work in this stage.
        planned: Total number of units of work in this stage; 0 if unknown.
        note: Description of the current work.
    """

    number: int
    stages: int
    name: str
    done: int = 0
    planned: int = 0
    note: str = ""


OnStudy = Callable[[StudyProgress], None]


@dataclass(frozen=True, slots=True)
class StudyOutcome:
    """Measurements of a complete study.

    Attributes:
        plan: Plan of the study.
        learners: All learners with their trials.
        predictions: For each task, the folder of its confounded demonstrations, which contains the predicted failures
            (prediction.json).
        seconds: Duration of the stages by kind [s], without interrupted sessions.
    """

    plan: StudyPlan
    learners: tuple[LearnerOutcome, ...]
    predictions: Mapping[str, Path]
    seconds: Mapping[str, float]


@strict_form
@dataclass(frozen=True, slots=True)
class _Done:
    """Content of the file that marks a stage as complete."""

    inputs: str
    output: dict[str, Any]
    seconds: float
    version: Literal[2] = 2


@open_form
@dataclass(frozen=True, slots=True)
class _Hashed:
    sha256: str


@open_form
@dataclass(frozen=True, slots=True)
class _Learned:
    address: str
    digest: str


@open_form
@dataclass(frozen=True, slots=True)
class _Evaluated:
    trials: tuple[TrialOutcome, ...]


_DONE = TypeAdapter(_Done)
_OUTPUTS: Mapping[str, TypeAdapter[Any]] = {
    "sets": TypeAdapter(_Hashed),
    "questions": TypeAdapter(_Hashed),
    "learners": TypeAdapter(_Learned),
    "runs": TypeAdapter(_Evaluated),
}
"""Format of the output for each kind of stage."""


def run_study(
    plan: StudyPlan,
    out: Path,
    workshop: Workshop,
    *,
    certificate: Path | None = None,
    on_progress: OnStudy | None = None,
) -> StudyOutcome:
    """Run all unfinished stages of a plan, and return the measurements.

    A study can be continued in the same folder with a larger plan.

    Args:
        plan: Plan of the study.
        out: Folder of the study.
        workshop: Functions that do the work.
        certificate: Certificate of the trials, or its folder. The default is the certificate in the package.
        on_progress: Called during the stages.

    Raises:
        RunConflictError: If another process uses the folder, or the folder contains a stage of another plan.
        InvalidInputError: If a trial is not certified.
        StorageError: If the disk is full, or the folder was removed or renamed during the study.
        BetterError: If a stage fails. Earlier results are kept.
    """
    out = out.absolute()
    require_certified(make_plan("expert", tasks=plan.tasks, trials=plan.trials), certificate)
    with job_folder(out):
        return _Study(plan, out, workshop, on_progress).run()


@dataclass(frozen=True, slots=True)
class _Learning:
    """Learner with everything needed to train it.

    Attributes:
        learner: The learner.
        job: Training job of the learner.
        inputs: Hash of all inputs that determine the weights.
    """

    learner: PlannedLearner
    job: TrainingJob
    inputs: str


class _Study:
    """Study in progress."""

    def __init__(self, plan: StudyPlan, out: Path, workshop: Workshop, on_progress: OnStudy | None) -> None:
        self._plan, self._out, self._workshop, self._on_progress = plan, out, workshop, on_progress
        self._learners = tuple(plan.learners())
        self._sets = dict(self._all_sets())
        self._questions = dict(self._all_questions())
        self._stages = len(self._sets) + len(self._questions) + 2 * len(self._learners)
        self._number = 0
        self._seconds: dict[str, float] = {}
        self._digests: dict[PlannedLearner, str] = {}
        self._hashes: dict[str, str] = {}

    def _all_sets(self) -> Iterator[tuple[str, SetRecipe]]:
        """Yield the name and the recipe of each demonstration set that is needed. Several learners can share a set."""
        for learner in self._learners:
            for regime, demos in self._plan.sets_of(learner.arm).items():
                yield self._set_name(learner.task, regime, demos), self._set_recipe(learner.task, regime, demos)

    def _all_questions(self) -> Iterator[tuple[str, tuple[str, int]]]:
        """Yield each question set that is needed, as its name, its demonstration set and its number of questions."""
        for learner in self._learners:
            if asked := self._plan.questions_of(learner):
                yield from ((_asked_name(name, asked), (name, asked)) for name in self._sets_of(learner))

    def _sets_of(self, learner: PlannedLearner) -> list[str]:
        return [self._set_name(learner.task, r, n) for r, n in self._plan.sets_of(learner.arm).items()]

    def _folders_of(self, learner: PlannedLearner) -> tuple[str, ...]:
        return tuple(str(self._out / "sets" / name) for name in self._sets_of(learner))

    def _set_name(self, task: str, regime: Regime, demos: int) -> str:
        return f"{task}-{regime}" + ("" if demos == self._plan.demos else f"-{demos}")

    def _set_recipe(self, task: str, regime: Regime, demos: int) -> SetRecipe:
        plan = self._plan
        return SetRecipe((task,), regime, demos, min(plan.sources, demos), noise=plan.noise)

    def run(self) -> StudyOutcome:
        """Run all stages: first the demonstration sets and question sets, then the learners.

        As many learners as possible are trained in parallel.
        """
        self._require_questions()
        hashes = {name: self._make_set(name, recipe) for name, recipe in self._sets.items()}
        self._hashes = hashes
        for recipe in self._asked_elsewhere():
            self._workshop.require_questions(recipe)
        asked = {name: self._ask(name, *about, hashes) for name, about in self._questions.items()}
        found: list[LearnerOutcome] = []
        while len(found) < len(self._learners):
            group = self._side_by_side(self._learners[len(found) :], hashes | asked)
            policies = self._train(group)
            found += [self._evaluate(one.learner, policy) for one, policy in zip(group, policies, strict=True)]
        confounded = (self._set_name(task, "training", self._plan.demos) for task in self._plan.tasks)
        folders = {n.rpartition("-")[0]: self._out / "sets" / n for n in confounded if n in hashes}
        return StudyOutcome(self._plan, tuple(found), folders, dict(self._seconds))

    def _require_questions(self) -> None:
        """Raise an error early if a question set that the plan names cannot be read."""
        asked = (recipe.co_training.sets for recipe in self._asked_elsewhere() if recipe.co_training is not None)
        for place in dict.fromkeys(itertools.chain.from_iterable(asked)):
            read_set(Path(place))

    def _asked_elsewhere(self) -> Iterator[TrainingRecipe]:
        """Yield a recipe for each combination of demonstrations and existing question sets that occurs in the plan."""
        seen = set()
        for learner in (one for one in self._learners if not self._plan.questions_of(one)):
            data = self._folders_of(learner)
            recipe = self._plan.recipe_of(learner, data)
            if recipe.co_training is not None and (pair := (data, recipe.co_training.sets)) not in seen:
                seen.add(pair)
                yield recipe

    def _make_set(self, name: str, recipe: SetRecipe) -> str:
        form = {**asdict(recipe), "conditions": _conditions(recipe)}
        found = self._stage(
            "sets",
            name,
            form,
            lambda tell: {"sha256": self._workshop.make_set(recipe, self._out / "sets" / name, tell)},
        )
        return str(found["sha256"])

    def _ask(self, name: str, about: str, count: int, hashes: Mapping[str, str]) -> str:
        """Make the questions about a demonstration set, and return the hash of the question set."""
        source, out = (self._out / kind / of for kind, of in (("sets", about), ("questions", name)))
        found = self._stage(
            "questions",
            name,
            {"set": hashes[about], "questions": count},
            lambda tell: {"sha256": self._workshop.ask(source, count, out, tell)},
        )
        return str(found["sha256"])

    def _side_by_side(self, learners: Sequence[PlannedLearner], hashes: Mapping[str, str]) -> list[_Learning]:
        """Return the learners to train next, with their inputs.

        The number of learners is limited by the number of threads.
        """
        group: list[_Learning] = []
        threads = 0
        for learner in learners:
            if self._plan.start_of(learner) in [one.learner for one in group]:
                break  # this learner starts from the weights of a learner in the same group
            one = self._learning(learner, hashes)
            threads += one.job.recipe.threads
            if group and threads > self._workshop.threads:
                break
            group.append(one)
        return group

    def _learning(self, learner: PlannedLearner, hashes: Mapping[str, str]) -> _Learning:
        names, count = self._sets_of(learner), self._plan.questions_of(learner)
        asked = [_asked_name(name, count) for name in names] if count else []
        questions = tuple(str(self._out / "questions" / name) for name in asked)
        start = self._plan.start_of(learner)
        place = str(self._out / "learners" / start.name) if start is not None else ""
        data = self._folders_of(learner)
        recipe = self._plan.recipe_of(learner, data, start=place, questions=questions)
        form = {**recipe.to_json(), "data": names}
        inputs: dict[str, Any] = {"recipe": form, "sets": [hashes[name] for name in names]}
        if (code := code_of("family", recipe.family)) is not None:
            inputs["learner"] = code
        if start is not None:
            form["start"], inputs["start"] = start.name, self._digests[start]
        if asked:
            form["co_training"]["sets"], inputs["questions"] = asked, [hashes[name] for name in asked]
        elif recipe.co_training is not None:
            inputs["questions"] = [read_set(Path(place)).sha256 for place in recipe.co_training.sets]
        begins_with = "" if start is None else self._digests[start]
        job = TrainingJob(recipe, self._out / "learners" / learner.name, begins_with)
        return _Learning(learner, job, _hash_of(inputs))

    def _train(self, group: Sequence[_Learning]) -> list[TrainedPolicy]:
        """Train the learners of a group that are not trained yet, and return the policies of all its learners."""
        self._number += len(group)
        due = [one for one in group if self._there("learners", one.learner.name, one.inputs) is None]
        for name in dict.fromkeys(name for one in due for name in self._sets_of(one.learner)):
            self._workshop.require_set(self._out / "sets" / name, self._hashes[name])
        if due:
            began = time.perf_counter()
            names = ", ".join(one.learner.name for one in due)
            made = self._workshop.train([one.job for one in due], self._teller(f"learner {names}"))
            seconds = (time.perf_counter() - began) / len(due)
            for one, policy in zip(due, made, strict=True):
                output = {"address": policy.address.replace(str(self._out), _HERE), "digest": policy.digest}
                self._keep("learners", one.learner.name, _Done(one.inputs, output, round(seconds, 1)))
        policies = []
        for one in group:
            output = self._counted("learners", one.learner.name, one.inputs)
            address = str(output["address"]).replace(_HERE, str(self._out))
            if address != learned_address(
                one.job.out
            ):  # another address could run any policy, even Python code from a file
                file = self._marker("learners", one.learner.name)
                raise RecordError(
                    f"{file}: output.address is not the address of the learner {one.learner.name}. {_CURE}."
                )
            policies.append(TrainedPolicy.of(address, str(output["digest"]), one.job.recipe))
            self._digests[one.learner] = policies[-1].digest
        return policies

    def _evaluate(self, learner: PlannedLearner, policy: TrainedPolicy) -> LearnerOutcome:
        """Evaluate one learner, and return it with its trials."""
        run = self._out / "runs" / learner.name

        def evaluate(tell: OnWork) -> dict[str, Any]:
            found = self._workshop.evaluate(policy, learner.task, self._plan.trials, run, tell)
            return {"trials": trials_form(found)}

        inputs = {"policy": policy.digest, "trials": self._plan.trials}
        found = self._stage("runs", learner.name, inputs, evaluate)
        where = str(self._marker("runs", learner.name))
        return LearnerOutcome(learner, read_trials(found.get("trials"), where))

    def _stage(
        self, kind: str, name: str, inputs: Mapping[str, Any], work: Callable[[OnWork], dict[str, Any]]
    ) -> dict[str, Any]:
        """Return the output of a stage. The stage is only run if it was not completed with the same inputs before."""
        self._number += 1
        hashed = _hash_of(inputs)
        if self._there(kind, name, hashed) is None:
            began = time.perf_counter()
            output = work(self._teller(f"{kind.removesuffix('s')} {name}"))
            self._keep(kind, name, _Done(hashed, output, round(time.perf_counter() - began, 1)))
        return self._counted(kind, name, hashed)

    def _teller(self, label: str) -> OnWork:
        """Report the start of a stage, and return a callback that reports its progress."""

        def tell(done: int, planned: int, note: str) -> None:
            if self._on_progress is not None:
                self._on_progress(StudyProgress(self._number, self._stages, label, done, planned, note))

        tell(0, 0, "")
        return tell

    def _marker(self, kind: str, name: str) -> Path:
        return self._out / STAGES / f"{kind}-{name}.json"

    def _there(self, kind: str, name: str, inputs: str) -> _Done | None:
        """Return the content of a stage's file, or None if the stage was not completed with the given inputs."""
        path = self._marker(kind, name)
        there = _read(path, kind) if path.exists() else None
        return there if there is not None and there.inputs == inputs else None

    def _keep(self, kind: str, name: str, done: _Done) -> None:
        path = self._marker(kind, name)
        with on_disk(path):
            write_durably(path, (json.dumps(sealed_form(asdict(done)), indent=1) + "\n").encode())

    def _counted(self, kind: str, name: str, inputs: str) -> dict[str, Any]:
        """Return the output of a complete stage, and add its duration to the total."""
        there = self._there(kind, name, inputs)
        if there is None:
            raise AssertionError(f"{kind} {name} is done")
        self._seconds[kind] = round(self._seconds.get(kind, 0.0) + there.seconds, 1)
        return there.output


def _asked_name(about: str, questions: int) -> str:
    """Return a name for a question set that differs from the names of all demonstration sets."""
    return f"{about}-{questions}-questions"


def _conditions(recipe: SetRecipe) -> list[list[Any]]:
    """Return the conditions of a demonstration set and the versions of its tasks. A changed task needs a new set."""
    tasks = [get_task(name) for name in recipe.tasks]
    shown = [(task.version, c) for task in tasks for c in conditions_of(task, recipe.regime)]
    return [[version, c.id, c.instruction.text, dict(c.layout)] for version, c in shown]


def _hash_of(inputs: Mapping[str, Any]) -> str:
    return hashlib.sha256(json.dumps(inputs, sort_keys=True).encode()).hexdigest()


def _read(path: Path, kind: str) -> _Done | None:
    """Read the file that marks a complete stage.

    Return None if an earlier version wrote the file, so that the stage is checked again.
    """
    data = read_bounded(path, max_bytes=_MAX_BYTES, cure=_CURE, raises=RecordError)
    form = open_seal(data, where=str(path), cure=_CURE, raises=RecordError, since=("version", 2))
    if "version" not in form:
        return None
    done = read_form(_DONE, form, where=str(path), cure=_CURE, raises=RecordError)
    read_form(_OUTPUTS[kind], done.output, where=f"{path}: output", cure=_CURE, raises=RecordError)
    return done
