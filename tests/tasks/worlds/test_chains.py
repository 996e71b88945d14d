"""CALVIN's chains, starts and rules against the golden values, and a thousand chains in a world without physics."""

from __future__ import annotations

import dataclasses
import hashlib
import sys
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from betterbench.errors import InvalidInputError, UnknownNameError
from betterbench.tasks.worlds.calvin import (
    ChainResult,
    SubtaskResult,
    calvin_chains,
    contrast,
    done,
    draw_chains,
    play_chain,
    read_play_table,
    start_of,
    start_states,
    subtask_named,
    subtasks,
    summarize,
)
from betterbench.tasks.worlds.calvin.sequences import GOLDEN, chain_text, draw_names
from betterbench.tasks.worlds.calvin.starts import pyhash_fnv1_32, start_seed

sys.path.insert(0, str(Path(__file__).parent))
from fake_world import BODIES, FakePolicy, FakeWorld

FIRST = "dict_values([1, 1, 'left', 'open', 'slider_left', 'table', 'slider_right', 0])"


def test_the_chains_are_calvin_s():
    chains = calvin_chains()
    assert hashlib.sha256(chain_text(chains).encode()).hexdigest() == GOLDEN
    assert len(chains) == 1000
    assert len({str(dict(c.start)) for c in chains}) == 192
    assert {name for c in chains for name in c.names} == {s.name for s in subtasks()}
    assert chains[0].names == (
        "rotate_blue_block_right",
        "move_slider_right",
        "lift_red_block_slider",
        "place_in_slider",
        "turn_off_lightbulb",
    )
    assert str(dict(chains[0].start).values()) == FIRST


def test_fewer_chains_are_the_first_of_the_thousand():
    assert calvin_chains(100) == calvin_chains()[:100]
    for wrong in (0, 1001):
        with pytest.raises(InvalidInputError, match="chains"):
            calvin_chains(wrong)


def test_a_start_draws_the_chains_that_the_file_has():
    for seed in (0, 77):
        start = start_states()[seed]
        of_file = [c.names for c in calvin_chains() if c.start == start]
        assert Counter(draw_names(start, len(of_file), seed=seed)) == Counter(of_file)


@pytest.mark.slow
def test_the_generator_draws_all_chains_anew():
    assert draw_chains() == calvin_chains()


def test_the_hash_is_that_of_pyhash_0_9_3():
    assert pyhash_fnv1_32("abc") == 2203671488
    assert pyhash_fnv1_32(FIRST) == 2138410836
    assert start_seed(calvin_chains()[0].start) == 2138410836


def fnv1(text: str) -> int:
    value = 0x811C9DC5
    for byte in text.encode():
        value = (value * 0x01000193 & 0xFFFFFFFF) ^ byte
    return value


def test_the_starts_are_not_those_of_ports_with_another_hash(monkeypatch):
    states = start_states()
    own = np.array([start_of(state).scene for state in states])
    digest = hashlib.sha256(own.astype("<f8").tobytes()).hexdigest()
    assert digest == "e551ab1eb96645a014cfc8e0af61e363e4bbc7176db11dc62b4734c7f8f6160b"
    assert fnv1(FIRST) == 4264316145
    monkeypatch.setattr("betterbench.tasks.worlds.calvin.starts.pyhash_fnv1_32", fnv1)
    other = np.array([start_of(state).scene for state in states])
    yaws = [11, 17, 23]
    places = np.delete(own != other, yaws, axis=1).any(axis=1)
    assert places.sum() == 107
    assert np.abs(own - other)[:, yaws].mean() == pytest.approx(0.26, abs=0.005)


def test_a_start_shows_its_state():
    world = FakeWorld()
    for state in start_states():
        world.reset(start_of(state))
        assert world.symbolic() == dict(state)
        assert len({tuple(p) for p in world.position.values()}) == 3


@pytest.fixture(scope="module", params=[250, pytest.param(1000, marks=pytest.mark.slow)])
def perfect(request):
    policy = FakePolicy(delay=2)
    return [play_chain(FakeWorld(), policy, chain) for chain in calvin_chains(request.param)]


def test_all_chains_are_done_by_one_who_can_do_all(perfect):
    summary, number = summarize(perfect), len(perfect)
    assert [(rate.k, rate.n) for rate in summary.in_a_row] == [(number, number)] * 5
    assert summary.length.value == summary.length.high == 5.0
    assert 5.0 - 30.0 / number < summary.length.low < 5.0
    assert {subtask.steps for result in perfect for subtask in result.played} == {3}
    assert sum(rate.n for rate in summary.subtasks.values()) == 5 * number
    assert set(summary.subtasks) == {s.name for s in subtasks()}


def test_a_chain_ends_with_the_first_subtask_that_is_not_done(perfect):
    cannot = frozenset({"lift_red_block_table", "open_drawer", "stack_block"})
    policy = FakePolicy(cannot=cannot)
    chains = calvin_chains(len(perfect))
    results = [play_chain(FakeWorld(), policy, chain, steps=4) for chain in chains]
    expected = [next((i for i, name in enumerate(chain.names) if name in cannot), 5) for chain in chains]
    assert [result.length for result in results] == expected
    assert policy.resets == sum(len(result.played) for result in results)
    summary = summarize(results)
    assert summary.length.value == pytest.approx(sum(rate.value for rate in summary.in_a_row))
    assert summary.length.value == pytest.approx(np.mean(expected))
    assert summary.length.low < summary.length.value < summary.length.high
    assert {name for name, rate in summary.subtasks.items() if rate.k < rate.n} == cannot
    assert all(rate.k == 0 for name, rate in summary.subtasks.items() if name in cannot)
    assert summarize(results[::-1]) == summary
    found = contrast(perfect, results)
    assert found.chains == len(perfect)
    assert max(found.p_values) < 1e-6
    assert 5 * found.difference.value == pytest.approx(5 - summary.length.value)
    same = contrast(results, results)
    assert same.p_values == (1.0,) * 5
    assert same.difference.value == 0.0


def test_the_last_step_counts_and_the_one_after_it_does_not():
    chain = calvin_chains()[0]
    assert play_chain(FakeWorld(), FakePolicy(delay=359), chain).length == 5
    late = play_chain(FakeWorld(), FakePolicy(delay=360), chain)
    assert (late.length, late.played[0].steps) == (0, 360)


def test_a_chain_that_was_not_played_counts_for_no_subtask():
    name = calvin_chains()[0].names[0]
    found = summarize([ChainResult(0, (SubtaskResult(name, False, 360),)), ChainResult(1, ())])
    assert (found.chains, found.length.value) == (2, 0.0)
    assert {subtask: (rate.k, rate.n) for subtask, rate in found.subtasks.items()} == {name: (0, 1)}


def test_results_that_no_chain_can_have_are_refused(perfect):
    whole, name = perfect[0], calvin_chains()[0].names[0]
    for wrong, problem in (
        ([], "there is no chain"),
        ([whole, whole], "occurs twice"),
        ([ChainResult(1000, whole.played)], "is not one of the"),
        ([ChainResult(1, whole.played)], "expected the subtasks"),
        ([ChainResult(0, (SubtaskResult(name, True, 3),))], "first failed subtask"),
        (
            [ChainResult(0, (dataclasses.replace(whole.played[0], success=False), *whole.played[1:]))],
            "first failed subtask",
        ),
    ):
        with pytest.raises(InvalidInputError, match=problem):
            summarize(wrong)
    with pytest.raises(InvalidInputError, match="have no chain in common"):
        contrast(perfect[:3], perfect[3:])


def scene(world: FakeWorld, **changes):
    return dataclasses.replace(world.info(), **changes)


def block(info, color, **changes):
    name = f"block_{color}"
    return dataclasses.replace(info, blocks={**info.blocks, name: dataclasses.replace(info.blocks[name], **changes)})


@pytest.fixture
def start():
    """Red on the table, the others in the cabinet."""
    state = next(s for s in start_states() if s["red_block"] == "table" and list(s.values()).count("table") == 1)
    world = FakeWorld()
    world.reset(start_of(state))
    return world.info()


def moved(info, color, dx=0.0, dz=0.0):
    x, y, z = info.blocks[f"block_{color}"].position
    return (x + dx, y, z + dz)


def test_no_rule_fires_where_nothing_happened(start):
    assert [s.name for s in subtasks() if done(s.rule, start, start)] == []


def test_a_push_needs_its_way_and_its_surface(start):
    right, left = subtask_named("push_red_block_right").rule, subtask_named("push_red_block_left").rule
    far = block(start, "red", position=moved(start, "red", 0.101))
    assert done(right, start, far)
    assert not done(left, start, far)
    assert not done(right, start, block(start, "red", position=moved(start, "red", 0.099)))
    assert not done(right, start, block(far, "red", contacts=frozenset({(0, 9)})))
    touched = start.blocks["block_red"].contacts | {(0, 9), (5, 7)}
    assert done(right, start, block(far, "red", contacts=touched))


def test_a_lift_needs_height_the_robot_alone_and_its_surface(start):
    table, slider = subtask_named("lift_red_block_table").rule, subtask_named("lift_red_block_slider").rule
    held = {"position": moved(start, "red", dz=0.051), "contacts": frozenset({(0, 9), (0, 10)})}
    assert done(table, start, block(start, "red", **held))
    assert not done(slider, start, block(start, "red", **held))
    assert not done(table, start, block(start, "red", **{**held, "position": moved(start, "red", dz=0.049)}))
    assert not done(table, start, block(start, "red", **{**held, "contacts": frozenset({(0, 9), (5, -1)})}))


def test_a_rotation_needs_its_angle_upright_and_in_place(start):
    from betterbench.geometry import from_axis_angle, multiply

    left, right = subtask_named("rotate_red_block_left").rule, subtask_named("rotate_red_block_right").rule

    def turned(*degrees, dx=0.0):
        rotation = multiply(from_axis_angle(np.radians(degrees)), start.blocks["block_red"].rotation)
        return block(start, "red", rotation=rotation, position=moved(start, "red", dx))

    assert done(left, start, turned(0, 0, 61))
    assert done(right, start, turned(0, 0, -61))
    assert not done(left, start, turned(0, 0, 59))
    assert not done(left, start, turned(0, 0, -61))
    assert not done(left, start, turned(40, 0, 70))
    assert not done(left, start, turned(0, 0, 61, dx=0.11))
    assert not done(left, start, block(turned(0, 0, 61), "red", contacts=frozenset({(0, 9)})))


def test_a_stack_has_to_rest_on_blocks_alone(start):
    rule = subtask_named("stack_block").rule
    on_blue = block(start, "red", contacts=frozenset({(BODIES["blue"], -1)}))
    assert done(rule, start, on_blue)
    assert not done(rule, start, block(on_blue, "red", velocity=(0.0, 0.0, -1.0, 0.0, 0.0, 0.0)))
    assert not done(rule, start, block(start, "red", contacts=frozenset({(BODIES["blue"], -1), (0, 9)})))
    assert not done(rule, on_blue, on_blue)


def test_a_block_falls_into_the_drawer_also_while_it_is_touched(start):
    rule = subtask_named("push_into_drawer").rule
    assert done(rule, start, block(start, "red", contacts=frozenset({(5, 0), (0, 9)})))
    leaned = block(start, "red", contacts=start.blocks["block_red"].contacts | {(0, 9)})
    assert not done(rule, leaned, block(start, "red", contacts=frozenset({(5, 0)})))


def test_what_is_no_get_info_is_named():
    with pytest.raises(InvalidInputError, match=r"get_info\(\) of CALVIN.*robot_info"):
        read_play_table({})


def test_an_unknown_subtask_is_named():
    with pytest.raises(UnknownNameError, match="open_drawer"):
        subtask_named("open_drawr")
