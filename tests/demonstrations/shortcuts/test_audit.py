"""The audit finds the documented confounds of all tasks and none in the balanced recipe, and judges by chance alone."""

from __future__ import annotations

import shutil
import subprocess
from dataclasses import replace

import numpy as np
import pytest
from tests.daily import part_of_today
from tests.demonstrations.shortcuts.conftest import findings_alone
from tests.looping import each

from betterbench.demonstrations.shortcuts.association import association, random_orders, shuffled_inside, strongest_of
from betterbench.demonstrations.shortcuts.examine import audit_dataset
from betterbench.demonstrations.shortcuts.facts import EpisodeFacts, ShownStep, facts_of_condition
from betterbench.demonstrations.shortcuts.prediction import NAMESPACE, predict, read_prediction, sign, write_prediction
from betterbench.errors import InvalidInputError, RecordError
from betterbench.tasks import get_task, suite_tasks, training_distribution_of
from betterbench.tasks.authoring.training_distribution import pairing
from betterbench.tasks.interventions import resolve_condition
from betterbench.tasks.interventions.balanced import balanced_conditions, crossed, slots_aside
from betterbench.tasks.interventions.regimes import conditions_of

TASKS = suite_tasks("better60")


def facts_of(regime, tasks=TASKS, demos=48):
    found = []
    for name in tasks:
        conditions = conditions_of(get_task(name), regime)
        for condition in conditions:
            facts = facts_of_condition(condition)
            found += [replace(facts, episode=f"{condition.id}/{i}") for i in range(max(1, demos // len(conditions)))]
    return found


@pytest.fixture(scope="module")
def training():
    with findings_alone():
        return audit_dataset("training", facts_of("training"))


@pytest.fixture(scope="module")
def balanced():
    with findings_alone():
        return audit_dataset("balanced", facts_of("balanced"))


def rules_of(group, *questions):
    found = {}
    for question in questions:
        for f in group.of(question):
            if f.verdict != "none":
                found |= {x: set(ys) for x, ys in f.seen.items()}
    return found


@pytest.mark.parametrize("task", TASKS)
def test_every_documented_confound_is_found(training, task):
    group = next(g for g in training.groups if g.group == task)
    trained = training_distribution_of(get_task(task))
    assert group.of("word_place")[0].verdict == "shortcut"
    words = rules_of(group, "word_place")
    assert words.keys() == {word for word, slots in trained.word_slots.items() if slots}
    assert all(found <= set(trained.word_slots[word]) for word, found in words.items())  # either of two burgers
    places = rules_of(group, "thing_place", "bystander_place")
    landmarks = rules_of(group, "landmark")
    varied = {kind for f in facts_of("training", [task]) for kind, _ in f.landmarks} - landmarks.keys()
    for slot, kinds in trained.standing_kinds.items():
        if len(kinds) == 1 and kinds[0] not in varied:
            assert slot in (places | landmarks)[kinds[0]]
    if varied and len({tuple(c.layout.items()) for c in get_task(task).training}) > 1:
        assert group.of("landmark_place")[0].verdict != "none"
    targets = rules_of(group, "thing_target")
    single = {kind for kind, at in trained.kind_targets.items() if len(at) == 1}
    if len({at for found in trained.kind_targets.values() for at in found}) > 1:
        asked = {kind for kind in single if trained.kind_slots.get(kind)}
        assert asked <= {kind for kind, found in targets.items() if len(found) == 1}
    if len(trained.first_kinds) == 1 and trained.longest > 1:
        assert rules_of(group, "first_step")[trained.habit] == {"first"}
    assert group.of("count")[0].verdict != "none"


def test_the_balanced_recipe_has_no_shortcut(balanced):
    assert [(g.group, f.question, f.rules) for g in balanced.groups for f in g.shortcuts] == []
    assert {g.group for g in balanced.groups} == set(TASKS)


@pytest.mark.usefixtures("only_findings")
@pytest.mark.parametrize("tasks", [part_of_today(TASKS, 4), pytest.param(TASKS, marks=pytest.mark.slow)], ids=len)
def test_nor_has_it_one_in_a_larger_set(tasks):
    """As large as the command of the documentation makes it: a rule of few conditions shows only there.

    Every fourth task, others each day: p-values are corrected for fewer questions, so that it is the stricter test.
    """
    found = audit_dataset("balanced", facts_of("balanced", tasks, demos=120))
    assert {g.group for g in found.groups} == set(tasks)
    assert [(g.group, f.question, f.rules) for g in found.groups for f in g.shortcuts] == []


@each("task", TASKS)
def test_no_sentence_tells_where_its_first_thing_stands_in_the_balanced_recipe(task):
    places = {}
    for condition in balanced_conditions(task):
        facts = facts_of_condition(condition)
        if condition.instruction.subgoals[0].word in ("top", "bottom"):
            continue  # which are places
        places.setdefault(facts.instruction, []).append(facts.steps[0].origin)
    trained = get_task(task).training
    if len({facts_of_condition(c).steps[0].origin for c in trained}) > 1:
        assert all(len({*found}) > 1 for found in places.values()), places


def test_the_balanced_recipe_holds_no_test_and_says_what_it_crosses():
    for name in TASKS:
        task = get_task(name)
        trained = {pairing(c) for c in task.training}
        tests = {pairing(c) for c in conditions_of(task, "covered")} - trained
        assert not tests & {pairing(c) for c in balanced_conditions(name)}
        said = {c.instruction.text for c in conditions_of(task, "covered")} - {t for t, _ in trained}
        assert crossed(name)
        assert not said & {c.instruction.text for c in balanced_conditions(name)}


def meant(condition, instruction, kinds):
    """Return what an instruction asks for in the start of a condition, or None if what it names is not there."""
    steps, taken = [], set()
    for goal in instruction.subgoals:
        loose = [n for n in condition.resolve(goal.reference) if n not in condition.preplaced and n not in taken]
        names = [n for n in loose if condition.object(n).kind in kinds]
        if not names or goal.target not in {o.name for o in condition.objects}:
            return None
        taken.add(names[0])
        steps.append((names[0], goal.target, goal.region))
    return tuple(steps)


@each("task", TASKS)
def test_words_decide_in_balanced_scenes(task):
    conditions = balanced_conditions(task)
    kinds = {c.object(n).kind for c in conditions for g in c.instruction.subgoals for n in c.resolve(g.reference)}
    deciding = [
        c
        for c in conditions
        if any(meant(c, d.instruction, kinds) not in (None, meant(c, c.instruction, kinds)) for d in conditions)
    ]
    assert 4 * len(deciding) >= len(conditions)


def taken_kinds(condition):
    """The kinds that a condition asks to be moved."""
    return {condition.object(n).kind for g in condition.instruction.subgoals for n in condition.resolve(g.reference)}


@each("task", TASKS)
def test_what_training_always_takes_and_a_test_leaves_alone_is_left_alone_in_balanced_conditions(task):
    """That the apple is always packed is a confound too, which a recomposition breaks."""
    always = set.intersection(*(taken_kinds(c) for c in get_task(task).training))
    broken = {kind for c in conditions_of(get_task(task), "covered") for kind in always - taken_kinds(c)}
    for kind in broken:
        without = [c for c in balanced_conditions(task) if kind not in taken_kinds(c)]
        assert 6 * len(without) >= len(balanced_conditions(task)), kind


def test_every_word_for_a_mug_is_said_of_both_scenes_with_two_mugs():
    said = {}
    for c in balanced_conditions("morning_coffee"):
        if {"red_mug", "blue_mug"} <= c.layout.keys():
            (goal,) = c.instruction.subgoals
            (mug,) = c.resolve(goal.reference)
            said.setdefault(goal.word, set()).add((mug, c.layout[mug]))
    mugs = ("red_mug", "blue_mug")
    assert said["red"] == {("red_mug", "near"), ("red_mug", "far")}
    assert said["blue"] == {("blue_mug", "near"), ("blue_mug", "far")}
    assert said["top"] == {(mug, "far") for mug in mugs}
    assert said["bottom"] == {(mug, "near") for mug in mugs}


def test_a_slot_aside_belongs_to_the_conditions_that_use_it_alone():
    for name in TASKS:
        task, aside = get_task(name), {slot.name for slot in slots_aside(name)}
        assert not aside & {slot.name for slot in task.slots}
        for condition in balanced_conditions(name):
            used = {slot.name for slot in resolve_condition(name, condition.name).task.slots}
            assert used - {slot.name for slot in task.slots} == aside & set(condition.layout.values())
            asked = {n for g in condition.instruction.subgoals for n in condition.resolve(g.reference)}
            assert not aside & {condition.layout.get(n) for n in asked}
        for condition in (*task.training, *conditions_of(task, "covered")):
            assert resolve_condition(name, condition.name).task is task
    assert slots_aside("morning_coffee")


def test_what_breaks_a_rule_is_a_variation_that_was_made_to(training):
    group = next(g for g in training.groups if g.group == "fruit_lunch")
    assert {name for name, _ in group.of("thing_place")[0].separating} == {"L1", "O1", "O2", "T1", "T2"}
    assert {name for name, _ in group.of("first_step")[0].separating} == {"R1"}
    assert {name for name, _ in group.of("count")[0].separating} == {"T1"}


def test_the_prediction_ranks_all_variations_and_notices_changes(training, balanced, tmp_path):
    found = predict(training)
    assert len(found.variations) == 60
    assert [f.rank for f in found.variations] == list(range(1, 61))
    assert all(a.risk >= b.risk for a, b in zip(found.variations, found.variations[1:], strict=False))
    assert found.of("fruit_lunch", "L1").label in ("lexical_kinematic_shortcut", "visual_layout_bias")
    assert all(bool(f.label) is (f.risk > 0.0) is bool(f.because) for f in found.variations)
    assert sum(f.risk for f in predict(balanced).variations) == 0.0
    path = tmp_path / "prediction.json"
    path.write_bytes(found.file_bytes())
    assert read_prediction(path) == found
    path.write_text(path.read_text().replace('"rank": 1,', '"rank": 2,', 1))
    with pytest.raises(RecordError, match="changed after it was written"):
        read_prediction(path)


def test_chance_is_no_finding_and_a_planted_rule_is():
    draw = np.random.default_rng(0)
    words, places = draw.choice(["red", "blue"], 200).tolist(), draw.choice(["near", "far"], 200).tolist()
    by_chance = association(words, places, np.random.default_rng(1))
    assert by_chance.p_value > 0.01
    assert by_chance.strength < 0.1
    rule = association(words, [{"red": "near", "blue": "far"}[w] for w in words], np.random.default_rng(1))
    assert rule.strength == pytest.approx(1.0)
    assert rule.p_value < 0.001
    assert rule.bits == pytest.approx(1.0, abs=0.01)


@each("generator", [np.random.PCG64, np.random.MT19937])
@each("n", [1, 2, 40, 2048, 2049])
def test_random_orders_are_those_of_random_numbers(n, generator):
    draw, same = (np.random.Generator(generator(5)) for _ in range(2))
    for rows in (3, 20):
        assert np.array_equal(random_orders(draw, rows, n), np.argsort(same.random((rows, n)), axis=1))
    assert draw.random() == same.random(), "as many numbers are drawn"


@each("generator", [np.random.PCG64, np.random.MT19937])
@each("n, blocks", [(1, 1), (40, 1), (40, 2), (300, 7), (2048, 2048), (2048, 90), (2049, 90)])
def test_orders_inside_blocks_are_those_of_random_numbers_and_blocks(n, blocks, generator):
    draw, same = (np.random.Generator(generator(5)) for _ in range(2))
    block = np.random.default_rng(3).integers(0, blocks, n)
    for rows in (3, 20):
        expected = np.argsort(same.random((rows, n)) + block, axis=1)
        assert np.array_equal(random_orders(draw, rows, n, block), expected)
        x = np.arange(n)
        shuffled = shuffled_inside(x, block, rows, draw)
        back = np.empty((rows, n), dtype=np.int64)
        back[:, np.argsort(block, kind="stable")] = np.argsort(same.random((rows, n)) + block, axis=1)
        assert np.array_equal(shuffled, back)
        assert np.array_equal(block[shuffled], np.tile(block, (rows, 1)))
    assert draw.random() == same.random(), "as many numbers are drawn"


def test_words_that_are_tested_together_have_the_information_of_each_alone():
    draw = np.random.default_rng(2)
    presence, outcome = draw.random((40, 3)) < (0.1, 0.5, 0.9), draw.choice(["near", "far", "inside"], 40).tolist()
    for word, found in zip(presence.T, strongest_of(presence, outcome, np.random.default_rng(1)), strict=True):
        alone = association(outcome, word.tolist(), np.random.default_rng(1))
        assert found.bits == pytest.approx(alone.bits, abs=2e-6)
        assert found.expected_bits == pytest.approx(alone.expected_bits, abs=2e-6), "the same permutations"
        assert found.p_value >= alone.p_value, "corrected for the other words"


def test_the_test_has_its_level():
    rejected = 0
    for seed in range(60):
        draw = np.random.default_rng(seed)
        has = draw.random((40, 5)) < 0.5
        found = strongest_of(has, draw.choice(["a", "b", "c"], 40).tolist(), draw)
        rejected += min(f.p_value for f in found) <= 0.05
    assert rejected <= 8  # 3 are expected; the chance of more than 8 is 0.4 %


def test_repetitions_within_a_demonstration_are_no_evidence():
    blocks = [i // 10 for i in range(40)]
    words = ["red" if b % 2 else "blue" for b in blocks]
    found = association(words, words, np.random.default_rng(0), blocks=blocks)
    assert found.p_value > 0.2  # four demonstrations, of which two are of each


def test_the_order_of_the_demonstrations_does_not_matter():
    facts = facts_of("training", ["fruit_lunch"], 40)
    assert audit_dataset("a", facts) == audit_dataset("a", facts[::-1])


def test_too_few_demonstrations_are_refused():
    facts = [EpisodeFacts(str(i), "g", "put it", (ShownStep("a", "a", "b", "c"),)) for i in range(7)]
    with pytest.raises(InvalidInputError, match="has 7 demonstrations, but at least 8 are needed"):
        audit_dataset("few", facts)


def test_a_signature_of_another_prediction_does_not_stay_beside_a_new_one(training, tmp_path):
    path, found = tmp_path / "prediction.json", predict(training)
    signature = tmp_path / "prediction.json.sig"
    write_prediction(path, found)
    signature.write_text("signed")
    write_prediction(path, found)
    assert signature.read_text() == "signed"
    path.write_bytes(path.read_bytes() + b"\n")
    write_prediction(path, found)
    assert not signature.exists()
    assert read_prediction(path) == found


@pytest.mark.skipif(shutil.which("ssh-keygen") is None, reason="OpenSSH is not installed")
def test_a_signed_prediction_is_verified_by_ssh_keygen(training, tmp_path):
    path, key = tmp_path / "prediction.json", tmp_path / "key"
    path.write_bytes(predict(training).file_bytes())
    program = shutil.which("ssh-keygen")
    subprocess.run([program, "-q", "-t", "ed25519", "-N", "", "-f", key], check=True)
    (tmp_path / "allowed").write_text(f"me {key.with_suffix('.pub').read_text()}")
    signature = sign(path, key)

    def is_valid():
        command = [
            "ssh-keygen",
            "-Y",
            "verify",
            "-n",
            NAMESPACE,
            "-f",
            tmp_path / "allowed",
            "-I",
            "me",
            "-s",
            signature,
        ]
        return subprocess.run(command, input=path.read_bytes(), capture_output=True, check=False).returncode == 0

    assert is_valid()
    path.write_bytes(path.read_bytes().replace(b'"rank": 1,', b'"rank": 2,', 1))
    assert not is_valid()
    with pytest.raises(InvalidInputError, match="--sign"):
        sign(path, tmp_path / "nothing")
