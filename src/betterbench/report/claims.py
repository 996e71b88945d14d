"""Statistical tests of the conclusions about a policy, and the trials that would settle an open conclusion."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from betterbench.diagnosis.measures.metrics import twins
from betterbench.diagnosis.verdict import RunDiagnosis
from betterbench.quoting import shell_line
from betterbench.report.wording import Figure
from betterbench.statistics import Rate, Verdict, chance_p, paired_power
from betterbench.statistics.power import DEFAULT_ALPHA, DEFAULT_POWER
from betterbench.tasks.labels import Kind
from betterbench.tasks.user_files import options_for
from betterbench.tasks.worlds.facts import facts_of_task
from betterbench.wording import listed, plural

USUAL_SHARE = 0.2
"""Reference rate for conclusions that are not based on an illusion gap.

Such a conclusion is supported if significantly more than this fraction of the trials fail (exact binomial test). It is
about training, or about variations without training twins (training trials with the same seed).
"""

FEW = 3
"""Minimum number of trials for a conclusion about a habit, an axis or, if failures are rare, a single task."""

MOST_PAIRS = 100
"""Maximum number of pairs per variation that is recommended."""

MOST_VARIATIONS = 3
"""Maximum number of variations that are recommended."""

_SETTINGS = (
    ("--action-space", "action_space", "ee_delta"),
    ("--observation", "camera_preset", "default"),
    ("--quality", "render_quality", "standard"),
    ("--looks", "looks", "seen"),
)
"""Options of ``better eval``, each with the field of the record that stores it and its default value."""


@dataclass(frozen=True, slots=True)
class Grounds:
    """Statistical basis of a conclusion: the test, and the trials that would settle the conclusion if it is open.

    Attributes:
        supported: Whether the test supports the conclusion. Always True for a conclusion that only states counts.
        test: Name of the test in words.
        p_value: The p-value of the test; None if there is no test.
        deciding: Sentence about the trials that would settle the conclusion; "" if the conclusion is not open.
        command: Command that runs these trials; "" if it is not known.
    """

    supported: bool
    test: str = ""
    p_value: float | None = None
    deciding: str = ""
    command: str = ""


DESCRIBED = Grounds(True)
"""Basis of a conclusion that only counts outcomes, without a test."""


def claim_of_weak_training(training: Figure, diagnosis: RunDiagnosis | None = None) -> Grounds:
    """Test the claim that a policy solves less than half of its training trials."""
    k, n = training.k or 0, training.n or 0
    p = chance_p(Rate(k, n), chance=0.5)
    test = "training trials solved, against one half (exact binomial)"
    if n and (2 * k >= n or p <= DEFAULT_ALPHA):
        return Grounds(2 * k < n, test, p)
    text = "More trials of the training conditions would decide it (a larger --trials)"
    needed = next((m for m in range(n + 1, MOST_PAIRS + 1) if _is_below_half(k, n, m)), None)
    if n and needed is not None:
        text += f", {needed} in total if the share of solved trials stays the same"
    command = "" if diagnosis is None else _training_command(diagnosis, needed or MOST_PAIRS)
    return Grounds(False, test, p, f"{text}.", command)


def _is_below_half(k: int, n: int, more: int) -> bool:
    """Return whether a rate is significantly below one half.

    ``more`` further trials with the same success rate are added to the counts before the test.
    """
    return n > 0 and chance_p(Rate(k * more // n, more), chance=0.5) <= DEFAULT_ALPHA


def _training_command(diagnosis: RunDiagnosis, trials: int) -> str:
    """Return the command that runs about ``trials`` more training trials of a run's first task, with new seeds."""
    task = next((t.task for t in diagnosis.trials if t.variation is None), "")
    conditions = {t.condition for t in diagnosis.trials if t.task == task}
    if not task or not facts_of_task(task).measured:
        return ""
    each = -(-trials // len(conditions))
    return _evaluation(diagnosis, [task], seed=_next_seed(diagnosis), trials=each, out="runs/training")


def claim_of_training_failure(count: int, n: int) -> Grounds:
    """For a run without variations, test the claim that one kind of failure is frequent in training.

    Args:
        count: Number of training trials with this kind of failure.
        n: Number of training trials.
    """
    p = _above(count, n, USUAL_SHARE)
    test = f"failed training trials against {100 * USUAL_SHARE:.0f} % (exact binomial)"
    return Grounds(count >= FEW and p <= DEFAULT_ALPHA, test, p)


def grounds_of_training(diagnosis: RunDiagnosis) -> Grounds:
    """Return the statistical basis of a conclusion about a run without variations.

    The trials that would settle open conclusions are the variations of the same tasks, since they show how the policy
    reasons.
    """
    text = "To diagnose its reasoning, run the variations of these tasks, with the same seeds."
    tasks = list(dict.fromkeys(t.task for t in diagnosis.trials))
    if not tasks or not all(facts_of_task(task).measured for task in tasks):
        return DESCRIBED
    seeds = [t.seed for t in diagnosis.trials]
    trials = max(seeds) - min(seeds) + 1
    command = _evaluation(diagnosis, tasks, seed=min(seeds), trials=trials, out="runs/variations")
    return Grounds(True, deciding=text, command=command)


def claim_of_habit(count: int, n: int, conditions: int) -> Grounds:
    """Test the claim that a policy habitually fails in certain conditions.

    The p-value is corrected for the number of conditions.

    Args:
        count: Number of trials with the failure in these conditions.
        n: Number of all trials in these conditions.
        conditions: Number of conditions in the run.
    """
    p = min(1.0, conditions * _above(count, n, USUAL_SHARE))
    test = f"failed trials against {100 * USUAL_SHARE:.0f} % (exact binomial, times {plural(conditions, 'condition')})"
    return Grounds(count >= FEW and p <= DEFAULT_ALPHA, test, p)


def claim_of_no_failure(diagnosis: RunDiagnosis, n: int) -> Grounds:
    """For a run in which all variation trials succeeded, test the claim that the policy has no failure.

    At least six solved trials are needed to rule out that the policy fails half of all variation trials.
    """
    p = chance_p(Rate(n, n), chance=0.5)
    test = "variation trials solved, against one half (exact binomial)"
    if p <= DEFAULT_ALPHA:
        return Grounds(True, test, p)
    tasks = list(dict.fromkeys(t.task for t in diagnosis.trials))
    text = "More trials of the variations on new seeds would decide it (a larger --trials)."
    if not tasks or not all(facts_of_task(task).measured for task in tasks):
        return Grounds(False, test, p, text)
    command = _evaluation(diagnosis, tasks, seed=_next_seed(diagnosis), trials=3, out="runs/more")
    return Grounds(False, test, p, text, command)


def claim_of_failure(diagnosis: RunDiagnosis, gap: Figure, count: int, n: int) -> Grounds:
    """Test the claim that the most frequent kind of failure occurs more often than by chance.

    The claim is supported if variations are solved less often than the training trials with the same seeds, either by
    the test of the illusion gap or by the verdict of ``better eval --until-decided``. It is also supported if
    significantly more than :data:`USUAL_SHARE` of the variation trials fail, regardless of training.

    Args:
        diagnosis: Diagnosis of the run.
        gap: Illusion gap of the run over all variations.
        count: Number of variation trials with this kind of failure.
        n: Number of variation trials that have ended.
    """
    decided = diagnosis.until_decided
    if decided is not None and decided.decisions.count(Verdict.DROP):
        return Grounds(True, "a variation drops (evidence of the run until decided)")
    if gap.p_value is not None and (gap.value or 0.0) > 0.0 and gap.p_value <= DEFAULT_ALPHA:
        return Grounds(True, "illusion gap over all variations", gap.p_value)
    p = _above(count, n, USUAL_SHARE)
    if count >= FEW and p <= DEFAULT_ALPHA:
        return Grounds(True, f"failed variation trials against {100 * USUAL_SHARE:.0f} % (exact binomial)", p)
    if gap.p_value is None:
        return Grounds(False, f"failed variation trials against {100 * USUAL_SHARE:.0f} %", p, *_deciding(diagnosis))
    return Grounds(False, "illusion gap over all variations", gap.p_value, *_deciding(diagnosis))


def _above(count: int, n: int, share: float) -> float:
    return chance_p(Rate(count, n), chance=share) if n and count > share * n else 1.0


def _deciding(diagnosis: RunDiagnosis) -> tuple[str, str]:
    """Return a sentence about the pairs of trials that would settle the claim, and the command that runs them.

    The command uses new seeds. The new run must be judged alone. If its pairs were pooled with the earlier pairs, the
    result would be biased, because the earlier outcomes were the reason for the new run.
    """
    varied = [t for t in diagnosis.trials if t.variation is not None and t.kind is not Kind.UNFINISHED]
    failed = Counter((t.task, t.pool) for t in varied if t.kind is not Kind.NONE)
    lost = Counter((t.task, t.pool) for twin, t in twins(diagnosis.even_trials) if twin.success and not t.success)
    ranked = [key for key, _ in (lost or failed).most_common()]
    if not ranked:
        return "", ""
    chosen = [key for key in ranked if key[0] == ranked[0][0]][:MOST_VARIATIONS]  # of one task, for one command
    names = listed([f"{task}/{name}" for task, name in chosen])
    each = _pairs_needed(diagnosis, chosen)
    if each is None:
        text = f"To decide it, run more pairs of {names} with their training twins"
    else:
        text = f"If the failure rate stays the same, it can be decided with {plural(each, 'pair')} of {names}"
        text += " each" if len(chosen) > 1 else ""
    text += " on new seeds, judged without the earlier pairs."
    if not all(facts_of_task(task).measured for task, _ in chosen):
        return text, ""
    command = _evaluation(
        diagnosis,
        [chosen[0][0]],
        variations=[name for _, name in chosen],
        seed=_next_seed(diagnosis),
        trials=each or MOST_PAIRS,
        out="runs/decide",
    )
    return text, command


def _evaluation(
    diagnosis: RunDiagnosis, tasks: Sequence[str], *, variations: Sequence[str] = (), seed: int, trials: int, out: str
) -> str:
    """Return the command that evaluates the policy of a run. Return "" if the command cannot be written in a shell."""
    if "\0" in diagnosis.address:
        return ""
    named = ["--variations", *variations] if variations else []
    words = [
        "--policy", diagnosis.address, "--tasks", *tasks, *named, *_settings(diagnosis.versions),
        "--seed", str(seed), "--trials", str(trials), "--out", out,
    ]  # fmt: skip
    return f"better eval{options_for(tasks)} {shell_line(words)}"


def _settings(versions: Mapping[str, str]) -> Iterator[str]:
    """Yield the command-line options for settings of a run that differ from the defaults.

    A setting is left out if it differs between records of the run, or if the records do not contain it.
    """
    for option, name, usual in _SETTINGS:
        value = versions.get(name, usual)
        if value not in (usual, str(None)) and " | " not in value:
            yield from (option, value)


def _next_seed(diagnosis: RunDiagnosis) -> int:
    return 1 + max((trial.seed for trial in diagnosis.trials), default=-1)


def _pairs_needed(diagnosis: RunDiagnosis, conditions: Sequence[tuple[str, str]]) -> int | None:
    """Return the number of pairs per variation that give the test of the illusion gap a power of 80 %.

    The observed drop in success is assumed to be the true drop. Return None if there is no drop, or if more than
    :data:`MOST_PAIRS` pairs per variation would be needed.
    """
    pairs = [
        (twin.success, trial.success)
        for twin, trial in twins(diagnosis.even_trials)
        if (trial.task, trial.pool) in conditions
    ]
    n, lost, won = len(pairs), pairs.count((True, False)), pairs.count((False, True))
    if lost <= won:
        return None
    for each in range(1, MOST_PAIRS + 1):
        if paired_power(each * len(conditions), (lost - won) / n, opposite=won / n) >= DEFAULT_POWER:
            return each
    return None
