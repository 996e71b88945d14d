"""The page on policy kinds is carried out: its file registers a kind, and a trial is run with it."""

from __future__ import annotations

import dataclasses
import hashlib
import os
import re
import sys
from pathlib import Path

import numpy as np
import pytest
from tests.docs.copies import ROOT, attempt, copy_checkout, run
from tests.evaluation.conftest import in_few_steps
from tests.prepared_process import COMMAND_LINE, prepared

from betterbench.cli.main import main
from betterbench.errors import RunConflictError
from betterbench.evaluation import evaluate, make_plan
from betterbench.policies import kinds
from betterbench.policies.address import PolicyAddress
from betterbench.policies.factory import check_policy
from betterbench.policies.kinds import KINDS, PolicyKind
from betterbench.records import RunFolder
from betterbench.tasks import user_files
from betterbench.tasks.trial import Trial

PAGE = (Path(__file__).parents[2] / "docs" / "adding-a-policy-kind.md").read_text(encoding="utf-8")
FILE, CHECK = re.findall(r"```python\n(.*?)```", PAGE, flags=re.DOTALL)


@pytest.fixture
def sway(tmp_path, monkeypatch):
    (tmp_path / "sway_of_the_page.py").write_text(FILE, encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    module = __import__("sway_of_the_page")
    yield module
    del KINDS["sway"], sys.modules["sway_of_the_page"]


def test_the_kind_of_the_page_is_listed_and_read(sway, capsys):
    exec(compile(CHECK, "adding-a-policy-kind.md", "exec"), {"SWAY": sway.SWAY})  # noqa: S102 - the page's own code
    assert main(["list", "policies"]) == 0
    assert "sway:AXIS" in capsys.readouterr().out
    for address, text in (
        ("sway:x?amplitud=1", "Did you mean 'amplitude'"),
        ("sway:x?amplitude=2", "Set it to the share of the largest action, from 0 to 1"),
        ("sway:x?period=ten", "Set it to the number of control steps of one swing, such as 8"),
        ("sway:x?start=up", "Unknown start 'up'"),
        ("sway:x?period=0", "Give a whole number such as 40"),
        ("sway:w", "Unknown axis 'w'"),
        ("sway", "Unknown policy 'sway'"),
    ):
        assert main(["eval", "--policy", address, "--out", "/nowhere/run"]) == 2
        said = " ".join(capsys.readouterr().err.split())
        assert text in said


@pytest.mark.usefixtures("sway")
def test_a_trial_is_run_with_the_kind_of_the_page(tmp_path, monkeypatch):
    monkeypatch.setattr(Trial, "resolve", in_few_steps(60))  # one swing and a half
    address = "sway:y?amplitude=0.3&start=backward"
    assert check_policy(address).action_space == "ee_delta"
    plan = make_plan(address, tasks=("fruit_lunch",), trials=1, observation="state_only")
    run = evaluate(dataclasses.replace(plan, trials=plan.trials[:1]), tmp_path / "run", workers=1)
    (entry,) = run.entries()
    assert entry.status == "done"
    applied = run.read_record(entry.task, entry.condition, entry.seed).applied[1:]
    steps = np.arange(len(applied))
    assert len(steps) > 50
    np.testing.assert_allclose(applied[:, 1], -0.3 * np.cos(2.0 * np.pi * steps / 40), atol=1e-6)


def test_the_kind_of_the_page_works_in_a_file_of_its_own(tmp_path):
    """In another process: its workers get the file too."""
    assert "`--task-file sway.py`" in PAGE
    (tmp_path / "sway.py").write_text(FILE, encoding="utf-8")
    (point, *_) = re.findall(r"```python\n(.*?)```", (ROOT / "docs" / "adding-a-world.md").read_text(), flags=re.DOTALL)
    (tmp_path / "point.py").write_text(point, encoding="utf-8")
    environment = {name: value for name, value in os.environ.items() if not name.startswith("BETTERBENCH")}

    def better(*words: str) -> str:
        done = prepared(*COMMAND_LINE).run("-m", "betterbench.cli", *words, cwd=tmp_path, env=environment)
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout

    assert "sway:AXIS" in better("list", "policies", "--task-file", "sway.py")
    files = ("--task-file", "point.py", "--task-file", "sway.py")
    better("eval", *files, "--suite", "point", "--policy", "sway:y", "--trials", "1", "--workers", "2", "--out", "run")
    better("report", "run", *files)
    assert "sway:y" in (tmp_path / "run" / "report" / "index.html").read_text(encoding="utf-8")


def test_a_run_in_packaged_tasks_notices_that_the_file_of_its_kind_has_changed(tmp_path, monkeypatch):
    monkeypatch.setenv(user_files.VARIABLE, "")
    monkeypatch.setattr("betterbench.policies.kinds.kind.KINDS", dict(KINDS))
    monkeypatch.setattr(Trial, "resolve", in_few_steps(4))
    plan = make_plan("sway:y", tasks=("fruit_lunch",), trials=1, observation="state_only")
    plan = dataclasses.replace(plan, trials=plan.trials[:1])
    file = tmp_path / "sway.py"

    def evaluated_with(text: str, **options: bool) -> RunFolder:
        kinds.kind.KINDS.pop("sway", None)
        monkeypatch.setattr(user_files, "_files", {})
        file.write_text(text, encoding="utf-8")
        user_files.load_task_files([file])
        return evaluate(plan, tmp_path / "run", **options)

    first = evaluated_with(FILE)
    assert first.context["policy"]["kind_file"] == f"sway.py, sha256 {hashlib.sha256(FILE.encode()).hexdigest()}"
    assert evaluated_with(FILE).context == first.context
    changed = FILE.replace('"amplitude", 0.5', '"amplitude", 0.4')
    with pytest.raises(RunConflictError, match=r"policy\.kind_file was .sway\.py, sha256 .* --allow-changed-policy"):
        evaluated_with(changed)
    (change,) = evaluated_with(changed, allow_changed_policy=True).context["policy_changes"]
    assert change["policy"]["kind_file"] != first.context["policy"]["kind_file"]


def test_the_contract_tests_pass_with_the_file_of_the_page_in_its_folder(tmp_path):
    place = "src/betterbench/policies/kinds/sway.py"
    assert place in PAGE
    checkout = copy_checkout(tmp_path, {place: FILE})
    said = run(checkout, "-m", "pytest", "-v", "-p", "no:cacheprovider", "tests/policies/test_kinds.py")
    assert "test_the_names_of_runs_know_which_policies_are_built_in PASSED" in said
    run(checkout, "-c", "from betterbench.policies.kinds import KINDS; assert 'sway' in KINDS")


def test_a_scheme_that_is_not_a_literal_is_named_by_a_contract_test(tmp_path):
    named = FILE.replace('scheme="sway"', "scheme=SCHEME").replace("AXES = (", 'SCHEME = "sway"\nAXES = (')
    checkout = copy_checkout(tmp_path, {"src/betterbench/policies/kinds/sway.py": named})
    laws = ("-k", "word_is_a_literal")
    done = attempt(checkout, "-m", "pytest", "-q", "-p", "no:cacheprovider", "tests/policies/test_kinds.py", *laws)
    assert "betterbench/policies/kinds/sway.py: the first word of kind 'sway' is not a literal. Write" in done.stdout
    assert "1 failed" in done.stdout


def test_each_field_of_a_kind_is_explained():
    for name in PolicyKind.__dataclass_fields__:
        assert f"`{name}`" in PAGE


def test_each_member_of_an_address_is_explained():
    for name in {name for name in dir(PolicyAddress) if not name.startswith("_")} - {"check"}:  # the form calls it
        assert f"`address.{name}" in PAGE
