"""Plans of a protocol: randomized, balanced, reproducible, and closed against damage."""

import itertools
from collections import Counter

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.looping import each

from betterbench.errors import InvalidInputError, RecordError, UnknownNameError
from betterbench.real.plan import PLAN_NAME, RealPolicy, make_plan, matrix_conditions, plan_bytes, read_plan, write_plan

TWO = (RealPolicy("ours", "openpi://127.0.0.1:8000"), RealPolicy("base", "lerobot:folder"))


def test_the_default_plan_has_the_18_cells_of_both_matrices_for_each_policy():
    plan = make_plan(TWO)
    assert len(plan.conditions) == 18
    assert plan.conditions[0] == "train1"
    assert len(plan.trials) == 36
    assert {(t.condition, t.policy) for t in plan.trials} == set(
        itertools.product(matrix_conditions("fruit_basket"), ("ours", "base"))
    )


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10**6), st.integers(1, 4), st.integers(1, 3))
def test_policies_are_interleaved_and_take_turns_in_being_first(seed, repeats, count):
    policies = [RealPolicy(f"p{i}", "noop") for i in range(count)]
    plan = make_plan(policies, repeats=repeats, seed=seed)
    for end in range(len(plan.trials)):
        counts = Counter(t.policy for t in plan.trials[: end + 1])
        assert max(counts.values()) - min(counts.get(p.name, 0) for p in policies) <= 1
    for block in range(repeats):
        trials = [t for t in plan.trials if t.block == block]
        assert len({t.scene_seed for t in trials}) == 1
        firsts = Counter(t.policy for t in trials[::count])
        assert max(firsts.values()) - min(firsts.values()) <= 1


def test_the_same_seed_gives_the_same_bytes_and_another_seed_another_order():
    assert plan_bytes(make_plan(TWO, seed=3)) == plan_bytes(make_plan(TWO, seed=3))
    one, other = make_plan(TWO, seed=3), make_plan(TWO, seed=4)
    assert [t.condition for t in one.trials] != [t.condition for t in other.trials]
    assert {t.code for t in one.trials} != {t.code for t in other.trials}


def test_blocks_have_different_orders():
    plan = make_plan(TWO, repeats=2)
    first, second = ([t.condition for t in plan.trials if t.block == b] for b in (0, 1))
    assert first != second
    assert sorted(first) == sorted(second)


def test_a_code_is_independent_of_condition_and_policy():
    """The same codes are given whatever the names are, so a code is a function of seed and place in the plan."""
    renamed = (RealPolicy("zzz", "noop"), RealPolicy("aaa", "noop"))
    codes = [[t.code for t in make_plan(p, seed=5, repeats=3).trials] for p in (TWO, renamed)]
    assert codes[0] == codes[1]
    assert len(set(codes[0])) == 108
    assert codes[0] != sorted(codes[0])


@each(
    "options, error, says",
    [
        ({"conditions": ["O1", "O1"]}, InvalidInputError, "conditions: 'O1' occurs 2 times"),
        ({"conditions": []}, InvalidInputError, "conditions: the list is empty"),
        ({"conditions": ["O99"]}, UnknownNameError, "Unknown condition of fruit_basket 'O99'"),
        ({"task": "fast_food"}, InvalidInputError, "has no diagnostic matrices"),
        ({"task": "fruit_baskets"}, UnknownNameError, "fruit_basket"),
        ({"repeats": 0}, InvalidInputError, "trials per cell: 0 blocks"),
        ({"repeats": 10**9}, InvalidInputError, "trials per cell"),
        ({"rate_hz": float("nan")}, InvalidInputError, "rate_hz"),
        ({"unit": "radians"}, InvalidInputError, "unit"),
        ({"seed": -1}, InvalidInputError, "seed"),
    ],
)
def test_bad_arguments_are_named(options, error, says):
    with pytest.raises(error) as told:
        make_plan(TWO, **options)
    assert says in str(told.value)


def test_two_policies_of_one_name_are_refused():
    with pytest.raises(InvalidInputError, match="policies: 'a' occurs 2 times"):
        make_plan([RealPolicy("a", "noop"), RealPolicy("a", "random")])


@each(
    "names, says",
    [
        (["a\nb"], "unprintable characters"),
        (["a\0"], "unprintable characters"),
        (["\x1b[31ma"], "unprintable characters"),
        (["a\u202eb"], "unprintable characters"),
        (["\u200b"], "unprintable characters"),
        ([" "], "has leading or trailing spaces"),
        (["a", "a "], "has leading or trailing spaces"),
        (["ours", "Ours"], "'ours' and 'Ours' differ only in case, spaces or Unicode forms"),
        (["caf\u00e9", "cafe\u0301"], "differ only in case, spaces or Unicode forms"),
    ],
)
def test_names_that_people_cannot_tell_apart_are_refused(names, says):
    with pytest.raises(InvalidInputError, match=says):
        make_plan([RealPolicy(name, "noop") for name in names])


def test_names_of_other_scripts_and_with_signs_are_kept(tmp_path):
    names = ["\u673a\u5668", "pi0.5 (ours)", "../x", "<b>"]
    plan = make_plan([RealPolicy(name, "noop") for name in names])
    write_plan(tmp_path, plan)
    assert [p.name for p in read_plan(tmp_path).policies] == names


def test_a_plan_is_read_back_and_never_replaced(tmp_path):
    plan = make_plan(TWO, seed=1, repeats=2)
    write_plan(tmp_path, plan)
    write_plan(tmp_path, plan)
    assert read_plan(tmp_path) == plan
    with pytest.raises(InvalidInputError, match="contains a different plan"):
        write_plan(tmp_path, make_plan(TWO, seed=2))


def test_a_missing_and_a_changed_plan_are_refused(tmp_path):
    with pytest.raises(RecordError, match=r"plan\.json: not found"):
        read_plan(tmp_path)
    write_plan(tmp_path, make_plan(TWO))
    path = tmp_path / PLAN_NAME
    path.write_text(path.read_text().replace('"condition": "O1"', '"condition": "O2"', 1))
    with pytest.raises(RecordError, match=r"plan\.json.*changed after it was written"):
        read_plan(tmp_path)
