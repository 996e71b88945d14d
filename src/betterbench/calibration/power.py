"""Measurement of the power matrix: the success rate of each simulated faulty policy on each variation.

Most faulty policies have a faulty decision rule, for example to pick at the same slot in every trial. To save time, the
expert runs first and records which faulty rules would make the same decisions in a trial. A policy with such a rule
would produce exactly the same episode, so the outcome of this trial is copied from the expert instead of being
simulated. The cell of the matrix counts the trial as shared. An interrupted measurement can be resumed.
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
"""Number of trials per faulty rule and variation. A few trials suffice, because decisions hardly depend on the seed."""
GUESS_TRIALS = 14
"""Minimum number of trials per variation of the policy that ignores the instruction.

If this policy guesses correctly with a probability of 1/3, it succeeds in more than half of 14 trials with a
probability of only 6 %. With 7 trials, the probability would be 17 %.
"""
STILL_TRIALS = 2
"""Number of trials per variation of the policy that never moves. Two suffice, because all its trials are alike."""
MOST_CHANCE = 0.9
"""Largest chance level for which a number of trials is computed.

At a chance level of 1, i.e. if only one instruction is possible, no number of trials can show a difference from chance.
"""
ALPHA = 0.05

_NO_LANGUAGE = BLIND[0]


@dataclass(frozen=True, slots=True)
class PowerTrials:
    """Number of trials of each simulated faulty policy on each variation. The seeds start at 0.

    Attributes:
        of: Number of trials, by policy and variation. The expert has enough trials to be compared with every policy.
        chances: Chance level of each variation, i.e. the success rate of guessing the instruction.
    """

    of: dict[str, dict[Key, int]]
    chances: dict[Key, float]

    @property
    def total(self) -> int:
        """Total number of trials, including trials whose outcome is copied from the expert."""
        return sum(n for row in self.of.values() for n in row.values())


@dataclass(frozen=True, slots=True)
class _Outcome:
    """Outcome of one trial, which is counted in a cell of the power matrix.

    Attributes:
        success: Whether the trial succeeded.
        right: Whether the policy had the correct intention, according to the diagnosis.
        truth: Label of the first wrong decision that the policy reported, or an empty string.
        shared: Whether the outcome was copied from the expert.
    """

    success: bool
    right: bool
    truth: str
    shared: bool = False


def trials_to_flag(chance: float, cells: int) -> int:
    """Return the smallest number of trials for which a success rate of 100 % differs significantly from chance.

    The significance level is 5 %, corrected for the number of cells (first step of Holm's method).
    """
    n = 1
    while cells * chance_p(Rate(n, n), chance=chance) >= ALPHA:
        n += 1
    return n


def power_trials(tasks: Sequence[str] = (), *, rule_trials: int = RULE_TRIALS, probes: bool = True) -> PowerTrials:
    """Return the number of trials for each cell of a power matrix, for the given tasks or for the whole suite.

    A policy that lacks an input, such as the image, gets enough trials to show that it solves a variation significantly
    more often than by chance, corrected for the number of cells. If ``probes`` is False, these policies are omitted,
    and only the expert and policies with faulty rules are run, which need few trials.
    """
    suite = [get_task(name) for name in suite_tasks(built_in_suite(tasks))]
    chosen = [get_task(name) for name in dict.fromkeys(tasks)] or suite
    # Ambiguous variations are omitted, because their trials neither succeed nor fail.
    keys = [(t.id, v.name) for t in chosen for v in t.variations if v.expected is not Expected.AMBIGUOUS]
    # Correct for all cells of the suite even if only some tasks are measured, so that the number of trials per cell
    # does not depend on the selection of tasks.
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
    """Run every simulated faulty policy on every variation, and return the power matrix.

    If a faulty rule makes the same decisions as the expert in a trial, the outcome is copied from the expert. The same
    call resumes an interrupted measurement.

    Raises:
        RunConflictError: If a folder already contains a different run.
        RecordError: If a record cannot be read, or if a trial ended with an error that the policy did not cause.
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
    """Return the plan for the run of one simulated faulty policy, without the trials whose outcomes are copied."""
    tasks = tuple(dict.fromkeys(task for task, _ in wanted))
    # The baseline policies in FLOOR return end-effector deltas for every robot.
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
    """Return the names of the faulty rules that agreed with every decision of the expert, by trial."""
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
