"""The processes that a worker keeps: one for each trial under way, and under the key None one for each trial alone."""

import os
import signal
import time
from pathlib import Path

import pytest

from betterbench.evaluation.planning.world_plan import make_world_plan
from betterbench.interface.actions import EE_DELTA
from betterbench.sim.worlds import WorldProcesses
from betterbench.sim.worlds.process import WorldError


def _lives(pid):
    return Path(f"/proc/{pid}").exists()


def _until(holds):
    until = time.monotonic() + 30.0
    while not holds() and time.monotonic() < until:
        time.sleep(0.01)
    assert holds()


def test_a_process_for_one_trial_alone_is_ended_and_the_next_one_is_there(fake_command):
    processes = WorldProcesses(fake_command)
    first = processes.take(None)
    ready = processes._next.pid
    processes.give_back(None, first)
    assert not _lives(first.pid)
    second = processes.take(None)
    assert second.pid == ready
    assert second.suite("libero_object")["tasks"]
    third = processes._next.pid
    second.close(0.0)
    processes.close()
    assert not _lives(third)


def test_no_process_is_started_early_for_a_trial_that_the_run_does_not_have(fake_command):
    processes = WorldProcesses(fake_command, trials=2)
    first = processes.take(None)
    assert processes._next is not None
    second = processes.take(None)
    assert processes._next is None
    again = processes.take(None)  # as after the death of the policy
    assert again.suite("libero_object")["tasks"]
    for process in (first, second, again):
        process.close(0.0)
    processes.close()


def test_a_process_that_died_before_its_trial_costs_nothing(fake_command):
    processes = WorldProcesses(fake_command)
    first = processes.take(None)
    dead = processes._next
    os.kill(dead.pid, signal.SIGKILL)
    _until(lambda: dead.has_ended)
    second = processes.take(None)
    assert second.pid != dead.pid
    assert second.suite("libero_object")["tasks"]
    for process in (first, second):
        process.close(0.0)
    processes.close()


def test_a_process_that_cannot_be_started_ahead_is_reported_by_the_trial_that_needs_it(fake_command, monkeypatch):
    processes = WorldProcesses(fake_command)
    first = processes.take(None)
    second = processes.take(None)
    monkeypatch.setattr(processes, "_command", ("/nowhere/python",))
    third = processes.take(None)
    with pytest.raises(WorldError, match="cannot be started"):
        processes.take(None)
    for process in (first, second, third):
        process.close(0.0)
    processes.close()


def test_an_episode_that_is_begun_again_keeps_its_process_where_processes_are_kept(fake_command):
    """As after the death of the policy: the runner resets the same scene."""
    world = make_world_plan("noop", suite="libero_object", command=fake_command, tasks=["3"], trials=1).world
    processes = WorldProcesses(fake_command)
    scene = world.open_scene(
        processes, task="libero_object-03", condition="base", seed=1, action_space=EE_DELTA, images=False
    )
    ids = []
    for _ in range(2):
        scene.reset()
        ids.append(scene._process.pid)
    assert ids[0] == ids[1]
    scene.close(well=True)
    processes.close()
    assert not _lives(ids[0])
