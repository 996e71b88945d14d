"""Knowledge against behavior by group: the tests require more than guesses, and their claim has a direction."""

from __future__ import annotations

from betterbench.tasks import Label
from betterbench.vqa.knowing import KnowledgeStanding, TrialKnowledge
from betterbench.vqa.knowing_groups import GroupVerdict, group_knowledge

_STANDINGS = {
    (True, True): KnowledgeStanding.KNOWS_AND_DOES,
    (True, False): KnowledgeStanding.KNOWS_AND_DOES_NOT,
    (False, True): KnowledgeStanding.DOES_WITHOUT_KNOWING,
    (False, False): KnowledgeStanding.DOES_NOT_KNOW,
}


def trials(count, *, known, success, variation="L1", axis="spatial_layout_shift", chance=0.1):
    label = Label.SUCCESS if success else Label.WRONG_OBJECT
    standing = KnowledgeStanding.NOT_ASKED if known is None else _STANDINGS[known, success]
    return [
        TrialKnowledge(f"t/{variation}/{i}", label.value, success, standing, {}, (), chance, "t", variation, axis)
        for i in range(count)
    ]


def groups(found):
    return {group.name: group for group in group_knowledge(found)}


def test_the_axis_on_which_knowledge_is_not_acted_on_is_named_and_no_other():
    lost = trials(20, known=True, success=False)
    kept = trials(20, known=True, success=True, variation="O1", axis="adversarial_object_perturbation")
    found = groups([*lost, *kept, *trials(20, known=True, success=True, variation=None, axis=None)])
    more = {name for name, group in found.items() if group.verdict is GroupVerdict.KNOWS_MORE}
    assert more == {"all", "spatial_layout_shift", "t/L1", "wrong_object"}
    assert found["training"].verdict is GroupVerdict.OPEN
    assert found["training"].knows.k == 20
    assert "t/training" not in found  # of one task, the same trials
    assert found["spatial_layout_shift"].corrected == 1.0


def test_known_failures_that_guessing_explains_are_not_a_finding():
    known = trials(10, known=True, success=False, chance=0.5)
    missed = trials(10, known=False, success=False, chance=0.5)
    found = groups([*known, *missed])["all"]
    assert found.p_paired < 0.01
    assert found.p_guessing > 0.5
    assert found.verdict is GroupVerdict.OPEN
    assert found.corrected == 0.0


def test_a_policy_that_does_more_than_the_model_knows_is_named_too():
    assert groups(trials(20, known=False, success=True))["all"].verdict is GroupVerdict.DOES_MORE


def test_trials_without_answers_stay_out_of_the_rates_and_of_the_correction():
    asked = trials(8, known=True, success=False)
    silent = trials(5, known=None, success=False, variation="T1", axis=None)
    found = groups([*asked, *silent])
    assert (found["all"].trials, found["all"].knows.n) == (13, 8)
    assert (found["t/T1"].knows.n, found["t/T1"].adjusted, found["t/T1"].corrected) == (0, 1.0, None)
    alone = groups(asked)
    assert found["t/L1"].adjusted == alone["t/L1"].adjusted
