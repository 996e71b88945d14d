"""Shadow simulations: an expert behind the server leaves the same record as a local one, bit for bit."""

from __future__ import annotations

import functools

import pytest
from tests.daily import others_slow

from betterbench.episodes import Observer, TrialContext, run_episode
from betterbench.evaluation import open_server
from betterbench.interface import observation_spec
from betterbench.interface.actions import EE_DELTA
from betterbench.policies.experts import make_expert
from betterbench.policies.kinds import make_policy
from betterbench.records.parquet import record_bytes
from betterbench.sim.scenes import Scene
from betterbench.sim.scenes.stage import quality_preset
from betterbench.tasks import TrialId
from betterbench.tasks.interventions import resolve_condition

TRIAL = TrialId("morning_coffee", "train1", 1)
CONTEXT = TrialContext(policy="the same name")


def scene():
    found = resolve_condition(TRIAL.task, TRIAL.condition)
    task, condition = found.task, found.condition
    return Scene(task, condition, seed=TRIAL.seed, action_space=EE_DELTA, quality=quality_preset("standard"))


@functools.cache
def local(policy):
    here = scene()
    return run_episode(here, make_expert(policy, here), context=CONTEXT).record


def remote(policy, options="", chunk=8):
    with open_server(policy, port=0, chunk=chunk) as server:
        client = make_policy(f"{server.address}{options}")
        client.name_trial(TRIAL)
        try:
            assert not client.info.needs_images
            assert client.info.action_space == "ee_delta"
            observer = Observer(observation_spec("state_only"))
            return run_episode(scene(), client, context=CONTEXT, observer=observer).record
        finally:
            client.close()


@pytest.mark.parametrize(
    ("policy", "options", "chunk"),
    others_slow(
        [
            ("expert", "", 8),
            ("expert", "?horizon=5", 8),
            ("expert", "?horizon=6&ahead=2", 8),
            ("zoo:shape?action_noise=0.001", "?preset=native", 13),
        ],
        2,
    ),
)
def test_the_record_is_that_of_the_local_policy(policy, options, chunk):
    here, there = local(policy), remote(policy, options, chunk)
    assert there.outcome == here.outcome
    assert record_bytes(there) == record_bytes(here)


def test_the_expert_solves_the_trial_that_is_compared():
    assert local("expert").outcome.success


def test_images_are_rendered_for_an_adapter_that_names_cameras():
    with open_server("expert", port=0, trial=TRIAL) as server:
        client = make_policy(f"{server.address}?preset=openpi_libero")
        try:
            assert client.info.needs_images
            here = scene()
            seen = Observer(observation_spec("default")).observe(here, here.reset())
            assert client.act(seen).shape == (8, 7)
        finally:
            client.close()
