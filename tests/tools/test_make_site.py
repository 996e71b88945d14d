"""The check of the site finds what leads nowhere, what is loaded from elsewhere, and what the reference leaves out."""

from __future__ import annotations

import importlib
import re
from pathlib import Path

import pytest

TOOLS = Path(__file__).resolve().parents[2] / "tools"


@pytest.fixture
def tool(monkeypatch):
    monkeypatch.syspath_prepend(TOOLS)
    return importlib.import_module("make_site")


@pytest.mark.parametrize(
    ("body", "problem"),
    [
        ('<a href="b.html">b</a><a href="b.html#here">b</a><a href="#top" id="top">t</a><img src="p.png">', None),
        ('<a href="https://example.org/x">far</a><a href="mailto:a@b">m</a>', None),
        ('<a href="c.html">c</a>', "links to c.html, which does not exist"),
        ('<a href="b.html#there">b</a>', "links to b.html#there, which has no such anchor"),
        ('<a href="#nowhere">n</a>', "links to #nowhere, which has no such anchor"),
        ('<img src="q.png">', "links to q.png, which does not exist"),
        ('<script src="https://example.org/x.js"></script>', "loads https://example.org/x.js"),
        ('<link rel="stylesheet" href="//example.org/x.css">', "loads //example.org/x.css"),
    ],
)
def test_every_link_is_followed(tool, tmp_path, body, problem):
    (tmp_path / "a.html").write_text(f"<html><body>{body}</body></html>")
    (tmp_path / "b.html").write_text('<h2 id="here">b</h2>')
    (tmp_path / "p.png").write_bytes(b"")
    found = list(tool.link_problems(tmp_path, tool.read_pages(tmp_path)))
    assert found == ([] if problem is None else [f"a.html: {problem}"])


def test_public_names_are_those_of_all_or_the_ones_without_an_underscore(tool, tmp_path):
    (tmp_path / "package").mkdir()
    (tmp_path / "package" / "__init__.py").write_text('from x import A, b\n__all__ = ["A", "b"]\n')
    (tmp_path / "module.py").write_text("class C: ...\ndef d(): ...\ndef _e(): ...\nF = 1\n")
    assert tool.public_names(tmp_path / "package" / "__init__.py") == {"A", "b"}
    assert tool.public_names(tmp_path / "module.py") == {"C", "d"}


def test_modules_of_every_distribution_are_found(tool):
    for name in ("betterbench", "betterbench.tasks", "betterbench.geometry", "betterbench_calibration.audit"):
        assert tool.module_file(name).exists()
    assert not tool.module_file("betterbench.comparison.compare.compare").exists()


def test_a_name_that_the_reference_leaves_out_is_found(tool, tmp_path):
    folder = tmp_path / "reference"
    folder.mkdir()
    for page in (TOOLS.parent / "docs" / "reference").glob("*.md"):
        modules = re.findall(r"^::: (\S+)$", page.read_text(), re.MULTILINE)
        files = {name: tool.module_file(name) for name in modules}
        names = [f"{m}.{name}" for m, file in files.items() if file.exists() for name in tool.public_names(file)]
        names += [name for name, file in files.items() if not file.exists()]
        ids = (f'<h2 id="{name}"></h2>' for name in names if name != "betterbench.interface.PolicyInfo")
        (folder / f"{page.stem}.html").write_text("".join(ids))
    (problem,) = tool.name_problems(tmp_path, tool.read_pages(tmp_path))
    assert "betterbench.interface.PolicyInfo" in problem


def test_a_page_that_is_opened_from_the_disk_has_the_index_of_the_search_as_a_script(tool, tmp_path):
    (tmp_path / "search").mkdir()
    index = '{"docs": [{"title": "Shortcuts"}]}'
    (tmp_path / "search" / "search_index.json").write_text(index)
    tool.write_index_script(tmp_path)
    assert (tmp_path / "search" / "search_index.js").read_text() == f"var __index = {index}"
    assert "site/disk-search.js" in (tool.ROOT / "mkdocs.yml").read_text()
