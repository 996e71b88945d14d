"""What importing the public names of evaluation costs: each imports its own module and no other."""

from __future__ import annotations

import functools
import json
import os
import subprocess
import sys

import pytest

import betterbench.evaluation as package

HEAVY = ("ray", "av", "websockets", "zmq", "matplotlib", "vla_eval", "gymnasium")


EVALUATE = (
    "from betterbench.evaluation import evaluate\n"
    "import betterbench.evaluation.workers.worker, betterbench.evaluation.running.runner"
)
STATEMENTS = (
    "from betterbench.evaluation import make_plan",
    "from betterbench.evaluation import show_training",
    EVALUATE,
    "import betterbench.evaluation.workers.pool",
)
EACH_APART = """
import json, os, sys
import numpy, mujoco, pyarrow, pydantic  # which every statement imports, and which take most of the time
found = {}
for statement in sys.argv[1:]:
    result, there = os.pipe()
    if os.fork() == 0:
        exec(statement)
        with open(there, "w") as told:
            json.dump([*sys.modules], told)
        os._exit(0)
    os.close(there)
    with open(result) as told:
        found[statement] = json.load(told)
    os.wait()
json.dump(found, sys.stdout)
"""


def run(code: str, *arguments: str) -> str:
    done = subprocess.run([sys.executable, "-c", code, *arguments], check=True, capture_output=True, text=True)
    return done.stdout


@functools.cache
def imported_by_each() -> dict[str, list[str]]:
    return json.loads(run(EACH_APART, *STATEMENTS))


def imported(statement: str) -> set[str]:
    """Returns the modules of a process that has run a statement. What all of them import is imported before."""
    return set(imported_by_each()[statement])


def test_every_public_name_is_there():
    assert all(hasattr(package, name) for name in package.__all__)
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        package.nothing  # noqa: B018


def test_the_package_alone_imports_nothing():
    modules = set(run("import sys, betterbench.evaluation\nprint(*sys.modules)").split())
    assert not {"mujoco", "numpy", *HEAVY} & modules
    assert not [name for name in modules if name.startswith("betterbench.evaluation.")]


@pytest.mark.parametrize(
    ("name", "packages"),
    [("make_plan", {"planning"}), ("show_training", {"figures"})],
)
def test_one_name_imports_only_its_own_packages(name, packages):
    modules = imported(f"from betterbench.evaluation import {name}")
    assert not set(HEAVY) & modules
    inner = {n.split(".")[2] for n in modules if n.startswith("betterbench.evaluation.")}
    assert inner == packages


def test_a_local_run_imports_no_ray_no_film_and_no_network():
    modules = imported(EVALUATE)
    assert not {"ray", "av", "matplotlib", "zmq", "vla_eval", "scipy.stats", "trimesh"} & modules
    inner = {n.split(".")[2] for n in modules if n.startswith("betterbench.evaluation.")}
    assert not {"figures", "preflight", "integrations"} & inner
    assert "betterbench.evaluation.ray_engine.pool" not in modules


def test_a_run_in_our_own_scenes_reads_nothing_of_calvin():
    modules = imported(EVALUATE)
    modules |= imported("from betterbench.evaluation import make_plan")
    assert not [
        name
        for name in modules
        if name.startswith(("betterbench.tasks.worlds.calvin", "betterbench.sim.worlds.calvin"))
    ]


def test_a_worker_imports_no_planner_no_special_functions_and_no_habits():
    modules = imported(EVALUATE)
    assert not {"mink", "qpsolvers", "scipy.special", "scipy.sparse"} & modules
    assert "betterbench_calibration.independent.registry" not in modules


def test_a_worker_process_imports_no_plan_no_statistics_and_no_server():
    modules = imported("import betterbench.evaluation.workers.pool")
    assert not {"betterbench.statistics", "websockets", "PIL", "trimesh"} & modules
    inner = {n.split(".")[2] for n in modules if n.startswith("betterbench.evaluation.")}
    assert inner == {"trials", "workers"}


POLICY = """
import numpy as np
from betterbench import PolicyInfo

class Still:
    info = PolicyInfo(name="still", action_space="ee_delta", needs_images=True)

    def reset(self, start):
        pass

    def act(self, observation):
        return np.zeros(7)
"""
HOSTED = """
import sys, threading
from multiprocessing import Pipe
import numpy as np
from betterbench.evaluation.serving.host import serve
from betterbench.interface import EpisodeStart, Observation
from betterbench.policies.kinds import make_policy

here, there = Pipe()
run = ("ee_delta", "standard", "", 20.0)
threading.Thread(target=serve, args=("python:still_policy:Still", run, 30.0, 0, there), daemon=True).start()
assert here.poll(60.0)
info, batches, port = here.recv()
assert (info.name, batches) == ("still", False)
client = make_policy(f"openpi://127.0.0.1:{port}?preset=native")
client.reset(EpisodeStart("go", 0, "ee_delta"))
picture = np.zeros((64, 64, 3), np.uint8)
joints, position, turn = np.zeros(7), np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0])
seen = Observation("go", 0, {"front": picture}, joints, joints, position, turn, 0.08, {}, {})
assert client.act(seen).shape == (1, 7)
print(*sys.modules, sep="\\n")
"""


def test_a_host_serves_a_users_policy_without_simulator_pictures_or_tables(tmp_path):
    (tmp_path / "still_policy.py").write_text(POLICY)
    done = subprocess.run(
        [sys.executable, "-c", HOSTED],
        check=False,
        capture_output=True,
        text=True,
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(tmp_path)},
    )
    assert done.returncode == 0, done.stderr
    modules = set(done.stdout.split())
    assert "betterbench.evaluation.serving.host" in modules
    assert not {"mujoco", "pyarrow", "PIL", "scipy", "betterbench.sim", "betterbench.records"} & modules
    assert "betterbench.tasks" not in modules
