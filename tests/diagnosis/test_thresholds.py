"""Thresholds stand in one place, each with its unit, its reason and what moves if it moves."""

from __future__ import annotations

import ast
import functools
import importlib
import re
from pathlib import Path

from tests.looping import each

from betterbench.diagnosis import diagnose_records, thresholds
from betterbench.tasks import THRESHOLDS, all_labels, threshold_table

ROOT = Path(__file__).parents[2]
PACKAGE = Path(thresholds.__file__).parent
MODULES = sorted(str(path.relative_to(PACKAGE)) for path in PACKAGE.rglob("*.py") if path.name != "thresholds.py")

NO_THRESHOLDS = {
    "changes.py": {"_SAME_TIME"},  # rounding of a stored time
    "findings.py": {"_SHOWN"},  # trials that a note names
    "bindings.py": {"_SHOWN"},  # words that a sentence names
    "instruction_effect.py": {"_PLACE_DIGITS"},  # rounding of poses that are equal by construction
    "rule_likelihood.py": {"ROUNDING", "_GRID_POINTS"},  # of a numerical method, as are the next two
    "task_rules.py": {"_DECIMALS"},
    "second_pass.py": {"_PSEUDOCOUNT", "_EM_STEPS"},
    "stored.py": {"STORED_SCHEMA_VERSION", "_MAX_BYTES"},
}
"""Numeric constants of a module that decide no label, or belong to a method and not to what is measured."""

UNLISTED = {
    "tremble": 0.001,
    "passing_at_end": 0.25,
    "straight": 0.8,
    "flicker_time": 0.25,
    "push_share": 0.5,
    "begins_to_move": 0.002,
    "risen_again": 0.03,
    "least_region": 0.02,
    "search_step": 0.5,
    "rests_on_gap": 0.01,
    "highest_strength": 0.99,
    "lowest_error_rate": 0.001,
    "highest_error_rate": 0.99,
    "order_trials": 3,
    "other_tasks": 2,
    "one_attempt": 3.0,
    "clearly_better": 2.0,
    "instruction_pairs": 10,
    "instruction_used": 0.5,
    "instruction_level": 0.025,
    "favorite_asked": 3,
    "nearly_all": 0.9,
    "share_of_all": 0.8,
    # Trials of a real arm.
    "jaw_moves": 5.0,
    "jaw_rests": 1.5,
    "jaw_gap": 4.0,
    "jaw_load": 0.1,
    "jaw_shut": 15.0,
    "jaw_fully_shut": 4.0,
    "held_share": 0.5,
}
"""Values that no stored diagnosis lists: they decided before they had an entry, or decide only trials of a real arm."""


@functools.cache
def tree_of(module: str) -> ast.Module:
    return ast.parse((PACKAGE / module).read_text())


def numbers(node: ast.AST) -> set[float]:
    """Return the numeric literals of an expression, other than indices and whole numbers up to 2."""
    indices = {n for sub in ast.walk(node) if isinstance(sub, ast.Subscript) for n in ast.walk(sub.slice)}
    found = (n.value for n in ast.walk(node) if isinstance(n, ast.Constant) and n not in indices)
    return {value for value in found if type(value) in (int, float)} - {0, 1, 2}


def constants(tree: ast.Module) -> set[str]:
    """Return the names that a module gives to numbers, or to what is computed from numbers alone."""
    found = set()
    for node in tree.body:
        if isinstance(node, ast.Assign | ast.AnnAssign) and node.value is not None:
            target = node.targets[0] if isinstance(node, ast.Assign) else node.target
            literal = all(
                isinstance(n, ast.Constant | ast.BinOp | ast.UnaryOp | ast.operator | ast.unaryop)
                for n in ast.walk(node.value)
            )
            values = [n.value for n in ast.walk(node.value) if isinstance(n, ast.Constant)]
            if literal and isinstance(target, ast.Name) and all(type(v) in (int, float) for v in values):
                found.add(target.id)
    return found


@each("module", MODULES)
def test_no_module_of_the_diagnosis_has_a_threshold_of_its_own(module):
    calls = [n for n in ast.walk(tree_of(module)) if isinstance(n, ast.Call) and isinstance(n.func, ast.Name)]
    entered = [call.args[0].value for call in calls if call.func.id == "threshold"]
    assert not entered, f"{module} enters {entered}: enter it in diagnosis/thresholds.py and import it"
    extra = constants(tree_of(module)) - NO_THRESHOLDS.get(module, set())
    assert not extra, f"{module} has the numbers {sorted(extra)}: enter them in diagnosis/thresholds.py"


@each("module", MODULES)
def test_nothing_is_compared_with_a_number_that_has_no_name(module):
    """A number in a comparison, or a time in seconds that is turned into steps, is a threshold."""
    for node in ast.walk(tree_of(module)):
        decides = isinstance(node, ast.Compare) and isinstance(node.ops[0], ast.Lt | ast.LtE | ast.Gt | ast.GtE)
        span = isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.func.attr == "steps"
        if decides or span:
            assert not numbers(node), f"{module}:{node.lineno} has {numbers(node)}: give it a name in thresholds.py"


def test_exceptions_are_still_there():
    for module, names in NO_THRESHOLDS.items():
        assert names <= constants(tree_of(module)), f"{module}: remove what is gone from NO_THRESHOLDS"


@each("entry", threshold_table(), name=lambda entry: entry.name)
def test_every_threshold_says_what_moves_if_it_moves(entry):
    match = re.fullmatch(r"Larger: [^.]+\.", entry.effect)
    assert match, f"{entry.name}: say what a larger value changes, in one sentence that begins with 'Larger: '"
    words = set(re.findall(r"\w+", entry.effect))
    labels = {label.value for label in all_labels()}
    assert words & labels or "no label changes" in entry.effect, f"{entry.name}: name the labels"
    unknown = {word for word in words if "_" in word} - labels - set(THRESHOLDS.names())
    assert not unknown, f"{entry.name}: {unknown} is no label"


def test_the_page_of_thresholds_is_the_table(monkeypatch):
    monkeypatch.syspath_prepend(ROOT / "tools")
    page = importlib.import_module("threshold_page").page()
    assert (ROOT / "docs" / "thresholds.md").read_text() == page, "run tools/threshold_page.py"
    shown = re.findall(r"^\| `(\w+)`", page, flags=re.MULTILINE)
    assert sorted(shown) == sorted(THRESHOLDS.names())


def test_values_that_no_stored_diagnosis_lists_stay_as_they_are(stage):
    """A stored diagnosis cannot tell that such a value changed: list it when it does."""
    table = {entry.name: entry.value for entry in threshold_table() if not entry.listed}
    assert table == UNLISTED
    listed = diagnose_records([stage("fast_food", "train1").wait(1).end()]).thresholds
    assert listed == THRESHOLDS.to_json()
    assert not UNLISTED.keys() & listed.keys()
    assert UNLISTED.keys() <= set(THRESHOLDS.names())
