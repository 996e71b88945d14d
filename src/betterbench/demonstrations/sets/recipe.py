"""Recipe of a training set: all values that determine its bytes, and the command that reproduces it."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated

from pydantic import Field, TypeAdapter

from betterbench.demonstrations.making.starts import FIRST_AMPLIFIED_SEED
from betterbench.errors import InvalidInputError, RecordError, require_between
from betterbench.jobs import write_durably
from betterbench.jobs.conflict import require_free, require_same
from betterbench.jobs.outputs import LIST_NAME
from betterbench.json_form import read_bounded, read_form, strict_form
from betterbench.quoting import shell_line
from betterbench.tasks import SUITE_VERSION
from betterbench.tasks.interventions.regimes import Regime
from betterbench.tasks.randomness import FIRST_DEMONSTRATION_SEED
from betterbench.tasks.user_files import options_by_name
from betterbench.version import __version__

RECIPE_VERSION = 1
"""Version of the procedure that makes a set from a recipe."""
_MAX_BYTES = 1 << 20
_CURE = "Give the --out folder of better dataset"


@strict_form
@dataclass(frozen=True, slots=True)
class SetRecipe:
    """Recipe of a training set.

    Attributes:
        tasks: Names of the tasks.
        regime: Training distribution whose conditions are demonstrated.
        demos: Demonstrations per training condition; the other distributions divide the same total among their
            conditions.
        sources: Number of expert demonstrations to amplify, or 0 if the expert makes all demonstrations.
        seed: First seed of the expert's demonstrations, from which the first seed of amplified demonstrations is
            computed.
        noise: Standard deviation of the noise on executed actions in amplified demonstrations, in action units.
        validation: Fraction of the seeds whose demonstrations are for validation.
        pairs: Whether conditions with the same scene share their seeds and thus form twins.
    """

    tasks: tuple[str, ...]
    regime: Regime = "training"
    demos: Annotated[int, Field(ge=1)] = 50
    sources: Annotated[int, Field(ge=0)] = 10
    seed: int = FIRST_DEMONSTRATION_SEED
    noise: float = 0.02
    validation: float = 0.1
    pairs: bool = False
    version: int = RECIPE_VERSION
    suite: str = SUITE_VERSION
    betterbench: str = __version__

    @property
    def amplified(self) -> bool:
        """Whether the demonstrations are amplified from expert demonstrations."""
        return self.sources > 0 and not self.pairs

    @property
    def amplified_seed(self) -> int:
        """First seed of the amplified demonstrations."""
        return self.seed - FIRST_DEMONSTRATION_SEED + FIRST_AMPLIFIED_SEED

    def check(self) -> None:
        """Raise InvalidInputError if a number is out of range."""
        require_between("--demos", self.demos, 1, 10_000)
        require_between("--sources", self.sources, 0, 10_000)
        require_between("--seed", self.seed, FIRST_DEMONSTRATION_SEED, FIRST_AMPLIFIED_SEED - 1)
        require_between("--noise", self.noise, 0.0, 0.5)
        require_between("--validation", self.validation, 0.0, 0.9)
        if not self.tasks:
            raise InvalidInputError("--tasks", "no task is given", "Give at least one task")

    def command(self, sha256: str, *, out: str = "DATASET") -> str:
        """Return the command that reproduces the set and compares its hash."""
        words = ["better", "dataset", "--out", out, "--tasks", *self.tasks, "--regime", self.regime]
        words += ["--demos", str(self.demos), "--sources", str(self.sources), "--seed", str(self.seed)]
        words += ["--noise", f"{self.noise:g}", "--validation", f"{self.validation:g}"]
        words += ["--pairs"] if self.pairs else []
        words += options_by_name(self.tasks)
        return shell_line([*words, "--expect", sha256])


_FORM = TypeAdapter(SetRecipe)


def holds_recipe(out: Path) -> bool:
    """Return whether a folder contains the recipe of a set."""
    try:
        read_recipe(out)
    except RecordError:
        return False
    return True


def keep_recipe(recipe: SetRecipe, out: Path) -> None:
    """Write the recipe into the folder of its set. Raises the errors of :func:`require_recipe`."""
    require_recipe(recipe, out)
    text = json.dumps(asdict(recipe), indent=1) + "\n"
    write_durably(out / "recipe.json", text.encode())


def require_recipe(recipe: SetRecipe, out: Path) -> None:
    """Reject a folder with other files or the set of another recipe, except one that differs only by fewer ``demos``.

    Raises:
        RunConflictError: If the folder contains other files, or the set of another recipe.
        RecordError: If the recipe in the folder cannot be read.
    """
    require_free(out, "dataset", file="recipe.json", besides=(LIST_NAME,))
    if (out / "recipe.json").exists():
        there = read_recipe(out)
        grown = SetRecipe(**{**asdict(there), "demos": max(there.demos, recipe.demos)})
        require_same(out, asdict(grown), asdict(recipe), "dataset", where="recipe")


def read_recipe(out: Path) -> SetRecipe:
    """Return the recipe in the folder of a set. Raises RecordError if there is none."""
    path = out / "recipe.json"
    data = read_bounded(path, max_bytes=_MAX_BYTES, cure=_CURE, raises=RecordError)
    return read_form(_FORM, data, where=str(path), cure=_CURE, raises=RecordError)
