"""kill -9 of a simulator, a worker or the run itself: the same command finishes the run, and nothing is left behind."""

import os
import subprocess
import sys
import time
import uuid
from dataclasses import replace
from pathlib import Path

import pytest
from tests.evaluation.test_misbehavior import left_over
from tests.sim.worlds.test_calvin import policy_text

import betterbench
from betterbench.evaluation import evaluate
from betterbench.evaluation.planning.world_plan import make_world_plan
from betterbench.records import RunFolder
from betterbench.sim.worlds.installation import start_code
from betterbench.tasks.worlds.calvin import calvin_chains, start_of
from betterbench.tasks.worlds.libero import PROTOCOLS

TRIALS = 3
SCRIPT = """
import os, sys
from pathlib import Path

if __name__ == "__main__":
    os.environ["FAKE_RUN"] = str(os.getpid())
    from betterbench.evaluation import evaluate
    from tests.sim.worlds.test_world_kills import plan_of
    evaluate(plan_of(sys.argv[1], Path(sys.argv[2])), Path(sys.argv[3]), workers=2, envs=1)
"""


def plan_of(world, policy):
    """Returns a plan of three trials in a stand-in of a world; ``policy`` is the file of the one for CALVIN."""
    folder = str(Path(__file__).parent)
    code = f"import sys; sys.path.append({folder!r})\n{{}}"
    if world == "calvin":
        command = (sys.executable, "-c", code.format(start_code("fake_calvin")), folder, "", "")
        return make_world_plan(f"python:{policy}:Reads", suite="calvin", command=command, trials=TRIALS)
    command = (sys.executable, "-c", code.format(start_code("fake_world")))
    plan = make_world_plan("noop", suite="libero_object_swap", command=command, tasks=["3"], trials=TRIALS)
    return replace(plan, world=replace(plan.world, protocol=replace(PROTOCOLS["openpi"], steps={"libero_object": 12})))


def _bytes(run):
    return {p.relative_to(run.path): p.read_bytes() for p in sorted(run.path.glob("records/**/*.parquet"))}


def _started(world, policy, out, **variables):
    """Runs the plan in a process of its own; returns its exit status."""
    script = policy.with_name("run.py")
    script.write_text(SCRIPT)
    paths = (Path(__file__).parents[3], Path(betterbench.__file__).parents[1])
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(map(str, paths)), **variables}
    command = [sys.executable, str(script), world, str(policy), str(out)]
    return subprocess.run(command, env=environment, check=False, start_new_session=True).returncode


CASES = [(world, killed) for world in ("libero", "calvin") for killed in ("simulator", "worker", "run")]
QUICK = {("libero", "run")}


@pytest.mark.parametrize(
    ("world", "killed"), [case if case in QUICK else pytest.param(*case, marks=pytest.mark.slow) for case in CASES]
)
def test_after_a_kill_the_same_command_finishes_the_run(tmp_path, world, killed):
    policy = tmp_path / "reads.py"
    policy.write_text(policy_text())
    where = "1" if world == "libero" else repr(float(start_of(calvin_chains()[1].start).scene[11]))
    mark, happened = uuid.uuid4().hex, tmp_path / "it happened"
    out = tmp_path / "run"
    fault = f"kill the {killed}:{where}:{happened}"
    status = _started(world, policy, out, FAKE_FAULT=fault, BETTERBENCH_TEST_MARK=mark)
    assert happened.exists()
    assert status == (-9 if killed == "run" else 0)
    until = time.monotonic() + 30.0
    while left_over(mark) and time.monotonic() < until:
        time.sleep(0.1)
    assert not left_over(mark)
    before = {e.seed: e.status for e in RunFolder.open(out).entries()}
    if killed == "simulator":
        assert before == {0: "done", 1: "error", 2: "done"}
    elif killed == "worker":
        assert before == {0: "done", 1: "done", 2: "done"}
    else:
        assert 1 not in before
    run = evaluate(plan_of(world, policy), out, workers=1, envs=1)
    assert {e.seed: e.status for e in run.entries()} == {0: "done", 1: "done", 2: "done"}
    lines = (out / "journal.jsonl").read_bytes().splitlines()
    assert len(lines) == TRIALS + (killed == "simulator")
    assert not list(out.rglob("*.part"))
    assert _bytes(run) == _bytes(evaluate(plan_of(world, policy), tmp_path / "undisturbed", workers=1, envs=1))
