"""What is registered: every label has its mode, the documents say the same, and nothing is registered in vain."""

from __future__ import annotations

import ast
import functools
import importlib
import re
import runpy
from pathlib import Path

import pytest

from betterbench.diagnosis.failure_mode import FailureMode, remove_mode
from betterbench.diagnosis.modes import MODES
from betterbench.diagnosis.verdict import Evidence
from betterbench.errors import InvalidInputError, UnknownNameError
from betterbench.tasks import THRESHOLDS, Kind, Label, all_labels, new_label, remove_label, threshold
from betterbench.tasks.user_files import VARIABLE, load_task_files

ROOT = Path(__file__).parents[2]


@functools.cache
def texts() -> dict[Path, str]:
    """Return the texts of the files of the package."""
    return {path: path.read_text() for path in sorted((ROOT / "src").rglob("*.py"))}


def test_every_label_has_a_mode_with_words_for_it():
    assert tuple(MODES) == all_labels()
    for mode in MODES.values():
        assert mode.definition.endswith("."), mode.label
        assert mode.name, mode.label
        assert mode.short, mode.label
        assert bool(mode.conclusion) == (mode.label.kind is not Kind.NONE), mode.label


def test_the_table_of_the_documents_is_the_registry():
    text = (ROOT / "docs" / "diagnosis.md").read_text()
    table = text[text.index("| label |") : text.index("\n\n", text.index("| label |"))]
    rows = [tuple(cell.strip() for cell in line.strip("|").split("|")) for line in table.splitlines()[2:]]
    kinds = {Kind.NONE: "right"}
    expected = [(f"`{m.label}`", kinds.get(m.label.kind, m.label.kind.value), m.definition) for m in MODES.values()]
    assert rows == expected


def test_a_name_is_registered_once_and_unknown_names_are_refused():
    with pytest.raises(InvalidInputError, match="early_halt"):
        new_label("early_halt", Kind.REASONING)
    with pytest.raises(InvalidInputError, match="early_halt"):
        FailureMode(Label.EARLY_HALT, "halt", "It stops.")(lambda _: None)
    with pytest.raises(InvalidInputError, match=r"thresholds\.py, .*test_registry\.py, .*threshold 'halt_time'"):
        threshold("halt_time", 2.0, "s", "Again.")
    with pytest.raises(UnknownNameError, match="Did you mean 'early_halt'"):
        Label("early_hlat")


FINDER = """from betterbench.diagnosis.authoring import *

@FailureMode(new_label("limp", Kind.REASONING), short="limp", definition="It limps.", conclusion="It limps.")
def find(trial):
    return trial
"""


@pytest.mark.parametrize("how", ["in the package", "own file"])
@pytest.mark.parametrize("found", [True, "It limps.", [Evidence("limp", "It limps.", 0.0, 1.0)]])
def test_a_finder_that_returns_no_evidence_is_named(tmp_path, monkeypatch, how, found):
    file = tmp_path / "limp.py"
    file.write_text(FINDER)
    if how == "own file":
        monkeypatch.setenv(VARIABLE, "")
        for name in ("_files", "_origins", "_makers"):
            monkeypatch.setattr(f"betterbench.tasks.user_files.{name}", {})
        load_task_files([file])
    else:
        runpy.run_path(str(file), run_name="betterbench.diagnosis.modes.limp")
    label = Label("limp")
    try:
        find = MODES[label].find
    finally:
        remove_mode(label)
        remove_label(label)
    right = Evidence("limp", "It limps.", 0.0, 1.0)
    assert find(right) is right
    assert find(None) is None
    with pytest.raises(InvalidInputError) as caught:
        find(found)
    assert re.match(
        rf"{re.escape(str(file))}, line 3: the finder of limp returned \S.*, not Evidence", str(caught.value)
    )
    assert str(caught.value).endswith("or None. Return trial.episode.evidence(rule, text, ...), or None.")


def entered(tree: ast.Module) -> dict[str, str]:
    """Return which constant a file makes of each threshold that it enters."""
    found = {}
    for node in ast.walk(tree):
        if isinstance(node, ast.Assign) and isinstance(node.value, ast.Call) and isinstance(node.targets[0], ast.Name):
            called = node.value.func
            if isinstance(called, ast.Name) and called.id == "threshold":
                found[node.value.args[0].value] = node.targets[0].id
    return found


def test_every_threshold_is_read_somewhere():
    """A threshold is read as ``THRESHOLDS.name``, or as the constant of the file that enters it, there or imported."""
    importlib.import_module("betterbench.diagnosis.measures.power_matrix")  # it enters thresholds of its own
    entering = {path: ast.parse(text) for path, text in texts().items() if re.search(r"\bthreshold\(", text)}
    constants = {name: (constant, path) for path, tree in entering.items() for name, constant in entered(tree).items()}
    threshold_of = {constant: name for name, (constant, _) in constants.items()}
    mention = re.compile(rf"\bTHRESHOLDS\.(\w+)|\b({'|'.join(threshold_of)})\b")
    read = set()
    for path, text in texts().items():
        if {of_table or threshold_of[constant] for of_table, constant in mention.findall(text)} <= read:
            continue  # it is not parsed for thresholds that other files read
        nodes = list(ast.walk(ast.parse(text)))
        loaded = {node.id for node in nodes if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Load)}
        imported = {alias.name for node in nodes if isinstance(node, ast.ImportFrom) for alias in node.names}
        read |= {c for c, (name, home) in constants.items() if name in loaded and (path == home or name in imported)}
        for node in nodes:
            if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "THRESHOLDS":
                read.add(node.attr)
    assert set(constants) == set(THRESHOLDS.names())
    assert set(THRESHOLDS.names()) <= read
    for name in vars(type(THRESHOLDS)).keys() - {"names", "to_json"}:
        assert name.startswith("_") or getattr(THRESHOLDS, name) == THRESHOLDS.to_json()[name]


@pytest.mark.parametrize("package", ["diagnosis", "calibration", "comparison"])
def test_labels_are_values_and_no_texts(package):
    """``success`` is also a measure, ``policy_error`` also how an episode ends, and the others also plain words."""
    names = {label.value for label in all_labels()} - {"success", "policy_error", "timeout", "unfinished"}
    for path in sorted((ROOT / "src" / "betterbench" / package).rglob("*.py")):
        nodes = list(ast.walk(ast.parse(path.read_text())))
        calls = [node for node in nodes if isinstance(node, ast.Call) and isinstance(node.func, ast.Name)]
        made = [call.args[0] for call in calls if call.func.id == "new_label"]  # where a mode makes its own label
        typed = [node for node in nodes if isinstance(node, ast.Constant) and node not in made]
        found = [
            f"{path.relative_to(ROOT)}, line {n.lineno}: {n.value!r}"
            for n in typed
            if isinstance(n.value, str) and n.value in names
        ]
        cure = "Use Label.NAME, or the constant of new_label(...); as `short`, use another word than the label"
        assert not found, f"{found[0]} repeats the name of a label. {cure}"
