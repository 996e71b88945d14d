"""Files of users that import by the names of modules before the packages moved are loaded as they are."""

from __future__ import annotations

import ast
import hashlib
import importlib
import importlib.util

import pytest
from tests.kept_registry import kept_registry

from betterbench.cli.main import main
from betterbench.sim.assets import categories
from betterbench.tasks import get_task, task_names
from betterbench.tasks.renamed import MODULES, NAMES, present_name, with_present_names
from betterbench.tasks.user_files import TaskFile, load_sources, origins_of

OLD_TASK = '''"""A task and an asset by the imports that were documented before."""

from betterbench.assets.authoring import generator
from betterbench.assets.procedural.mug import mug
from betterbench.state import WorldState as State
from betterbench.tasks import get_task, registry
from betterbench.tasks.registry import task
import betterbench.recording.lock as lock
from betterbench.recording import RunFolder, RunLock


@generator("renamed_mug", colors=("red",), looks=1)
def renamed_mug(look, color):
    """A mug."""
    return mug(look, color)


@task
def renamed_lunch():
    """Like fruit_lunch."""
    from dataclasses import replace

    assert (State.__module__, lock.LOCK_NAME) and registry.task is task and RunLock is lock.RunLock and RunFolder
    return replace(get_task("fruit_lunch"), id="renamed_lunch")
'''


def test_every_earlier_name_leads_to_a_module():
    for old, new in MODULES.items():
        assert importlib.util.find_spec(f"betterbench.{new}") is not None, f"{old} -> {new}"
        assert old == "demonstrations" or present_name(old) == new


def test_every_earlier_public_name_is_where_the_table_says():
    for (_, name), home in NAMES.items():
        assert hasattr(importlib.import_module(f"betterbench.{home}"), name)


def test_names_of_today_are_left_alone():
    for name in ("demonstrations.export", "tasks.authoring", "diagnosis.modes.success", "records.run", "evaluation"):
        assert present_name(name) == name
    assert present_name("demonstrations.production") == "demonstrations.making.production"
    text = "from betterbench.tasks import get_task as g\nimport os\nfrom betterbench.demonstrations.export import job\n"
    assert [ast.unparse(node) for node in with_present_names(text, "x.py").body] == text.splitlines()


@pytest.mark.parametrize(
    ("line", "now"),
    [
        ("from betterbench import scenes", "from betterbench.sim import scenes"),
        ("from betterbench import recording as r", "from betterbench import records as r"),
        ("from betterbench import recording", "from betterbench import records as recording"),
        (
            "from betterbench.learned.families import learner",
            "from betterbench.policies.learned.families import learner",
        ),
        ("import betterbench.scenes.objects as o", "import betterbench.sim.scenes.objects as o"),
    ],
)
def test_a_statement_is_translated(line, now):
    assert [ast.unparse(node) for node in with_present_names(line, "x.py").body] == [now]


def test_a_file_by_earlier_names_is_loaded_with_the_hash_of_its_text(tmp_path):
    path = tmp_path / "old_task.py"
    path.write_text(OLD_TASK)
    with kept_registry():
        load_sources([TaskFile.read(path)])
        assert "renamed_lunch" in task_names()
        assert "renamed_mug" in categories()
        assert get_task("renamed_lunch").id == "renamed_lunch"
        (file,) = (f for f in origins_of(["renamed_lunch"])["task_files"] if f["name"] == "old_task.py")
    assert file["sha256"] == hashlib.sha256(OLD_TASK.encode()).hexdigest()


def test_an_error_in_such_a_file_names_its_own_line(tmp_path, capsys):
    path = tmp_path / "broken.py"
    path.write_text("from betterbench.assets.authoring import generator, disc\n\nraise ValueError('no luck')\n")
    assert main(["list", "tasks", "--task-file", str(path), "--json"]) == 2
    assert f"{path}, line 3" in capsys.readouterr().err
