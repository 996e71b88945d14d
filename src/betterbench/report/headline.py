"""The verdict on a policy in plain sentences, computed from the diagnosis; the first thing a reader sees."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

from betterbench.diagnosis.verdict import Kind, Label, RunDiagnosis, TrialDiagnosis
from betterbench.report.legend import LEGEND
from betterbench.report.wording import THIN, Figure, listed, plural, points

RARE_SHARE = 0.05
"""Share of failed variation trials up to which they are called exceptions: one in the suite's usual 20 trials."""

WEAK_SHARE = 0.5
"""Success rate on training conditions below which a policy has not learned the task well enough to judge its reasoning
by its success; what it attempts first can still be judged."""


@dataclass(frozen=True, slots=True)
class Headline:
    """What the top of the page says about one policy.

    Attributes:
        policy: Address of the policy.
        conclusion: One sentence that names what is wrong, or that nothing is.
        sentences: One or two sentences with the numbers behind it.
        family: Colour family of the main failure, "right" if there is none.
        training: Success rate on the training conditions.
        variations: Success rate on the variations.
        gap: Illusion gap.
        intention: Intention accuracy on the variations.
    """

    policy: str
    conclusion: str
    sentences: tuple[str, ...]
    family: str
    training: Figure
    variations: Figure
    gap: Figure
    intention: Figure


def headline_of(diagnosis: RunDiagnosis) -> Headline:
    """Return the verdict on a run.

    Args:
        diagnosis: The run.

    Returns:
        The verdict. The main failure is the most frequent label within the most frequent kind of failure over all
        variation trials; reasoning goes first when two kinds are equally frequent.
    """
    training = Figure.of(diagnosis.metric("success_rate", "training"))
    variations = Figure.of(diagnosis.metric("success_rate", "overall"))
    gap = Figure.of(diagnosis.metric("illusion_gap", "overall"), difference=True, noun="pairs")
    intention = Figure.of(diagnosis.metric("intention_accuracy", "overall"))
    varied = [trial for trial in diagnosis.trials if trial.variation is not None]
    conclusion, family = _conclusion(varied, training)
    sentences = [_numbers(training, variations, gap), _failures(varied, diagnosis.findings)]
    return Headline(
        diagnosis.policy,
        conclusion,
        tuple(sentence for sentence in sentences if sentence),
        family,
        training,
        variations,
        gap,
        intention,
    )


def main_failure(trials: list[TrialDiagnosis]) -> Label | None:
    """Return the most frequent label within the most frequent kind of failure, or None without failures."""
    kinds = Counter(trial.kind for trial in trials if trial.kind is not Kind.NONE)
    if not kinds:
        return None
    order = [Kind.REASONING, Kind.EXECUTION, Kind.SYSTEM]
    kind = min(kinds, key=lambda k: (-kinds[k], order.index(k)))
    labels = Counter(trial.label for trial in trials if trial.kind is kind)
    ranks = list(LEGEND)
    return min(labels, key=lambda label: (-labels[label], ranks.index(label)))


def _conclusion(varied: list[TrialDiagnosis], training: Figure) -> tuple[str, str]:
    """Return the naming sentence and its colour family."""
    if not varied:
        return "No variation was run, so nothing is known about its reasoning.", "system"
    failed = [trial for trial in varied if trial.kind is not Kind.NONE]
    main = main_failure(failed)
    if main is None:
        return "No failure found: it solves every variation that was run.", "right"
    if len(failed) <= RARE_SHARE * len(varied):
        return f"No systematic failure found; {plural(len(failed), 'trial')} of {len(varied)} failed.", "right"
    entry = LEGEND[main]
    weak = training.value is not None and training.value < WEAK_SHARE and main.kind is not Kind.SYSTEM
    if weak:
        return f"It has not learned the training conditions. {entry.conclusion}", entry.family
    return entry.conclusion, entry.family


def _numbers(training: Figure, variations: Figure, gap: Figure) -> str:
    """Return the sentence with the success rates and the gap."""
    if training.missing and variations.missing:
        return "No trial was run."
    if variations.missing:
        return f"Solves {training.with_unit()} ({training.count()}) of what it was trained on."
    if training.missing:
        return f"Solves {variations.with_unit()} ({variations.count()}) of the variations; no training trial was run."
    text = (
        f"Solves {training.with_unit()} ({training.count()}) of what it was trained on and "
        f"{variations.with_unit()} ({variations.count()}) of the variations"
    )
    if gap.value is None:
        return f"{text}; without twins there is no illusion gap."
    size = f"{points(gap.value)} points"
    ends = f"95{THIN}% interval {gap.interval()}, {gap.count()}" if gap.interval() else gap.count()
    return f"{text}: an illusion gap of {size} ({ends})."


def _failures(varied: list[TrialDiagnosis], findings: tuple[str, ...]) -> str:
    """Return the sentence about the failures: how many of which kind, and which label leads."""
    failed = [trial for trial in varied if trial.kind is not Kind.NONE]
    main = main_failure(failed)
    if main is None:
        return findings[0] if findings else ""
    kinds = Counter(trial.kind for trial in failed)
    names = {Kind.REASONING: "of reasoning", Kind.EXECUTION: "of execution", Kind.SYSTEM: "of the system"}
    parts = [f"{kinds[kind]} {name}" for kind, name in names.items() if kinds[kind]]
    same = sum(trial.label is main for trial in failed)
    cells = sorted({f"{trial.task}/{trial.variation}" for trial in failed if trial.label is main})
    shown = listed(cells) if len(cells) <= 4 else f"{', '.join(cells[:3])} and {len(cells) - 3} more"
    text = f"{plural(len(failed), 'failure')} in {plural(len(varied), 'variation trial')}: {listed(parts)}"
    return f"{text}; most often {LEGEND[main].name.lower()} ({same} times, in {shown})."
