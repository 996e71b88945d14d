"""Results of the diagnosis for a trial and for a run. They can be converted to JSON."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from typing import Any

from betterbench.diagnosis.until_decided import UntilDecided
from betterbench.statistics import Rate
from betterbench.tasks.axes import Expected
from betterbench.tasks.labels import Kind, Label
from betterbench.tasks.trial_id import TrialId
from betterbench.tasks.worlds.facts import WorldFacts, facts_of_task
from betterbench.tasks.worlds.libero_plus import axis_of

OUTCOME_ALONE = "outcome_alone"
"""Evidence rule of a failed trial if only the outcome of each trial is judged."""


@dataclass(frozen=True, slots=True)
class Evidence:
    """Reason for a label, with the part of the episode that shows it.

    Attributes:
        rule: Name of the evidence rule.
        text: Explanation in one or more sentences.
        start_s: Beginning of the part of the episode [s].
        end_s: End of the part of the episode [s].
        objects: Names of the objects involved.
        shared: Properties that the grasped object shares with the requested object ("color", "shape"; for a look-alike
            also "slot").
        candidates: Labels that are possible if only this trial is considered. The second pass may decide between them.
    """

    rule: str
    text: str
    start_s: float
    end_s: float
    objects: tuple[str, ...] = ()
    shared: tuple[str, ...] = ()
    candidates: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Attempt:
    """Grasp attempt of a trial.

    Closing the gripper far from all objects also counts as an attempt. Such an attempt has neither an object nor a
    slot.

    Attributes:
        start_s: Time when the gripper begins to close [s].
        end_s: Time when the gripper is closed [s].
        object: Name of the grasped object, or None if the gripper closed without an object.
        slot: Nearest slot, or None if no slot is near.
        result: "target" (an object that was requested at that time), "distractor" (any other object) or "null" (no
            object).
        secured: Whether the object was lifted.
    """

    start_s: float
    end_s: float
    object: str | None
    slot: str | None
    result: str
    secured: bool


@dataclass(frozen=True, slots=True)
class TrialDiagnosis:
    """Diagnosis of a single trial.

    Attributes:
        task: Name of the task.
        variation: Name of the variation, or None for a trial of a training condition.
        condition: Name of the training condition. For a variation, this is the training condition of the trial's twin
            (the training trial with the same seed).
        axis: Variation axis, or None.
        seed: Seed of the trial.
        policy: Name of the policy.
        instruction: Text of the instruction.
        success: Whether the trial succeeded.
        expected: Expected behavior: "succeed", "refuse", "stay_still" or "ambiguous".
        label: Outcome label.
        first_attempt: Name of the object of the first grasp attempt. None if there was no attempt, or if the gripper
            closed without an object. A drawer is only named if the first step of the instruction is about the drawer
            itself.
        first_attempt_kind: Kind of that object.
        first_slot: Slot of the first grasp attempt, or None.
        intended: Name of the object that should be attempted first, or None if no attempt would be correct. If the
            first attempt was correct, this is the attempted object, otherwise the first of ``intended_any``.
        intended_kind: Kind of that object.
        intended_any: Names of all objects that would be correct to attempt first, ordered by subgoal and slot.
        intention_correct: Whether the first attempt was at a requested object. None if there is no record.
        progress: Fraction of the requested subgoals that were completed in a valid order.
        attempts: All grasp attempts, in chronological order.
        evidence: Evidence that decided the label.
        collisions: Number of collisions of the robot or a held object with fixtures. None if there is no record.
        steps: Number of control steps.
        duration_s: Duration of the episode [s].
        record: Path of the record relative to the run, or None if there is no record.
        harm: One clause for each harm to an object that is not part of the instruction ("the mouse lies on the floor").
            A trial with harm is not a success.
        needless: For a success, the steps of training that the policy executed although they were not requested, such
            as a grasp at an emptied slot. They are evidence of inertia that did not prevent the goal. Empty for
            failures.
        scene: Digest of the initial state. Trials with the same seed and digest differ only in the instruction. Empty
            if there is no record, or if first attempts are not judged.
    """

    task: str
    variation: str | None
    condition: str
    axis: str | None
    seed: int
    policy: str
    instruction: str
    success: bool
    expected: str
    label: Label
    first_attempt: str | None
    first_attempt_kind: str | None
    first_slot: str | None
    intended: str | None
    intended_kind: str | None
    intended_any: tuple[str, ...]
    intention_correct: bool | None
    progress: float
    attempts: tuple[Attempt, ...]
    evidence: Evidence
    collisions: int | None
    steps: int
    duration_s: float
    record: str | None
    harm: tuple[str, ...] = ()
    needless: tuple[Evidence, ...] = ()
    scene: str = ""

    @property
    def ambiguous(self) -> bool:
        """Whether a premise of the instruction is false in this trial.

        The trial then gets a label but is not part of any rate.
        """
        return self.expected == Expected.AMBIGUOUS.value

    @property
    def kind(self) -> Kind:
        """Kind of outcome that the label belongs to, such as a reasoning failure."""
        return self.label.kind

    @property
    def judged_kind(self) -> str | None:
        """Name of the kind, for tables and JSON. None for a failure in a world in which causes are not judged."""
        of_causes = self.kind in (Kind.REASONING, Kind.EXECUTION)
        return None if of_causes and not facts_of_task(self.task).judges_causes else self.kind.value

    @property
    def trial_id(self) -> TrialId:
        """Identifier of the trial: its task, its variation or training condition, and its seed."""
        return TrialId(self.task, self.variation or self.condition, self.seed)

    @property
    def pool(self) -> str:
        """Name of the condition for which the trial is counted: the variation or the training condition.

        In LIBERO-Plus, this is the axis, because each variant is run only once.
        """
        return axis_of(self.variation) or self.variation or self.condition

    @property
    def key(self) -> str:
        """Key of the trial as a string ("fast_food/T1/3", "fast_food/train1/3")."""
        return str(self.trial_id)

    @property
    def twin_key(self) -> str | None:
        """Key of the counterfactual twin (the training trial with the same seed), or None for a training trial."""
        return None if self.variation is None else str(TrialId(self.task, self.condition, self.seed))

    def to_json(self) -> dict[str, Any]:
        """Return a JSON-serializable dict."""
        return {**asdict(self), "label": self.label.value, "kind": self.judged_kind, "key": self.key}


@dataclass(frozen=True, slots=True)
class Metric:
    """Rate or other measure with its confidence interval.

    Attributes:
        name: Name of the measure ("success_rate", "success_with_a_needless_step", "intention_accuracy",
            "instruction_effect", "delta_sr", "distractor_grasp_rate", "illusion_gap", "reasoning_failure_rate",
            "execution_failure_rate", "system_failure_rate", "collision_rate", "progress"). If trials are unfinished,
            there is also "unfinished_rate". For each "illusion_gap", "twin_success_rate" is the success rate of the
            twins, and "paired_success_rate" is the success rate of the paired variation trials.
        scope: Set of trials that the measure covers: "overall" (all trials of variations), "training" (all trials of
            training conditions), "axis:temporal_extrapolation", "fast_food" (the variations of this task),
            "fast_food/training", "fast_food/T1", "fast_food/train1".
        k: Numerator, or None if the measure is not a single rate.
        n: Denominator. For paired measures, this is the number of pairs.
        value: Value of the measure, a fraction in [-1, 1], or None for n = 0.
        low: Lower end of the 95 % confidence interval, or None.
        high: Upper end of the interval, or None.
        p_value: p-value of the test, or None if there is no test.
        method: Method of the interval ("wilson", "newcombe", "paired bootstrap", "anytime-valid").
    """

    name: str
    scope: str
    k: int | None
    n: int
    value: float | None
    low: float | None
    high: float | None
    p_value: float | None = None
    method: str = "wilson"

    @classmethod
    def of_rate(cls, name: str, scope: str, rate: Rate) -> Metric:
        """Return a metric for a rate of ``k`` out of ``n``."""
        return cls(name, scope, rate.k, rate.n, rate.value, rate.low, rate.high)

    def to_json(self) -> dict[str, Any]:
        """Return a JSON-serializable dict."""
        return asdict(self)


@dataclass(frozen=True, slots=True)
class RunDiagnosis:
    """Diagnosis of a run, with its trials, metrics and findings.

    Attributes:
        policy: Name of the policy.
        trials: One entry for each diagnosed trial, finished or not, in the order of the plan.
        metrics: All metrics of the run.
        findings: Conclusions about the policy from several trials, one sentence each, most important first.
        notes: Limits of the run's evidence, one sentence each (missing pairs, smallest detectable difference).
        thresholds: Values of the thresholds, by name.
        versions: Versions found in the records, by name.
        waiting: Planned trials that a run in progress has not reached yet and that do not count. Empty if no process is
            writing to the run, because missing trials are then unfinished ``trials``.
        until_decided: Verdict on each variation of a run with ``--until-decided``, or None for other runs. Trials that
            were made unnecessary by a verdict are left out.
        address: Policy address used in suggested commands. By default, it is ``policy``.
    """

    policy: str
    trials: tuple[TrialDiagnosis, ...]
    metrics: tuple[Metric, ...]
    findings: tuple[str, ...]
    notes: tuple[str, ...]
    thresholds: dict[str, float]
    versions: dict[str, str]
    waiting: tuple[TrialDiagnosis, ...] = ()
    until_decided: UntilDecided | None = None
    address: str = ""

    def __post_init__(self) -> None:
        """If no address is given, use the policy's name as the address."""
        if not self.address:
            object.__setattr__(self, "address", self.policy)

    @property
    def pending(self) -> tuple[str, ...]:
        """Keys of the planned trials that a run in progress has not reached yet."""
        return tuple(t.key for t in self.waiting)

    @property
    def worlds(self) -> tuple[WorldFacts, ...]:
        """Facts about the worlds of all planned trials."""
        tasks = dict.fromkeys(t.task for t in (*self.trials, *self.waiting))
        return tuple({facts.name: facts for facts in map(facts_of_task, tasks)}.values())

    @property
    def causes_judged(self) -> bool:
        """Whether the causes of failures are judged in the world of at least one planned trial."""
        return not self.worlds or any(world.judges_causes for world in self.worlds)

    @property
    def unfinished(self) -> tuple[TrialDiagnosis, ...]:
        """Trials that had not ended when the run was stopped."""
        return tuple(t for t in self.trials if t.kind is Kind.UNFINISHED)

    @property
    def counted_trials(self) -> tuple[TrialDiagnosis, ...]:
        """Trials that are included in the rates, i.e. all trials that are not ambiguous."""
        return tuple(t for t in self.trials if not t.ambiguous)

    @property
    def even_trials(self) -> tuple[TrialDiagnosis, ...]:
        """Trials that were chosen independently of the outcomes and are not ambiguous."""
        return tuple(t for t in self.shown_trials if not t.ambiguous)

    @property
    def shown_trials(self) -> tuple[TrialDiagnosis, ...]:
        """Trials that were chosen independently of the outcomes, including ambiguous trials."""
        if self.until_decided is None:
            return self.trials
        return tuple(t for t in self.trials if t.seed in self.until_decided.first_seeds)

    def even(self) -> RunDiagnosis:
        """Return a diagnosis that contains only ``even_trials``, for measures over several variations."""
        return replace(self, trials=self.even_trials)

    def named(self, name: str) -> RunDiagnosis:
        """Return a copy of the diagnosis with a different policy name in all trials."""
        trials, waiting = (tuple(replace(t, policy=name) for t in part) for part in (self.trials, self.waiting))
        return replace(self, policy=name, trials=trials, waiting=waiting)

    @property
    def planned(self) -> int:
        """Number of planned trials."""
        return len(self.trials) + len(self.pending)

    def metric(self, name: str, scope: str) -> Metric | None:
        """Return a metric by its name and scope, or None if it does not exist."""
        for metric in self.metrics:
            if metric.name == name and metric.scope == scope:
                return metric
        return None

    def to_json(self) -> dict[str, Any]:
        """Return the dict that ``better diagnose --json`` prints. The list "trials" contains all planned trials."""
        return {
            "policy": self.policy,
            "trials": [t.to_json() for t in (*self.trials, *self.waiting)],
            "metrics": [m.to_json() for m in self.metrics],
            "findings": list(self.findings),
            "notes": list(self.notes),
            "thresholds": self.thresholds,
            "versions": self.versions,
            "pending": list(self.pending),
            "until_decided": None if self.until_decided is None else self.until_decided.to_json(),
        }
