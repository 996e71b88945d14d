"""Summary of a policy's diagnosis in a few sentences, which the report shows first."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace

from betterbench.diagnosis.bindings import confused_words, wrong_places
from betterbench.diagnosis.failure_mode import exposed_labels
from betterbench.diagnosis.instruction_effect import effect_sentence, is_unused, unused_sentence
from betterbench.diagnosis.libero import untold_by
from betterbench.diagnosis.thresholds import SHARE_OF_ALL
from betterbench.diagnosis.verdict import RunDiagnosis, TrialDiagnosis
from betterbench.errors import UnknownNameError, one_line
from betterbench.report.claims import (
    DESCRIBED,
    FEW,
    Grounds,
    claim_of_failure,
    claim_of_habit,
    claim_of_no_failure,
    claim_of_training_failure,
    claim_of_weak_training,
    grounds_of_training,
)
from betterbench.report.legend import AXIS_PLACES, LEGEND
from betterbench.report.outcomes import Segment, segments_of
from betterbench.report.wording import THIN, Figure
from betterbench.statistics import Rate, fisher_p
from betterbench.statistics.power import DEFAULT_ALPHA
from betterbench.statistics.wording import p_text, points
from betterbench.tasks.labels import Kind, Label
from betterbench.wording import listed, plural

RARE_SHARE = 0.05
"""Failures in at most this fraction of the variation trials (one in 20) are treated as exceptions."""

WEAK_SHARE = 0.5
"""Success rate in training conditions below which a policy is said not to have learned the task. Its success rates then
do not show how it reasons, but its first grasp attempts can still be judged.
"""


ANYWHERE = (Label.EARLY_HALT, Label.EXECUTION_FAILURE, Label.TIMEOUT)
"""Labels of failures that can occur in any condition and are therefore not attributed to an axis of variation."""

KIND_NAMES = {Kind.REASONING: "reasoning", Kind.EXECUTION: "execution", Kind.SYSTEM: "the system"}
"""Names of the kinds of failures in conclusions, used after "failures of"."""

LONGEST_REASON = 300
"""Maximum length of the error message on the first screen if the policy failed to run, in characters."""

SLOT_RULES = (Label.LEXICAL_KINEMATIC_SHORTCUT, Label.VISUAL_LAYOUT_BIAS)
"""Labels of policies that pick from a certain slot regardless of the object in it."""


@dataclass(frozen=True, slots=True)
class Failure:
    """Main failure mode of some trials, with three counts: trials with this failure, all failures, and all trials.

    ``look_alikes`` counts further trials that the same faulty rule explains. In these trials, the policy took an object
    that looks like the target from the slot in which the target was during training. The count is 0 if there are fewer
    such trials than trials with the label itself.
    """

    label: Label
    count: int
    failures: int
    trials: int
    look_alikes: int = 0

    @property
    def name(self) -> str:
        """Full name of the failure mode."""
        return LEGEND[self.label].name

    @property
    def share(self) -> str:
        """Fraction of the failures with counts, e.g. "80 % of all failures (40/50), 40/240 variation trials".

        If all failures are of this kind, the percentage is left out, since :attr:`lead` says so.
        """
        more = f"; the same rule also explains {plural(self.look_alikes, 'look-alike')} taken from a trained slot"
        text = f"{self.count}/{self.trials} variation trials"
        if self.count < self.failures:
            percent = Figure(self.count / self.failures, None, None, self.count, self.failures).with_unit()
            text = f"{percent} of all failures ({self.count}/{self.failures}), {text}"
        return text + (more if self.look_alikes else "")

    @property
    def lead(self) -> str:
        """Words that precede the name of the failure mode, such as "Most often"."""
        if self.look_alikes:
            return "The rule behind most failures"
        if self.count < self.failures:
            return "Most often"
        return "The only failure" if self.failures == 1 else "All failures"


@dataclass(frozen=True, slots=True)
class Headline:
    """Conclusion about one policy, with the numbers that support it, for the top of the page.

    Attributes:
        conclusion: One sentence that names the main fault, or says that no fault was found.
        sentences: One or more sentences with the numbers that support the conclusion.
        family: Family of the main failure, such as "reasoning"; "right" if there is no failure. It determines the
            color.
        effect: Effect of the instruction, measured over pairs of trials that differ only in the instruction.
        effect_sentence: Sentence that explains the instruction effect.
        needless: Successful trials in which the policy also did a training step that was not requested.
        segments: Outcomes of the variation trials.
        breakdown: Error message that ended most trials, if the policy itself failed to run.
        claim: Test on which the conclusion is based, and the trials that would settle the conclusion if the test is not
            passed.
    """

    policy: str
    conclusion: str
    sentences: tuple[str, ...]
    family: str
    training: Figure
    variations: Figure
    gap: Figure
    intention: Figure
    grasps: Figure
    effect: Figure
    effect_sentence: str
    needless: Figure
    failure: Failure | None
    segments: tuple[Segment, ...]
    breakdown: str = ""
    claim: Grounds = DESCRIBED

    @property
    def twins_differ(self) -> bool:
        """Whether the training twins in the illusion gap have a different success rate than all training trials."""
        return self.gap.sides is not None and self.gap.sides[0].number(1) != self.training.number(1)

    def to_json(self) -> dict[str, object]:
        """Return the conclusion as a JSON-serializable dict, with its test or the trials that would settle it."""
        return {"conclusion": self.conclusion, **asdict(self.claim)}


def headline_of(diagnosis: RunDiagnosis) -> Headline:
    """Return the conclusion about the policy of a run.

    The main failure is the most frequent label within the most frequent kind of failure, over all variation trials. If
    two kinds are equally frequent, reasoning failures come first.
    """
    diagnosis = replace(diagnosis, trials=diagnosis.counted_trials)
    training = Figure.of(diagnosis.metric("success_rate", "training"))
    variations = Figure.of(diagnosis.metric("success_rate", "overall"))
    gap = Figure.gap(diagnosis, "overall")
    intention = Figure.of(diagnosis.metric("intention_accuracy", "overall"))
    varied = [trial for trial in diagnosis.trials if trial.variation is not None]
    conclusion, family, claim = _conclusion(diagnosis, training, gap)
    effect = diagnosis.metric("instruction_effect", "overall")
    breakdown = _breakdown(varied)
    sentences = [
        _numbers(training, variations, gap),
        _failures(varied, diagnosis.findings),
        breakdown,
        _unfinished(diagnosis),
    ]
    return Headline(
        diagnosis.policy,
        conclusion,
        tuple(sentence for sentence in sentences if sentence),
        family,
        training,
        variations,
        gap,
        intention,
        Figure.of(diagnosis.metric("distractor_grasp_rate", "overall"), noun="grasps"),
        Figure.of(effect, noun="pairs"),
        effect_sentence(effect),
        Figure.of(diagnosis.metric("success_with_a_needless_step", "overall")),
        leading_failure(varied),
        segments_of([trial for trial in diagnosis.even_trials if trial.variation is not None]),
        breakdown,
        claim,
    )


def verdict_line(diagnosis: RunDiagnosis) -> str:
    """Return the conclusion about a run in one line for a terminal: policy, conclusion and the two success rates."""
    headline = headline_of(diagnosis)
    rates = (("training", headline.training), ("variations", headline.variations))
    counts = ", ".join(f"{name} {figure.count()}" for name, figure in rates if not figure.missing)
    counts += f", unfinished {len(diagnosis.unfinished)}" if diagnosis.unfinished else ""
    said = headline.conclusion.rstrip(".")
    if counts:
        said = f"{said.removesuffix(')')}; {counts})" if said.endswith(")") else f"{said} ({counts})"
    return f"{headline.policy}: {said}."


def leading_failure(trials: Sequence[TrialDiagnosis]) -> Failure | None:
    """Return the main failure mode of variation trials with its counts. Return None if no trial failed."""
    failed = [trial for trial in trials if _has_failed(trial)]
    label = main_failure(trials)
    if label is None:
        return None
    count = sum(trial.label is label for trial in failed)
    return Failure(label, count, len(failed), len(trials), _look_alikes(failed, label, count))


def _look_alikes(failed: Sequence[TrialDiagnosis], label: Label, count: int) -> int:
    """Return the number of trials in which the rule of a label led the policy to a look-alike of the target.

    Return 0 if there are fewer trials in which a look-alike was taken than trials with the label itself.
    """
    taken = [trial for trial in failed if trial.label is Label.SEMANTIC_FEATURE_COLLAPSE]
    if label not in SLOT_RULES or len(taken) < count:
        return 0
    return sum("slot" in trial.evidence.shared for trial in taken)


def main_failure(trials: Sequence[TrialDiagnosis]) -> Label | None:
    """Return the most frequent label within the most frequent kind of failure. Return None if no trial failed.

    A policy that always picks from a certain slot takes any object in this slot, including look-alikes of the target.
    If such a rule is proven and most look-alikes were taken from a slot in which the target was during training, the
    rule explains them, and the label of the rule is returned. The exception is a policy for which the appearance of the
    objects explains all attempts.
    """
    kinds = Counter(trial.kind for trial in trials if _has_failed(trial))
    if not kinds:
        return None
    order = [Kind.REASONING, Kind.EXECUTION, Kind.SYSTEM]
    kind = min(kinds, key=lambda k: (-kinds[k], order.index(k)))
    labels = Counter(trial.label for trial in trials if trial.kind is kind)
    ranks = list(LEGEND)
    main = min(labels, key=lambda label: (-labels[label], ranks.index(label)))
    if main is not Label.SEMANTIC_FEATURE_COLLAPSE:
        return main
    in_slot = sum("slot" in t.evidence.shared for t in trials if t.label is main)
    rule = max(SLOT_RULES, key=lambda label: labels[label])
    explained = 3 * in_slot >= 2 * labels[main] and 2 * labels[rule] >= labels[main]
    return rule if explained and not _only_looks(trials, rule) else main


def _has_failed(trial: TrialDiagnosis) -> bool:
    """Return whether a trial has ended without success."""
    return trial.kind not in (Kind.NONE, Kind.UNFINISHED)


def _only_looks(trials: Sequence[TrialDiagnosis], rule: Label) -> bool:
    """Return whether objects that look like the target explain all trials better than a rule about slots.

    This is the case if the rule led the policy only to look-alikes, and the policy often made a correct first attempt
    in trials where the rule predicts a wrong one.
    """
    followed = [trial for trial in trials if trial.label is rule]
    alike = all({"color", "shape"} & set(trial.evidence.shared) for trial in followed)
    right = sum(bool(trial.intention_correct) and rule in _exposed(trial) for trial in trials)
    return alike and 2 * right >= len(followed)


def _exposed(trial: TrialDiagnosis) -> tuple[Label, ...]:
    """Return the labels that the variation of a trial can reveal. Return () if the variation is unknown."""
    try:
        return exposed_labels(trial.task, trial.variation or "")
    except UnknownNameError:
        return ()


def _conclusion(diagnosis: RunDiagnosis, training: Figure, gap: Figure) -> tuple[str, str, Grounds]:
    """Return the main sentence of the conclusion, the family of the failure, and the statistical basis.

    The family is "reasoning", for example.

    If there is evidence that the policy does not use the instruction, this is the conclusion instead of the main
    failure. The exception is a policy with a habit that explains its wrong first attempts in the whole run, because
    such a policy can seem to ignore the instruction if only a few variations were run.
    """
    trials = diagnosis.trials
    varied = [trial for trial in trials if trial.variation is not None and trial.kind is not Kind.UNFINISHED]
    if not varied and any(trial.kind is Kind.UNFINISHED for trial in trials):
        return "The run is not finished: no trial of a variation has ended.", Kind.UNFINISHED.value, DESCRIBED
    if not varied:
        return _training_alone(diagnosis, training)
    main = main_failure(varied)
    found = _by_failures(diagnosis, varied, training, gap)
    failed = [trial for trial in varied if _has_failed(trial)]
    said = main is Label.VISUAL_LAYOUT_BIAS and found[1] == LEGEND[main].family and _is_majority(failed, main)
    explained = sum(trial.label is Label.VISUAL_LAYOUT_BIAS for trial in trials) < FEW
    settled = found[2].supported and (said or explained)
    unused = None if settled or (main is not None and main.kind is Kind.SYSTEM) else _unused_instruction(diagnosis)
    return unused or found


def _by_failures(
    diagnosis: RunDiagnosis, varied: Sequence[TrialDiagnosis], training: Figure, gap: Figure
) -> tuple[str, str, Grounds]:
    """Return the conclusion from the failures in variation trials alone, in the form of :func:`_conclusion`."""
    trials = diagnosis.trials
    failed = [trial for trial in varied if _has_failed(trial)]
    main = main_failure(varied)
    weak = training.value is not None and training.value < WEAK_SHARE
    weak_claim = claim_of_weak_training(training, diagnosis)
    rare = len(failed) <= RARE_SHARE * len(varied)
    if weak and rare and weak_claim.supported:
        solved = "all" if main is None else f"{len(varied) - len(failed)} of {len(varied)}"
        text = f"It fails the training conditions ({training.count()} solved) and solves {solved} trials of variations"
        return f"{text}: watch the films of training first.", "execution", weak_claim
    if weak and rare:
        solved = f"{len(varied) - len(failed)} of {len(varied)}"
        text = f"it solved {training.count()} training trials and {solved} trials of variations"
        return f"{NOTHING_YET}: {text}.", Kind.UNFINISHED.value, weak_claim
    if main is None:
        return _no_failure(diagnosis, len(varied))
    habit = _habit(trials)
    if rare:
        text = f"No systematic failure found; {plural(len(failed), 'trial')} of {len(varied)} failed."
        return habit or (text, "right", DESCRIBED)
    claim = claim_of_failure(diagnosis, gap, sum(trial.kind is main.kind for trial in failed), len(varied))
    before = f"It has not learned the training conditions ({training.count()} solved)."
    if not claim.supported and (broken := _never_ran(trials)):
        return broken
    if not claim.supported:
        planned = sum(trial.variation is not None for trial in trials)
        nothing = _nothing_yet(len(failed), planned, gap), Kind.UNFINISHED.value, claim
        weak_training = (before, "execution", weak_claim) if weak and weak_claim.supported else None
        return habit or weak_training or nothing
    entry = LEGEND[main]
    text = entry.conclude([trial for trial in failed if trial.label is main])
    if main in ANYWHERE and (where := _where(trials, main)):
        text = f"{text.removesuffix('.')} {where}."
    text = _confused(trials, failed, main) or _of_several(text, failed, main)
    text = f"{text}{_of_other_kinds(failed, main.kind)}"
    if weak and main.kind is not Kind.SYSTEM:
        if not weak_claim.supported:
            before = f"It solved {training.count()} training trials."
            claim = replace(claim, deciding=weak_claim.deciding, command=weak_claim.command)
        elif main.kind is Kind.EXECUTION:
            before = "It fails the training conditions too."
        else:
            before = "It has not learned the training conditions."
        return f"{before} {text}", entry.family, claim
    return text, entry.family, claim


def _confused(trials: Sequence[TrialDiagnosis], failed: Sequence[TrialDiagnosis], main: Label) -> str:
    """Return the sentence about words or targets that the policy confuses, if the main label does not name them.

    If a rule is proven, the sentence begins with this rule. A habit of placing objects at certain targets is ruled out
    if the policy brings objects to targets where they were never placed in training.
    """
    reasoning = [trial for trial in failed if trial.kind is Kind.REASONING]
    vague = main is Label.WRONG_OBJECT or (main.kind is Kind.REASONING and not _is_majority(failed, main))
    words = confused_words(trials, reasoning) if vague else ""
    return words or (wrong_places(reasoning) if main in (Label.WRONG_OBJECT, Label.BEHAVIORAL_INERTIA) else "")


def _no_failure(diagnosis: RunDiagnosis, solved: int) -> tuple[str, str, Grounds]:
    """Return the conclusion for a run that solves every variation. It also mentions failures in training trials."""
    trained = [trial for trial in diagnosis.trials if trial.variation is None and trial.kind is not Kind.UNFINISHED]
    failed = [trial for trial in trained if _has_failed(trial)]
    main = main_failure(trained)
    if main is None or len(failed) <= RARE_SHARE * len(trained):
        claim = claim_of_no_failure(diagnosis, solved)
        if claim.supported:
            return "No failure found: it solves every variation that was run.", "right", claim
        text = f"{NOTHING_YET}: {solved} of {plural(solved, 'variation trial')} solved, too few to rule out a policy"
        return f"{text} that fails half of them.", Kind.UNFINISHED.value, claim
    counts = f"{len(failed)} of {plural(len(trained), 'training trial')}"
    text = f"It solves every variation that was run ({plural(solved, 'trial')}) and fails {counts}"
    claim = claim_of_training_failure(sum(trial.kind is main.kind for trial in failed), len(trained))
    if not claim.supported:
        return f"{text}.", Kind.UNFINISHED.value, claim
    said = _of_several(LEGEND[main].conclude([trial for trial in failed if trial.label is main]), failed, main)
    return f"{text}. In training: {said[0].lower()}{said[1:]}", LEGEND[main].family, claim


def _training_alone(diagnosis: RunDiagnosis, training: Figure) -> tuple[str, str, Grounds]:
    """Return the conclusion for a run without variations: its results under the training conditions, and a warning."""
    ended = [trial for trial in diagnosis.trials if trial.kind is not Kind.UNFINISHED]
    untold = untold_by(diagnosis.trials)
    if not ended:
        text = f"No variation was run, so its reasoning is unknown{untold and ': '}{untold}."
        return text, Kind.UNFINISHED.value, DESCRIBED
    missing = f"no variation was run, so nothing is known beyond the training conditions{untold and ': '}{untold}"
    failed = [trial for trial in ended if _has_failed(trial)]
    main, wanted = main_failure(ended), grounds_of_training(diagnosis)
    if main is None:
        return f"No failure found in {plural(len(ended), 'training trial')}; {missing}.", Kind.UNFINISHED.value, wanted
    claim = claim_of_training_failure(sum(trial.kind is main.kind for trial in failed), len(ended))
    weak_claim = claim_of_weak_training(training, diagnosis)
    before = f"It has not learned the training conditions ({training.count()} solved). " if weak_claim.supported else ""
    if not claim.supported and (broken := _never_ran(ended)):
        return broken
    if not claim.supported:
        if before:
            return f"{before}N{missing[1:]}.", "execution", replace(weak_claim, deciding=wanted.deciding)
        text = f"{NOTHING_YET}: {len(failed)} of {plural(len(ended), 'training trial')} failed, and {missing}."
        return text, Kind.UNFINISHED.value, replace(claim, deciding=wanted.deciding, command=wanted.command)
    entry = LEGEND[main]
    text = _of_several(entry.conclude([trial for trial in failed if trial.label is main]), failed, main)
    told = (
        f"{before}{text.removesuffix('.')} ({len(failed)} of {plural(len(ended), 'training trial')} failed); {missing}."
    )
    return told, entry.family, replace(claim, deciding=wanted.deciding, command=wanted.command)


def _counts(failed: Sequence[TrialDiagnosis], main: Label) -> tuple[int, int]:
    """Return the number of failures with a label, and the number of all failures of the same kind."""
    same = sum(trial.label is main for trial in failed)
    return same + _look_alikes(failed, main, same), sum(trial.kind is main.kind for trial in failed)


def _is_majority(failed: Sequence[TrialDiagnosis], main: Label) -> bool:
    """Return whether a label explains at least half of the failures of its kind."""
    same, kind = _counts(failed, main)
    return 2 * same >= kind


def _of_several(text: str, failed: Sequence[TrialDiagnosis], main: Label) -> str:
    """Add a note to a conclusion if its label explains less than half of the failures of the label's kind."""
    if _is_majority(failed, main):
        return text
    same, kind = _counts(failed, main)
    return (
        f"Its failures of {KIND_NAMES[main.kind]} have several forms, none of which is a majority; the most frequent "
        f"one ({same} of {kind}): {text[0].lower()}{text[1:]}"
    )


def _of_other_kinds(failed: Sequence[TrialDiagnosis], kind: Kind) -> str:
    """Return a sentence with the number of failures of other kinds.

    Return "" if they are fewer than half of all failures.
    """
    others = [trial.kind for trial in failed if trial.kind is not kind]
    if 2 * len(others) < len(failed):
        return ""
    names = listed([KIND_NAMES[other] for other in KIND_NAMES if other in others])
    return f" {len(others)} of {len(failed)} failures are of another kind: {names}."


NOTHING_YET = "Nothing to conclude yet"
"""Beginning of the conclusion if no test is passed."""
REPAIR = "Correct the error of the policy, and run the same trials again in a new folder."


def _never_ran(trials: Sequence[TrialDiagnosis]) -> tuple[str, str, Grounds] | None:
    """Return the conclusion for a run in which every trial ended with an error of the policy.

    Return None for other runs.
    """
    if any(trial.label is not Label.POLICY_ERROR for trial in trials):
        return None
    text = f"Nothing was measured: the policy failed with an error in {len(trials)} of {plural(len(trials), 'trial')}."
    return text, LEGEND[Label.POLICY_ERROR].family, Grounds(False, deciding=REPAIR)


def _unused_instruction(diagnosis: RunDiagnosis) -> tuple[str, str, Grounds] | None:
    """Return the conclusion for a policy that provably does not use the instruction. Return None for other policies.

    Such a policy chooses correctly in some trials by chance, so its failures alone may prove nothing.
    """
    effect = diagnosis.metric("instruction_effect", "overall")
    if effect is None or not is_unused(effect):
        return None
    test = "instruction effect over pairs of trials (exact binomial against 50 %)"
    return unused_sentence(effect), Kind.REASONING.value, Grounds(True, test, effect.p_value)


def _nothing_yet(failed: int, n: int, gap: Figure) -> str:
    """Return the conclusion for failures that may have occurred by chance."""
    text = f"{NOTHING_YET}: {failed} of {plural(n, 'variation trial')} failed"
    if gap.missing:
        return f"{text}, and there are no training twins to compare them with."
    ends = f"95{THIN}% interval {gap.interval()}" if gap.interval() else ""
    shown = ", ".join(part for part in (ends, p_text(gap.p_value)) if part)
    return f"{text}, and an illusion gap of {points(gap.value or 0.0, gap.digits)} points may be chance ({shown})."


def _habit(trials: Sequence[TrialDiagnosis]) -> tuple[str, str, Grounds] | None:
    """Return the conclusion about a failure that is rare overall but frequent in certain conditions of one task.

    Training conditions are included, because a policy may fail even in training. A failure that also occurs
    in many other tasks is not a habit. Return None if there is no such failure.
    """
    groups: dict[tuple[str, Label], list[TrialDiagnosis]] = defaultdict(list)
    for trial in trials:
        if _has_failed(trial):
            groups[trial.task, trial.label].append(trial)
    ranks, counts, shown = list(LEGEND), dict[tuple[str, Label], str](), Counter[Label]()
    conditions = len({(t.task, t.variation or t.condition) for t in trials})
    claims = dict[tuple[str, Label], Grounds]()
    for (task, label), members in groups.items():
        names = sorted({t.variation or t.condition for t in members})
        n = sum(t.task == task and (t.variation or t.condition) in names for t in trials)
        claim = claim_of_habit(len(members), n, conditions)
        if any(t.variation for t in members) and len(members) >= SHARE_OF_ALL * n and claim.supported:
            claims[task, label] = claim
            where = listed(names) if len(names) <= 4 else f"{', '.join(names[:3])} and {len(names) - 3} more"
            counts[task, label] = f"{len(members)}/{n} trials of {where}"
            shown[label] += len(members)
    labels = Counter(trial.label for trial in trials)
    found = [key for key in counts if shown[key[1]] >= SHARE_OF_ALL * labels[key[1]]]
    if not found:
        return None
    task, label = min(found, key=lambda key: (-len(groups[key]), ranks.index(key[1]), key[0]))
    text = LEGEND[label].conclude(groups[task, label]).removesuffix(".")
    sentence = f"In {task} {text[0].lower()}{text[1:]} ({counts[task, label]})."
    return sentence, LEGEND[label].family, claims[task, label]


def _where(trials: Sequence[TrialDiagnosis], label: Label) -> str:
    """Return a clause that describes the axis of nearly all variation trials with a failure, or "" if there is none.

    The failure rate on this axis must differ significantly from the rate on the other axes (Fisher's exact test). The
    failure rate in training must be at most half of the rate on this axis.
    """
    ended = [trial for trial in trials if trial.kind is not Kind.UNFINISHED]
    varied = [trial for trial in ended if trial.variation is not None]
    trained = [trial for trial in ended if trial.variation is None]
    axes = Counter(trial.axis for trial in varied if trial.label is label)
    axis, count = axes.most_common(1)[0]
    others = [trial for trial in varied if trial.axis != axis]
    here = Rate(count, len(varied) - len(others))
    there = Rate(axes.total() - count, len(others))
    if count < max(FEW, SHARE_OF_ALL * axes.total()) or fisher_p(here, there) > DEFAULT_ALPHA:
        return ""
    in_training = sum(trial.label is label for trial in trained)
    if 2 * in_training * here.n > count * len(trained):
        return ""  # the failure rate in training is more than half of the rate on the axis
    return AXIS_PLACES.get(axis or "", "")


def _numbers(training: Figure, variations: Figure, gap: Figure) -> str:
    """Return the sentence with the success rates and the illusion gap."""
    if training.missing and variations.missing:
        return "No trial was run."
    if variations.missing:
        return f"Solves {training.with_unit()} ({training.count()}) of the training conditions."
    if training.missing:
        return f"Solves {variations.with_unit()} ({variations.count()}) of the variations; no training trial was run."
    text = (
        f"Solves {training.with_unit()} ({training.count()}) of the training conditions and "
        f"{variations.with_unit()} ({variations.count()}) of the variations"
    )
    if gap.value is None:
        return f"{text}; without twins there is no illusion gap."
    digits = gap.digits
    size = f"{points(gap.value, digits)} points"
    ends = f"95{THIN}% interval {gap.interval(digits)}, {gap.count()}" if gap.interval() else gap.count()
    if gap.sides is None:
        return f"{text}: an illusion gap of {size} ({ends})."
    twins, varied = gap.sides
    if (twins.number(digits), varied.number(digits)) == (training.number(), variations.number()):
        return f"{text}: an illusion gap of {size} ({ends})."
    both = f"{twins.with_unit(digits)} of the twins and {varied.with_unit(digits)} of the variations"
    ends = f"95{THIN}% interval {gap.interval(digits)}" if gap.interval() else ""
    return f"{text}. In {gap.count()} it solves {both}: an illusion gap of {size}{f' ({ends})' if ends else ''}."


def _failures(varied: list[TrialDiagnosis], findings: tuple[str, ...]) -> str:
    """Return the sentence about the failures, with their counts by kind and the main failure mode."""
    failed = [trial for trial in varied if _has_failed(trial)]
    main = main_failure(varied)
    if main is None:
        return findings[0] if findings else ""
    kinds = Counter(trial.kind for trial in failed)
    names = {Kind.REASONING: "of reasoning", Kind.EXECUTION: "of execution", Kind.SYSTEM: "of the system"}
    parts = [f"{kinds[kind]} {name}" for kind, name in names.items() if kinds[kind]]
    same = sum(trial.label is main for trial in failed)
    cells = sorted({f"{trial.task}/{trial.variation}" for trial in failed if trial.label is main})
    shown = listed(cells) if len(cells) <= 4 else f"{', '.join(cells[:3])} and {len(cells) - 3} more"
    text = f"{plural(len(failed), 'failure')} in {plural(len(varied), 'variation trial')}"
    name = LEGEND[main].name.lower()
    if same == len(failed):
        every = "all " if same > 1 else ""
        return f"{text}, {every}{names[main.kind]}: {name}, in {shown}."
    text += f", all {names[main.kind]}" if len(parts) == 1 else f": {listed(parts)}"
    failure = leading_failure(varied)
    lead = "most often" if failure is None else failure.lead.lower()
    times = {1: "once", 2: "twice"}.get(same, f"{same} times")
    return f"{text}; {lead}: {name} ({times}, in {shown})."


def _unfinished(diagnosis: RunDiagnosis) -> str:
    """Return the sentence about unfinished trials of a run that was stopped. Return "" if there are none."""
    count, planned = len(diagnosis.unfinished), len(diagnosis.trials)
    return f"{count} of {planned} planned trials are unfinished; they stay in all denominators." if count else ""


def _breakdown(varied: list[TrialDiagnosis]) -> str:
    """Return the error that ended most trials if the policy itself failed to run. Return "" otherwise."""
    if main_failure(varied) is not Label.POLICY_ERROR:
        return ""
    texts = Counter(trial.evidence.text for trial in varied if trial.label is Label.POLICY_ERROR)
    return one_line(texts.most_common(1)[0][0], most=LONGEST_REASON)
