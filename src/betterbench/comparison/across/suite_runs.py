"""Outcomes of runs that each cover one suite of one simulated world.

All planned trials are included. Unfinished trials count as failures.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from betterbench.errors import InvalidInputError, RecordError
from betterbench.records import Record, RunFolder
from betterbench.records.naming import run_names
from betterbench.tasks import TrialId, suite_of
from betterbench.tasks.worlds.calvin import Chain, ChainResult, SubtaskResult, calvin_chains
from betterbench.tasks.worlds.facts import OUR_SUITE
from betterbench.tasks.worlds.facts import OURS as OUR_WORLD
from betterbench.tasks.worlds.libero import PLUS_SUITES

OURS = OUR_SUITE
"""Name of the suite for runs in betterbench's own scenes."""

InitialState = tuple[str, int]
"""Key for pairing trials, with their twins in the base suite or across policies: task and index of the initial state.

The index is the seed of the trial. In LIBERO-Plus, the task is the name of a variant
("libero_object-03/camera_0_0_100_2_4").
"""


@dataclass(frozen=True, slots=True)
class SuiteRun:
    """Run of one policy in one suite.

    Attributes:
        policy: Name of the policy. Runs with the same name belong to one policy.
        path: Folder of the run.
        suite: Name of the suite.
        base: Suite from which this suite is derived. For a base suite, this is the suite itself.
        change: Change that was made to the base suite ("swap", "resampled"), or None.
        protocol: Published evaluation protocol that the run follows. Empty for betterbench's own suite.
        versions: Versions of the world's packages. Results with different versions cannot be compared.
        successes: Whether each planned trial succeeded.
        chains: Results of the planned CALVIN chains.
        unfinished: Number of planned trials that have not ended yet.
        broken: Number of trials that could not be run and have no record.
    """

    policy: str
    path: Path
    suite: str
    base: str
    change: str | None
    protocol: str = ""
    versions: Mapping[str, str] = field(default_factory=dict)
    successes: Mapping[InitialState, bool] = field(default_factory=dict)
    chains: tuple[ChainResult, ...] = ()
    unfinished: int = 0
    broken: int = 0

    @property
    def planned(self) -> int:
        """Number of planned trials."""
        return len(self.chains) or len(self.successes)


def is_across(runs: Sequence[RunFolder]) -> bool:
    """Return whether the runs belong to different suites, or at least one of them contains CALVIN chains."""
    suites = {_suite_of(run) for run in runs}
    return len(suites) > 1 or any(run.world.reading == "chains" for run in runs)


def read_suite_runs(runs: Sequence[RunFolder], *, names: Sequence[str] = ()) -> tuple[SuiteRun, ...]:
    """Read the outcomes of runs in several suites or worlds.

    Args:
        runs: Folders of the runs.
        names: Policy name for each run. Runs with the same name share a row of the result table. By default, the names
            are those that the policies declared.

    Raises:
        InvalidInputError: If there are not as many names as runs, or if a policy has two runs in the same suite.
        RecordError: If a run or a record cannot be read.
    """
    called = tuple(names) if names else tuple(run_names([run])[0] for run in runs)
    if len(called) != len(runs):
        raise InvalidInputError(
            "--name",
            f"got {len(called)} names for {len(runs)} runs",
            "Use --name once for each run, in the order of the runs",
        )
    found: dict[tuple[str, str], SuiteRun] = {}
    for run, name in zip(runs, called, strict=True):
        read = _read(run, name)
        other = found.setdefault((name, read.suite), read)
        if other is not read:
            raise InvalidInputError(
                "runs",
                f"{other.path} and {read.path} are both runs of {name} in {read.suite}",
                "Pass only one of them, or use a different --name for each",
            )
    return tuple(found.values())


def _suite_of(run: RunFolder) -> str:
    """Return the suite of a run.

    Raises:
        RecordError: If the tasks of the run do not belong to one known suite.
    """
    facts = run.world
    if facts.name == OUR_WORLD.name:
        others = {found for trial in run.plan["trials"] if (found := suite_of(str(trial["task"]))) not in (None, OURS)}
        if others:
            problem = (
                f"{run.path} is a run of the suite {min(map(str, others))}, which cannot be compared across worlds"
            )
            raise InvalidInputError("runs", problem, "Leave this run out, and view it with `better report`")
        return OURS
    if len(facts.suites) == 1:
        return next(iter(facts.suites))
    stored = _mapping(run.plan["world"]).get("tasks")
    suites = {str(t.get("suite")) for t in _mapping(stored).values() if isinstance(t, dict)}
    if stored is None:
        planned = {(str(t["task"]).rpartition("-")[0], t.get("variation")) for t in run.plan["trials"]}
        suites = {suite.name for suite in facts.suites.values() if (suite.base, suite.change) in planned}
    if len(suites) != 1 or not suites <= facts.suites.keys():
        listed = ", ".join(sorted(suites))[:80] or "none"
        raise RecordError(
            f"{run.path / 'run.json'}: plan.world.tasks must belong to one known suite, got {listed}. Restore the file."
        )
    return suites.pop()


def _read(run: RunFolder, name: str) -> SuiteRun:
    suite = _suite_of(run)
    if suite == OURS:
        return SuiteRun(name, run.path, OURS, OURS, None)
    world = _mapping(run.plan["world"])
    known = run.world.suites[suite]
    entries = {TrialId(e.task, e.variation or e.condition, e.seed): e for e in run.entries()}
    planned = [TrialId(str(t["task"]), str(t["condition"]), int(t["seed"])) for t in run.plan["trials"]]
    lost = {trial for trial in planned if trial in entries and entries[trial].status != "done"}
    left = {trial for trial in planned if trial not in entries}
    successes: dict[InitialState, bool] = {}
    chains: list[ChainResult] = []
    for trial in planned:
        missing = trial in lost or trial in left
        if run.world.reading == "chains":
            chain = calvin_chains()[trial.seed]
            record = None if missing else run.read_record(trial.task, trial.condition, trial.seed)
            chains.append(chain_result(chain, record))
        else:
            task = f"{trial.task}/{trial.condition}" if suite in PLUS_SUITES else trial.task
            successes[task, trial.seed] = not missing and run.succeeded(trial, entries[trial])
    return SuiteRun(
        name,
        run.path,
        suite,
        known.base,
        known.change,
        str(_mapping(world.get("protocol")).get("name", "")),
        {str(k): str(v) for k, v in _mapping(world.get("versions")).items()},
        successes,
        tuple(chains),
        len(left),
        len(lost),
    )


def chain_result(chain: Chain, record: Record | None) -> ChainResult:
    """Return the result of a chain from its record. A chain without a record counts as not run.

    Raises:
        RecordError: If the record has different subtasks than the chain.
    """
    if record is None:
        return ChainResult(chain.number, ())
    if record.metadata.subgoal_names != chain.names:
        raise RecordError(
            f"the record of chain {chain.number} has the subtasks {', '.join(record.metadata.subgoal_names)} instead "
            f"of {', '.join(chain.names)}. Run the chain again."
        )
    played = []
    began = 0
    for i, name in enumerate(chain.names):
        ended = np.flatnonzero(record.subgoals[:, i])
        success = bool(len(ended))
        at = int(ended[0]) if success else record.n_steps
        played.append(SubtaskResult(name, success, at - began))
        if not success:
            break
        began = at
    return ChainResult(chain.number, tuple(played))


def _mapping(value: object) -> Mapping[str, object]:
    return value if isinstance(value, dict) else {}
