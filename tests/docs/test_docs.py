"""The documentation is true: its Python runs, its links lead somewhere, its names exist."""

from __future__ import annotations

import os
import re
from pathlib import Path

import pytest
from tests.looping import each
from tests.prepared_process import COMMAND_LINE, OTHERS, prepared

from betterbench.cli.main import VERBS
from betterbench.diagnosis.failure_mode import exposed_labels
from betterbench.policies.experts import expert_names
from betterbench.tasks import TEMPLATES, all_labels, get_task, suite_tasks, threshold_table

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", ROOT / "CHANGELOG.md", *sorted((ROOT / "docs").rglob("*.md"))]


def blocks(page: Path, language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", page.read_text(), flags=re.DOTALL)


SNIPPETS = [
    (page.name, i, code)
    for page in PAGES
    for i, code in enumerate(blocks(page, "python"))
    if not page.name.startswith("adding-a")  # their code is carried out by tests of their own
]


@pytest.mark.parametrize(("page", "number", "code"), SNIPPETS, ids=[f"{p}-{i}" for p, i, _ in SNIPPETS])
def test_snippets_run(page, number, code, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    if "gymnasium.make" in code:  # Gymnasium imports betterbench, which this process has imported before
        done = prepared(*OTHERS).run("-c", code)
        assert done.returncode == 0, done.stderr
        return
    exec(compile(code, f"{page}:{number}", "exec"), {"__name__": "snippet"})  # noqa: S102 - our own documentation


@each("page", PAGES, name=lambda p: p.name)
def test_links_lead_somewhere(page):
    for target in re.findall(r"\]\(([^)#]+?)\)", page.read_text()):
        if not target.startswith("http"):
            assert (page.parent / target).exists(), f"{page.name} links to {target}"


@each("page", PAGES, name=lambda p: p.name)
def test_commands_exist(page):
    for block in blocks(page, "sh"):
        for verb in re.findall(r"^(?:\.venv/bin/)?better ([a-z][\w-]*)", block, flags=re.MULTILINE):
            assert verb in VERBS


def test_every_label_and_zoo_policy_is_explained():
    text = (ROOT / "docs" / "diagnosis.md").read_text()
    for name in [*(label.value for label in all_labels()), *(n for n in expert_names() if n.startswith("zoo:"))]:
        assert f"`{name}`" in text, name


def test_every_variation_has_a_card():
    index = (ROOT / "docs" / "tasks.md").read_text()
    for name in suite_tasks("better60"):
        task = get_task(name)
        assert f"tasks/{name}.md" in index
        text = (ROOT / "docs" / "tasks" / f"{name}.md").read_text()
        for variation in task.variations:
            assert f"pictures/{name}_{variation.name}.jpg" in text
            assert variation.hypothesis in text
            exposed = ", ".join(f"`{label}`" for label in exposed_labels(name, variation.name))
            assert f"- can expose: {exposed or 'no label'}\n" in text
        for condition in task.training:
            assert condition.instruction.text.isascii()
            assert condition.instruction.text in text


def test_every_template_has_its_section():
    text = (ROOT / "docs" / "templates.md").read_text()
    for template in TEMPLATES.values():
        assert f"## {template.title}" in text
        assert all(f"`{group.group_id}`" in text for group in template.groups)


NEW_TASK = """
import sys
sys.path.insert(0, sys.argv[1])
import tea_tray
from betterbench.certification.support import TrainedSupport
from betterbench.episodes import TrialContext, run_episode
from betterbench.policies.experts import make_expert
from betterbench.interface.actions import EE_DELTA
from betterbench.tasks.interventions import vary
from betterbench.sim.scenes import Scene
from betterbench.sim.scenes.stage import FAST
from betterbench.tasks import environment_id, get_task, suite_tasks
from betterbench.tasks.demonstrated import Demonstrated
task = get_task("tea_tray")
assert "tea_tray" not in suite_tasks("better60")
assert environment_id("tea_tray") == "BeTTER/TeaTray-v0"
assert TrainedSupport.of(task, Demonstrated("", "", 1, 0, (), ())).grasped == {"cup", "spoon"}
for seed, condition in enumerate((task.training[0], vary(task, task.variations[0])[0])):
    assert task.template.problems(condition) == ()
    scene = Scene(task, condition, seed=seed, action_space=EE_DELTA, quality=FAST)
    assert run_episode(scene, make_expert("expert", scene), context=TrialContext("expert")).record.outcome.success
import task_pages
assert "cup right, spoon left" in task_pages.task_page(task)
"""


def test_the_task_of_the_contributors_page_works(tmp_path):
    (code,) = blocks(ROOT / "docs" / "adding-a-task.md", "python")
    (tmp_path / "tea_tray.py").write_text(code)
    environment = {**os.environ, "PYTHONPATH": str(ROOT / "tools")}
    done = prepared(*COMMAND_LINE).run("-c", NEW_TASK, str(tmp_path), env=environment)
    assert done.returncode == 0, done.stderr


def test_every_threshold_states_its_reason():
    for entry in threshold_table():
        assert len(entry.reason) > 20, entry.name
        assert entry.reason.endswith("."), entry.name
        assert entry.unit in ("m", "s", "rad", "m/s", "rad/s", "N", "1", "%"), entry.name


def test_the_calibration_page_has_the_remarks_of_its_generator(monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT / "tools"))
    import calibration_page

    page = (ROOT / "docs" / "calibration.md").read_text()
    for family, remark in calibration_page.REMARKS.items():
        missing = [line for line in remark.splitlines() if line not in page.splitlines()]
        assert remark in page, (
            f"write the remark on {family!r} into docs/calibration.md too; lines that differ: {missing}"
        )
