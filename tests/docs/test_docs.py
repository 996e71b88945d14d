"""The documentation is true: its Python runs, its links lead somewhere, its names exist."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from betterbench.cli.main import VERBS
from betterbench.diagnosis import Label
from betterbench.experts import expert_names
from betterbench.tasks import Thresholds, all_tasks

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", ROOT / "CHANGELOG.md", *sorted((ROOT / "docs").glob("*.md"))]


def blocks(page: Path, language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", page.read_text(), flags=re.DOTALL)


SNIPPETS = [(page.name, i, code) for page in PAGES for i, code in enumerate(blocks(page, "python"))]


@pytest.mark.parametrize(("page", "number", "code"), SNIPPETS, ids=[f"{p}-{i}" for p, i, _ in SNIPPETS])
def test_snippets_run(page, number, code, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    exec(compile(code, f"{page}:{number}", "exec"), {"__name__": "snippet"})  # noqa: S102 - our own documentation


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.name)
def test_links_lead_somewhere(page):
    for target in re.findall(r"\]\(([^)#]+?)\)", page.read_text()):
        if not target.startswith("http"):
            assert (page.parent / target).exists(), f"{page.name} links to {target}"


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.name)
def test_commands_exist(page):
    for block in blocks(page, "sh"):
        for verb in re.findall(r"^(?:\.venv/bin/)?better (\w+)", block, flags=re.MULTILINE):
            assert verb in VERBS


def test_every_label_and_zoo_policy_is_explained():
    text = (ROOT / "docs" / "diagnosis.md").read_text()
    for name in [*(label.value for label in Label), *(n for n in expert_names() if n.startswith("zoo:"))]:
        assert f"`{name}`" in text, name


def test_every_variation_has_a_card():
    text = (ROOT / "docs" / "tasks.md").read_text()
    for task in all_tasks():
        for variation in task.variations:
            assert f"pictures/{task.id}_{variation.name}.jpg" in text
            assert variation.hypothesis in text
        for condition in task.training:
            assert condition.instruction.text.isascii()


def test_every_threshold_states_its_reason():
    for name in Thresholds.names():
        assert re.search(rf"^\s+{name}: .{{20,}}", Thresholds.__doc__ or "", flags=re.MULTILINE), name
