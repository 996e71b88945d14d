"""The contributors' page on a new task, carried out word for word in a copy of the checkout."""

from __future__ import annotations

import shlex

import pytest
from tests.docs.copies import ROOT, copy_checkout, run
from tests.docs.test_docs import blocks

PAGE = ROOT / "docs" / "adding-a-task.md"
FILE = "src/betterbench/tasks/suite/tea_tray.py"
LONG = ("test_every_target_offers_the_place_that_is_asked_for", "test_looks_of_a_thing_differ")
"""Laws that are checked for the page's task alone, because other tests check them for the tasks of the suite."""

LAWS = f"""
import sys, pytest
class Alone:
    def pytest_collection_modifyitems(self, items):
        found = [item.function for item in items if item.name in {LONG}]
        assert len(found) == {len(LONG)}
        for law in found:
            law.only = lambda task, *_: task.id == "tea_tray"
ended = pytest.main(sys.argv[1:], [Alone()])
import betterbench, betterbench.tasks
print(betterbench.__file__, betterbench.tasks.task_names())
sys.exit(ended)
"""
"""Runs tests, and prints where the package and which tasks were found."""


@pytest.fixture(scope="module")
def checkout(tmp_path_factory):
    """A copy of code and tests into which the page's file has been put where the page says."""
    assert FILE in PAGE.read_text()
    (code,) = blocks(PAGE, "python")
    return copy_checkout(tmp_path_factory.mktemp("checkout"), {FILE: code})


def test_the_laws_of_the_suite_hold_with_a_task_more_in_its_folder(checkout):
    laws = "suite or axis or consistent or reference or support or step_limit or new"
    said = run(checkout, "-c", LAWS, "-q", "-p", "no:cacheprovider", "tests/tasks/test_suite.py", "-k", laws)
    where = said.splitlines()[-1]
    assert str(checkout) in where
    assert "tea_tray" in where
    assert "passed" in said


@pytest.mark.slow
def test_every_command_of_the_page_ends_well(checkout):
    """Measures 120 demonstrations, certifies, and plays the tests of the task: some two minutes."""
    lines = [line for block in blocks(PAGE, "sh") for line in block.splitlines()]
    assert len(lines) >= 4
    for line in lines:
        program, *arguments = shlex.split(line)
        if program == "better":
            run(checkout, "-m", "betterbench.cli", *arguments)
        else:
            assert program == ".venv/bin/python"
            run(checkout, *arguments)
    assert (checkout / "tea_tray.png").stat().st_size > 10_000
    assert (checkout / "runs/tea/certificate.html").is_file()
