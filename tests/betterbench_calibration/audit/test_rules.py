"""The rules on their own: misprints are noticed or counted as unnoticed, and bad files are refused in one line."""

from __future__ import annotations

import functools
import itertools
import json
from decimal import Decimal
from fractions import Fraction

import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.looping import each

from betterbench.errors import BetterError
from betterbench.statistics import round_half_up
from betterbench_calibration.audit import Verdict, audit_source, audit_table, load_tables, paper_tables, read_source
from betterbench_calibration.audit.chance import Chance
from betterbench_calibration.audit.claims import Composition, Differences
from betterbench_calibration.audit.counts import count_behind
from betterbench_calibration.audit.pooled import Pooled, Sizes, _explain
from betterbench_calibration.audit.table import misprints

TABLES = {table.name: (table, rules) for table, rules in paper_tables().tables}
PAPER = paper_tables().by_name


@given(n=st.integers(1, 3000), k=st.integers(0, 3000), digits=st.integers(0, 3))
def test_the_count_behind_a_percentage_is_found(n, k, digits):
    k = min(k, n)
    printed = round_half_up(Fraction(100 * k, n), digits)
    found = count_behind(printed, n)
    assert found is not None
    assert round_half_up(Fraction(100 * found.k, n), digits) == printed


@given(n=st.integers(1, 60), units=st.integers(0, 1000))
def test_a_count_is_found_only_where_there_is_one(n, units):
    printed = Decimal(units).scaleb(-1)
    by_hand = [k for k in range(n + 1) if round_half_up(Fraction(100 * k, n), 1) == printed]
    found = count_behind(printed, n)
    assert (found is not None) == bool(by_hand)
    assert found is None or found.k in by_hand


def arithmetic(name):
    table, rules = TABLES[name]
    return table, [r for r in rules if not isinstance(r, Composition | Differences)]


def flaws(table, rules):
    return {(f.rule, f.row, f.cell, f.verdict) for f in audit_table(table, rules, PAPER).findings if flagged(f)}


def flagged(finding):
    return finding.verdict in (Verdict.BROKEN, Verdict.UNKNOWN)


@functools.cache
def misprint_results(name, every=37):
    """Returns for wrong digits of every number that holds whether they are flagged, and whether a miss was foretold.

    Of a large table only every so many-th misprint is tried: all digits of all places take their turn.
    """
    table, rules = arithmetic(name)
    audit = audit_table(table, rules, PAPER)
    before = {(f.rule, f.row, f.cell, f.verdict) for f in audit.findings if flagged(f)}
    results = []
    small, turn = len(table.rows) * len(table.columns) < 40, itertools.count()
    for (row, column), number in table.printed():
        covering = [f for f in audit.findings if (row, column) in f.covers]
        if any(flagged(f) for f in covering):
            continue
        for wrong in [w for w in misprints(number) if small or next(turn) % every == 0]:
            after = flaws(table.with_cell(row, column, wrong), rules)
            results.append((row, column, wrong, bool(after - before), all(f.unnoticed > 0 for f in covering)))
    return results


MORE = pytest.param(11, marks=pytest.mark.slow)
"""Of the large tables the slow tests try every eleventh misprint."""


@pytest.mark.parametrize("every", [37, MORE])
def test_one_wrong_digit_is_flagged_or_foretold_as_unnoticed(every):
    for name in sorted(set(TABLES) - {"mixture_weights", "vla_data"}):
        results = misprint_results(name, every)
        assert results, name
        assert [r for r in results if not r[3] and not r[4]] == [], name


@pytest.mark.parametrize("name", ["composition_case", "vlm_data", "task_taxonomy", "real_robot", "running_text"])
def test_where_numbers_determine_each_other_every_wrong_digit_is_flagged(name):
    lone = ("π0.5 rejects the red block", "Total")
    missed = [r for r in misprint_results(name) if not r[3] and r[0] not in lone]
    assert missed == []


@pytest.mark.parametrize("every", [37, MORE])
def test_most_wrong_digits_of_the_large_tables_are_flagged(every):
    for name, least in (("static_bottleneck", 0.9), ("combined_results", 0.95)):
        results = misprint_results(name, every)
        noticed = sum(r[3] for r in results)
        assert noticed >= least * len(results), f"{name}: {noticed}/{len(results)}"


def test_unnoticed_misprints_are_counted_right():
    table, rules = arithmetic("coffee_case")
    for f in audit_table(table, rules).findings:
        if f.rule == "grid":
            passed = [w for w in misprints(Decimal(f.printed)) if w % 5 == 0 and 0 <= w <= 100]
            assert (f.unnoticed, f.misprints) == (len(passed), len(list(misprints(Decimal(f.printed)))))


def test_misprints_are_counted_by_the_printed_digits():
    """40.6 and 40.60 are equal, but 40.60 has a digit more."""
    rules = [{"rule": "falling", "columns": ["a", "b", "all"]}]
    rows = {"x": "[50.0, 40.6, 30.0]", "y": "[50.00, 40.60, 30.00]"}
    text = source(rules, {"x": [1], "y": [2]}).replace("[1]", rows["x"]).replace("[2]", rows["y"])
    first, second = audit_source(read_source(text, "test")).findings
    assert second.misprints > first.misprints


def source(rules, rows=None, columns=("a", "b", "all")):
    rows = rows or {"x": [10, 20, 15], "y": [30, 40, 35]}
    tables = [{"name": "t", "title": "a table", "columns": list(columns), "rows": rows, "rules": rules}]
    return json.dumps({"source": "a test", "tables": tables})


def verdicts(text):
    return [f.verdict for f in audit_source(read_source(text, "test")).findings]


def test_printed_digits_are_kept():
    text = source([], {"x": [1, 2, 3]}).replace("[1, 2, 3]", "[40.60, 2, 3]")
    [(table, _)] = read_source(text, "test").tables
    assert str(table.cell("x", "a")) == "40.60"


def test_a_mean_of_rounded_parts_may_be_off_by_a_little():
    rows = {"x": [10.01, 10.02, 10.01]}
    strict = {"rule": "mean", "target": "all", "parts": ["a", "b"]}
    assert verdicts(source([strict], rows)) == [Verdict.BROKEN]
    assert verdicts(source([strict | {"rounded_parts": True}], rows)) == [Verdict.UNKNOWN]
    far = {"x": [10.01, 10.02, 10.04]}
    assert verdicts(source([strict | {"rounded_parts": True}], far)) == [Verdict.BROKEN]


def test_a_number_that_no_rule_reads_is_named():
    found = audit_source(read_source(source([]), "test")).findings
    assert [f.rule for f in found] == ["unread"] * 6
    assert {f.verdict for f in found} == {Verdict.UNKNOWN}


def test_rates_that_rise_are_flagged():
    assert verdicts(source([{"rule": "falling", "columns": ["a", "b"]}])).count(Verdict.BROKEN) == 2


def test_rates_that_stay_equal_are_not_flagged():
    found = audit_source(read_source(source([{"rule": "falling", "columns": ["a", "b"]}], {"x": [5, 5, 5]}), "test"))
    assert [f.verdict for f in found.findings if f.rule == "falling"] == [Verdict.HOLDS]


def test_a_total_that_was_cut_off_is_told_from_a_wrong_one():
    rule = {"rule": "total", "row": "sum", "column": "n", "unit": 1000}
    for printed, says in ((3.9, "truncated"), (3.8, "not 3.8")):
        text = source([rule], {"x": [1500], "y": [2460], "sum": [printed]}, columns=("n",))
        [finding] = audit_source(read_source(text, "test")).findings[:1]
        assert finding.verdict is Verdict.BROKEN
        assert says in finding.why


def test_sizes_that_nothing_reproduces_stay_open():
    rows = {"x": [0.01, 99.99, 50.01], "y": [77.77, 13.13, 0.01], "z": [5.55, 4.44, 99.99]}
    found = audit_source(read_source(source([{"rule": "pooled", "target": "all", "parts": ["a", "b"]}], rows), "test"))
    assert {f.verdict for f in found.findings} == {Verdict.UNKNOWN}


def test_many_parts_end_soon():
    columns = [f"p{i}" for i in range(30)]
    rows = {"x": [50] * 31, "y": [25] * 31}
    rule = {"rule": "pooled", "target": "all", "parts": columns}
    assert verdicts(source([rule], rows, columns=(*columns, "all")))


def test_many_trials_take_the_quick_test():
    rule = {"rule": "composition", "novel": "a", "seen": ["b"], "trials": 1_000_000}
    found = audit_source(read_source(source([rule]), "test")).findings
    tests = {f.support.test for f in found if f.support is not None}
    assert tests == {"Fisher's exact test"}


def test_a_wrong_guess_is_flagged():
    rule = {"rule": "chance", "guess": "x", "choices": 3, "trials": 10, "rows": ["y"]}
    found = audit_source(read_source(source([rule]), "test")).findings
    assert all(f.verdict is Verdict.BROKEN for f in found if f.row == "x" and f.rule == "chance")


def test_holm_is_taken_over_the_family():
    table, rules = TABLES["coffee_case"]
    [rule] = [r for r in rules if isinstance(r, Chance)]
    found = [f.support for f in rule.findings(table, PAPER) if f.support]
    smallest = min(found, key=lambda s: s.p_value)
    assert smallest.p_holm == pytest.approx(len(found) * smallest.p_value)


@each(
    "text, says",
    [
        ("", "is not JSON"),
        ("[" * 100_000, "is not JSON"),
        ("[]", "is not a JSON object"),
        ("{}", "source"),
        ('{"source": "s", "tables": []}', "tables: Tuple should have at least 1 item"),
        ('{"source": "s", "tables": [], "tables": []}', "twice"),
        ('{"source": "s", "tables": [3]}', "tables[0]"),
        (source([{"rule": "grids"}]), "grid"),
        (source([{"rule": "grid"}]), "trials"),
        (source([{"rule": "grid", "trials": 0}]), "trials"),
        (source([{"rule": "grid", "trials": 2.5}]), "trials"),
        (source([{"rule": "grid", "trials": 10**9}]), "trials"),
        (source([{"rule": "grid", "trials": "20"}]), "trials"),
        (source([], {str(i): [1, 2, 3] for i in range(201)}), "rows"),
        (source([{"rule": "grid", "trials": True}]), "trials"),
        (source([{"rule": "grid", "trials": 20, "row": ["x"]}]), "row"),
        (source([{"rule": "grid", "trials": 20, "rows": ["z"]}]), "'z'"),
        (source([{"rule": "grid", "trials": 20, "rows": ["z" * 100_000]}]), "… ("),
        (source([{"rule": "grid", "trials": 20, "rows": ["z\n"]}]), "'z'"),
        (source([{"rule": "mean", "target": "all", "parts": []}]), "parts"),
        (source([{"rule": "mean", "target": "all", "parts": ["a"], "rounded_parts": "yes"}]), "rounded_parts"),
        (source([{"rule": "chance", "choices": 1, "trials": 5}]), "choices"),
        (source([{"rule": "differences", "claims": []}]), "claims"),
        (source([], {"x": [1, 2]}), "3 numbers"),
        (source([], {"x": [1, 2, "3"]}), "tables[0].rows.x[2]"),
        (source([], {"x": [1, 2, 1e30]}), "tables[0].rows.x[2]"),
        (source([], {"x": [1, 2, "3" * 100_000]}), "tables[0].rows.x[2]"),
        (source([], {"x": [1, 2, 3]}).replace("3]", "NaN]"), "NaN"),
        (source([], {"x": [1, 2, 3]}).replace("3]", "3e2]"), "tables[0].rows.x[2]"),
        (source([], {"x": [1, 2, 3]}).replace("3]", "1e999999999]"), "tables[0].rows.x[2]"),
        (source([], columns=("a", "a", "b")), "twice"),
    ],
)
def test_bad_files_are_one_clear_error(tmp_path, text, says):
    path = tmp_path / "tables.json"
    path.write_text(text)
    with pytest.raises(BetterError) as caught:
        load_tables(path)
    assert says in str(caught.value)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 1000


def test_a_quotation_of_an_unknown_table_is_refused():
    rule = {"rule": "quoted", "row": "x", "column": "a", "table": "u", "at_row": "x", "at_column": "a"}
    with pytest.raises(BetterError, match="Unknown table 'u'"):
        verdicts(source([rule]))


@pytest.mark.parametrize("content", [b"\xff\xfe\x00", None])
def test_files_that_cannot_be_read(tmp_path, content):
    path = tmp_path / "tables.json"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(BetterError, match=r"tables\.json"):
        load_tables(path)


def test_a_misprint_is_only_claimed_where_one_digit_mends_the_row():
    table, rules = TABLES["static_bottleneck"]
    [rule] = [r for r in rules if isinstance(r, Pooled)]
    other = table.with_cell("Claude-Sonnet-4", "EgoPlan2 Work", Decimal("39.87"))
    [finding] = [f for f in rule.findings(other, PAPER) if f.row == "Claude-Sonnet-4"]
    assert finding.verdict is Verdict.BROKEN
    assert "likely a misprint" not in finding.why


def test_many_misfits_end_soon():
    parts = tuple(Decimal("33.33") for _ in range(12))
    _, why = _explain((parts, Decimal("33.33")), Sizes((100,) * 12, 1, 1), list(range(12)))
    assert why.startswith("Neither")


def test_the_fewest_missing_questions_are_named():
    row = ((Decimal("33.33"), Decimal("50.00")), Decimal(42))
    repaired, why = _explain(row, Sizes((100, 100), 1, 1), [0])
    assert repaired == {0: "33/99"}
    assert "1 question missing" in why


def test_two_tables_of_one_name_are_refused():
    document = json.loads(source([]))
    document["tables"] *= 2
    with pytest.raises(BetterError, match="'t' occurs twice"):
        read_source(json.dumps(document), "test")
