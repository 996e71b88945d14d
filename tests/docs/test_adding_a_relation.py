"""The page on relations is carried out: its three files pass the tests of relations and tasks in a copy."""

from __future__ import annotations

import json
import re

import pytest
from tests.docs.copies import ROOT, attempt, copy_checkout, run
from tests.docs.test_docs import blocks

from betterbench.tasks.relations import Relation

PAGE = ROOT / "docs" / "adding-a-relation.md"
PLACES = (
    "src/betterbench/tasks/relations/perched.py",
    "src/betterbench/tasks/suite/block_on_can.py",
    "tests/tasks/test_perched.py",
)

LAWS = """
import sys, pytest
class Alone:
    def pytest_collection_modifyitems(self, items):
        for item in items:
            if item.name in ("test_every_target_offers_the_place_that_is_asked_for", "test_looks_of_a_thing_differ"):
                item.function.only = lambda task, *_: task.id == "block_on_can"
ended = pytest.main(sys.argv[1:], [Alone()])
import betterbench, betterbench.tasks
print(betterbench.__file__, betterbench.tasks.task_names())
sys.exit(ended)
"""
"""Runs tests, and prints where the package and which tasks were found; other tests check the tasks of the suite."""


@pytest.fixture(scope="module")
def checkout(tmp_path_factory):
    """A copy of code and tests into which the page's files have been put where the page says."""
    page = PAGE.read_text()
    assert all(f"`{place}`" in page for place in PLACES)
    *files, _ = blocks(PAGE, "python")
    return copy_checkout(tmp_path_factory.mktemp("checkout"), dict(zip(PLACES, files, strict=True)))


def test_the_contract_tests_pass_with_the_files_of_the_page_in_their_folders(checkout):
    files = ("tests/tasks/test_perched.py", "tests/tasks/test_relations.py", "tests/tasks/test_suite.py")
    assert " ".join(files) in PAGE.read_text()
    laws = ("-k", "not beside and not at_a_side")  # of another relation
    said = run(checkout, "-c", LAWS, "-q", "-p", "no:cacheprovider", *files, "tests/tasks/test_template.py", *laws)
    assert "block_on_can" in said.splitlines()[-1]
    assert str(checkout) in said.splitlines()[-1]


def test_the_expert_achieves_the_relation_of_the_page(checkout):
    (command, *_) = (line for block in blocks(PAGE, "sh") for line in block.splitlines() if line.startswith("better"))
    _, *arguments = command.replace("--trials 3", "--trials 1").split()
    quickly = ("--observation", "state_only", "--workers", "1")
    said = run(checkout, "-m", "betterbench.cli", *arguments, *quickly, "--out", "run")
    assert "(2/2," in said
    assert "(1/1," in said


def test_the_names_and_the_template_of_the_page_are_found(checkout):
    *_, check = blocks(PAGE, "python")
    run(checkout, "-c", check)
    assert "Tasks: block_on_can." in run(checkout, "-m", "betterbench.cli", "list", "templates")


@pytest.mark.slow
def test_all_tests_of_relations_and_tasks_pass_with_the_files_of_the_page(checkout):
    commands = [line for block in blocks(PAGE, "sh") for line in block.splitlines() if "pytest" in line]
    assert len(commands) == 2
    for command in commands:
        run(checkout, *command.split()[1:], "-p", "no:cacheprovider")


def test_a_task_with_other_numbers_of_objects_needs_groups_of_its_own(checkout):
    """As the page says: without `groups` it is one error with the file, and with the groups of the page it is made."""
    ((groups, unpacked),) = re.findall(r"`(groups=\(.*?)` after `(.*?)`", " ".join(PAGE.read_text().split()))
    _, task, *_ = blocks(PAGE, "python")
    two = task.replace('CAN = a.fixture("can")', 'CAN, BIN = a.fixture("can"), a.fixture("second", category="can")')
    two = two.replace("MIDDLE = a.Slot(", 'BACK = a.Slot("back", 0.70, 0.0)\nMIDDLE = a.Slot(')
    two = two.replace("CAN: MIDDLE}", "CAN: MIDDLE, BIN: BACK}").replace("RIGHT, MIDDLE)", "RIGHT, MIDDLE, BACK)")
    two = two.replace("block_on_can", "between_cans").replace('name="perching"', 'name="between"')
    (checkout / "two.py").write_text(two)
    words = ("-m", "betterbench.cli", "list", "templates", "--task-file", "two.py")
    failed = attempt(checkout, *words)
    said = " ".join(failed.stderr.split())
    assert failed.returncode == 2, failed.stdout + failed.stderr
    assert re.search(r"two\.py, line \d+, task between_cans: training\[0\]", said), said
    assert "group 'fixture' (role 'fixture') has 2 objects, not 1" in said
    two = two.replace("    relation=PERCHED.name,", f"    relation=PERCHED.name,\n    {groups},")
    (checkout / "two.py").write_text(two.replace("PERCHING = ", f"{unpacked}\nPERCHING = "))
    assert "between_cans" in run(checkout, *words)


def test_each_field_of_a_relation_is_explained():
    for name in set(Relation.__dataclass_fields__) - {"wide"}:
        assert f"`{name}`" in PAGE.read_text()


def test_the_regions_of_the_page_are_those_of_the_assets(checkout):
    """In a process of its own: other tests may have registered assets in this one."""
    pairs = "[(region.name, category) for category in categories() for region in build_unpainted(category).regions]"
    code = f"import json; from betterbench.sim.assets import build_unpainted, categories; print(json.dumps({pairs}))"
    found: dict[str, set[str]] = {}
    for region, category in json.loads(run(checkout, "-c", code)):
        found.setdefault(region, set()).add(category)
    rows = re.findall(r"^\| `(\w+)` \| (.*) \|$", PAGE.read_text(), flags=re.MULTILINE)
    told = {region: set(re.findall(r"`(\w+)`", listed)) for region, listed in rows if region in found}
    no_targets = {"base", "knob", "handle", "lid", "spout", "rim", "front"}
    assert told == {region: assets for region, assets in found.items() if region not in no_targets}
