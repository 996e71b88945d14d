"""Plan of a study: tasks, arms (mixtures of training distributions), training seeds, and recipe changes (levers)."""

from __future__ import annotations

import itertools
import json
import math
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, field
from importlib import resources
from typing import Annotated, Any, Literal

from pydantic import Field, TypeAdapter

from betterbench.errors import InvalidInputError, require_between
from betterbench.json_form import read_form, strict_form
from betterbench.learning.study.vocabulary import never_shown_before
from betterbench.policies.learned.recipe import TrainingRecipe, read_training_recipe
from betterbench.tasks import get_task
from betterbench.tasks.interventions.regimes import Regime, conditions_of
from betterbench.vqa.dataset import MOST_QUESTIONS

CURE = "Correct the plan; see docs/learned.md for an example"
PRESETS = ("small", "full", "levers", "doses", "diverse")
OWN_FIELDS = ("data", "tasks", "seed", "variations", "start")
"""Fields of the training recipe that the study sets itself."""
MOST_LEARNERS = 1000
MOST_TRIALS = 200_000
"""Maximum number of trials for all learners with the same seed.

All of these trials are planned before the first trial is run.
"""
_SUM_SLACK = 1e-6

_Name = Annotated[str, Field(pattern=r"^[a-z0-9][a-z0-9_.-]{0,39}$")]
_Share = Annotated[float, Field(gt=0.0, le=1.0)]
RegimeShares = Annotated[dict[Regime, _Share], Field(min_length=1)]
"""Fractions of an arm's demonstrations that come from each training distribution (regime)."""

ROLES: Mapping[str, dict[Regime, float]] = {
    "confounded": {"training": 1.0},
    "balanced": {"balanced": 1.0},
    "covered": {"covered": 1.0},
    "diverse-confounded": {"diverse-confounded": 1.0},
}
"""Fractions of the training distributions that define each role in the findings.

Every arm with these fractions has the role. Its name does not matter.
"""
USUAL_ARMS = ("confounded", "balanced", "covered")
"""Default arms of a plan. All tasks of the suite support them."""


@strict_form
@dataclass(frozen=True, slots=True)
class Lever:
    """Change to the training recipe. Learners with the change are compared with learners without it.

    Attributes:
        name: Name that is used in file names and tables.
        changes: Changed fields of the recipe.
        arms: Arms that are trained with this change; empty for all arms.
        tasks: Tasks that are trained with this change; empty for all tasks.
        start: Arm that provides the initial weights. They are taken from the learner of this arm that has the same task
            and training seed and the unchanged recipe. ``changes`` may then freeze parts of the weights. None for
            random initial weights.
        against: Lever to compare with, which must have the same arms and tasks. None to compare with the unchanged
            recipe.
        questions: Approximate number of co-training questions about the demonstrations from each training distribution
            of the arm. The study makes the questions. ``co_training`` in ``changes`` may set their weight.
    """

    name: _Name
    changes: dict[str, Any]
    arms: tuple[_Name, ...] = ("confounded",)
    tasks: tuple[str, ...] = ()
    start: _Name | None = None
    against: _Name | None = None
    questions: Annotated[int, Field(ge=0, le=MOST_QUESTIONS)] = 0


@dataclass(frozen=True, slots=True, order=True)
class PlannedLearner:
    """Learner that a study trains. ``lever`` names the change to the recipe; it is "" for the unchanged recipe."""

    task: str
    arm: str
    seed: int
    lever: str = ""

    @property
    def name(self) -> str:
        """Name of the learner, which is used for files and folders."""
        return "-".join(part for part in (self.task, self.arm, self.lever, f"seed{self.seed}") if part)


def _usual_arms() -> dict[str, dict[Regime, float]]:
    return {arm: dict(ROLES[arm]) for arm in USUAL_ARMS}


@strict_form
@dataclass(frozen=True, slots=True)
class StudyPlan:
    """Plan of a study.

    Attributes:
        tasks: Names of the tasks.
        arms: For each arm, the fractions of its demonstrations that come from each training distribution. An arm that
            mixes two distributions has a confound in only a part of its demonstrations (the dose).
        seeds: Training seeds. Each combination of task and arm is trained with each seed.
        demos: Demonstrations per training condition. Other training distributions divide the same total among their own
            conditions.
        sources: Number of expert demonstrations that are used to generate the others; 0 if the expert makes all
            demonstrations.
        noise: Noise on the executed actions of generated demonstrations, in action units.
        trials: Number of trials of each learner per variation. All training conditions together get the same number of
            trials.
        recipe: Fields of the training recipe that differ from the defaults.
        levers: Changes to the recipe. Each of them is applied separately.
    """

    tasks: Annotated[tuple[str, ...], Field(min_length=1)]
    arms: Annotated[dict[_Name, RegimeShares], Field(min_length=1)] = field(default_factory=_usual_arms)
    seeds: Annotated[tuple[Annotated[int, Field(ge=0, le=2**31 - 1)], ...], Field(min_length=1)] = (0, 1, 2)
    demos: int = 50
    sources: int = 10
    noise: float = 0.02
    trials: int = 10
    recipe: dict[str, Any] = field(default_factory=dict)
    levers: tuple[Lever, ...] = ()
    version: Literal[1] = 1

    def __post_init__(self) -> None:
        """Raise InvalidInputError if the plan is invalid."""
        for name, least, most in (("demos", 1, 10_000), ("sources", 0, 10_000), ("trials", 1, 10_000)):
            require_between(name, getattr(self, name), least, most)
        require_between("noise", self.noise, 0.0, 0.5)
        for name, listed in (("tasks", self.tasks), ("seeds", self.seeds), ("levers", [v.name for v in self.levers])):
            if len(set(listed)) < len(listed):
                raise InvalidInputError(name, "an entry occurs twice", "List each entry once")
        self._require_few()
        for task in map(get_task, self.tasks):
            for regime in {regime for shares in self.arms.values() for regime in shares}:
                conditions_of(task, regime)
        for arm, shares in self.arms.items():
            if abs(sum(shares.values()) - 1.0) > _SUM_SLACK:
                raise InvalidInputError(
                    f"arms.{arm}", "the fractions do not add up to 1", "Change them so that they add up to 1"
                )
            if len(shares) > self.demos:
                problem = f"{self.demos} demonstrations are too few for {len(shares)} training distributions"
                raise InvalidInputError(f"arms.{arm}", problem, "Increase the field demos")
        self.recipe_of(PlannedLearner(self.tasks[0], next(iter(self.arms)), self.seeds[0]), ("data",))
        for i, lever in enumerate(self.levers):
            _require_known(f"levers[{i}].arms", lever.arms, self.arms)
            _require_known(f"levers[{i}].tasks", lever.tasks, self.tasks)
            _require_known(f"levers[{i}].start", () if lever.start is None else (lever.start,), self.arms)
            self._require_comparable(f"levers[{i}].against", lever)
            changed = PlannedLearner(self.tasks[0], next(iter(self.arms)), self.seeds[0], lever.name)
            self._require_weights_fit(changed, self.recipe_of(changed, ("data",)))
            self._require_words_known(f"levers[{i}].start", lever)
        names = Counter(learner.name for learner in self.learners())
        twice = next((name for name, times in names.items() if times > 1), None)
        if twice is not None:
            raise InvalidInputError("levers", f"two learners would be named {twice}", "Rename the arm or the lever")

    def _require_few(self) -> None:
        """Raise InvalidInputError if the plan has too many learners or too many trials."""
        plain = len(self.tasks) * len(self.arms)
        levered = sum(len(v.tasks or self.tasks) * len(v.arms or self.arms) for v in self.levers)
        learners = len(self.seeds) * (plain + levered)
        if learners > MOST_LEARNERS:
            raise InvalidInputError(
                "seeds", f"the plan has {learners} learners", f"Plan at most {MOST_LEARNERS} learners"
            )
        most = max(len(get_task(task).variations) for task in self.tasks) + 1
        if len(self.tasks) * most * self.trials > MOST_TRIALS:
            problem = f"{self.trials} trials per variation are more than {MOST_TRIALS} for all learners of a seed"
            raise InvalidInputError("trials", problem, "Plan fewer trials or tasks")

    def learners(self) -> Iterator[PlannedLearner]:
        """Yield all learners, ordered by seed, so that an unfinished study already covers all arms."""
        for seed in self.seeds:
            yield from (PlannedLearner(task, arm, seed) for task in self.tasks for arm in self.arms)
        for lever in self.levers:
            for seed in self.seeds:
                for task in lever.tasks or self.tasks:
                    yield from (PlannedLearner(task, arm, seed, lever.name) for arm in lever.arms or self.arms)

    def start_of(self, learner: PlannedLearner) -> PlannedLearner | None:
        """Return the learner that provides the initial weights of another learner. Return None if they are random."""
        lever = self._lever_of(learner)
        if lever is None or lever.start is None:
            return None
        return PlannedLearner(learner.task, lever.start, learner.seed)

    def questions_of(self, learner: PlannedLearner) -> int:
        """Return the approximate number of questions about each demonstration set of a learner; 0 if there are none."""
        lever = self._lever_of(learner)
        return 0 if lever is None else lever.questions

    def _lever_of(self, learner: PlannedLearner) -> Lever | None:
        return next((v for v in self.levers if v.name == learner.lever), None)

    def _require_comparable(self, where: str, lever: Lever) -> None:
        """Raise InvalidInputError if a recipe change cannot be compared with the change named in ``against``."""
        if lever.against is None:
            return
        others = {v.name: v for v in self.levers if v is not lever}
        _require_known(where, (lever.against,), others)
        other = others[lever.against]
        for name, mine, theirs in (
            ("arms", lever.arms or tuple(self.arms), other.arms or tuple(self.arms)),
            ("tasks", lever.tasks or self.tasks, other.tasks or self.tasks),
        ):
            missing = [one for one in mine if one not in theirs]
            if missing:
                problem = f"{other.name} is not applied to {', '.join(missing)}"
                raise InvalidInputError(where, problem, f"Use the same {name} in both levers")

    def _require_weights_fit(self, learner: PlannedLearner, recipe: TrainingRecipe) -> None:
        """Raise InvalidInputError if the initial weights differ in shape from the weights of the new learner."""
        start = self.start_of(learner)
        if start is None:
            return
        plain = self.recipe_of(start, ("data",))
        if plain.co_training is not None or recipe.co_training is not None:
            problem = "the learner that it starts from was trained with other questions, or without questions"
            raise InvalidInputError(
                f"lever {learner.lever}.co_training", problem, "Leave out either co_training or start"
            )
        theirs = plain.shape
        other = next((name for name, value in recipe.shape.items() if theirs[name] != value), None)
        if other is not None:
            where, problem = (
                f"lever {learner.lever}.{other}",
                f"the learner of {start.arm} that it starts from has another value",
            )
            raise InvalidInputError(where, problem, "Leave out this field, or change it in the recipe of the study")

    def _require_words_known(self, where: str, lever: Lever) -> None:
        """Raise InvalidInputError if a learner would start from weights that were not trained on all of its words.

        Object categories and colors are checked like words.
        """
        if lever.start is None:
            return
        for task, arm in itertools.product(lever.tasks or self.tasks, lever.arms or self.arms):
            missing = never_shown_before(self.arms[lever.start], task, self.arms[arm])
            if missing:
                problem = f"its learner of {task} was not trained on {', '.join(missing)}, but {arm} is"
                raise InvalidInputError(
                    where, problem, "Start from an arm that was trained on all of them, or leave out the task"
                )

    def sets_of(self, arm: str) -> dict[Regime, int]:
        """Return the number of demonstrations per training condition that an arm takes from each training distribution.

        The numbers add up to ``demos``. Each training distribution of the arm provides at least one demonstration, and
        the numbers are as close to the planned fractions as possible.
        """
        wanted = {regime: share * self.demos for regime, share in self.arms[arm].items()}
        found = {regime: max(1, math.floor(number + _SUM_SLACK)) for regime, number in wanted.items()}
        while sum(found.values()) != self.demos:
            short = sum(found.values()) < self.demos
            off = {regime: wanted[regime] - count for regime, count in found.items() if short or count > 1}
            found[(max if short else min)(off, key=off.__getitem__)] += 1 if short else -1
        return found

    def dose_of(self, arm: str) -> float:
        """Return the fraction of an arm's demonstrations that have confounds.

        The numbers of demonstrations are rounded to integers before the fraction is computed.
        """
        return self.sets_of(arm).get("training", 0) / self.demos

    def arm_in(self, role: str) -> str | None:
        """Return the first arm with a role, such as "balanced". Return None if no arm has the role.

        A role stands for certain training distributions.
        """
        return next((name for name, shares in self.arms.items() if shares == ROLES[role]), None)

    def recipe_of(
        self,
        learner: PlannedLearner,
        data: tuple[str, ...],
        *,
        start: str = "start",
        questions: tuple[str, ...] = ("questions",),
    ) -> TrainingRecipe:
        """Return the training recipe of a learner.

        Args:
            learner: The learner.
            data: Folders of its demonstrations.
            start: Folder with its initial weights.
            questions: Folders with its question sets.

        Raises:
            InvalidInputError: If a field is unknown or out of range. The message names the field.
        """
        lever = self._lever_of(learner)
        given = {**self.recipe, **({} if lever is None else lever.changes)}
        where = "recipe" if lever is None else f"lever {lever.name}"
        for name in OWN_FIELDS:
            if name in given:
                raise InvalidInputError(f"{where}.{name}", "this field is set by the study", "Leave out this field")
        begins = lever is not None and lever.start is not None
        if "frozen" in given and not begins:
            problem = "weights that were never trained would be frozen"
            raise InvalidInputError(f"{where}.frozen", problem, "Freeze weights only in a lever with the field start")
        if lever is not None and lever.questions:
            given["co_training"] = _asked(given.get("co_training", {}), questions, f"{where}.co_training")
        fixed = {
            "data": data,
            "tasks": (learner.task,),
            "seed": learner.seed,
            "variations": "covered" in self.arms[learner.arm],
            "start": start if begins else None,
        }
        return read_training_recipe({**given, **fixed}, where=where)

    def to_json(self) -> dict[str, Any]:
        """Return the plan as a JSON-serializable dict, including all default values."""
        form: dict[str, Any] = json.loads(json.dumps(asdict(self)))
        return form


def _asked(given: object, questions: tuple[str, ...], where: str) -> dict[str, Any]:
    """Return the recipe's field ``co_training``, extended by the question sets that the study makes."""
    if not isinstance(given, dict):
        raise InvalidInputError(where, "this is not a mapping", "Write {weight: 0.25}, or leave out the field")
    if "sets" in given:
        raise InvalidInputError(
            f"{where}.sets", "the study makes its own questions", "Leave out either sets or questions"
        )
    return {**given, "sets": questions}


def _require_known(where: str, names: tuple[str, ...], known: Any) -> None:  # noqa: ANN401 - any container
    for name in names:
        if name not in known:
            raise InvalidInputError(where, f"{name!r} is not in the study", f"Use one of {', '.join(known)}")


_FORM = TypeAdapter(StudyPlan)


def read_study_plan(form: object, *, where: str = "plan") -> StudyPlan:
    """Parse a study plan from JSON.

    Raises:
        InvalidInputError: If a field is missing, unknown or out of range. The message names the field.
        UnknownNameError: If a task does not exist.
    """
    return read_form(_FORM, form, where=where, cure=CURE)


def preset_text(name: str) -> str:
    """Return a preset of a study plan as YAML. Raises InvalidInputError if the preset does not exist."""
    if name not in PRESETS:
        raise InvalidInputError("--preset", f"{name!r} is not a preset", f"Use one of {', '.join(PRESETS)}")
    return resources.files("betterbench.learning.study").joinpath("presets", f"{name}.yaml").read_text(encoding="utf-8")
