"""Suites as folders: the same tasks give the same folder, and a folder that differs from its digests is refused."""

from __future__ import annotations

import json
import shutil

import pytest
from tests.looping import each
from tests.tasks.forgetting import forgotten_tasks

from betterbench.cli.main import main
from betterbench.errors import InvalidInputError
from betterbench.tasks import suite_tasks
from betterbench.tasks.authoring.task_form import task_forms
from betterbench.tasks.suite_folder import HEAD, read_suite_folder, suite_files
from betterbench.tasks.user_files import load_task_files, options_by_name, options_for, suite_file, suite_folder_of


def forms():
    found = task_forms(["fruit_lunch", "tidy_desk"])
    for name, form in found.items():
        form["id"] = f"shared_{name}"
    return {form["id"]: form for form in found.values()}


@pytest.fixture
def suite(tmp_path):
    name, files = suite_files("shared", forms())
    for path, content in files.items():
        (tmp_path / name / path).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name / path).write_bytes(content)
    return tmp_path / name


def test_the_same_tasks_give_the_same_files_in_any_order():
    one, other = forms(), dict(reversed(forms().items()))
    assert suite_files("shared", one) == suite_files("shared", other)
    other["shared_tidy_desk"]["version"] += 1
    assert suite_files("shared", one)[0] != suite_files("shared", other)[0]
    assert suite_files("shared", one)[0].startswith("shared-")


def test_a_folder_is_read_back(suite):
    read = read_suite_folder(suite)
    assert read.name == suite.name
    assert read.tasks == ("shared_fruit_lunch", "shared_tidy_desk")
    assert [json.loads(file.read_text())["id"] for file in read.files] == list(read.tasks)
    (suite / "tasks" / "shared_tidy_desk.demonstrations.json").write_text("{}")
    assert read_suite_folder(suite) == read


def _edit(suite, **changes):
    head = json.loads((suite / HEAD).read_text())
    (suite / HEAD).write_text(json.dumps({**head, **changes}))


SPOILED = {
    "does not list 'x.json'": lambda s: (s / "tasks" / "x.json").write_text("{}"),
    "shared_tidy_desk.json: has the digest": lambda s: (s / "tasks" / "shared_tidy_desk.json").write_text("{}"),
    "shared_fruit_lunch.json": lambda s: (s / "tasks" / "shared_fruit_lunch.json").unlink(),
    "suite.json: name": lambda s: _edit(s, name="../x"),
    "suite.json: tasks": lambda s: _edit(s, tasks={}),
    "suite.json: is not JSON": lambda s: (s / HEAD).write_text("{"),
    "its tasks have the digest": lambda s: (
        _edit(s, tasks={k: v for k, v in json.loads((s / HEAD).read_text())["tasks"].items() if "fruit" in k})
        or (s / "tasks" / "shared_tidy_desk.json").unlink()
    ),
}


@each("problem", SPOILED, str)
def test_a_changed_folder_is_refused(problem, tmp_path_factory):
    folder = tmp_path_factory.mktemp("suites")
    name, files = suite_files("shared", forms())
    for path, content in files.items():
        (folder / name / path).parent.mkdir(parents=True, exist_ok=True)
        (folder / name / path).write_bytes(content)
    SPOILED[problem](folder / name)
    with pytest.raises(InvalidInputError) as caught:
        read_suite_folder(folder / name)
    assert problem in str(caught.value)


def test_a_suite_without_tasks_or_with_another_name_is_refused():
    with pytest.raises(InvalidInputError, match="tasks"):
        suite_files("shared", {})
    with pytest.raises(InvalidInputError, match="name"):
        suite_files("Shared tasks", forms())


ENDS = """
from betterbench.interface import PolicyInfo
class Ends:
    info = PolicyInfo("ends", needs_images=False)
    def reset(self, start):
        pass
    def act(self, observation):
        raise RuntimeError("enough")  # long before the step limit
"""


def test_commands_take_the_folder(suite, tmp_path, capfd):
    """As ``--suite`` and as ``--task-file``; messages name ``--suite`` and the folder, and not each of its files."""
    out = tmp_path / "run"
    (tmp_path / "ends.py").write_text(ENDS, encoding="utf-8")
    words = ["eval", "--policy", f"python:{tmp_path / 'ends.py'}:Ends", "--suite", str(suite), "--out", str(out)]
    words += ["--variations", "shared_fruit_lunch/O1", "--trials", "1", "--uncertified", "--workers", "1"]
    with forgotten_tasks():
        main(words)
    told = capfd.readouterr()
    assert "errors      2 trials ended with an error of the policy" in told.out, told
    assert f"better report {out} --suite {suite}" in " ".join((told.out + told.err).split())
    assert len(list((out / "task_files").iterdir())) == 2
    with forgotten_tasks():
        assert main(["diagnose", str(out), "--task-file", str(suite), "--json"]) == 0
    shown = json.loads(capfd.readouterr().out)
    assert {trial["task"] for trial in shown["trials"]} == {"shared_fruit_lunch"}
    shutil.rmtree(suite)


def test_files_of_the_folder_belong_to_its_tasks_alone(suite):
    (suite / "power.json").write_text("{}")
    with forgotten_tasks():
        tasks = suite_tasks(str(suite))
        found = [suite_file(tasks, "power.json"), suite_file(tasks[:1], "power.json")]
        others = [
            suite_file(tasks, "certificate.json"),
            suite_file([*tasks, "fast_food"], "power.json"),
            suite_file(["fast_food"], "power.json"),
            suite_file([], "power.json"),
        ]
    assert found == [suite / "power.json"] * 2
    assert others == [None] * 4


def test_commands_for_others_name_the_folder_without_its_place(suite):
    with forgotten_tasks():
        assert options_by_name(suite_tasks(str(suite))) == ("--task-file", suite.name)
        assert options_by_name(["fast_food"]) == ()


def test_messages_name_the_suite_option_for_one_suite_and_files_for_several(suite, tmp_path):
    """``--suite`` can be given once."""
    with forgotten_tasks():
        load_task_files([suite])
        assert options_for(["shared_fruit_lunch"]).strip() == f"--suite {suite}"
        assert str(suite_folder_of(["shared_fruit_lunch"])) == str(suite)
        for tasks in (["fast_food"], [], ["shared_fruit_lunch", "fast_food"]):
            assert suite_folder_of(tasks) is None
        form = dict(forms()["shared_fruit_lunch"], id="other_lunch")
        name, files = suite_files("other", {"other_lunch": form})
        other = tmp_path / name
        for path, content in files.items():
            (other / path).parent.mkdir(parents=True, exist_ok=True)
            (other / path).write_bytes(content)
        load_task_files([other])
        assert options_for(["shared_fruit_lunch"]).strip() == f"--task-file {suite} --task-file {other}"
