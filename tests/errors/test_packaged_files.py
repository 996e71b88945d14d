"""Mistakes in files that are added to a folder of the package are one line that names the files.

The files are added to a copy of the package, which processes of their own import.
"""

from __future__ import annotations

import os
import re
from pathlib import Path

import pytest
from tests.prepared_process import OTHERS, prepared

import betterbench


@pytest.fixture(scope="module")
def package(tmp_path_factory) -> Path:
    """Return the folder of a copy of the package, in which links replace the files."""
    copy = tmp_path_factory.mktemp("copy") / "betterbench"
    for root, _, names in os.walk(betterbench.__path__[0]):
        folder = copy / Path(root).relative_to(betterbench.__path__[0])
        folder.mkdir()
        for name in names:
            (folder / name).symlink_to(Path(root) / name)
    return copy


@pytest.fixture
def better(package):
    """Return a function that adds a file to the copy and returns the message of a command that fails."""
    added = []

    def run(name: str, source: str, *words: str) -> str:
        added.append(package / name)
        added[-1].write_text(source, encoding="utf-8")
        environment = {**os.environ, "PYTHONPATH": str(package.parent), "PYTHONDONTWRITEBYTECODE": "1"}
        done = prepared(*OTHERS).run("-m", "betterbench.cli", *words, env=environment)
        assert done.returncode == 2, done.stderr
        assert "Traceback" not in done.stderr
        return " ".join(done.stderr.split())

    yield run
    for file in added:
        file.unlink()


MODE = """from betterbench.diagnosis.authoring import *

PUT = new_label("put_back", Kind.REASONING, after=Label.EARLY_HALT)
{threshold}

@FailureMode(PUT, short="put back", definition="It is put back.", conclusion="It puts objects back.")
def _find(trial):
    {body}
"""


@pytest.mark.parametrize(
    ("threshold", "body", "text"),
    [
        (
            "threshold('hover_time', 0.5, 's', 'Why.', 'Larger: more put_back.')",
            "return None",
            r"\S+/tasks/thresholds\.py, line \d+, and \S+/modes/put_back\.py, line 4: both register the threshold",
        ),
        (
            "threshold('put_back_radius', '0.5', 'm', 'Why.')",
            "return None",
            r"\S+/modes/put_back\.py, line 4: .*'put_back_radius' must be a finite number, got '0\.5'\. Correct the",
        ),
        ("RADIUS = 0.5 m", "return None", r"\S+/modes/put_back\.py, line 4: SyntaxError: invalid syntax\. Correct the"),
    ],
    ids=["taken", "number", "syntax"],
)
def test_a_mistake_in_the_file_of_a_failure_mode_names_the_file(better, threshold, body, text):
    said = better("diagnosis/modes/put_back.py", MODE.format(threshold=threshold, body=body), "diagnose", "runs/none")
    assert re.match(f"error: {text}", said), said


TASK = """from betterbench.tasks import authoring as a

BLOCK, CAN = a.item("block"), a.item("can")
LEFT, RIGHT = a.Slot("left", 0.50, 0.20), a.Slot("right", 0.50, -0.20)
BOX = a.container("box", category="lunchbox")
MIDDLE = a.Slot("middle", 0.55, 0.00)

@a.task
def {name}():
    '''Pack the block.'''
    return a.Task(
        {fields}
        title="Block",
        template=a.LOOSE_PACKING,
        slots=(LEFT, RIGHT, MIDDLE),
        training=a.conditions(
            [{{BLOCK: LEFT, CAN: RIGHT, BOX: MIDDLE}}],
            [a.Instruction("Pack the block.", a.packed("pack", BOX, BLOCK))],
        ),
        variations=(a.Variation("{variation}", (a.swap(BLOCK, CAN),), "exchanged", "It can."),),
    )
"""


@pytest.mark.parametrize("name", ["a_block.py", "zz_block.py"])
def test_a_task_whose_name_is_taken_names_both_files(better, name):
    """The task that was read last replaced the other one without a message."""
    source = TASK.format(name="fruit_lunch", fields="version=1,", variation="L1")
    said = better(f"tasks/suite/{name}", source, "list", "tasks")
    places = sorted([rf"\S+/tasks/suite/{name}, line 8", r"\S+/tasks/suite/fruit_lunch\.py, line \d+"])
    text = r"both register the task 'fruit_lunch'\. Change the name at one of the two places\."
    assert re.fullmatch(rf"error: {places[0]}, and {places[1]}: {text}", said), said


@pytest.mark.parametrize(
    ("fields", "variation", "text"),
    [
        ("", "L1", r", line 11: TypeError: .*missing 1 required .*'version'\. Correct the file\."),
        (
            "version=1,",
            "L/1",
            r": task zz_block: variations\[0\]\.name: 'L/1' cannot be a name\. Use up to 100 letters, .*",
        ),
        ("version=1", "L1", r", line \d+: SyntaxError: .*\. Correct the file\."),
    ],
    ids=["version", "variation", "syntax"],
)
def test_a_mistake_in_the_file_of_a_task_names_the_file(better, fields, variation, text):
    source = TASK.format(name="zz_block", fields=fields, variation=variation)
    said = better("tasks/suite/zz_block.py", source, "list", "variations", "--tasks", "zz_block")
    assert re.fullmatch(rf"error: \S+/tasks/suite/zz_block\.py{text}", said), said


RELATION = """from betterbench.tasks.relations.authoring import *

def there(state, name, target):
    return True

def goals(state, name, target, region):
    return ()

register(
    Relation(
        name="inside",
        words="{object} is inside {target}",
        where=single(there),
        regions=offers("inside"),
        needs=("inside",),
        goals=goals,
    )
)
"""


def test_a_relation_whose_name_is_taken_names_both_files(better):
    """The file that was read first took the name, so the message named the shipped file alone."""
    said = better("tasks/relations/a_inside.py", RELATION, "list", "tasks")
    text = r"\S+/relations/a_inside\.py, line 9, and \S+/relations/inside\.py, line \d+: both register "
    assert re.fullmatch(rf"error: {text}the relation 'inside'\. Change the name at one of the two places\.", said), said


KIND = """from betterbench.policies.kinds.authoring import *

def _make(address):
    return {"left": 1}[address.target]

FORM = AddressForm(scheme="toy", example="toy:SIDE")
register(PolicyKind(form=FORM, shown="toy:SIDE", summary="A toy.", needs=AT_ONCE, make=_make))
"""


def test_an_error_in_the_code_of_a_policy_kind_names_the_file(better):
    said = better("policies/kinds/toy.py", KIND, "serve", "toy:right")
    text = r"\S+/policies/kinds/toy\.py, line 4: KeyError: 'right'\. Correct the file\."
    assert re.fullmatch(f"error: {text}", said), said


@pytest.mark.parametrize(
    ("place", "source", "command", "cure"),
    [
        (
            "diagnosis/modes/zz_put_back.py",
            MODE.format(threshold="", body="return None").replace("@", "MODE = "),
            "diagnose nowhere",
            r"Decorate the function that finds the evidence with @FailureMode\(\.\.\.\)\.",
        ),
        (
            "tasks/relations/zz_perched.py",
            RELATION.replace("register(", "PERCHED = ("),
            "list tasks",
            r"Pass the relation to register\.",
        ),
        (
            "tasks/suite/zz_block.py",
            TASK.format(name="zz_block", fields="version=1,", variation="L1").replace("@a.task\n", ""),
            "list tasks",
            r"Decorate the function that returns the task with @a\.task\.",
        ),
        (
            "policies/kinds/zz_toy.py",
            KIND.replace("register(", "TOY = ("),
            "list policies",
            r"Pass the policy kind to register\.",
        ),
    ],
    ids=["mode", "relation", "task", "policy kind"],
)
def test_a_file_that_registers_nothing_is_named(better, place, source, command, cure):
    """It was ignored without a message."""
    said = better(place, source, *command.split())
    assert re.fullmatch(rf"error: \S+/{place}: it registers nothing\. {cure}", said), said
