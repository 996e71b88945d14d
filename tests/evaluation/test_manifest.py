"""The manifest: what a run was made with, and that it is made with one policy."""

from __future__ import annotations

import importlib.metadata
import json
import re
import subprocess

import mujoco
import numpy as np
import pytest
from tests.resealing import rewrite

from betterbench.diagnosis import diagnose_run
from betterbench.errors import RecordError, RunConflictError
from betterbench.evaluation import evaluate, make_plan, open_server
from betterbench.evaluation.planning import machine
from betterbench.evaluation.planning.manifest import policy_difference, run_context, run_conventions, same_policy
from betterbench.interface import Execution, PolicyInfo
from betterbench.interface.actions import ActionSpace, action_space
from betterbench.policies.description import bounded, describe_policy
from betterbench.records import JournalEntry, RunFolder

PLAN = make_plan("random", tasks=["morning_coffee"], variations=["T1"], trials=1, observation="state_only")


def info(**metadata: str) -> PolicyInfo:
    return PolicyInfo("openpi://host:8000", metadata=metadata, execution=Execution(horizon=5))


def test_the_context_of_a_run_is_json_and_says_what_it_was_made_with():
    policy = describe_policy("random", info(server='{"checkpoint": "pi05", "step": 3}', adapter='{"turn": 180}'))
    context = run_context(PLAN, policy=policy, engine={"name": "local", "workers": 2, "envs": 3})
    assert json.loads(json.dumps(context, allow_nan=False)) == context
    assert f"mujoco=={mujoco.__version__}" in context["packages"]
    assert context["packages"] == sorted(context["packages"])
    assert {"cpu", "memory_gb", "graphics_cards", "processors"} <= set(context["machine"])
    assert context["machine"]["memory_gb"] > 0.5
    assert context["engine"] == {"name": "local", "workers": 2, "envs": 3}
    assert context["policy"]["metadata"] == {"adapter": {"turn": 180}, "server": {"checkpoint": "pi05", "step": 3}}
    assert context["policy"]["execution"] == {"horizon": 5, "ahead": 0, "ensemble": None}
    assert ActionSpace.from_json(context["conventions"]["action_space"]) == action_space("ee_delta")
    assert context["renderer"] == {"problem": "no images are rendered in this run"}


def test_conventions_that_nobody_chose_are_written_out_too():
    conventions = run_conventions(PLAN)
    assert conventions["physics_timestep_s"] == 0.002
    assert conventions["control_rate_hz"] == 20.0
    assert conventions["robot"]["tcp_site"] == "tcp"
    assert conventions["quaternions"].startswith("w x y z")
    assert conventions["thresholds"]["grasp_reach"] > 0.0


@pytest.mark.render
def test_a_run_with_images_knows_its_renderer():
    plan = make_plan("random", tasks=["morning_coffee"], variations=["T1"], trials=1)
    context = run_context(plan, policy=describe_policy("random", info()), engine={})
    assert context["renderer"]["mujoco"] == mujoco.__version__
    assert context["renderer"]["renderer"]


def test_no_developer_tool_is_locked():
    names = {line.partition("==")[0] for line in machine.package_lock()}
    assert {"betterbench", "numpy", "mujoco", "pyarrow"} <= names
    assert not {"pytest", "ruff", "mypy", "hypothesis"} & names


def test_the_locked_versions_are_those_of_the_standard_library():
    for line in machine.package_lock():
        name, _, version = line.partition("==")
        assert version == importlib.metadata.version(name)


@pytest.mark.parametrize("packed", [False, True])
def test_the_revision_of_the_folder_is_read_without_git(tmp_path, packed):
    def git(*arguments: str) -> str:
        identity = ["-c", "user.name=a", "-c", "user.email=a@b.c", "-c", "init.defaultBranch=main"]
        command = ["git", "-C", str(tmp_path), *identity, *arguments]
        return subprocess.run(command, check=True, capture_output=True, text=True).stdout.strip()

    git("init", "-q")
    git("commit", "-q", "--allow-empty", "-m", "one")
    if packed:
        git("pack-refs", "--all")
    deep = tmp_path / "a" / "b"
    deep.mkdir(parents=True)
    assert machine.source_revision(deep) == git("rev-parse", "HEAD")
    git("checkout", "-q", "--detach")
    assert machine.source_revision(tmp_path) == git("rev-parse", "HEAD")
    git("worktree", "add", "-q", str(tmp_path / "tree"), "-b", "other")
    assert machine.source_revision(tmp_path / "tree") == git("rev-parse", "HEAD")


def test_a_folder_without_a_repository_has_no_revision(tmp_path):
    (tmp_path / ".git").write_text("gitdir: /nowhere\n", encoding="utf-8")
    assert machine.source_revision(tmp_path) is None
    (tmp_path / ".git").unlink()
    (tmp_path / ".git").mkdir()
    (tmp_path / ".git" / "HEAD").write_text("ref: ../../etc/passwd\n", encoding="utf-8")
    assert machine.source_revision(tmp_path) is None


def test_what_a_server_declares_becomes_bounded_json():
    declared = {
        b"bytes": b"\x00\x01",
        "pose": np.array([1.0, np.nan], dtype=np.float32),
        "large": np.zeros((600, 600)),
        "scalar": np.int64(3),
        "infinite": float("inf"),
        "list": (1, {"deep": None}),
        "object": object,
    }
    form = bounded(declared)
    assert json.loads(json.dumps(form, allow_nan=False)) == form
    assert form["pose"] == [1.0, "nan"]
    assert form["large"]["shape"] == [600, 600]
    assert form["scalar"] == 3
    assert form["bytes"]["bytes"] == 2
    assert form["list"] == [1, {"deep": None}]
    endless: dict[str, object] = {}
    endless["again"] = endless
    assert "too deep" in json.dumps(bounded(endless))
    assert set(bounded({"text": "x" * 10_000_000})) == {"sha256"}


# ------------------------------------------------------------------------------------------------ one policy in one run


@pytest.fixture
def run(tmp_path):
    policy = describe_policy("openpi://host:8000", info(server='{"checkpoint": "pi05-1000"}'))
    folder = RunFolder.start(tmp_path / "run", PLAN.to_json(), context={"policy": policy})
    with folder.journal() as journal:
        journal.append(JournalEntry("morning_coffee", "T1", "T1", 0, "error", "the server went away"))
    return folder


def test_the_same_policy_goes_on_and_nothing_is_written(run):
    before = (run.path / "run.json").read_bytes()
    same = describe_policy("openpi://host:8000", info(server='{"checkpoint": "pi05-1000"}'))
    assert same_policy(run, same, allow_changed=False) == run
    assert policy_difference(run, same) is None
    assert (run.path / "run.json").read_bytes() == before


def test_another_checkpoint_behind_the_same_address_stops_the_run_and_names_both(run):
    other = describe_policy("openpi://host:8000", info(server='{"checkpoint": "pi05-2000"}'))
    with pytest.raises(RunConflictError) as caught:
        same_policy(run, other, allow_changed=False)
    text = str(caught.value)
    assert 'policy.metadata.server.checkpoint was "pi05-1000" and is "pi05-2000"' in text
    assert "--allow-changed-policy" in text


def test_a_change_that_is_allowed_is_noted_and_is_then_the_policy_of_the_run(run):
    other = describe_policy("openpi://host:8000", info(server='{"checkpoint": "pi05-2000"}'))
    noted = same_policy(run, other, allow_changed=True)
    assert noted == RunFolder.open(run.path)
    assert [c["policy"]["metadata"]["server"] for c in noted.context["policy_changes"]] == [{"checkpoint": "pi05-2000"}]
    assert noted.context["policy"] == run.context["policy"], "what it began with stays"
    assert noted.plan == run.plan
    assert same_policy(noted, other, allow_changed=False) == noted
    first = describe_policy("openpi://host:8000", info(server='{"checkpoint": "pi05-1000"}'))
    assert len(same_policy(noted, first, allow_changed=True).context["policy_changes"]) == 2
    notes = diagnose_run(run.path).notes
    assert re.search(r"after 0 trials: .*pi05-1000.* and is .*pi05-2000", notes[0])
    assert "pi05-1000" in notes[1]


CHANGE = {"at_utc": "2026-01-01T00:00:00Z", "trials_before": 1, "difference": "x", "policy": {}}
DEEP = json.loads("[" * 150 + "]" * 150)


@pytest.mark.parametrize(
    "context",
    [
        *({"policy": value} for value in (5, True, "expert", None, [], [{}])),
        *({"policy_changes": value} for value in (5, {}, "x", None, [5], [[]], [{}], [{"policy": 5}], [None])),
        *(
            {"policy_changes": [{**CHANGE, field: value}]}
            for field in ("trials_before", "difference", "policy")
            for value in (5.5, [], DEEP)
        ),
        *({"extended": value} for value in (5, {}, "x", None, [5], DEEP)),
        *({"sources": value} for value in (5, {}, None, [5])),
    ],
    ids=lambda context: json.dumps(context)[:60],
)
def test_a_context_of_foreign_types_is_refused_and_never_taken_for_an_older_version(run, context):
    rewrite(run.path / "run.json", lambda form: form["context"].update(context))
    with pytest.raises(RecordError, match=r"run\.json: context\.") as caught:
        RunFolder.open(run.path)
    assert "\n" not in str(caught.value)
    with pytest.raises(RecordError, match=r"run\.json: context\."):
        RunFolder.start(run.path, PLAN.to_json())


def test_a_run_of_an_older_version_has_no_policy_to_compare_with(tmp_path):
    folder = RunFolder.start(tmp_path / "run", PLAN.to_json(), context={"python": "3.11"})
    assert same_policy(folder, describe_policy("random", info()), allow_changed=False) == folder


def test_the_command_is_told_without_the_folder_of_the_program(monkeypatch):
    monkeypatch.setattr("sys.argv", ["/home/somebody/bin/better", "eval", "--policy", "noop"])
    context = run_context(PLAN, policy={}, engine={})
    assert context["command"] == "better eval --policy noop"


def test_a_server_that_serves_another_policy_since_is_noticed(tiny_plan, tmp_path):
    with open_server("noop", port=0) as server:
        plan = tiny_plan(f"{server.address}?preset=native", trials=1)
        first = evaluate(plan, tmp_path / "run")
        port = server.port
    assert first.context["policy"]["metadata"]["server: betterbench"]["policy"] == "noop"
    assert first.context["policy"]["metadata"]["adapter"], "every convention of the adapter is written out"
    with open_server("random", port=port):
        with pytest.raises(RunConflictError, match='was "noop" and is "random"'):
            evaluate(plan, tmp_path / "run")
        again = evaluate(plan, tmp_path / "run", allow_changed_policy=True)
    assert [c["trials_before"] for c in again.context["policy_changes"]] == [1]
    assert first.plan == again.plan
