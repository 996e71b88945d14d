"""``better eval``: run a policy over the suite."""

from __future__ import annotations

import inspect
import re
from collections import Counter
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import Annotated, Literal

import tyro

from betterbench.certification import Coverage, load_coverage, packaged_coverage
from betterbench.certification.coverage import cure_for
from betterbench.cli.console import ERR, OUT, print_json, progress_bar, say
from betterbench.cli.tally import RunTally, service
from betterbench.errors import InvalidInputError
from betterbench.evaluation import Plan, Progress, make_plan
from betterbench.evaluation import evaluate as run_plan
from betterbench.evaluation.planning.repeat import repeated_plan
from betterbench.evaluation.ray_engine.cluster import ANYWHERE, Cluster
from betterbench.evaluation.trials.policy_factory import needs_no_thread
from betterbench.evaluation.trials.trial import POLICY_TIMEOUT_S
from betterbench.recording import JournalEntry, RunFolder
from betterbench.robots import build_robot_spec
from betterbench.scenes import engine_version
from betterbench.statistics import Rate, percent, smallest_paired_difference
from betterbench.tasks import SUITE_VERSION, TrialId, get_task, suite_tasks

LOG_EVERY_S = 60.0
"""How often a line tells how far a run is where there is no terminal to draw a bar on [s]: the log of a batch job."""

USUAL_OPPOSITE = 0.1
"""Share of pairs against the difference for the second figure of :func:`what_trials_show`: policies that fail on
different trials are usual, and one that fails on a subset of the other's failures is the best case."""


def evaluate(
    *,
    policy: str | None = None,
    out: Path | None = None,
    from_run: Annotated[Path | None, tyro.conf.arg(name="from")] = None,
    suite: str = "better60",
    tasks: tuple[str, ...] = (),
    variations: tuple[str, ...] = (),
    trials: int = 20,
    seed: int = 0,
    workers: int | None = None,
    envs: int | None = None,
    engine: Literal["local", "ray"] = "local",
    ray_address: str | None = None,
    replicas: int | None = None,
    replica_gpus: float | None = None,
    policy_timeout: float = POLICY_TIMEOUT_S,
    action_space: str = "ee_delta",
    observation: str = "default",
    quality: str = "standard",
    certificate: Path | None = None,
    uncertified: bool = False,
    allow_other_versions: bool = False,
    allow_changed_policy: bool = False,
    json: bool = False,
) -> None:
    """Evaluate a policy. The same command goes on with an unfinished run.

    Every variation runs with the same seeds, and the training conditions with as many trials in all; the first of them
    are the counterfactual twins. Trials that no certificate vouches for are refused (see better certify).

    Example: better eval --policy expert --tasks fast_food --trials 20 --out runs/expert

    Args:
        policy: Address of the policy (see better list policies). With --from, another one than that of the run.
        out: Folder of the run; runs/POLICY if not given.
        from_run: run.json of another run, or its folder, to be repeated: same trials, seeds, conventions and policy.
        suite: Suite to take the tasks from.
        tasks: Tasks to run; all of the suite if none is named.
        variations: Variations to run; all if none is named.
        trials: Trials per variation.
        seed: First seed.
        workers: Worker processes; one per processor if not given.
        envs: Environments that each worker keeps open at once, so that the policy always has something to answer;
            chosen by the policy if not given. Results do not depend on it.
        engine: local runs the workers on this machine, ray on a Ray cluster (extra ray).
        ray_address: Address of the Ray cluster; if not given, RAY_ADDRESS or a cluster of this machine alone.
        replicas: On Ray, copies of a policy that the run itself holds (lerobot:, or one that takes batches); 1 if
            not given.
        replica_gpus: Graphics cards of each copy, or the part of one; 1 if the cluster has them, if not given.
        policy_timeout: Deadline of one answer of a policy in our own processes (python:, lerobot:) in seconds; servers
            have theirs in the address, timeout=SECONDS.
        action_space: Action space of the policy.
        observation: Observation preset: default, official or state_only.
        quality: Render preset: fast, standard or high.
        certificate: Certificate of better certify, or its folder; the one that ships with the suite if not given.
        uncertified: Run trials that no certificate vouches for as well.
        allow_other_versions: With --from, repeat the run although versions differ that decide about results.
        allow_changed_policy: Go on although the policy server declares something else than when the run began.
        json: Print one JSON document at the end.
    """
    if engine == "local":
        _refuse_placing({"replicas": replicas, "replica_gpus": replica_gpus, "ray_address": ray_address})
    if allow_other_versions and from_run is None:
        raise InvalidInputError(
            "--allow-other-versions", "it is about a run that is repeated", "Give --from too, or leave it out"
        )
    of_suite = suite_tasks(suite)  # also where --tasks names others, so that a mistyped suite never goes unnoticed
    if from_run is not None:
        chosen = {"tasks": tasks, "variations": variations, "trials": trials, "seed": seed, "suite": suite}
        chosen |= {"action_space": action_space, "observation": observation, "quality": quality}
        _refuse_choices(chosen)
        plan = repeated_plan(from_run, policy=policy, allow_other_versions=allow_other_versions)
        seed, trials = _extent(plan)
    elif policy is None:
        raise InvalidInputError("--policy", "no policy is named", "Give its address, or --from RUN to repeat a run")
    else:
        plan = make_plan(
            policy,
            tasks=tasks or of_suite,
            variations=variations,
            trials=trials,
            seed=seed,
            action_space=action_space,
            observation=observation,
            quality=quality,
        )
    if not uncertified:
        require_certified(plan, certificate, seed=seed, trials=trials)
    say(f"{len(plan.trials)} trials. {what_trials_show(plan)}")
    run = run_with_bar(
        plan,
        out or Path("runs") / default_folder(plan.policy),
        workers=workers,
        envs=envs,
        engine=engine,
        cluster=Cluster(ray_address, 1 if replicas is None else replicas, replica_gpus),
        policy_timeout=policy_timeout,
        allow_changed_policy=allow_changed_policy,
        repeats=from_run if policy is None else None,
    )
    summary = _summary(run)
    if json:
        print_json(summary)
    else:
        for name in ("training", "variations"):
            k, n = summary[name]["k"], summary[name]["n"]
            OUT.print(f"{name:<11} {_shown(k, n)}", markup=False)
        broken = summary["errors"]["k"]
        if broken:
            OUT.print(f"broken      {broken} trials broke down; the same command runs them again", markup=False)
        OUT.print(f"run         {run.path}\nnext        better report {run.path}", markup=False)


def require_certified(plan: Plan, certificate: Path | None, *, seed: int, trials: int) -> None:
    """Check that a certificate vouches for every trial of a plan, and name those that the expert did not solve.

    Args:
        plan: The plan.
        certificate: Certificate or its folder; None for the one that ships with the suite.
        seed: First seed of the run.
        trials: Trials per variation of the run.

    Raises:
        InvalidInputError: If a trial is not covered; the text names the first one and the cure.
    """
    coverage: Coverage = packaged_coverage() if certificate is None else load_coverage(certificate)
    planned = [TrialId(t.task, t.condition, t.seed) for t in plan.trials]
    versions = {task: get_task(task).version for task in dict.fromkeys(t.task for t in plan.trials)}
    gap = coverage.gap(planned, suite=SUITE_VERSION, engine=engine_version(), tasks=versions)
    if gap is not None:
        whole = set(versions) == set(suite_tasks("better60"))
        raise InvalidInputError(
            f"the plan: {gap.trial.task}/{gap.trial.condition} seed {gap.trial.seed}",
            f"it is not certified ({gap.reason})",
            cure_for(gap, tasks=() if whole else versions, first=seed, trials=trials),
        )
    unsolved = coverage.unsolved(planned)
    if unsolved:
        named = ", ".join(f"{t.task}/{t.condition} seed {t.seed}" for t in unsolved[:5])
        more = f" and {len(unsolved) - 5} more" if len(unsolved) > 5 else ""
        say(f"The expert did not solve {len(unsolved)} of the planned trials: {named}{more}.")


def what_trials_show(plan: Plan) -> str:
    """Return what the trials of a plan can and cannot show, per variation, per axis and overall.

    Args:
        plan: The plan, in which every trial of a variation has its twin.
    """
    varied = [t for t in plan.trials if t.variation is not None]
    if not varied:
        return "None of them is a variation, so they show how well the training conditions were learned, and no more."
    variations = Counter((t.task, t.variation) for t in varied)
    axes = Counter(t.axis for t in varied)
    levels = (("a variation", variations.values()), ("an axis", axes.values()), ("all variations", (len(varied),)))
    best, usual, hidden = [], [], []
    for name, counts in levels:
        fewest, most = min(counts), max(counts)
        pairs = (str(fewest) if fewest == most else f"{fewest} to {most}") + (" pair" if most == 1 else " pairs")
        found = _smallest(fewest, most, opposite=0.0)
        if not found:
            hidden.append(f"{name} ({pairs})")
            continue
        best.append(f"{found} points for {name} ({pairs})")
        usual.append(_smallest(fewest, most, opposite=USUAL_OPPOSITE) or "more than they can show")
    sentences = []
    if best:
        sentences.append(
            "At 80 % power they show a drop against the twins, or a difference from another policy on the same trials, "
            f"of at least {', '.join(best)}; where {100 * USUAL_OPPOSITE:.0f} % of the pairs differ the other way, of "
            f"{', '.join(usual)}. Smaller ones can stay unseen."
        )
    if hidden:
        sentences.append(f"They are too few to show any difference for {', '.join(hidden)}; give more --trials.")
    return " ".join(sentences)


def _smallest(fewest: int, most: int, *, opposite: float) -> str:
    """Return the smallest difference that the most and the fewest pairs show, in points; empty if none do."""
    values = [smallest_paired_difference(n, opposite=opposite).value for n in (most, fewest)]
    return " to ".join(dict.fromkeys(f"{100 * v:.{1 if v < 0.1 else 0}f}" for v in values if v is not None))


def default_folder(policy: str) -> str:
    """Return the name of the folder that the runs of a policy go to unless another one is named."""
    return re.sub(r"[^A-Za-z0-9.]+", "-", policy).strip("-.") or "policy"


def prepare_robot(name: str) -> None:
    """Decimate a robot's meshes into the cache, with a bar; later runs find them there and show nothing."""
    with ExitStack() as stack:
        shown: list[Callable[[int], None]] = []

        def told(what: str, done: int, planned: int) -> None:
            if not shown:
                bar, task = stack.enter_context(progress_bar(what, planned))
                shown.append(lambda completed: bar.update(task, completed=completed))
            shown[0](done)

        build_robot_spec(name, progress=told)


def run_with_bar(
    plan: Plan,
    out: Path,
    *,
    workers: int | None = None,
    envs: int | None = None,
    engine: Literal["local", "ray"] = "local",
    cluster: Cluster = ANYWHERE,
    policy_timeout: float = POLICY_TIMEOUT_S,
    allow_changed_policy: bool = False,
    repeats: Path | None = None,
) -> RunFolder:
    """Run a plan with a progress bar on standard error, after the meshes of its robot are ready.

    Args:
        plan: The plan.
        out: Folder of the run.
        workers: Worker processes; one per processor if not given.
        envs: Environments per worker; chosen by the policy if not given.
        engine: What runs the workers.
        cluster: Where the workers of the engine "ray" are placed.
        policy_timeout: Deadline of one answer of a policy in our own processes [s].
        allow_changed_policy: Go on although the policy declares something else than when the run began.
        repeats: Run whose policy has to be the same.
    """
    prepare_robot(plan.robot)
    tally, folder, ended, elapsed_s = RunTally(), RunFolder(out, {}, {}), list[JournalEntry](), 0.0
    next_line_s = 0.0
    with progress_bar(plan.policy.partition("://")[0], len(plan.trials), estimate=False) as (bar, task):

        def told(progress: Progress) -> None:
            nonlocal elapsed_s, next_line_s
            if progress.last is None:
                tally.resume(folder)
            else:
                tally.add(folder, progress.last)
                ended.append(progress.last)
            elapsed_s = progress.elapsed_s
            note = tally.note(progress)
            bar.update(task, completed=progress.done, note=note)
            if not ERR.is_terminal and elapsed_s >= next_line_s:
                next_line_s = elapsed_s + LOG_EVERY_S
                say(f"{progress.done}/{progress.planned} trials{f' · {note}' if note else ''}")

        run = run_plan(
            plan,
            out,
            workers=workers,
            envs=envs,
            engine=engine,
            cluster=cluster,
            policy_timeout_s=policy_timeout,
            allow_changed_policy=allow_changed_policy,
            repeats=repeats,
            on_progress=told,
        )
    answers = "" if needs_no_thread(plan.policy) else service(ended, elapsed_s)
    if answers:
        say(f"policy: {answers}")
    return run


def _refuse_placing(given: Mapping[str, object]) -> None:
    """Refuse options that say where on a Ray cluster something is placed, for a run that is on none.

    Raises:
        InvalidInputError: If one of them is given.
    """
    for name, value in given.items():
        if value is not None:
            option = f"--{name.replace('_', '-')}"
            raise InvalidInputError(
                option, "it is for a Ray cluster, and the engine is local", f"Add --engine ray, or leave out {option}"
            )


def _refuse_choices(chosen: Mapping[str, object]) -> None:
    """Refuse options that a repeated run has answered already.

    Raises:
        InvalidInputError: If one of them is given.
    """
    defaults = inspect.signature(evaluate).parameters
    for name, value in chosen.items():
        if value != defaults[name].default:
            option = f"--{name.replace('_', '-')}"
            raise InvalidInputError(option, "--from repeats a run as it was", f"Leave out {option}, or --from")


def _extent(plan: Plan) -> tuple[int, int]:
    """Return the first seed of a plan and its trials per variation, which the cure for a missing certificate names."""
    seeds = [t.seed for t in plan.trials]
    counts = Counter((t.task, t.condition) for t in plan.trials if t.variation is not None)
    return min(seeds), max(counts.values(), default=len(set(seeds)))


def _summary(run: RunFolder) -> dict[str, dict[str, int]]:
    counts = {"training": {"k": 0, "n": 0}, "variations": {"k": 0, "n": 0}, "errors": {"k": 0, "n": 0}}
    for entry in run.entries():
        counts["errors"]["n"] += 1
        counts["errors"]["k"] += entry.status == "error"
    for record in run.records():
        group = counts["training" if record.metadata.variation is None else "variations"]
        group["n"] += 1
        group["k"] += record.outcome.success
    return counts


def _shown(k: int, n: int) -> str:
    rate = Rate(k, n)
    if rate.value is None:
        return "no trials"
    return f"{percent(k, n)} % success ({k}/{n}, 95 % interval {100 * rate.low:.0f} to {100 * rate.high:.0f})"
