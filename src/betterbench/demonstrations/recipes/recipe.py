"""Fine-tuning recipes: the values given in the BeTTER paper, each with its source."""

from __future__ import annotations

import importlib.resources
import json
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cache
from typing import Annotated, Any, Literal

from pydantic import Field, TypeAdapter

from betterbench.errors import InvalidInputError, UnknownNameError
from betterbench.json_form import read_form, strict_form

Framework = Literal["openpi", "gr00t", "being-h", "lerobot"]
Backbone = Literal["vision", "language"]
Benchmark = Literal["better", "libero", "calvin", "real"]
RecipeName = Literal["better", "libero", "calvin", "real_arm"]
Origin = Literal["paper", "upstream", "recipe", "ours"]
"""Origin of a value: the paper, the framework's own recipe ("upstream"), the user's recipe file, or betterbench
("ours").
"""

_CURE = "Correct the recipe; see docs/recipes.md for an example"

Positive = Annotated[int, Field(ge=1, le=100_000_000)]


@dataclass(frozen=True, slots=True)
class Setting:
    """Field of a framework's configuration, with its value and the source of the value."""

    name: str
    value: Any
    origin: Origin
    where: str


@strict_form
@dataclass(frozen=True, slots=True)
class RecipeForm:
    """Content of a recipe file. Fields that are missing are taken from the recipe that the file extends."""

    extends: RecipeName = "better"
    name: Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]{0,40}$")] | None = None
    steps: Positive | None = None
    batch: Positive | None = None
    frozen: dict[Framework, tuple[Backbone, ...]] | None = None
    chunk: Annotated[int, Field(ge=1, le=1000)] | None = None
    learning_rate: Annotated[float, Field(gt=0.0, le=1.0)] | None = None
    proprioception: bool | None = None
    save_every: Positive | None = None
    seed: Annotated[int, Field(ge=0, le=2**31 - 1)] | None = None


_FORM = TypeAdapter(RecipeForm)


@dataclass(frozen=True, slots=True)
class Recipe:
    """Recipe in which each value is either set or left to the framework (None).

    Attributes:
        name: Name of the recipe, which is used in the names of configurations and folders.
        benchmark: Benchmark whose demonstrations are used for training.
        form: Content of the user's recipe file.
        fixed: Default values of ``steps`` and ``batch``, for recipe files that do not set them, each with its source
            and the passage in the source.
        frozen: Frozen parts of the backbone by framework, with the passage in the paper.
        policies: Number of steps and batch size by policy type, for the policy types of LeRobot whose recipe differs
            from ``fixed``.
    """

    name: str
    benchmark: Benchmark
    form: RecipeForm
    fixed: Mapping[str, tuple[int, Origin, str]]
    frozen: Mapping[str, tuple[tuple[Backbone, ...], str]]
    policies: Mapping[str, Mapping[str, tuple[int, Origin, str]]] = field(default_factory=dict)

    @property
    def steps(self) -> int:
        """Number of training steps."""
        return self.form.steps or self.fixed["steps"][0]

    @property
    def batch(self) -> int:
        """Total batch size per step, summed over all GPUs."""
        return self.form.batch or self.fixed["batch"][0]

    @property
    def save_every(self) -> int:
        """Number of steps between two checkpoints."""
        return self.form.save_every or self.saved_every(5000)

    def saved_every(self, usual: int) -> int:
        """Return the number of steps between two checkpoints, chosen so that the last step is saved.

        Args:
            usual: Preferred number of steps between two checkpoints, which is used if it divides the total number of
                steps.
        """
        return usual if self.steps % usual == 0 else self.steps

    def setting(self, name: str, what: Literal["steps", "batch"]) -> Setting:
        """Return the number of steps or the batch size as a field of a framework's configuration.

        Args:
            name: Name of the field in the framework.
            what: Value to return, ``steps`` or ``batch``.
        """
        given = getattr(self.form, what)
        return given_or(name, given, *self.fixed[what])

    def of_policy(self, policy: str) -> Recipe:
        """Return the recipe for a policy type of LeRobot.

        Raises InvalidInputError if ``save_every`` does not divide the number of steps.
        """
        fixed = dict(self.fixed)
        # The paper only trained pi0.5.
        if self.policies and policy != "pi05":
            fixed = {name: (value, "ours", f"as pi0.5; no recipe for {policy}") for name, (value, *_) in fixed.items()}
        found = replace(self, fixed=fixed | dict(self.policies.get(policy, {})))
        _check_saving(found, "recipe")
        return found

    def frozen_parts(self, framework: Framework) -> tuple[tuple[Backbone, ...] | None, Origin, str]:
        """Return the frozen parts of the backbone for a framework, with the source of this choice.

        The parts are None if the framework's default is used. The last returned value is the passage in the source.
        """
        given = (self.form.frozen or {}).get(framework)
        if given is not None:
            return given, "recipe", "frozen"
        if framework in self.frozen:
            parts, where = self.frozen[framework]
            return parts, "paper", where
        return None, "upstream", ""


def given_or(name: str, given: object, value: object, origin: Origin, where: str) -> Setting:
    """Return a field of a framework's configuration, with the value in the recipe file or a default value.

    Args:
        name: Name of the field in the framework.
        given: Value in the recipe file; None if the file does not set the field.
        value: Default value.
        origin: Source of the default value.
        where: Passage in the source that contains the default value.
    """
    return Setting(name, value, origin, where) if given is None else Setting(name, given, "recipe", "recipe file")


def recipe_of(form: object = None, *, where: str = "recipe") -> Recipe:
    """Return a recipe from the BeTTER paper by name, or create a recipe from the content of a recipe file.

    Args:
        form: ``better``, ``libero``, ``calvin`` or ``real_arm``, or a mapping of fields.
        where: File name for error messages.

    Raises:
        UnknownNameError: If the paper has no recipe of that name.
        InvalidInputError: If a field has an invalid value.
    """
    if isinstance(form, str) or form is None:
        name = form or "better"
        if name not in _paper():
            raise UnknownNameError("recipe", name, _paper())
        form = {"extends": name}
    read = read_form(_FORM, form, where=where, cure=_CURE)
    for framework, parts in (read.frozen or {}).items():
        if len(set(parts)) < len(parts):
            raise InvalidInputError(f"{where}: frozen: {framework}", "a part is listed twice", _CURE)
    base = _paper()[read.extends]
    recipe = Recipe(
        name=read.name or read.extends,
        benchmark=base["benchmark"],
        form=read,
        fixed={
            name: (base[name][0], "upstream" if name in base.get("upstream", ()) else "paper", base[name][1])
            for name in ("steps", "batch")
        },
        frozen={name: (tuple(parts), told) for name, (parts, told) in base["frozen"].items()},
        policies={
            policy: {name: (value, "upstream", told) for name, (value, told) in fields.items()}
            for policy, fields in base.get("policies", {}).items()
        },
    )
    if not recipe.policies:
        _check_saving(recipe, where)
    return recipe


def _check_saving(recipe: Recipe, where: str) -> None:
    """Raise InvalidInputError if no checkpoint would be saved at the last step."""
    if recipe.steps % recipe.save_every:
        problem = (
            f"{recipe.steps} steps are not a multiple of {recipe.save_every}, so the last checkpoint would not be saved"
        )
        raise InvalidInputError(f"{where}: save_every", problem, "Use a divisor of steps, or leave out save_every")


@cache
def _paper() -> dict[str, Any]:
    file = importlib.resources.files("betterbench.demonstrations.recipes") / "data" / "fine_tuning.json"
    found: dict[str, Any] = json.loads(file.read_bytes())
    return found
