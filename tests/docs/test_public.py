"""The documentation uses the public interface alone: the root package and the modules that the reference documents."""

from __future__ import annotations

import ast
import importlib
import re
import sys
import textwrap
from collections.abc import Iterator
from pathlib import Path

import pytest
from tests.looping import each

ROOT = Path(__file__).parents[2]

sys.path.insert(0, str(ROOT / "tools"))
import make_site as site  # noqa: E402

REFERENCE = sorted((ROOT / "docs" / "reference").glob("*.md"))
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md")), *sorted((ROOT / "packages").glob("*/README.md"))]
OURS = ("betterbench", "betterbench_calibration", "lerobot_env_betterbench")
NEEDS_TORCH = "betterbench.policies.learned.authoring"
WORDS_OF_TASK_FILES = "betterbench.tasks.authoring"
"""The one module that is imported whole, under a short name."""


def blocks(page: Path) -> Iterator[tuple[int, str]]:
    """Yield the line and the text of every block of Python."""
    text = page.read_text()
    for found in re.finditer(r"^( *)```(?:python|py)\n(.*?)^ *```", text, flags=re.DOTALL | re.MULTILINE):
        yield text.count("\n", 0, found.start()) + 1, textwrap.dedent(found[2])


PUBLIC = {
    name: site.public_names(site.module_file(name)) for page in REFERENCE for name in site.documented_modules(page)
}
BLOCKS = [(page, line, code) for page in PAGES for line, code in blocks(page)]


def problems(code: str) -> Iterator[str]:
    """Yield what a block uses of our packages that is not public."""
    tree = ast.parse(code)
    whole = {"betterbench": "betterbench"}
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            for alias in node.names:
                if alias.name.partition(".")[0] in OURS and alias.name != "betterbench":
                    yield f"import {alias.name}: import names from it"
        elif isinstance(node, ast.ImportFrom) and (node.module or "").partition(".")[0] in OURS:
            for alias in node.names:
                inner = f"{node.module}.{alias.name}"
                if inner == WORDS_OF_TASK_FILES:
                    whole[alias.asname or alias.name] = inner
                elif alias.name not in PUBLIC.get(node.module or "", ()):
                    yield f"from {node.module} import {alias.name}"
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id in whole:
            module = whole[node.value.id]
            if node.attr not in PUBLIC[module]:
                yield f"{module}.{node.attr}"


@each("page, line, code", BLOCKS)
def test_a_block_uses_public_names_alone(page, line, code):
    assert list(problems(code)) == [], f"{page}:{line}. Public is what docs/reference documents"


@pytest.mark.parametrize(
    ("code", "found"),
    [
        (
            "from betterbench.policies.address import PolicyAddress",
            ["from betterbench.policies.address import PolicyAddress"],
        ),
        ("from betterbench.records import Record, _Form", ["from betterbench.records import _Form"]),
        ("import betterbench.records.run", ["import betterbench.records.run: import names from it"]),
        ("import betterbench\nbetterbench.api.runs.evaluate('expert')", ["betterbench.api"]),
        ("import betterbench\nbetterbench.evaluate('expert')", []),
        (
            "from betterbench.tasks import authoring as a\na.item('cup'), a.itemize",
            ["betterbench.tasks.authoring.itemize"],
        ),
        ("import numpy as np\nfrom pathlib import Path", []),
    ],
)
def test_the_check_tells_private_names_from_public_ones(code, found):
    assert list(problems(code)) == found


def test_there_are_blocks_to_check():
    assert len(BLOCKS) > 30
    assert {page.name for page, _, _ in BLOCKS} >= {"README.md", "python.md", "own-loop.md", "adding-an-asset.md"}


@pytest.mark.parametrize("module", PUBLIC)
def test_a_documented_module_has_its_names(module):
    if module == NEEDS_TORCH:
        pytest.importorskip("torch")
    found = importlib.import_module(module)
    assert [name for name in PUBLIC[module] if not hasattr(found, name)] == []


def test_every_documented_module_is_in_the_overview():
    index = (ROOT / "docs" / "reference" / "index.md").read_text()
    assert [module for module in PUBLIC if f"`{module}`" not in index] == []
