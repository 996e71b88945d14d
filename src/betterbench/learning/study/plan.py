"""Plan of a study: its tasks, arms, training seeds and changes of the recipe."""

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

CURE = "Correct the plan; docs/learned.md shows one"
PRESETS = ("small", "full", "levers", "doses", "diverse")
OWN_FIELDS = ("data", "tasks", "seed", "variations", "start")
"""Fields of a recipe that the study itself decides."""
MOST_LEARNERS = 1000
MOST_TRIALS = 200_000
"""Trials of the learners of one seed, at most; each is planned before the first is run."""
_SUM_SLACK = 1e-6

_Name = Annotated[str, Field(pattern=r"^[a-z0-9][a-z0-9_.-]{0,39}$")]
_Share = Annotated[float, Field(gt=0.0, le=1.0)]
RegimeShares = Annotated[dict[Regime, _Share], Field(min_length=1)]
"""Share of the demonstrations of an arm by regime."""

ROLES: Mapping[str, dict[Regime, float]] = {
    "confounded": {"training": 1.0},
    "balanced": {"balanced": 1.0},
    "covered": {"covered": 1.0},
    "diverse-confounded": {"diverse-confounded": 1.0},
}
"""Regime shares of each role in the findings: the arm with these shares plays the role, under any name."""
USUAL_ARMS = ("confounded", "balanced", "covered")
"""The arms of a plan that names none; all tasks of the suite have these."""


@strict_form
@dataclass(frozen=True, slots=True)
class Lever:
    """Change of the recipe, compared with the same learners without the change.

    Attributes:
        name: Its name in files and tables.
        changes: Fields of the recipe.
        arms: Arms on which it is tried; all if empty.
        tasks: Tasks on which it is tried; all if empty.
        start: Arm whose learner of the same task and training seed, with the recipe as it is, training begins with;
            ``changes`` may then freeze parts of it. None to begin with nothing.
        against: Lever on the same arms and tasks with which it is compared; the recipe as it is if None.
        questions: About how many questions are learned beside the actions, about the demonstrations of each regime of
            its arm; the study asks them. ``co_training`` in ``changes`` may then give their weight.
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
    """One learner of a study; ``lever`` is "" for the recipe as it is."""

    task: str
    arm: str
    seed: int
    lever: str = ""

    @property
    def name(self) -> str:
        """Its name in files."""
        return "-".join(part for part in (self.task, self.arm, self.lever, f"seed{self.seed}") if part)


def _usual_arms() -> dict[str, dict[Regime, float]]:
    return {arm: dict(ROLES[arm]) for arm in USUAL_ARMS}


@strict_form
@dataclass(frozen=True, slots=True)
class StudyPlan:
    """Plan of a study.

    Attributes:
        arms: Per arm what its demonstrations show. An arm of two regimes holds a planted confound at that dose.
        seeds: Seeds of training; each task and arm is trained with each of them.
        demos: Demonstrations per training condition; other regimes share as many out over theirs.
        sources: Number of these that the expert gives and from which the others are carried over; 0 if it gives all.
        noise: Noise on the executed actions of those that are carried over, in action units.
        trials: Trials per variation of each learner; the training conditions have as many in all.
        recipe: Fields of the training recipe other than its defaults.
        levers: Changes of the recipe, each tried on its own.
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
        """Refuse what cannot be done."""
        for name, least, most in (("demos", 1, 10_000), ("sources", 0, 10_000), ("trials", 1, 10_000)):
            require_between(name, getattr(self, name), least, most)
        require_between("noise", self.noise, 0.0, 0.5)
        for name, listed in (("tasks", self.tasks), ("seeds", self.seeds), ("levers", [v.name for v in self.levers])):
            if len(set(listed)) < len(listed):
                raise InvalidInputError(name, "one of them stands there twice", "Give each once")
        self._require_few()
        for task in map(get_task, self.tasks):
            for regime in {regime for shares in self.arms.values() for regime in shares}:
                conditions_of(task, regime)
        for arm, shares in self.arms.items():
            if abs(sum(shares.values()) - 1.0) > _SUM_SLACK:
                raise InvalidInputError(f"arms.{arm}", "its shares do not sum up to 1", "Give shares that do")
            if len(shares) > self.demos:
                problem = f"{self.demos} demonstrations cannot be shared by {len(shares)} regimes"
                raise InvalidInputError(f"arms.{arm}", problem, "Give more in demos")
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
            raise InvalidInputError("levers", f"two learners would be called {twice}", "Rename the arm or the lever")

    def _require_few(self) -> None:
        """Refuse more learners or trials than a study can have, by their numbers alone, before any of them is made."""
        plain = len(self.tasks) * len(self.arms)
        levered = sum(len(v.tasks or self.tasks) * len(v.arms or self.arms) for v in self.levers)
        learners = len(self.seeds) * (plain + levered)
        if learners > MOST_LEARNERS:
            raise InvalidInputError("seeds", f"they make {learners} learners", f"Give at most {MOST_LEARNERS}")
        most = max(len(get_task(task).variations) for task in self.tasks) + 1
        if len(self.tasks) * most * self.trials > MOST_TRIALS:
            problem = f"{self.trials} of each variation make more than {MOST_TRIALS} trials for the learners of a seed"
            raise InvalidInputError("trials", problem, "Give fewer trials or tasks")

    def learners(self) -> Iterator[PlannedLearner]:
        """Yield all learners: those of the first seed first, so that a part of the study already says something."""
        for seed in self.seeds:
            yield from (PlannedLearner(task, arm, seed) for task in self.tasks for arm in self.arms)
        for lever in self.levers:
            for seed in self.seeds:
                for task in lever.tasks or self.tasks:
                    yield from (PlannedLearner(task, arm, seed, lever.name) for arm in lever.arms or self.arms)

    def start_of(self, learner: PlannedLearner) -> PlannedLearner | None:
        """Return the learner whose weights the training of another one begins with, or None."""
        lever = self._lever_of(learner)
        if lever is None or lever.start is None:
            return None
        return PlannedLearner(learner.task, lever.start, learner.seed)

    def questions_of(self, learner: PlannedLearner) -> int:
        """Return about how many questions about each of its sets a learner is asked, 0 if the study asks none."""
        lever = self._lever_of(learner)
        return 0 if lever is None else lever.questions

    def _lever_of(self, learner: PlannedLearner) -> Lever | None:
        return next((v for v in self.levers if v.name == learner.lever), None)

    def _require_comparable(self, where: str, lever: Lever) -> None:
        """Refuse a lever that is compared with itself, with none, or with one that has no such learners."""
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
                problem = f"{other.name} is not tried on {', '.join(missing)}"
                raise InvalidInputError(where, problem, f"Give both levers the same {name}")

    def _require_weights_fit(self, learner: PlannedLearner, recipe: TrainingRecipe) -> None:
        """Refuse a start whose weights have other shapes than those of the learner that would begin with them."""
        start = self.start_of(learner)
        if start is None:
            return
        plain = self.recipe_of(start, ("data",))
        if plain.co_training is not None or recipe.co_training is not None:
            problem = "the learner that it begins with answers questions about other demonstrations, or none"
            raise InvalidInputError(f"lever {learner.lever}.co_training", problem, "Leave it out, or the start")
        theirs = plain.shape
        other = next((name for name, value in recipe.shape.items() if theirs[name] != value), None)
        if other is not None:
            where, problem = (
                f"lever {learner.lever}.{other}",
                f"the learner of {start.arm} that it begins with has another",
            )
            raise InvalidInputError(where, problem, "Leave it out, or change it in the recipe of the study")

    def _require_words_known(self, where: str, lever: Lever) -> None:
        """Refuse a start that has no number for something that the lever's own demonstrations show."""
        if lever.start is None:
            return
        for task, arm in itertools.product(lever.tasks or self.tasks, lever.arms or self.arms):
            missing = never_shown_before(self.arms[lever.start], task, self.arms[arm])
            if missing:
                problem = f"its learner of {task} is never shown {', '.join(missing)}, which {arm} shows"
                raise InvalidInputError(where, problem, "Begin with an arm that shows it, or leave out the task")

    def sets_of(self, arm: str) -> dict[Regime, int]:
        """Return the demonstrations of an arm per training condition, by the regime that they show, all together demos.

        Each regime has one at least; the others are those that come nearest to the shares.
        """
        wanted = {regime: share * self.demos for regime, share in self.arms[arm].items()}
        found = {regime: max(1, math.floor(number + _SUM_SLACK)) for regime, number in wanted.items()}
        while sum(found.values()) != self.demos:
            short = sum(found.values()) < self.demos
            off = {regime: wanted[regime] - count for regime, count in found.items() if short or count > 1}
            found[(max if short else min)(off, key=off.__getitem__)] += 1 if short else -1
        return found

    def dose_of(self, arm: str) -> float:
        """Return the share of the demonstrations of an arm that hold the confounds, in whole demonstrations."""
        return self.sets_of(arm).get("training", 0) / self.demos

    def arm_in(self, role: str) -> str | None:
        """Return the first arm that is trained on one regime alone, by the name of its role; None if there is none."""
        return next((name for name, shares in self.arms.items() if shares == ROLES[role]), None)

    def recipe_of(
        self,
        learner: PlannedLearner,
        data: tuple[str, ...],
        *,
        start: str = "start",
        questions: tuple[str, ...] = ("questions",),
    ) -> TrainingRecipe:
        """Return the recipe of a learner for the folders of its demonstrations.

        ``start`` is the folder of what it begins with, and ``questions`` are those of what it is asked, where it is.

        Raises InvalidInputError if a field is unknown or out of range; the text names it.
        """
        lever = self._lever_of(learner)
        given = {**self.recipe, **({} if lever is None else lever.changes)}
        where = "recipe" if lever is None else f"lever {lever.name}"
        for name in OWN_FIELDS:
            if name in given:
                raise InvalidInputError(f"{where}.{name}", "the study decides it", "Leave it out")
        begins = lever is not None and lever.start is not None
        if "frozen" in given and not begins:
            problem = "nothing is trained before it is frozen"
            raise InvalidInputError(f"{where}.frozen", problem, "Freeze in a lever that has a start")
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
        """Return the JSON form, with every value that the file left out."""
        form: dict[str, Any] = json.loads(json.dumps(asdict(self)))
        return form


def _asked(given: object, questions: tuple[str, ...], where: str) -> dict[str, Any]:
    """Return the form of a co-training with questions that the study asks."""
    if not isinstance(given, dict):
        raise InvalidInputError(where, "it is no mapping", "Give {weight: 0.25}, or leave it out")
    if "sets" in given:
        raise InvalidInputError(f"{where}.sets", "the study asks its own questions", "Leave it out, or the questions")
    return {**given, "sets": questions}


def _require_known(where: str, names: tuple[str, ...], known: Any) -> None:  # noqa: ANN401 - any container
    for name in names:
        if name not in known:
            raise InvalidInputError(where, f"{name!r} is not in the study", f"Give {', '.join(known)}")


_FORM = TypeAdapter(StudyPlan)


def read_study_plan(form: object, *, where: str = "plan") -> StudyPlan:
    """Return the plan that a JSON form stands for.

    Raises:
        InvalidInputError: If a field is missing, unknown or out of range; the text names it.
        UnknownNameError: If there is no such task.
    """
    return read_form(_FORM, form, where=where, cure=CURE)


def preset_text(name: str) -> str:
    """Return the YAML of a preset; InvalidInputError if there is none of that name."""
    if name not in PRESETS:
        raise InvalidInputError("--preset", f"{name!r} is no preset", f"Give {' or '.join(PRESETS)}")
    return resources.files("betterbench.learning.study").joinpath("presets", f"{name}.yaml").read_text(encoding="utf-8")
