"""``better eval``: run a policy on the trials of a suite."""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Iterable, Sequence
from contextlib import ExitStack
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tyro

from betterbench.cli.console import ERR, OUT, print_json, progress_bar, say
from betterbench.cli.robot_option import USUAL_OPTION, ChosenRobot, RobotOption
from betterbench.errors import InvalidInputError
from betterbench.quoting import default_name, shell_line, shell_word

if TYPE_CHECKING:
    from betterbench.diagnosis.until_decided import UntilDecided
    from betterbench.evaluation import Plan, Progress
    from betterbench.evaluation.ray_engine.cluster import Cluster
    from betterbench.records import JournalEntry, RunFolder
    from betterbench.sim.worlds import World
    from betterbench.tasks import TrialId

FIRST_ESTIMATE_S, FIRST_LOG_S = 4.0, 5.0
"""Time from the first steps to the first estimate of the duration, and interval of progress lines before that [s].
"""

LOG_EVERY_S = 60.0
"""Interval between progress lines if there is no terminal to draw a bar on [s]."""


@dataclass(frozen=True, slots=True)
class TrialOptions:
    """Options that select the trials and the conventions of a run.

    Attributes:
        suite: Suite that contains the tasks (see `better list suites`); LIBERO and CALVIN suites run in those worlds.
        tasks: Tasks to run; default: all tasks in the suite.
        variations: Variations to run; default: all. Only for betterbench's own scenes.
        trials: Trials per variation, default 20. In LIBERO: initial states per task, default from the protocol. In
            CALVIN: number of chains, default 1,000.
        seed: First seed; in LIBERO the first initial state, in CALVIN the first chain.
        action_space: The policy's action space; default: the usual action space of the robot (ee_delta for the Panda),
            and in other worlds the action space given in the policy address.
        observation: Observation preset: default, official or state_only.
        quality: Render preset: fast, standard or high.
        looks: Appearance of objects and rooms: seen (in demonstrations) or unseen.
        until_decided: Stop a variation as soon as its trials show that success drops compared with training, or that it
            does not drop by half; --trials is then the maximum.
    """

    suite: str = "better60"
    tasks: tuple[str, ...] = ()
    variations: tuple[str, ...] = ()
    trials: int | None = None
    seed: int = 0
    action_space: str | None = None
    observation: str = "default"
    quality: str = "standard"
    looks: str = "seen"
    until_decided: bool = False


USUAL_TRIALS = 20
"""Default number of trials per variation."""

MANY_TRIALS = 200
"""Maximum number of trials for which no smaller run is suggested."""

FIRST_TASK, FIRST_TRIALS = "morning_coffee", 3
"""Task of the suggested smaller run, and its number of trials per variation.

The task has the shortest trials of the suite.
"""


@dataclass(frozen=True, slots=True)
class WorldOptions:
    """Options that apply only in some worlds.

    Attributes:
        protocol: Name of the evaluation protocol in LIBERO.
        broken_premises: What to do if a scene contradicts the premise of its instruction: "refuse" stops the run, "run"
            continues and records the contradiction.
        axes: In LIBERO-Plus, the axes to run (layout, camera, robot, language, light, background, noise); default: all.
        variants: In LIBERO-Plus, maximum number of variants per task and axis, evenly spaced; default: all.
        libero_plus_assets: In LIBERO-Plus, the authors' assets (unzipped) with new objects, lights and textures;
            default: the environment variable BETTERBENCH_LIBERO_PLUS_ASSETS.
        libero_plus_sentences: In LIBERO-Plus, "clean" sends the instruction of the task. "published" also appends the
            variant name, as in the published results.
        calvin_env: In CALVIN, your clone of mees/calvin_env, or of mees/calvin with its submodules.
        calvin_config: In CALVIN, validation/.hydra/merged_config.yaml from the data set; without it, the configuration
            of scene D is composed from the checkout.
        calvin_renderer: In CALVIN, the image renderer: egl as in CALVIN, tiny for PyBullet's own renderer (its pixels
            differ), or auto to use EGL if it starts.
    """

    protocol: Literal["openpi", "gr00t", "lerobot"] = "openpi"
    broken_premises: Literal["refuse", "run"] = "refuse"
    axes: tuple[str, ...] = ()
    variants: int | None = None
    libero_plus_assets: Path | None = None
    libero_plus_sentences: Literal["clean", "published"] = "clean"
    calvin_env: Path | None = None
    calvin_config: Path | None = None
    calvin_renderer: Literal["auto", "egl", "tiny"] = "auto"


@dataclass(frozen=True, slots=True)
class RayOptions:
    """Ray cluster settings of a run, for --engine ray.

    Attributes:
        ray_address: Address of the Ray cluster; default: RAY_ADDRESS, or a local cluster on this machine.
        replicas: On Ray, number of replicas of a policy that runs in process (lerobot:, or a policy with act_batch);
            default 1.
        replica_gpus: Number of GPUs per replica, which may be a fraction; default: 1 if the cluster has GPUs.
    """

    ray_address: str | None = None
    replicas: int | None = None
    replica_gpus: float | None = None

    def cluster(self) -> Cluster:
        """Return the Ray cluster that executes the run."""
        from betterbench.evaluation.ray_engine.cluster import Cluster

        return Cluster(self.ray_address, 1 if self.replicas is None else self.replicas, self.replica_gpus)


def evaluate_command(
    *,
    policy: str | None = None,
    out: Path | None = None,
    from_run: Annotated[Path | None, tyro.conf.arg(name="from")] = None,
    chosen: Annotated[TrialOptions, tyro.conf.arg(name="")] = TrialOptions(),
    arm: ChosenRobot = USUAL_OPTION,
    world: Annotated[WorldOptions, tyro.conf.arg(name="")] = WorldOptions(),
    workers: int | None = None,
    envs: int | None = None,
    engine: Literal["local", "ray"] = "local",
    ray: Annotated[RayOptions, tyro.conf.arg(name="")] = RayOptions(),
    policy_timeout: float = 300.0,
    certificate: Path | None = None,
    uncertified: bool = False,
    allow_other_versions: bool = False,
    allow_changed_policy: bool = False,
    trust: bool = False,
    explain_power: bool = False,
    json: bool = False,
) -> None:
    """Evaluate a policy. Running the command again resumes an unfinished run.

    All variations of a task run with the same seeds. The training conditions of a task together get as many trials as
    each variation. Among them are the counterfactual twins: training trials with the same seeds. Trials that no
    certificate covers are rejected (see `better certify`).

    Example: better eval --policy expert --tasks fast_food --trials 3 --out runs/expert

    Args:
        policy: Policy address (see `better list policies`); with --from, a policy to run instead of that run's policy.
        out: Run folder; runs/POLICY if not given.
        from_run: Folder or run.json of another run, whose trials, seeds, conventions and policy are repeated.
        chosen: Options that select the trials and the conventions.
        arm: Option that selects the robot.
        world: Options for LIBERO, LIBERO-Plus and CALVIN.
        workers: Number of worker processes; default: one per CPU core.
        envs: Number of environments per worker, so that simulation continues while the policy computes; default: chosen
            by a warm-up.
        engine: local runs the workers on this machine, ray on a Ray cluster (extra ray).
        ray: Placement of a run on a Ray cluster.
        policy_timeout: Maximum time for one answer of a python: or lerobot: policy [s]; for a server, set it in the
            policy address.
        certificate: Certificate written by `better certify`, or its folder; default: the certificate shipped with the
            suite.
        uncertified: Also run trials that no certificate covers.
        allow_other_versions: With --from, repeat the run even if relevant versions differ.
        trust: With --from or --run-file, allow the file to run code or to send an API key.
        allow_changed_policy: Resume even if the policy's declarations have changed since the run began.
        explain_power: Print in detail which drops in success the trials can show.
        json: Print one JSON document at the end.
    """
    from betterbench.policies.kinds import read_address
    from betterbench.sim.worlds import world_of_suite

    if engine == "local":
        _refuse_changed(
            ray, "this option is for Ray clusters, but the engine is local", "Add --engine ray, or leave out {option}"
        )
    chosen_world = world_of_suite(chosen.suite)
    _refuse_other_options(world, chosen_world)
    if not chosen_world.facts.measured:
        _refuse_changed(arm, f"{chosen.suite} has its own robot", "Leave out {option}")
        plan = _world_plan(policy, from_run, chosen, world)
        for line in plan.world.announcement(plan.trials, chosen.suite):
            say(line)
    else:
        plan = _plan(policy, from_run, chosen, arm, allow_other_versions=allow_other_versions, trust=trust)
        read_address(plan.policy)  # report a mistyped policy before any statement about the plan
        if not uncertified:
            _require_certified(plan, certificate)
        out = out or Path("runs") / default_folder(plan.policy)
        certified = ([] if certificate is None else ["--certificate", str(certificate)]) + [
            "--uncertified"
        ] * uncertified
        certified += arm.words
        _say_plan(plan, out, chosen, certified if from_run is None else None, at_length=explain_power)
    run = run_with_bar(
        plan,
        out or Path("runs") / default_folder(plan.policy),
        workers=workers,
        envs=envs,
        engine=engine,
        cluster=ray.cluster(),
        policy_timeout_s=policy_timeout,
        allow_changed_policy=allow_changed_policy,
        repeats=from_run if policy is None else None,
    )
    _print_counts(run, plan, json=json)


def _say_plan(plan: Plan, out: Path, chosen: TrialOptions, certified: Sequence[str] | None, *, at_length: bool) -> None:
    """Print the number of trials and the smallest drops that they can detect. For a large plan, suggest a smaller run.

    ``certified`` contains the command-line options for robot and certificate. It is None if the plan is taken from
    another run.
    """
    from betterbench.evaluation.planning.power import smallest_drop_line, what_trials_show

    if plan.until_decided is not None or at_length:
        most = "" if plan.until_decided is None else "At most "
        say(f"{most}{len(plan.trials):,} trials. {what_trials_show(plan)}")
    else:
        say(f"{len(plan.trials):,} trials. {smallest_drop_line(plan)}")
    if certified is not None and len(plan.trials) > MANY_TRIALS:
        smaller = smaller_command(plan, out, chosen, certified)
        if smaller:
            say(f"To begin with, {smaller}", whole=True)


def smaller_command(plan: Plan, out: Path, chosen: TrialOptions, certified: Sequence[str] = ()) -> str:
    """Return "N trials: COMMAND" for a small part of a plan, or an empty string if the plan itself is small."""
    from betterbench.evaluation.planning.plan import make_plan
    from betterbench.tasks.user_files import options_for

    task = min({t.task for t in plan.trials}, key=lambda name: (name != FIRST_TASK, name))
    words = ["--policy", plan.policy]
    for name in ("action_space", "observation", "quality", "looks", "seed"):
        if getattr(chosen, name) != getattr(TrialOptions(), name):
            words += [f"--{name.replace('_', '-')}", str(getattr(chosen, name))]
    words += [*certified, "--tasks", task, "--trials", str(FIRST_TRIALS), "--out", f"{out}-first"]
    smaller = make_plan(plan.policy, tasks=(task,), trials=FIRST_TRIALS, seed=chosen.seed)
    if len(smaller.trials) >= len(plan.trials):
        return ""
    return f"{len(smaller.trials)} trials: better eval{options_for([task])} {shell_line(words)}"


def _plan(
    policy: str | None,
    from_run: Path | None,
    chosen: TrialOptions,
    arm: RobotOption,
    *,
    allow_other_versions: bool,
    trust: bool,
) -> Plan:
    """Return the plan that the options describe, or the plan of the run that is to be repeated."""
    from betterbench.evaluation import make_plan
    from betterbench.evaluation.planning.repeat import repeated_plan
    from betterbench.tasks import suite_tasks

    if allow_other_versions and from_run is None:
        raise InvalidInputError(
            "--allow-other-versions",
            "this option applies only to a repeated run",
            "Add --from RUN, or leave out this option",
        )
    # load the suite even if --tasks names other tasks, so that a mistyped suite is reported
    of_suite = suite_tasks(chosen.suite)
    if from_run is not None:
        for given in (chosen, arm):
            _refuse_changed(given, "--from repeats a run with its own options", "Leave out {option}, or --from")
        plan = repeated_plan(from_run, policy=policy, allow_other_versions=allow_other_versions, trust=trust)
        if policy is None:
            say(f"Policy named in {from_run}: {plan.policy}")
        return plan
    if policy is None:
        raise InvalidInputError(
            "--policy", "no policy is given", "Pass a policy address, or --from RUN to repeat a run"
        )
    options = asdict(chosen) | asdict(arm)
    del options["suite"]
    options["trials"] = USUAL_TRIALS if chosen.trials is None else chosen.trials
    return make_plan(policy, **{**options, "tasks": chosen.tasks or of_suite})


def _world_plan(policy: str | None, from_run: Path | None, chosen: TrialOptions, world: WorldOptions) -> Plan:
    """Return the plan for a suite of a world other than betterbench's own scenes."""
    from betterbench.evaluation.planning.world_plan import make_world_plan

    if from_run is not None:
        raise InvalidInputError(
            "--from", f"runs of {chosen.suite} cannot be repeated", "Use --suite and --policy instead"
        )
    if policy is None:
        raise InvalidInputError("--policy", "no policy is given", "Pass the address of a policy")
    _refuse_changed(
        replace(chosen, suite="better60", tasks=(), trials=None, seed=0, action_space=None, observation="default"),
        f"the option applies only to betterbench's own scenes, not to the suite {chosen.suite}",
        "Leave out {option}, and choose trials with --tasks, --trials and --seed",
    )
    return make_world_plan(
        policy,
        suite=chosen.suite,
        tasks=chosen.tasks,
        trials=chosen.trials,
        seed=chosen.seed,
        action_space=chosen.action_space,
        observation=chosen.observation,
        **_changed(world),
    )


def _changed(world: WorldOptions) -> dict[str, Any]:
    """Return the options that differ from their defaults, by name."""
    return {f.name: getattr(world, f.name) for f in fields(world) if getattr(world, f.name) != f.default}


def _refuse_other_options(given: WorldOptions, world: World) -> None:
    """Raise InvalidInputError for the first option that the world of the suite does not support.

    The message lists the worlds that support the option.
    """
    from betterbench.sim.worlds import all_worlds
    from betterbench.wording import listed

    def has(world: World, option: str) -> bool:
        return world.options is not None and option in {f.name for f in fields(world.options)}

    name = next((name for name in _changed(given) if not has(world, name)), None)
    if name is None:
        return
    option = f"--{name.replace('_', '-')}"
    others = [other for other in all_worlds() if has(other, name)]
    titles, suite = listed([other.facts.title for other in others]), next(iter(others[0].facts.suites))
    raise InvalidInputError(
        option, f"this option applies only to {titles}", f"Leave out {option}, or use --suite {suite}"
    )


def _refuse_changed(given: TrialOptions | RobotOption | RayOptions, problem: str, cure: str) -> None:
    """Reject the first option that differs from its default."""
    for field in fields(given):
        if getattr(given, field.name) != field.default:
            option = f"--{field.name.replace('_', '-')}"
            raise InvalidInputError(option, problem, cure.format(option=option))


def _require_certified(plan: Plan, certificate: Path | None) -> None:
    """Check that a certificate covers every trial of a plan, and print the parts that it does not cover."""
    from betterbench.certification.refusal import require_certified

    remark = require_certified(plan, certificate)
    if remark:
        say(remark)


def default_folder(policy: str) -> str:
    """Return the default name of the folder for a policy's runs."""
    return default_name(policy, otherwise="policy")


def prepare_robot(name: str | None = None) -> None:
    """Store simplified meshes of a robot in the cache while showing a progress bar. Later runs reuse these meshes.

    If no robot is named, the default robot is prepared.
    """
    from betterbench.interface.actions import USUAL_ROBOT
    from betterbench.sim.worlds import OWN_WORLD

    _prepare(OWN_WORLD, name or USUAL_ROBOT)


def prepare_robots_of(tasks: Iterable[str]) -> None:
    """Prepare the robots for which the tasks were designed. If there are no tasks, prepare the default robot."""
    from betterbench.tasks import get_task

    for name in dict.fromkeys(get_task(task).robot for task in tasks) or (None,):
        prepare_robot(name)


def _prepare(world: World, robot: str) -> None:
    """Prepare this machine for runs in a world, with a progress bar if that takes long."""
    with ExitStack() as stack:
        shown: list[Callable[..., None]] = []

        def on_progress(what: str, done: int, planned: int) -> None:
            if not shown:
                bar, task = stack.enter_context(progress_bar(what, planned, stays=False))
                shown.append(lambda **changes: bar.update(task, **changes))
            shown[0](description=what, completed=done, total=planned)

        world.prepare(robot, on_progress)


class _RunLine:
    """Progress line of a run, updated after each trial and during trials."""

    def __init__(self, plan: Plan, out: Path, label: str | None, draw: Callable[[int, str], None]) -> None:
        from betterbench.cli.outlook import Outlook
        from betterbench.cli.tally import RunTally
        from betterbench.records import RunFolder

        self.ended: list[JournalEntry] = []  # in this session
        self.elapsed_s = 0.0
        self._draw = draw
        self._folder, self._start = RunFolder(out, {}, {}), "" if label is None else f"{label}: "
        self._tally = RunTally(frozenset(t.id for t in plan.trials if t.ambiguous))
        self._outlook = Outlook(plan.world.step_limits(plan.trials))
        self._progress: Progress | None = None
        self._began_s = time.monotonic()
        self._next_line_s, self._estimated = 0.0, False

    def progress(self, progress: Progress) -> None:
        """Show the progress when the run begins or a trial has ended."""
        if progress.last is None:
            self._tally.resume(self._folder)
            done = {e.key for e in self._folder.entries() if e.status == "done"} if progress.done else set()
            self._outlook.begin(done)
            if progress.done:
                left = progress.planned - progress.done
                state = f"{left:,} {'is' if left == 1 else 'are'} left"
                say(f"{self._start}{progress.done:,} of {progress.planned:,} trials are done already; {state}.")
        else:
            self._tally.add(self._folder, progress.last)
            self.ended.append(progress.last)
            if progress.last.status == "done":
                self._outlook.end(progress.last.key)
        self.elapsed_s = progress.elapsed_s
        self._progress = progress
        self._show(progress)

    def step(self, steps: int) -> None:
        """Show the progress when the workers have reported how many steps they executed."""
        self._outlook.see(steps)
        if self._progress is None:
            return
        if not self._estimated and self._outlook.seen_s >= FIRST_ESTIMATE_S:
            self._estimated = True
            estimate = self._outlook.first_estimate()
            if estimate:
                say(f"{self._start}{estimate}")
        self._show(self._progress)

    def _show(self, progress: Progress) -> None:
        note = self._tally.note(progress, left=self._outlook.note(progress))
        self._draw(progress.done, note)
        now_s = time.monotonic() - self._began_s
        if not ERR.is_terminal and now_s >= self._next_line_s:
            self._next_line_s = now_s + (LOG_EVERY_S if self._outlook.steps else min(FIRST_LOG_S, LOG_EVERY_S))
            say(f"{self._start}{progress.done}/{progress.planned} trials{f' · {note}' if note else ''}")


def run_with_bar(plan: Plan, out: Path, *, label: str | None = None, **options: Any) -> RunFolder:  # noqa: ANN401 - those of evaluate
    """Prepare the meshes of the robot, and run a plan with a progress bar on standard error.

    The bar shows ``label``, or the policy name if no label is given. The options are the same as for
    :func:`betterbench.evaluation.evaluate`, except that there is one worker per CPU core by default.
    """
    from betterbench.cli.tally import service_text, times_text
    from betterbench.evaluation import evaluate
    from betterbench.evaluation.running.summary import policy_service, run_times
    from betterbench.policies.kinds import kind_of

    kind = kind_of(plan.policy)
    needs = kind.needs_of(plan.policy)
    shown_as = kind.name if needs.server else plan.policy
    _prepare(plan.world, plan.robot)
    with progress_bar(label or shown_as, len(plan.trials), estimate=False) as (bar, task):
        shown = _RunLine(plan, out, label, lambda done, note: bar.update(task, completed=done, note=note))
        on_progress, on_steps = shown.progress, shown.step
        run = evaluate(plan, out, **{"workers": None, **options}, on_progress=on_progress, on_steps=on_steps)
    ended, elapsed_s = shown.ended, shown.elapsed_s
    answers = service_text(policy_service(ended, elapsed_s)) if needs.thread else ""
    if answers:
        say(f"policy: {answers}")
    times = run_times(run.entries())
    if times is not None:
        chosen = options.get("envs") is None
        say(f"time: {times_text(times, drawn_here=not plan.world.drawn_by, chosen=chosen)}")
    return run


def _print_counts(run: RunFolder, plan: Plan, *, json: bool) -> None:
    """Print the results of a run: the success rate, and the number of trials that could not be run.

    For a run with ``until_decided``, the verdicts are printed too.
    """
    from betterbench.evaluation.running.summary import require_a_trial, run_counts, run_times
    from betterbench.statistics import Rate, percent
    from betterbench.tasks.user_files import options_for, origins_of

    decided = _decided(run, plan)
    counts = run_counts(run, seeds=None if decided is None else decided.first_seeds)
    if json:
        times = run_times(run.entries())
        told = {"times": None if times is None else times.to_json()}
        print_json({**counts, **told, **({} if decided is None else {"until_decided": decided.to_json()})})
        require_a_trial(run)
        return
    if decided is not None:
        trials = sum(e.status == "done" for e in run.entries())
        OUT.print(f"{decided.summary} It took {trials} trials.", markup=False)
        OUT.print(f"Success with the first {len(decided.first_seeds)} seeds, which every variation ran:", markup=False)
    for name in ("training", "variations"):
        k, n = counts[name]["k"], counts[name]["n"]
        rate = Rate(k, n)
        interval = f"95 % interval {100 * rate.low:.0f} to {100 * rate.high:.0f}"
        shown = "no trials" if rate.value is None else f"{percent(k, n)} % success ({k}/{n}, {interval})"
        OUT.print(f"{name:<11} {shown}", markup=False)
    ambiguous = counts["ambiguous"]["n"]
    if ambiguous:
        OUT.print(
            f"ambiguous   {ambiguous} trials, which are not counted because they have no right outcome", markup=False
        )
    broken = counts["errors"]["k"]
    if broken:
        counted, them = ("1 trial", "it") if broken == 1 else (f"{broken} trials", "them")
        cure = f"running the command again repeats {them}"
        theirs = origins_of({t.task for t in plan.trials}, worlds=(plan.world.name,)).get("task_files", ())
        if theirs:  # a run cannot be resumed with a changed file
            names = " or ".join(dict.fromkeys(file["name"] for file in theirs))
            cure += f". If the mistake is in {names}, correct the file and choose a new folder with --out"
        OUT.print(f"broken      {counted} could not be run; {cure}", markup=False, soft_wrap=not OUT.is_terminal)
    failed = [e.message for e in run.entries() if e.status == "done" and e.message is not None]
    if failed:
        text = f"errors      {len(failed)} trials ended with an error of the policy, the first with {failed[0]}"
        OUT.print(text, markup=False, soft_wrap=not OUT.is_terminal)
    if plan.policy == "expert" and plan.world.facts.measured:
        _print_expert(run, {t.id for t in plan.trials if t.ambiguous})
    files = options_for({t.task for t in plan.trials}, worlds=(plan.world.name,))
    following = f"better report {shell_word(run.path)}{files}"
    OUT.print(f"run         {run.path}", markup=False, soft_wrap=True)
    # A report shows labels, which chains of CALVIN do not have.
    if plan.world.facts.reading != "chains":
        OUT.print(f"next        {following}", markup=False, soft_wrap=True)
    require_a_trial(run)


def _print_expert(run: RunFolder, ambiguous: Collection[TrialId]) -> None:
    """Print why the expert failed in its first failed trial, and the command that shows this trial."""
    from betterbench.tasks.user_files import options_for

    done = [e for e in run.entries() if e.status == "done" and e.message is None and e.key not in ambiguous]
    failed = [e for e in done if not run.outcome(e).success]
    if not failed:
        return
    first = next((e for e in failed if e.ground_truth.get("mishap")), failed[0])
    why = first.ground_truth.get("mishap") or "no obstacle was found; look for objects that move or fall"
    text = f"{first.task}/{first.condition} seed {first.seed}: {why} (docs/adding-a-task.md, If the expert fails)"
    OUT.print(f"expert      {text}", markup=False, soft_wrap=not OUT.is_terminal)
    record = shell_word(run.record_path(first.task, first.condition, first.seed))
    shown = f"better replay {record}{options_for([first.task])} --out expert.mp4"
    OUT.print(f"watch       {shown}", markup=False, soft_wrap=True)


def _decided(run: RunFolder, plan: Plan) -> UntilDecided | None:
    """Return the verdicts of a run with ``until_decided``, computed from the records, or None for other runs."""
    from betterbench.diagnosis.until_decided import decided_of

    if plan.until_decided is None:
        return None
    done = {e.key for e in run.entries() if e.status == "done"}
    trials = [t.id for t in plan.trials]
    return decided_of(plan.until_decided, trials, lambda trial: run.succeeded(trial) if trial in done else None)
