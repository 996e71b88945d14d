"""Visual layout bias: the first attempt goes to the same place whatever is asked. A verdict over paired trials."""

from __future__ import annotations

from betterbench.diagnosis.episode_analysis import AttemptTarget, EpisodeAnalysis
from betterbench.diagnosis.modes.lexical_kinematic_shortcut import taken_for_another
from betterbench.diagnosis.verdict import Evidence


def find(episode: EpisodeAnalysis, slot: str | None) -> Evidence | None:
    """Return the evidence of a first attempt at the policy's favorite place.

    Args:
        episode: The course of the episode.
        slot: The place that the second pass over the run found, or None.

    Returns:
        The evidence, or None if the first attempt is right, elsewhere, or at an object that no instruction means.
    """
    step = episode.first_choice
    if slot is None or step is None or step.grasp.slot != slot:
        return None
    if step.target is AttemptTarget.FOREIGN:
        return None
    if step.target is AttemptTarget.ASKED and taken_for_another(episode, step) is None:
        return None
    text = (
        f"The first attempt goes to slot {slot!r}, as it does whatever the instruction: it is at "
        f"{episode.describe(step)} although {episode.asked_for(step)}."
    )
    return episode.at_step("same_place_whatever_the_instruction", text, step)
