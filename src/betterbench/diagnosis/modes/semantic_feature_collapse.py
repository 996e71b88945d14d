"""Semantic feature collapse: the policy goes for an object that no instruction of the task asks it to move."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from betterbench.diagnosis.analysis.episode_analysis import AttemptTarget, EpisodeAnalysis, Step
from betterbench.diagnosis.exposure import Exposure
from betterbench.diagnosis.failure_mode import FailureMode, TrialView
from betterbench.diagnosis.modes.lexical_kinematic_shortcut import word_of
from betterbench.diagnosis.thresholds import SHARE_OF_ALL
from betterbench.diagnosis.verdict import Evidence, TrialDiagnosis
from betterbench.tasks.labels import Label
from betterbench.wording import listed


def _shared_by(trials: Sequence[TrialDiagnosis]) -> str:
    """Describe the visual properties and slots that the wrongly chosen objects most often share with the targets."""
    counts = Counter(t.evidence.shared for t in trials)
    shared = min(counts, key=lambda s: (-counts[s], s))
    return f", {_likeness(shared)}" if shared else ", which shares nothing with the target"


def _likeness(shared: Sequence[str]) -> str:
    """Describe the properties that an object shares with the target ("of the target's color and shape")."""
    looks = [feature for feature in shared if feature != "slot"]
    if not looks:
        return "in the slot where the target was picked in training"
    return f"of the target's {listed(looks)}{', in its trained slot' if 'slot' in shared else ''}"


def _sharper(trials: Sequence[TrialDiagnosis]) -> str:
    """Return a sentence about the properties that nearly all wrongly chosen objects share with the targets.

    If the objects share no property with their targets, the sentence says that they are not look-alikes.
    """
    unlike = sum(not trial.evidence.shared for trial in trials)
    if unlike > (1.0 - SHARE_OF_ALL) * len(trials):
        share = f"in {unlike} of {len(trials)} of these trials, the object shares nothing with the target"
        return f"It takes objects that no instruction asks to move; {share}."
    counts = Counter(feature for trial in trials for feature in trial.evidence.shared)
    shared = [feature for feature in ("color", "shape", "slot") if counts[feature] >= SHARE_OF_ALL * len(trials)]
    return f"It takes look-alikes for the real thing: objects {_likeness(shared)}." if shared else ""


def _exposed(x: Exposure) -> bool:
    """Return whether the scene contains an object that no instruction names, but that may be mistaken for a target.

    The object stands in a slot where training picks up objects, or it has the color of a target.
    """
    picked = {slot for slots in x.trained.kind_slots.values() for slot in slots}
    colors = {x.test.object(n).color for g in x.goals for n in x.test.resolve(g.reference)} - {None}
    for o in x.test.objects:
        slot = x.test.layout.get(o.name)
        if o.role not in ("item", "distractor") or slot is None or x.known(o.kind) or slot == x.base.layout.get(o.name):
            continue
        if slot in picked or o.color in colors:
            return True
    return False


@FailureMode(
    Label.SEMANTIC_FEATURE_COLLAPSE,
    short="look-alike",
    definition="The attempt is at an object that no instruction of the task asks to move. This label is also used if "
    "a word of the instruction was paired with the object's slot in training. Attempts at placement targets of the "
    "current instruction do not count.",
    conclusion="It takes look-alikes for the real thing.",
    sharper=_sharper,
    finding="Goes for an object that no instruction asks to move",
    detail=_shared_by,
    exposed_by=_exposed,
)
def _find(trial: TrialView) -> Evidence | None:
    """Find the first evidence of this mode, with the properties that the attempted object shares with the target."""
    episode = trial.episode
    for step in episode.decisions:
        if step.target is AttemptTarget.FOREIGN:
            shared = shares(episode, step)
            common = f"the target's {listed(shared)}" if shared else "nothing with the target"
            text = (
                f"It goes for {episode.describe(step)}, which no instruction of this task asks to move, although "
                f"{_asked_for(episode, step)}; it shares {common}."
            )
            return episode.at_step("object_that_no_instruction_means", text, step, shared=shared)
    return None


def shares(episode: EpisodeAnalysis, step: Step) -> tuple[str, ...]:
    """Return the properties that the attempted object shares with the requested object.

    The properties are "color", "shape" and "slot", where "slot" means that training picked the requested object from
    the slot of the attempted object.
    """
    if step.at is None:
        return ()
    found = episode.trace.info.objects[step.at]
    absent = _absent(episode)
    goal = absent if absent is not None else step.goal if step.goal is not None else 0
    shared = [*episode.shared_looks(step.at, episode.meant[goal] if episode.meant else ())]
    word = word_of(episode, step) if absent is None else episode.goals[absent].word
    kind = episode.goals[goal].reference.kind if episode.goals else None
    slots = {*episode.trained.word_slots.get(word or "", ()), *episode.trained.kind_slots.get(kind or "", ())}
    if step.grasp.slot in slots or found.slot in slots:
        shared.append("slot")
    return tuple(shared)


def _absent(episode: EpisodeAnalysis) -> int | None:
    """Return the first subgoal with an object that is missing from the scene, or None."""
    return next((g for g, names in enumerate(episode.meant) if not names), None)


def _asked_for(episode: EpisodeAnalysis, step: Step) -> str:
    absent = _absent(episode)
    if absent is None:
        return episode.asked_for(step)
    return f"the instruction asks for {episode.goals[absent].word!r}, which is absent"
