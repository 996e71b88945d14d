"""Measurement of the power matrix by running simulated faulty policies on every variation. It can be resumed.

The power matrix tells how often each simulated faulty policy (called a pretender) succeeds on each variation. The
expert runs first and records which faulty rules agree with all its decisions in a trial. Such a rule would produce
exactly the same episode as the expert. That trial is therefore not simulated: its outcome is copied from the expert,
and the cell of the matrix counts it as shared. All other trials are simulated.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from betterbench.calibration.chance import chance_of
from betterbench.calibration.run import CalibrationProgress
from betterbench.diagnosis import TrialDiagnosis, diagnose_run
from betterbench.diagnosis.measures.power_matrix import BLIND, EXPERT, FLOOR, Key, PowerCell, PowerMatrix
from betterbench.diagnosis.measures.power_matrix import task_versions as versions_of_task
from betterbench.diagnosis.thresholds import REPLAY_LIMIT
from betterbench.errors import RecordError
from betterbench.evaluation import Plan, Progress, evaluate, make_plan
from betterbench.interface.actions import EE_DELTA
from betterbench.policies.experts.address import WITNESS
from betterbench.policies.experts.registry import witnessed
from betterbench.records import RunFolder
from betterbench.statistics import Rate, chance_p
from betterbench.tasks import Expected, built_in_suite, get_task, suite_tasks

RULE_TRIALS = 6
"""Number of trials per faulty rule and variation. A few are enough, since decisions hardly depend on the seed."""
GUESS_TRIALS = 14
"""Smallest number of trials of a policy without language.

With it, a guess that is right with a chance of one in three is right in more than half of the trials in only 6 % of the
cells. With 7 trials, this would happen in 17 %.
"""
STILL_TRIALS = 2
"""Number of trials of the policy that never moves. A few are enough, since they are all alike."""
MOST_CHANCE = 0.9
"""Largest chance level for which a number of trials is computed.

If only one instruction is possible, guessing it always succeeds.
"""
ALPHA = 0.05

_NO_LANGUAGE = BLIND[0]


@dataclass(frozen=True, slots=True)
class PowerTrials:
    """Number of trials of each pretender (simulated faulty policy) on each variation. Their seeds start at 0.

    Attributes:
        of: Number of trials by pretender and variation. The expert has the largest number that any faulty rule needs.
        chances: Success rate of guessing the instruction, by variation.
    """

    of: dict[str, dict[Key, int]]
    chances: dict[Key, float]

    @property
    def total(self) -> int:
        """Number of all trials, including those that are copied from the expert."""
        return sum(n for row in self.of.values() for n in row.values())


@dataclass(frozen=True, slots=True)
class _Outcome:
    """Outcome of one trial, as it is counted in a cell of the power matrix."""

    success: bool
    right: bool
    truth: str
    shared: bool = False


def trials_to_flag(chance: float, cells: int) -> int:
    """Return the smallest number of trials with which a cell that always succeeds differs significantly from chance.

    The significance level is 5 %, with Holm's correction for all cells.
    """
    n = 1
    while cells * chance_p(Rate(n, n), chance=chance) >= ALPHA:
        n += 1
    return n


def power_trials(tasks: Sequence[str] = (), *, rule_trials: int = RULE_TRIALS, probes: bool = True) -> PowerTrials:
    """Return the number of trials for each cell of a power matrix, for the named tasks or for the whole suite.

    A pretender (simulated faulty policy) that lacks an input, such as the image, gets enough trials that a variation
    which it always solves is significant after the correction for all cells. If ``probes`` is False, only policies with
    faulty rules are run, which need few trials.
    """
    suite = [get_task(name) for name in suite_tasks(built_in_suite(tasks))]
    chosen = [get_task(name) for name in dict.fromkeys(tasks)] or suite
    # Ambiguous variations are left out, since they have no right or wrong outcome.
    keys = [(t.id, v.name) for t in chosen for v in t.variations if v.expected is not Expected.AMBIGUOUS]
    # The cells of the full suite are counted even if only a few tasks are measured, so that the numbers of trials stay
    # the same.
    cells = sum(v.expected is Expected.SUCCEED for task in suite for v in task.variations) * (len(BLIND) + len(FLOOR))
    chances = {key: chance_of(*key) for key in keys}
    rules = {name: dict.fromkeys(keys, rule_trials) for name in witnessed() if name not in BLIND}
    if not probes:
        return PowerTrials({EXPERT: dict.fromkeys(keys, rule_trials)} | rules, chances)
    replayed = trials_to_flag(REPLAY_LIMIT, cells)
    guessed = {
        key: max(replayed, GUESS_TRIALS, trials_to_flag(chance, cells) if chance < MOST_CHANCE else 0)
        for key, chance in chances.items()
    }
    of = {EXPERT: {key: max(rule_trials, guessed[key]) for key in keys}}
    of |= rules
    of[_NO_LANGUAGE] = guessed
    of |= {name: dict.fromkeys(keys, replayed) for name in (*BLIND[1:], FLOOR[0])}
    of[FLOOR[1]] = dict.fromkeys(keys, STILL_TRIALS)
    return PowerTrials(of, chances)


def measure_power(
    planned: PowerTrials,
    out: Path,
    *,
    workers: int = 1,
    on_progress: Callable[[CalibrationProgress], None] | None = None,
) -> PowerMatrix:
    """Run every pretender (simulated faulty policy) on every variation, and return the power matrix.

    The same call resumes an interrupted measurement. If a faulty rule makes the same decisions as the expert in a
    trial, the outcome is copied from the expert instead of being simulated again.

    Raises:
        RunConflictError: If a folder already contains a different run.
        RecordError: If a record cannot be read, or if an error outside of the policy ended a trial.
    """
    total, before = planned.total, 0
    cells: dict[str, dict[Key, PowerCell]] = {}
    versions: dict[str, str] = {}
    same: dict[tuple[Key, int], frozenset[str]] = {}
    expert: dict[tuple[Key, int], _Outcome] = {}
    for name, wanted in planned.of.items():
        shared = {
            trial: expert[trial] for trial, rules in same.items() if name in rules and trial[1] < wanted[trial[0]]
        }
        plan = _plan(WITNESS if name == EXPERT else name, wanted, without=shared)

        def told(progress: Progress, name: str = name, offset: int = before + len(shared)) -> None:
            if on_progress is not None:
                on_progress(CalibrationProgress(offset + progress.done, total, name))

        outcomes = {trial: replace(outcome, shared=True) for trial, outcome in shared.items()}
        if plan.trials:
            run = evaluate(plan, out / name.replace(":", "-"), workers=workers, on_progress=told)
            diagnosis = diagnose_run(run)
            versions |= {k: v for k, v in diagnosis.versions.items() if not k.startswith("policy")}
            outcomes |= dict(_outcomes(run, diagnosis.trials))
            if name == EXPERT:
                expert, same = outcomes, _same(run)
        cells[name] = _cells(outcomes, wanted)
        before += sum(wanted.values())
    for task in dict.fromkeys(task for task, _ in planned.chances):
        versions |= versions_of_task(get_task(task))
    return PowerMatrix(cells, planned.chances, versions)


def _plan(address: str, wanted: Mapping[Key, int], *, without: Mapping[tuple[Key, int], _Outcome]) -> Plan:
    """Return the plan for the run of one pretender (simulated faulty policy).

    It contains all trials of the pretender except those whose outcome is already known.
    """
    tasks = tuple(dict.fromkeys(task for task, _ in wanted))
    # The baselines in FLOOR use end-effector deltas on every robot.
    space = EE_DELTA.name if address in FLOOR else None
    plan = make_plan(address, tasks=tasks, trials=max(wanted.values()), action_space=space, observation="state_only")
    kept = tuple(
        t
        for t in plan.trials
        if t.variation is not None
        and t.seed < wanted.get((t.task, t.variation), 0)
        and ((t.task, t.variation), t.seed) not in without
    )
    return replace(plan, trials=kept)


def _outcomes(run: RunFolder, trials: Sequence[TrialDiagnosis]) -> Iterator[tuple[tuple[Key, int], _Outcome]]:
    said = {((e.task, e.variation or ""), e.seed): e.ground_truth for e in run.entries() if e.status == "done"}
    for t in trials:
        trial = (t.task, t.variation or ""), t.seed
        if t.record is None:
            raise RecordError(f"{run.path}: {t.key} has no record. Run the same command again.")
        yield trial, _Outcome(t.success, bool(t.intention_correct), said.get(trial, {}).get("truth", ""))


def _same(run: RunFolder) -> dict[tuple[Key, int], frozenset[str]]:
    """Return, for each trial, the names of the faulty rules that agreed with every decision of the expert."""
    entries = [e for e in run.entries() if e.status == "done"]
    return {((e.task, e.variation or ""), e.seed): frozenset(e.ground_truth.get("same", "").split()) for e in entries}


def _cells(outcomes: Mapping[tuple[Key, int], _Outcome], wanted: Mapping[Key, int]) -> dict[Key, PowerCell]:
    groups: dict[Key, list[_Outcome]] = {key: [] for key in wanted}
    for (key, _), outcome in outcomes.items():
        groups[key].append(outcome)
    return {
        key: PowerCell(
            k=sum(o.success for o in members),
            n=len(members),
            right=sum(o.right for o in members),
            shared=sum(o.shared for o in members),
            wrong=dict(sorted(Counter(o.truth for o in members if o.truth).items())),
            failed=dict(sorted(Counter(o.truth for o in members if o.truth and not o.success).items())),
        )
        for key, members in groups.items()
    }
