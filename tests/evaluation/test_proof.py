"""The replay proof of `better doctor --policy`: factors of 1 on our own server, and the factor by which others miss."""

from __future__ import annotations

import dataclasses
import functools
import json

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from tests.daily import TODAY, others_slow

from betterbench.cli.main import main
from betterbench.evaluation import open_server, run_preflight
from betterbench.evaluation.preflight.proof import MAX_REQUESTS
from betterbench.interface.actions import EE_DELTA
from betterbench.policies.conventions.presets import OWN_PRESETS
from betterbench.policies.experts import make_expert
from betterbench.policies.serving.server import PolicyServer
from betterbench.sim.robots import PANDA
from betterbench.sim.scenes import Scene
from betterbench.sim.scenes.stage import quality_preset
from betterbench.tasks import TrialId
from betterbench.tasks.interventions import resolve_condition

TRIAL = TrialId("morning_coffee", "train1", 0)
REPRESENTATIVES = ["openpi_droid", "being_h_libero_study"]
"""Joints and another gripper, units, origin and tool point; the slow test has all presets, with images."""


def prove(address, *, space=None, observation="state_only"):
    found = run_preflight(address, TRIAL, action_space_name=space, observation=observation, quality="fast", proof=True)
    return found.proof


def without_images(name, folder):
    """The option of an address that gives a preset without its images, so that nothing is rendered."""
    file = folder / f"{name}.json"
    file.write_text(json.dumps(dataclasses.replace(OWN_PRESETS[name], views=()).to_json()), encoding="utf-8")
    return f"adapter={file}"


def served(name, layout, observation="state_only"):
    with open_server("expert", port=0, trial=TRIAL, layout=name) as server:
        return prove(f"{server.address}?{layout}", space=OWN_PRESETS[name].answer.space, observation=observation)


def check_exact(proof, name):
    assert {axis.name for axis in proof.moved} >= (
        {"joint1"} if OWN_PRESETS[name].answer.space.startswith("joint") else {"x", "y", "z", "rz"}
    )
    for axis in proof.moved:
        assert axis.factor == pytest.approx(1.0, abs=0.02), axis
    assert proof.is_proven
    assert proof.gripper == 1.0
    assert proof.executed_off_m < 1e-3


@pytest.fixture(scope="module")
def own_proof(tmp_path_factory):
    """Returns the proof of a preset on our own server, which is made once."""
    return functools.cache(lambda name: served(name, without_images(name, tmp_path_factory.mktemp("own"))))


@pytest.mark.parametrize("name", others_slow(REPRESENTATIVES, 2))
def test_a_preset_on_our_own_server_has_factors_of_one(name, own_proof):
    check_exact(own_proof(name), name)


@pytest.mark.slow
@pytest.mark.render
@pytest.mark.parametrize(
    "name", sorted(name for name, own in OWN_PRESETS.items() if own.answer.space in PANDA.action_spaces)
)
def test_every_preset_on_our_own_server_has_factors_of_one(name):
    cameras = {"openpi_droid": "droid", "gr00t_oxe_droid": "droid", "native": "state_only"}.get(name, "default")
    options = {"x_vla": "&send.domain_id=3"}.get(name, "")
    check_exact(served(name, f"preset={name}{options}", cameras), name)


class Checkpoint:
    """A policy that was trained on demonstrations as LIBERO would have recorded them: measured poses, in its units.

    It imports nothing of the adapters: it finds the step by the position that it is sent, relative to the first one,
    and answers what leads from one measured pose to the next.
    """

    unit_m, unit_rad, chunk = 0.0125, 0.1, 10

    def __init__(self):
        self.poses, self.gripper = demonstrated()
        self.first, self.step = None, 0

    def answer(self, request):
        position = np.array(request["observation/state"][:3], float)
        self.first = position if self.first is None else self.first
        ahead = self.poses[self.step : self.step + self.chunk + 1, :3] - self.poses[0, :3]
        self.step += int(np.argmin(np.linalg.norm(ahead - (position - self.first), axis=1)))
        rows = [self.row(min(i, len(self.gripper) - 1)) for i in range(self.step, self.step + self.chunk)]
        return {"actions": np.array(rows)}

    def row(self, step):
        here, there = self.poses[step], self.poses[step + 1]
        turn = Rotation.from_quat(there[3:]) * Rotation.from_quat(here[3:]).inv()
        return [*(there[:3] - here[:3]) / self.unit_m, *turn.as_rotvec() / self.unit_rad, self.gripper[step]]

    def close(self):
        pass


class Backward(Checkpoint):
    """Counts y to the right."""

    def row(self, step):
        x, y, *others = super().row(step)
        return [x, -y, *others]


@functools.cache
def demonstrated():
    """The measured poses of the expert, (n + 1, 7) with quaternions (x, y, z, w), and what it tells the gripper."""
    found = resolve_condition(TRIAL.task, TRIAL.condition)
    scene = Scene(found.task, found.condition, seed=0, action_space=EE_DELTA, quality=quality_preset("fast"))
    state = scene.reset()
    expert, poses, gripper = make_expert("expert", scene), [], []
    for _ in range(280):
        poses.append(state.ee_pose)
        action = expert.act_on_state(state)
        gripper.append(action[-1])
        scene.step(action)
        state = scene.state()
    rows = [[*p.position, *np.roll(p.quaternion, -1)] for p in [*poses, state.ee_pose]]
    return np.array(rows), np.array(gripper)


def undeclared(session, name, folder, options=""):
    with PolicyServer(session, metadata={}, port=0) as server:
        return prove(f"{server.address}?{without_images(name, folder)}{options}")


def test_a_libero_checkpoint_whose_units_are_left_as_they_were_overshoots_fourfold(tmp_path):
    proof = undeclared(Checkpoint, "openpi_libero", tmp_path)
    told = {axis.name: axis.factor for axis in proof.moved}
    assert [told[name] for name in "xyz"] == pytest.approx([4.0] * 3, abs=0.08)
    assert told["rz"] == pytest.approx(5.0, abs=0.1)
    assert proof.wrong == ("x", "y", "z", "rz")
    assert "units=libero_measured" in proof.verdict
    assert proof.executed_off_m > 0.05


def test_the_preset_of_its_suite_is_right_for_it(tmp_path):
    proof = undeclared(Checkpoint, "openpi_libero_spatial", tmp_path)
    for axis in proof.moved:
        assert axis.factor == pytest.approx(1.0, abs=0.02), axis
    assert not proof.wrong


@pytest.mark.parametrize(
    ("session", "options", "wrong", "cure"),
    others_slow(
        [
            (Backward, "", ("y",), "frame"),
            (Checkpoint, "&gripper=open_positive", ("gripper",), "polarity"),
            (Checkpoint, "&units=physical", ("x", "y", "z", "rz"), "units=libero_measured"),
        ],
        3,
    ),
)
def test_what_is_wrong_is_named_with_a_cure(session, options, wrong, cure, tmp_path):
    proof = undeclared(session, "openpi_libero_goal", tmp_path, options)
    assert proof.wrong == wrong
    assert cure in proof.verdict


def test_a_policy_that_does_something_else_proves_nothing():
    for policy in ("noop", "random"):
        proof = prove(policy)
        assert not proof.follows
        assert not proof.wrong
        assert proof.verdict == "inconclusive: the policy does not follow the demonstration"
        assert proof.requests <= MAX_REQUESTS
    assert run_preflight("expert", TRIAL, quality="fast", proof=True).proof is None


@pytest.mark.render
def test_the_doctor_prints_the_factors_and_ends_with_status_2_if_they_are_wrong(capsys, tmp_path):
    name = "openpi_libero_spatial"
    scene = ("--task", "morning_coffee", "--quality", "fast", "--observation", "state_only")
    out = ("--out", str(tmp_path / "sheet.png"))
    with open_server("expert", port=0, layout=name) as server:
        address = f"{server.address}?{without_images(name, tmp_path)}&units=libero"
        assert main(["doctor", "--policy", address, *scene, *out]) == 2
        captured = capsys.readouterr()
    text = " ".join(captured.out.split())
    for expected in ("x 26.2 cm 4.00 1.00", "rx 0.00 rad hardly moves", "rz 1.49 rad 5.00 1.00", "Verdict: the conv"):
        assert expected in text
    assert "The replayed demonstration shows: the conventions of x, y, z, rz are wrong" in " ".join(
        captured.err.split()
    )


def test_the_proof_has_a_json_form(own_proof):
    proof = own_proof(REPRESENTATIVES[TODAY % 2])
    told = json.loads(json.dumps(proof.to_json()))
    assert (told["proven"], told["wrong"], told["follows"]) == (True, [], True)
    assert {axis["name"]: axis["factor"] for axis in told["axes"]} == {a.name: a.factor for a in proof.axes}
