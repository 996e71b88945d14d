"""What the project says about itself: the paper it follows, how to cite it, and what it does not have yet."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
import yaml

import betterbench
from betterbench.cli.main import VERBS

ROOT = Path(__file__).parents[2]
TITLE = "Unmasking the Illusion of Embodied Reasoning in Vision-Language-Action Models"
AUTHORS = ["Haiweng Xu", "Sipeng Zheng", "Hao Luo", "Wanpeng Zhang", "Ziheng Xi", "Zongqing Lu"]
PAPER = "https://arxiv.org/abs/2604.18000"


def text_of(name):
    return (ROOT / name).read_text()


@pytest.fixture(scope="module")
def citation():
    return yaml.safe_load(text_of("CITATION.cff"))


@pytest.mark.parametrize("page", ["README.md", "docs/index.md", "docs/fidelity.md"])
def test_pages_name_the_paper_and_lead_to_it(page):
    assert TITLE in " ".join(text_of(page).split())
    assert PAPER in text_of(page)


def test_no_file_calls_the_paper_otherwise():
    pages = [*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md"), *ROOT.glob("src/**/*.py"), *ROOT.glob("src/**/*.j*")]
    assert [p.name for p in pages if "BeTTER: Testing True" in p.read_text()] == []


def test_the_citation_file_has_what_its_format_asks_for(citation):
    assert {"cff-version", "message", "title", "authors"} <= set(citation)
    assert citation["version"] == betterbench.__version__
    assert citation["license"] == "Apache-2.0"
    paper = citation["preferred-citation"]
    assert paper["title"] == TITLE
    assert [f"{a['given-names']} {a['family-names']}" for a in paper["authors"]] == AUTHORS
    assert paper["url"] == PAPER
    assert (paper["year"], paper["month"]) == (2026, 4)


def test_the_bibtex_entry_says_the_same(citation):
    (entry,) = re.findall(r"```bibtex\n(.*?)```", text_of("README.md"), flags=re.DOTALL)
    fields = dict(re.findall(r"^ *(\w+) *= *\{(.*)\},?$", entry, flags=re.MULTILINE))
    assert fields["title"].replace("{", "").replace("}", "") == TITLE
    names = [" ".join(reversed(name.split(", "))) for name in fields["author"].split(" and ")]
    assert names == AUTHORS
    assert fields["year"] == str(citation["preferred-citation"]["year"])
    assert PAPER.endswith(fields["eprint"])


def test_what_the_fidelity_page_calls_missing_is_missing():
    section = text_of("docs/fidelity.md").partition("## Other parts of the paper")[2].partition("\n## ")[0]
    rows = [line for line in section.splitlines() if line.startswith("| ")][1:]
    for word in ("retrieval", "instantiation", "VQA", "real arm", "demonstrations", "CALVIN"):
        assert any(word in row for row in rows), word
    planned = re.findall(r"`better ([\w-]+)`", section)
    assert not set(planned) & set(VERBS)
