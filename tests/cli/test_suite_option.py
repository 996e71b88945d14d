"""``--suite DIR``: the verbs take a suite in a folder as they take the packaged one."""

from __future__ import annotations

import json
import os

import pytest
from tests.cli.helps import help_of
from tests.prepared_process import COMMAND_LINE, prepared

from betterbench.cli.main import VERBS, main
from betterbench.errors import InvalidInputError
from betterbench.tasks.authoring.task_form import task_forms
from betterbench.tasks.suite_folder import CERTIFICATE, suite_files

TASK = "suite_coffee"


def form():
    """Return a small task: two training conditions, one variation, and two balanced conditions."""
    made = task_forms(["morning_coffee"])["morning_coffee"]
    made |= {"id": TASK, "version": 1, "training": made["training"][:2], "variations": made["variations"][:1]}
    made["regimes"] = {"balanced": made["regimes"]["balanced"]}
    made["regimes"]["balanced"]["conditions"] = made["regimes"]["balanced"]["conditions"][:2]
    return made


@pytest.fixture(scope="module")
def suite(tmp_path_factory):
    name, files = suite_files("coffee", {TASK: form()})
    folder = tmp_path_factory.mktemp("suites") / name
    for path, content in files.items():
        (folder / path).parent.mkdir(parents=True, exist_ok=True)
        (folder / path).write_bytes(content)
    return folder


@pytest.fixture(scope="module")
def better():
    """Run the command in a process of its own, because the tasks of a suite stay registered."""
    inherited = {key: value for key, value in os.environ.items() if key != "BETTERBENCH_TASK_FILES"}

    def run(*arguments):
        command = ("-m", "betterbench.cli", *map(str, arguments))
        done = prepared(*COMMAND_LINE).run(*command, env={**inherited, "COLUMNS": "1000"})
        assert done.returncode == 0, done.stderr
        return done.stdout

    return run


@pytest.fixture(scope="module")
def certified(better, suite, tmp_path_factory):
    """Measure and certify the suite, and put the certificate into its folder."""
    out = tmp_path_factory.mktemp("certificate")
    better("certify", "--suite", suite, "--demonstrations", 2, "--workers", 1, "--out", out / "demonstrations")
    better("certify", "--suite", suite, "--trials", 1, "--workers", 1, "--out", out / "certificate")
    (suite / CERTIFICATE).write_bytes((out / "certificate" / "certificate.json").read_bytes())
    return suite


@pytest.fixture(scope="module")
def run(better, certified, tmp_path_factory):
    """Return a run of the expert that the certificate in the folder covers."""
    out = tmp_path_factory.mktemp("run") / "expert"
    options = ("--trials", 1, "--workers", 1, "--observation", "state_only", "--out", out)
    better("eval", "--policy", "expert", "--suite", certified, *options)
    return out


def test_every_verb_on_tasks_takes_a_suite():
    """The others prepare assets, worlds and pages, take the tasks of their data, or have subcommands of their own."""
    without = {"assets", "worlds", "premise", "recipe", "mixture", "demo", "audit-paper"}
    without |= {"generate", "build", "vlm", "real"}
    for name in VERBS:
        assert ("--suite " in help_of(name)) == (name not in without), name


def test_tasks_of_a_folder_are_listed_and_shown(better, suite, tmp_path):
    listed = json.loads(better("list", "tasks", "--suite", suite, "--json"))
    assert TASK in [row["task"] for row in listed]
    better("show", f"{TASK}/L1", "--suite", suite, "--out", tmp_path / "shown.png")
    assert (tmp_path / "shown.png").stat().st_size > 10_000


@pytest.mark.parametrize(
    ("words", "asked"),
    [
        ((), "fast_food panda"),
        (("--suite", "so101"), "cheeseburger_so101 so101"),
        (("--suite", "better60", "--task", "tidy_desk"), "tidy_desk panda"),
    ],
)
def test_a_policy_is_tried_in_the_first_task_of_a_suite(capsys, monkeypatch, tmp_path, words, asked):
    def preflight(_, trial, **options):
        raise InvalidInputError("asked", f"{trial.task} {options['robot']}", "Stop here")

    monkeypatch.setattr("betterbench.evaluation.run_preflight", preflight)
    assert main(["doctor", "--policy", "noop", *words, "--out", str(tmp_path / "sheet.png")]) == 2
    assert f"asked: {asked}." in capsys.readouterr().err


def test_the_certificate_in_the_folder_covers_a_run_and_its_report(better, run, certified):
    tasks = {json.loads(line).get("task") for line in (run / "journal.jsonl").read_text().splitlines()}
    assert tasks - {None} == {TASK}
    better("report", run, "--suite", certified, "--films", 0)
    page = (run / "report" / "index.html").read_text()
    assert "covered by the certificate of the suite" in page
    assert "100.0 % (3/3)" in page[: page.index("covered by the certificate of the suite")][-60:]
    measured = f"better calibrate --power --suite {certified} --out runs/power, and copy runs/power/power.json into"
    assert f"does not contain {TASK}; measure it with {measured} {certified}." in page
    assert f"Not measured on L1 of {TASK}; measure it with {measured} {certified}." in page


def test_questions_are_about_the_tasks_of_the_folder(better, run, certified, tmp_path):
    size = ("--questions", 20, "--frames", 1, "--cameras", "front", "--size", 64)
    better("vqa", run, "--suite", certified, *size, "--out", tmp_path / "set")
    assert json.loads((tmp_path / "set" / "set.json").read_text())["options"]["tasks"] == [TASK]


@pytest.mark.slow
def test_a_set_of_the_folder_s_balanced_regime_is_made(better, certified, tmp_path):
    options = ("--demos", 2, "--workers", 1, "--out", tmp_path / "set")
    better("dataset", "--suite", certified, "--tasks", TASK, "--regime", "balanced", *options)
    card = (tmp_path / "set" / "README.md").read_text()
    assert TASK in card
    assert f"--task-file {certified.name} --expect" in card
    better("dataset", "--suite", certified, "--tasks", TASK, "--regime", "balanced", *options)  # resumes
    assert "each of the four words occurs" in card


@pytest.mark.slow
def test_the_diagnosis_is_calibrated_on_the_tasks_of_the_folder(better, certified, tmp_path):
    options = ("--policies", "zoo:lexical", "--strengths", "1.0", "--trials", 1, "--films", 0, "--workers", 1)
    better("calibrate", "--suite", certified, *options, "--out", tmp_path / "calibration")
    form = (tmp_path / "calibration" / "calibration.json").read_text()
    assert TASK in form
    assert "fast_food" not in form


def test_a_study_takes_the_tasks_of_a_suite():
    from betterbench.cli.verbs.study import _plan
    from betterbench.tasks import suite_tasks

    assert set(_plan(None, "small", None).tasks) < set(suite_tasks("better60"))
    assert _plan(None, "small", "better60").tasks == suite_tasks("better60")


@pytest.mark.parametrize("verb", [("report",), ("dataset", "--tasks", "fast_food", "--demos", "1", "--out")])
def test_an_unknown_suite_is_refused(capsys, tmp_path, verb):
    assert main([*verb, str(tmp_path / "nowhere"), "--suite", "better6"]) == 2
    assert "Did you mean 'better60'" in " ".join(capsys.readouterr().err.split())
