"""What is registered: every label has its mode, the documents say the same, and nothing is registered in vain."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

from betterbench.diagnosis.failure_mode import FailureMode
from betterbench.diagnosis.modes import MODES
from betterbench.errors import InvalidInputError, UnknownNameError
from betterbench.tasks import THRESHOLDS, Kind, Label, all_labels, new_label, threshold

ROOT = Path(__file__).parents[2]
SOURCES = {path: ast.parse(path.read_text()) for path in sorted((ROOT / "src").rglob("*.py"))}


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
    with pytest.raises(ValueError, match="halt_time"):
        threshold("halt_time", 2.0, "s", "Again.")
    with pytest.raises(UnknownNameError, match="Did you mean 'early_halt'"):
        Label("early_hlat")


def test_every_threshold_is_read_somewhere():
    """A threshold is read as ``THRESHOLDS.name``, or as the constant that the file which enters it makes of it."""
    constants, read = {}, set()
    for tree in SOURCES.values():
        for node in ast.walk(tree):
            if isinstance(node, ast.Assign) and isinstance(node.value, ast.Call):
                called = node.value.func
                if isinstance(called, ast.Name) and called.id == "threshold" and isinstance(node.targets[0], ast.Name):
                    constants[node.value.args[0].value] = node.targets[0].id
    for path, tree in SOURCES.items():
        for node in ast.walk(tree):
            if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "THRESHOLDS":
                read.add(node.attr)
            elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Load) and path.name != "thresholds.py":
                read |= {name for name, constant in constants.items() if constant == node.id}
    assert set(constants) == set(THRESHOLDS.names())
    assert set(THRESHOLDS.names()) <= read
    for name in vars(type(THRESHOLDS)).keys() - {"names", "to_json"}:
        assert name.startswith("_") or getattr(THRESHOLDS, name) == THRESHOLDS.to_json()[name]


@pytest.mark.parametrize("package", ["diagnosis", "calibration", "comparison"])
def test_labels_are_values_and_no_texts(package):
    """``success`` is also a measure, ``policy_error`` also how an episode ends, and ``timeout`` also a plain word."""
    names = {label.value for label in all_labels()} - {"success", "policy_error", "timeout"}
    for path, tree in SOURCES.items():
        if re.search(rf"/betterbench/{package}/", str(path)):
            typed = {node.value for node in ast.walk(tree) if isinstance(node, ast.Constant)}
            assert not names & {text for text in typed if isinstance(text, str)}, path
