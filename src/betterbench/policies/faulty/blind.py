"""``probe:no-language``: a policy that knows the complete state but not the instruction."""

from __future__ import annotations

from dataclasses import replace

from betterbench.policies.decisions import Situation
from betterbench.policies.faulty.rules import BrokenRule
from betterbench.tasks import Condition, Instruction, Reference, stream
from betterbench.tasks.interventions import vary


class NoLanguage(BrokenRule):
    """Rule that follows a random instruction of the task that is possible in the scene.

    By chance, it may be the given instruction. If this policy succeeds more often than chance, the scene reveals the
    instruction.
    """

    def __init__(self, situation: Situation, strength: float = 1.0) -> None:
        """Draw an instruction, using the trial's random stream."""
        choices = possible_instructions(situation)
        pick = stream(situation.task.id, situation.seed, f"blind:{situation.condition.name}").integers(len(choices))
        heard = situation.condition.with_(instruction=choices[int(pick)])
        super().__init__(replace(situation, condition=heard), strength)


def possible_instructions(situation: Situation) -> tuple[Instruction, ...]:
    """Return the instructions of the task that are possible in a trial's scene, in a stable order.

    In different scenes, the same text ("all the fruits") may refer to different objects. The text of the trial's own
    instruction keeps the meaning that it has in the trial.
    """
    task, own = situation.task, situation.condition.instruction
    conditions = (*task.training, *(vary(task, v)[0] for v in task.variations))
    known = {c.instruction.text: c.instruction for c in conditions} | {own.text: own}
    return tuple(known[text] for text in sorted(known) if _makes_sense(known[text], situation.condition))


def _makes_sense(instruction: Instruction, condition: Condition) -> bool:
    names = {o.name for o in condition.objects}
    asked: dict[Reference, int] = {}
    for goal in instruction.subgoals:
        asked[goal.reference] = max(asked.get(goal.reference, 0), goal.count)
        if goal.target not in names:
            return False
    said = instruction == condition.instruction
    return said or all(len(condition.resolve(reference)) >= count for reference, count in asked.items())
