"""Lexical-kinematic shortcut: a word leads the gripper to a slot from training, where another object now stands."""

from __future__ import annotations

from betterbench.diagnosis.analysis.episode_analysis import AttemptTarget, EpisodeAnalysis, Step
from betterbench.diagnosis.exposure import Exposure
from betterbench.diagnosis.failure_mode import FailureMode, TrialView
from betterbench.diagnosis.ruling import WORD
from betterbench.diagnosis.verdict import Evidence
from betterbench.tasks.labels import Label


def _exposed(x: Exposure) -> bool:
    """Return whether a known object is now in a slot where training picked up a different object for a word."""
    for goal in x.open_goals:
        for slot in set(x.trained.word_slots.get(goal.word, ())) - x.slots(goal):
            kind = x.movable_in(slot)
            if kind is not None and x.known(kind):
                return True
    return False


@FailureMode(
    Label.LEXICAL_KINEMATIC_SHORTCUT,
    short="lexical",
    definition="In training, a word of the instruction was paired with a slot. The first attempt is at another object "
    "that is in this slot now. Another instruction of the task asks to move this object.",
    conclusion="It maps words to motions: it goes where a word led in training, not to what the word means.",
    finding="Goes where the word led in training, to another object",
    rule=WORD,
    needs_rule=True,
    title="Lexical-kinematic shortcut",
    exposed_by=_exposed,
)
def _find(trial: TrialView) -> Evidence | None:
    """Return evidence if the first attempt follows a word of the instruction to a wrong object."""
    episode = trial.episode
    step = episode.first_choice
    if step is None:
        return None
    word = _leading_word(episode, step)
    another = taken_for_another(episode, step)
    if another is not None and word is not None:
        text = (
            f"The first attempt takes {episode.describe(step)} and brings it to the target of "
            f"{word!r}, which was picked in that slot in training."
        )
        return episode.at_step("word_leads_to_trained_slot", text, step, shared=_shared(episode, step, another))
    if step.target not in (AttemptTarget.LATER, AttemptTarget.REPEATED, AttemptTarget.OTHER):
        return None
    if word is None:
        return None
    text = (
        f"The first attempt goes to slot {step.grasp.slot!r}, where {word!r} was picked in training: it is at "
        f"{episode.describe(step, slots=False)}, which {word!r} does not mean here."
    )
    return episode.at_step("word_leads_to_trained_slot", text, step, shared=_shared(episode, step, step.goal))


def _shared(episode: EpisodeAnalysis, step: Step, goal: int | None) -> tuple[str, ...]:
    """Return the visual properties that the attempted object shares with the object that the word refers to."""
    return () if step.at is None or goal is None else episode.shared_looks(step.at, episode.meant[goal])


def _leading_word(episode: EpisodeAnalysis, step: Step) -> str | None:
    """Return the first word of the instruction that led to the attempted slot in training, or None if there is none."""
    return next((word for word in words_of(episode, step) if _led_to(episode, word, step.grasp.slot)), None)


def words_of(episode: EpisodeAnalysis, step: Step | None) -> tuple[str, ...]:
    """Return the words of the instruction that the policy may have followed in an attempt.

    The word of the current subgoal comes first. The earlier subgoals of an ordered instruction are already done, but
    their words are still in the text, and a policy may follow the first word that it reads. If there is no attempt, the
    current subgoal is the first one.
    """
    goals = episode.goals
    if not goals:
        return ()
    another = None if step is None else taken_for_another(episode, step)
    due = another if another is not None else 0 if step is None or step.goal is None else step.goal
    earlier = goals[:due] if another is None and episode.condition.instruction.ordered else ()
    return tuple(dict.fromkeys([goals[due].word, *(goal.word for goal in earlier)]))


def _led_to(episode: EpisodeAnalysis, word: str | None, slot: str | None) -> bool:
    """Return whether the object that a word refers to was picked from this slot in training.

    A slot at the same position in another layout counts as the same slot.
    """
    if word is None or slot is None:
        return False
    places = {episode.trace.place_of(trained) for trained in episode.trained.word_slots.get(word, ())}
    return episode.trace.place_of(slot) in places


def taken_for_another(episode: EpisodeAnalysis, step: Step) -> int | None:
    """Return the subgoal whose target receives an object of a different subgoal in this attempt, or None.

    For example, a policy may mistake the mug for the mouse. If both must be moved and the order of the steps is free,
    picking up the mug does not reveal the mistake. It becomes visible when the policy brings the mug to the target of
    the mouse. If mugs were brought to this target in training, habit is the simpler explanation, and the result is
    None.
    """
    step = episode.last_try(step)
    goal = episode.taken_for(step)
    if goal is None or step.at is None or step.target is not AttemptTarget.ASKED:
        return None
    found = episode.wrong_place(step)
    return None if found is None or episode.memorized(step.at, found[2]) else goal


def word_of(episode: EpisodeAnalysis, step: Step) -> str | None:
    """Return the word of the subgoal that was current at an attempt, or that of the first subgoal if none was open."""
    return next(iter(words_of(episode, step)), None)
