"""What importing the public names of evaluation costs: each imports its own module and no other."""

from __future__ import annotations

import subprocess
import sys

import pytest

import betterbench.evaluation as package

HEAVY = ("ray", "av", "websockets", "zmq", "matplotlib", "vla_eval", "gymnasium")


def imported(statement: str) -> set[str]:
    code = f"import sys\n{statement}\nprint('\\n'.join(sys.modules))"
    return set(subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True).stdout.split())


def test_every_public_name_is_there():
    assert all(hasattr(package, name) for name in package.__all__)
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        package.nothing  # noqa: B018


def test_the_package_alone_imports_nothing():
    modules = imported("import betterbench.evaluation")
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
    modules = imported("from betterbench.evaluation import evaluate")
    assert not {"ray", "av", "matplotlib", "zmq", "vla_eval", "scipy.stats", "trimesh"} & modules
    inner = {n.split(".")[2] for n in modules if n.startswith("betterbench.evaluation.")}
    assert not {"figures", "preflight", "integrations"} & inner
    assert "betterbench.evaluation.ray_engine.pool" not in modules


def test_a_run_in_our_own_scenes_reads_nothing_of_calvin():
    modules = imported("from betterbench.evaluation import evaluate, make_plan")
    assert not [
        name
        for name in modules
        if name.startswith(("betterbench.tasks.worlds.calvin", "betterbench.sim.worlds.calvin"))
    ]


def test_a_worker_imports_no_planner_no_special_functions_and_no_habits():
    modules = imported("import betterbench.evaluation.workers.worker, betterbench.evaluation.running.runner")
    assert not {"mink", "qpsolvers", "scipy.special", "scipy.sparse"} & modules
    assert "betterbench_calibration.independent.registry" not in modules
