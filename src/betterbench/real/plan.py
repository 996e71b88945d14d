"""Immutable plan of a protocol on a real arm: conditions and policies in randomized blocks.

A block contains each condition once per policy. The conditions of a block are in random order. All policies run the
same condition one after the other, so that the scene is set up only once. The policies take turns in running first.
Drift in lighting or calibration then affects all policies equally. Each trial has a code ("K7Q") that reveals neither
condition nor policy.

The same arguments give the same plan file, byte for byte.
"""

from __future__ import annotations

import hashlib
import itertools
import json
import unicodedata
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, TypeAdapter

from betterbench.errors import InvalidInputError, RecordError
from betterbench.interface.actions import SO101_DEGREES, SO101_NORMALIZED, ActionSpace
from betterbench.jobs.durable import write_durably
from betterbench.json_form import open_seal, read_bounded, read_form, sealed_form, strict_form
from betterbench.ordinary_file import read_ordinary
from betterbench.tasks import get_task
from betterbench.tasks.interventions.resolve import resolve_condition

PLAN_NAME = "plan.json"
"""Name of the plan file in a protocol folder."""

PLAN_VERSION = 1
MAX_PLAN_BYTES = 4 << 20
MOST_TRIALS = 2000
"""Maximum number of trials in a plan. At two minutes per trial, this many trials take about two weeks of work."""

CODE_LETTERS = "23456789ABCDEFGHJKLMNPQRSTUVWXYZ"
"""Characters used in trial codes. No two of them look alike."""

Unit = Literal["degrees", "normalized"]
"""Unit of the five arm joints: degrees, or -100 to 100 over each joint's range. The gripper is 0 to 100 in both."""

ACTION_SPACES: dict[Unit, ActionSpace] = {"degrees": SO101_DEGREES, "normalized": SO101_NORMALIZED}
"""Action space for each unit of joint positions."""

_CURE = "Restore the file from a copy, or plan into a new folder"
_Name = Annotated[str, Field(min_length=1, max_length=80)]
_Text = Annotated[str, Field(min_length=1, max_length=1000)]
_Code = Annotated[str, Field(pattern=f"^[{CODE_LETTERS}]{{3}}$")]


@strict_form
@dataclass(frozen=True, slots=True)
class RealPolicy:
    """Policy of a protocol, with its name in tables and its address."""

    name: _Name
    address: _Text


@strict_form
@dataclass(frozen=True, slots=True)
class PlannedTrial:
    """One planned trial.

    Attributes:
        code: Code that people see instead of the condition and the policy.
        block: Index of the block.
        condition: Name of the task condition ("T5").
        policy: Name of the policy.
        scene_seed: Seed of the simulated scene that the operator reproduces; the same for all trials of a block.
    """

    code: _Code
    block: Annotated[int, Field(ge=0)]
    condition: _Name
    policy: _Name
    scene_seed: Annotated[int, Field(ge=0)]


@strict_form
@dataclass(frozen=True, slots=True)
class RealPlan:
    """Plan of a protocol.

    Attributes:
        task: Task of the suite ("fruit_basket").
        task_version: Version of the task that defines the conditions.
        conditions: Names of the conditions, without repetition.
        policies: Policies, with different names.
        repeats: Number of trials per condition and policy, which is also the number of blocks.
        seed: Seed for the order and the codes of the trials.
        unit: Unit of joint positions in states and commands.
        rate_hz: Rate of actions [Hz].
        time_limit_s: Maximum duration of a trial [s].
        trials: Trials, in the order in which they are run.
    """

    version: Literal[1]
    task: _Name
    task_version: int
    conditions: tuple[_Name, ...]
    policies: tuple[RealPolicy, ...]
    repeats: Annotated[int, Field(ge=1)]
    seed: Annotated[int, Field(ge=0)]
    unit: Unit
    rate_hz: Annotated[float, Field(ge=1.0, le=100.0)]
    time_limit_s: Annotated[float, Field(ge=1.0, le=600.0)]
    trials: tuple[PlannedTrial, ...]

    def __post_init__(self) -> None:
        """Raise InvalidInputError unless each block contains each condition once per policy."""
        names = [policy.name for policy in self.policies]
        _require_different("conditions", self.conditions)
        _require_different("policies", names)
        _require_different("codes", [trial.code for trial in self.trials])
        planned = Counter((trial.block, trial.condition, trial.policy) for trial in self.trials)
        asked = {(block, c, p): 1 for block in range(self.repeats) for c in self.conditions for p in names}
        if planned != asked:
            problem = "the trials do not contain each condition once per policy and block"
            raise InvalidInputError("trials", problem, "Make the plan with `better real plan`")

    @property
    def action_space(self) -> ActionSpace:
        """Action space of the policies."""
        return ACTION_SPACES[self.unit]

    def trial(self, code: str) -> PlannedTrial:
        """Return the trial with a given code.

        Raises:
            InvalidInputError: If the plan has no trial with this code.
        """
        for trial in self.trials:
            if trial.code == code:
                return trial
        raise InvalidInputError("trial", f"the plan has no trial {code!r}", "Use a code listed by `better real status`")

    def address(self, policy: str) -> str:
        """Return the address of the policy with a given name."""
        return next(p.address for p in self.policies if p.name == policy)

    def instruction(self, condition: str) -> str:
        """Return the text of a condition's instruction."""
        return resolve_condition(self.task, condition).condition.instruction.text


def _require_different(where: str, names: Sequence[str]) -> None:
    """Raise InvalidInputError if a list of names is empty or contains a name twice."""
    if not names:
        raise InvalidInputError(where, "the list is empty", "Pass at least one name")
    name, count = Counter(names).most_common(1)[0]
    if count > 1:
        raise InvalidInputError(where, f"{name!r} occurs {count} times", "Use each name once")


def same_name(first: str, second: str) -> bool:
    """Return whether two names are equal apart from case, spaces and Unicode forms."""
    plain = [" ".join(unicodedata.normalize("NFKC", name).casefold().split()) for name in (first, second)]
    return plain[0] == plain[1]


def _require_readable(names: Sequence[str]) -> None:
    """Raise InvalidInputError if a policy name is not one printable line, or is nearly the same as another name.

    Names appear in tables, pages and files. They cannot be corrected later, because a plan is immutable.
    """
    for name in names:
        if not name.isprintable() or name != name.strip():
            problem = f"{name!r} has leading or trailing spaces, or unprintable characters"
            raise InvalidInputError("policies", problem, "Use letters, digits and punctuation")
    for first, second in itertools.combinations(names, 2):
        if same_name(first, second):
            problem = f"{first!r} and {second!r} differ only in case, spaces or Unicode forms"
            raise InvalidInputError("policies", problem, "Use names that are easier to distinguish")


def matrix_conditions(task: str) -> tuple[str, ...]:
    """Return the first condition in each cell of a task's diagnostic matrices.

    A protocol uses these conditions by default.
    """
    found = get_task(task)
    if not found.matrices:
        cure = "Use --conditions, or choose a task with diagnostic matrices, such as fruit_basket"
        raise InvalidInputError("task", f"{task} has no diagnostic matrices", cure)
    return tuple(cell.conditions[0] for matrix in found.matrices for cell in matrix.cells)


def make_plan(
    policies: Sequence[RealPolicy],
    *,
    task: str = "fruit_basket",
    conditions: Sequence[str] | None = None,
    repeats: int = 1,
    seed: int = 0,
    unit: Unit = "degrees",
    rate_hz: float = 20.0,
    time_limit_s: float = 30.0,
) -> RealPlan:
    """Create the plan of a protocol. By default, it has one condition per cell of the task's diagnostic matrices.

    Raises:
        UnknownNameError: If the task or a condition does not exist.
        InvalidInputError: If a condition or name is repeated, a policy name is unreadable or too similar to another
            name, or a number is out of range.
    """
    chosen = matrix_conditions(task) if conditions is None else tuple(conditions)
    names = [policy.name for policy in policies]
    _require_different("conditions", chosen)
    _require_different("policies", names)
    _require_readable(names)
    for name in chosen:
        resolve_condition(task, name)
    if not 1 <= repeats <= MOST_TRIALS // (len(chosen) * len(names)):
        problem = f"{repeats} blocks of {len(chosen) * len(names)} trials do not give 1 to {MOST_TRIALS} trials"
        raise InvalidInputError(
            "trials per cell", problem, "Choose a number of trials per condition so that the total is in this range"
        )
    trials = [
        PlannedTrial(code, block, condition, policy, scene_seed)
        for code, (block, scene_seed, condition, policy) in zip(
            _codes(repeats * len(chosen) * len(names), seed), _ordered(chosen, names, repeats, seed), strict=True
        )
    ]
    form = {
        "version": PLAN_VERSION,
        "task": task,
        "task_version": get_task(task).version,
        "conditions": list(chosen),
        "policies": [asdict(policy) for policy in policies],
        "repeats": repeats,
        "seed": seed,
        "unit": unit,
        "rate_hz": rate_hz,
        "time_limit_s": time_limit_s,
        "trials": [asdict(trial) for trial in trials],
    }
    return read_form(_PLAN, form, where="plan", cure="Use a different value")


def _stream(seed: int, purpose: str) -> np.random.Generator:
    """Return the random generator for one purpose, derived from the seed of the plan."""
    digest = hashlib.sha256(f"betterbench real|{seed}|{purpose}".encode()).digest()
    return np.random.Generator(np.random.PCG64(int.from_bytes(digest[:16], "little")))


def _ordered(
    conditions: Sequence[str], policies: Sequence[str], repeats: int, seed: int
) -> list[tuple[int, int, str, str]]:
    """Return the trials in the order of their execution, as tuples of block, scene seed, condition and policy."""
    found = []
    for block in range(repeats):
        order = _stream(seed, f"order {block}")
        scene_seed = int(_stream(seed, f"scene {block}").integers(1_000_000))
        around = [policies[i] for i in order.permutation(len(policies))]
        # Each policy runs first equally often (to within one trial), in random order.
        first = order.permutation([i % len(around) for i in range(len(conditions))])
        for i, start in zip(order.permutation(len(conditions)), first, strict=True):
            turned = [*around[start:], *around[:start]]
            found += [(block, scene_seed, conditions[i], policy) for policy in turned]
    return found


def _codes(count: int, seed: int) -> list[str]:
    """Return distinct random codes of three characters."""
    letters = len(CODE_LETTERS)
    drawn = _stream(seed, "codes").choice(letters**3, size=count, replace=False)
    return ["".join(CODE_LETTERS[int(n) // letters**k % letters] for k in range(3)) for n in drawn]


_PLAN = TypeAdapter(RealPlan)


def plan_bytes(plan: RealPlan) -> bytes:
    """Return the content of the plan file."""
    return (json.dumps(sealed_form(asdict(plan)), indent=1, sort_keys=True) + "\n").encode()


def write_plan(folder: Path, plan: RealPlan) -> Path:
    """Write the plan file of a new protocol, and return its path.

    Raises:
        InvalidInputError: If the folder contains a different plan.
    """
    path = folder / PLAN_NAME
    data = plan_bytes(plan)
    if path.exists() and read_ordinary(path) != data:
        raise InvalidInputError(
            str(path), "the folder contains a different plan, and a plan cannot be changed", "Choose another folder"
        )
    write_durably(path, data)
    return path


def read_plan(folder: Path) -> RealPlan:
    """Read the plan of a protocol.

    Raises:
        RecordError: If the file is missing, damaged or changed.
    """
    path = folder / PLAN_NAME
    if not path.exists():
        raise RecordError(
            f"{path}: not found. Create a plan with `better real plan`, or pass the folder of an existing one."
        )
    raw = read_bounded(path, max_bytes=MAX_PLAN_BYTES, cure=_CURE, raises=RecordError)
    form = open_seal(raw, where=str(path), cure=_CURE, raises=RecordError)
    return read_form(_PLAN, form, where=str(path), cure=_CURE, raises=RecordError)
