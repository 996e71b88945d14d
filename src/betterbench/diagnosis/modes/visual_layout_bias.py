"""Visual layout bias: the first attempt does not depend on the instruction.

Several trials are needed to show this, so the second pass assigns the label.
"""

from __future__ import annotations

from betterbench.diagnosis.analysis.episode_analysis import AttemptTarget
from betterbench.diagnosis.exposure import Exposure
from betterbench.diagnosis.failure_mode import FailureMode, TrialView, sharper_by_rule
from betterbench.diagnosis.instruction_effect import SAME_TARGET, SAME_THING
from betterbench.diagnosis.modes.lexical_kinematic_shortcut import taken_for_another
from betterbench.diagnosis.ruling import PLACE
from betterbench.diagnosis.verdict import Evidence
from betterbench.tasks import Expected
from betterbench.tasks.labels import Label


def _exposed(x: Exposure) -> bool:
    """Return whether the slot that most words led to in training contains a known object that is wrong now.

    Objects that no instruction names are left out, because an attempt at such an object is another failure mode. An
    empty slot only counts if the policy should grasp nothing, because a grasp there is harmless in all other cases.
    """
    slot = x.trained.favorite_slot
    kind = x.movable_in(slot)
    if kind is None:
        return x.test.expected is Expected.STAY_STILL
    return slot not in x.right_slots and x.known(kind)


@FailureMode(
    Label.VISUAL_LAYOUT_BIAS,
    short="layout bias",
    definition="The first attempt does not depend on the instruction. It is always at the same slot, or depends only "
    "on a feature of the scene or on the arm's start pose. This label needs evidence from pairs of trials.",
    conclusion="It goes to the same place regardless of the instruction.",
    sharper=sharper_by_rule(
        {
            SAME_TARGET: "It does not use the instruction: its first target stays the same when only the instruction "
            "changes.",
            SAME_THING: "It goes for one kind of object in every scene with such an object, regardless of the "
            "instruction.",
        }
    ),
    finding="Goes to the same place or kind of object regardless of the instruction",
    rule=PLACE,
    needs_rule=True,
    exposed_by=_exposed,
)
def _find(trial: TrialView) -> Evidence | None:
    """Return evidence if the first attempt is wrong and is at a slot.

    The second pass decides whether the policy prefers this slot regardless of the instruction.
    """
    episode = trial.episode
    step = episode.first_choice
    if step is None or step.grasp.slot is None or step.target is AttemptTarget.FOREIGN:
        return None
    another = taken_for_another(episode, step)
    if step.target is AttemptTarget.ASKED and another is None:
        return None
    thing = episode.describe(step, slots=False)
    what = f"it is at {thing}, although {episode.asked_for(step)}"
    if another is not None:
        what = f"it takes {thing} and brings it to the target of {episode.asked_words(another)}"
    text = f"The first attempt goes to slot {step.grasp.slot!r}: {what}."
    return episode.at_step("same_place_whatever_the_instruction", text, step)
