"""What the audit says about the benchmark paper's own tables: every number that is right, and every one that is not."""

from __future__ import annotations

import json
from decimal import Decimal
from importlib import resources

import pytest
from tests.looping import each

from betterbench_calibration.audit import Verdict, audit_source, paper_tables
from betterbench_calibration.audit.pooled import Pooled, recover_sizes

EGO_PARTS = ("EgoPlan2 Daily", "EgoPlan2 Hobbies", "EgoPlan2 Recreation", "EgoPlan2 Work")
EGO = Pooled("EgoPlan2 All", EGO_PARTS)


@pytest.fixture(scope="module")
def audit():
    return audit_source(paper_tables())


def findings(audit, table, rule=None, row=None, cell=None):
    return [
        f
        for f in audit.findings
        if f.table == table
        and (rule is None or f.rule == rule)
        and (row is None or f.row == row)
        and (cell is None or f.cell == cell)
    ]


def one(audit, *where):
    [finding] = findings(audit, *where)
    return finding


def test_exactly_these_numbers_do_not_hold(audit):
    broken = {(f.table, f.row, f.cell, f.printed) for f in audit.findings if f.verdict is Verdict.BROKEN}
    assert broken == {
        ("static_bottleneck", "InternVL-3.5-8B", "EmbSpatial", "74.96"),
        ("static_bottleneck", "InternVL-3.5-4B", "EmbSpatial", "72.08"),
        ("static_bottleneck", "Claude-Sonnet-4", "EgoPlan2 Work", "38.87"),
        ("static_bottleneck", "InternVL-3.5-4B", "EgoPlan2 Hobbies", "40.55"),
        ("static_bottleneck", "InternVL-3.5-4B", "EgoPlan2 Work", "31.67"),
        (
            "static_bottleneck",
            "2B + VLM + VLA (single 224px)",
            "EgoPlan2 Daily to EgoPlan2 All",
            "37.36/29.83/36.07/25.74/31.95",
        ),
        ("combined_results", "GR00T-N1.6", "LIBERO Spatial", "97.65"),
        ("combined_results", "GR00T-N1.6", "LIBERO Object", "98.45"),
        ("combined_results", "GR00T-N1.6", "LIBERO Goal", "97.5"),
        ("combined_results", "GR00T-N1.6", "LIBERO Long", "94.35"),
        ("vla_data", "Total", "frames", "47.69"),
    }


@each(
    "table, rule, number",
    [
        ("coffee_case", "grid", 12),
        ("composition_case", "grid", 9),
        ("composition_case", "delta", 3),
        ("static_bottleneck", "mean", 10),
        ("combined_results", "mean", 6),
        ("combined_results", "sum", 6),
        ("combined_results", "falling", 6),
        ("vlm_data", "total", 1),
        ("task_taxonomy", "total", 1),
        ("real_robot", "total", 1),
        ("running_text", "quoted", 13),
    ],
)
def test_what_holds(audit, table, rule, number):
    assert sum(f.verdict is Verdict.HOLDS for f in findings(audit, table, rule)) == number


@pytest.mark.parametrize(("row", "delta"), [("π0.5", "-47.5"), ("GR00T-N1.6", "-42.5"), ("Being-H0.5", "-52.5")])
def test_differences_of_the_composition_table(audit, row, delta):
    finding = one(audit, "composition_case", "delta", row)
    assert (finding.printed, finding.recomputed, finding.verdict) == (delta, delta, Verdict.HOLDS)


@pytest.mark.parametrize(
    ("row", "exact", "rounded"),
    [("Gemini-2.5-Pro", "38.155", "38.16"), ("GPT-4o", "8.775", "8.78"), ("Claude-Sonnet-4", "7.685", "7.69")],
)
def test_halves_are_rounded_up(audit, row, exact, rounded):
    finding = one(audit, "static_bottleneck", "mean", row)
    assert exact in finding.why
    assert (finding.recomputed, finding.verdict) == (rounded, Verdict.HOLDS)


def test_the_sizes_of_the_domains_are_found():
    table = paper_tables().by_name["static_bottleneck"]
    sizes = recover_sizes(tuple(EGO.rows(table).values()))
    assert (sizes.parts, sizes.total) == ((439, 295, 183, 404), 1321)


@each(
    "row, counts, overall",
    [
        ("Gemini-2.5-Pro", (194, 127, 85, 160), "42.85"),
        ("GPT-4o", (208, 118, 82, 144), "41.79"),
        ("RoboBrain-2.0-7B", (173, 95, 62, 109), "33.23"),
        ("RoboBrain-2.0-32B", (281, 157, 106, 212), "57.23"),
        ("InternVL-3.5-8B", (207, 117, 81, 134), "40.80"),
        ("InternVL-3.5-2B", (162, 99, 66, 114), "33.38"),
        ("2B + VLM + VLA (multi-patch)", (164, 88, 66, 104), "31.95"),
        ("2B + VLM + VLA (single 224px)", (164, 88, 66, 104), "31.95"),
    ],
)
def test_micro_averages(audit, row, counts, overall):
    finding = one(audit, "static_bottleneck", "pooled", row)
    listed = ", ".join(f"{k}/{n}" for k, n in zip(counts, (439, 295, 183, 404), strict=True))
    assert finding.verdict is Verdict.HOLDS
    assert listed in finding.why
    assert finding.recomputed == f"{sum(counts)}/1321 = {overall}"


def test_the_plain_mean_of_the_domains_is_wrong_everywhere(audit):
    assert "fits 0/10 rows" in one(audit, "static_bottleneck", "pooled", "").why


def test_the_misprint_of_the_work_domain_is_mended(audit):
    finding = one(audit, "static_bottleneck", "pooled", "Claude-Sonnet-4")
    assert finding.recomputed == "38.37"
    assert "155/404" in finding.why
    assert "545/1321 = 41.26" in finding.why


def test_the_missing_questions_of_the_4b_row_are_counted(audit):
    hobbies, work = findings(audit, "static_bottleneck", "pooled", "InternVL-3.5-4B")
    assert (hobbies.recomputed, work.recomputed) == ("118/291", "127/401")
    assert "7 questions missing" in hobbies.why
    assert "484/1314 = 36.83" in hobbies.why


@pytest.mark.parametrize(("row", "count"), [("InternVL-3.5-8B", "2727/3638"), ("InternVL-3.5-4B", "2623/3639")])
def test_items_missing_from_embspatial(audit, row, count):
    assert count in one(audit, "static_bottleneck", "grid", row, "EmbSpatial").why


@pytest.mark.parametrize("column", ["LIBERO Spatial", "LIBERO Object", "LIBERO Long"])
def test_gr00t_needs_two_thousand_trials(audit, column):
    assert "2000 is the smallest multiple" in one(audit, "combined_results", "grid", "GR00T-N1.6", column).why


def test_the_total_of_the_frames_was_cut_off(audit):
    finding = one(audit, "vla_data", "total", "Total", "frames")
    assert finding.recomputed == "47.70"
    assert "47.6968" in finding.why
    assert "truncated" in finding.why
    assert one(audit, "vla_data", "total", "Total", "episodes").recomputed == "924093"


def test_shares_of_the_mixture(audit):
    shares = [f.recomputed.rsplit("= ")[-1] for f in findings(audit, "mixture_weights")]
    assert shares == ["80 %", "5 %", "5 %", "5 %", "5 %"]


def test_only_the_row_without_parts_stays_open(audit):
    rows = {f.row for f in findings(audit, "static_bottleneck") if f.verdict is Verdict.UNKNOWN}
    assert rows == {"Mimo-Embodied-7B"}


@each(
    "row, column, count, p, supported",
    [
        ("π0.5", "top", "13/20", 0.26, False),
        ("π0.5", "bottom", "10/20", 1.0, False),
        ("π0.5", "red", "14/20", 0.12, False),
        ("π0.5", "blue", "7/20", 0.26, False),
        ("GR00T-N1.6", "top", "20/20", 1.9e-6, True),
        ("GR00T-N1.6", "bottom", "20/20", 1.9e-6, True),
        ("GR00T-N1.6", "red", "1/20", 4.0e-5, True),
        ("GR00T-N1.6", "blue", "1/20", 4.0e-5, True),
        ("Being-H0.5", "top", "20/20", 1.9e-6, True),
        ("Being-H0.5", "bottom", "6/20", 0.12, False),
        ("Being-H0.5", "red", "19/20", 4.0e-5, True),
        ("Being-H0.5", "blue", "9/20", 0.82, False),
    ],
)
def test_chance_in_the_coffee_table(audit, *, row, column, count, p, supported):
    finding = one(audit, "coffee_case", "chance", row, column)
    assert finding.recomputed == count
    assert float(f"{finding.support.p_value:.2g}") == p
    assert finding.support.p_holm >= finding.support.p_value
    assert finding.verdict is (Verdict.HOLDS if supported else Verdict.UNSUPPORTED)


@pytest.mark.parametrize(
    ("row", "counts", "fisher", "low", "high"),
    [
        ("π0.5", "1/20, 21/40", 2.2e-4, -62.6, -23.6),
        ("GR00T-N1.6", "3/20, 23/40", 2.2e-3, -59.6, -16.5),
        ("Being-H0.5", "0/20, 21/40", 2.4e-5, -67.1, -30.5),
    ],
)
def test_the_drop_on_novel_compositions_is_solid(audit, *, row, counts, fisher, low, high):
    finding = one(audit, "composition_case", "composition", row)
    support = finding.support
    assert finding.recomputed == counts
    assert float(f"{support.p_fisher:.2g}") == fisher
    assert support.test.startswith("Barnard")
    assert support.p_value < 0.002
    assert (round(support.low_pp, 1), round(support.high_pp, 1)) == (low, high)
    assert finding.verdict is Verdict.HOLDS


@pytest.mark.parametrize(
    ("table", "cell", "counts", "p", "supported"),
    [
        ("static_bottleneck", "EgoPlan2 All: co-training regresses", "441/1321, 422/1321", 0.46, False),
        ("static_bottleneck", "RefSpatial Loc: 8B above 4B", "48/100, 38/100", 0.20, False),
        ("static_bottleneck", "RefSpatial Loc: one small view loses", "41/100, 9/100", 1.9e-7, True),
        ("static_bottleneck", "EgoPlan2 All: 8B above 2B", "539/1321, 441/1321", 9.3e-5, True),
    ],
)
def test_claims_about_the_static_benchmarks(audit, *, table, cell, counts, p, supported):
    finding = one(audit, table, "differences", None, cell)
    assert finding.recomputed == counts
    assert float(f"{finding.support.p_value:.2g}") == p
    assert finding.verdict is (Verdict.HOLDS if supported else Verdict.UNSUPPORTED)


def test_the_drop_by_co_training_may_be_none(audit):
    support = one(audit, "static_bottleneck", "differences", None, "EgoPlan2 All: co-training regresses").support
    assert (round(support.low_pp, 1), round(support.high_pp, 1)) == (-2.1, 5.0)


def test_libero_differs_only_before_correction(audit):
    finding = one(audit, "combined_results", "differences", "No Pre-training")
    assert finding.recomputed == "1948/2000, 1925/2000"
    assert float(f"{finding.support.p_value:.2g}") == 0.047
    assert finding.support.p_holm > 0.05
    assert finding.verdict is Verdict.UNSUPPORTED


def test_worst_comes_first(audit):
    for table in audit.tables:
        ranks = [f.verdict.rank for f in table.findings]
        assert ranks == sorted(ranks)


def test_every_printed_number_is_read_by_a_finding(audit):
    for table in audit.tables:
        read = {cell for f in table.findings for cell in f.covers}
        assert {cell for cell, _ in table.table.printed()} <= read


def test_the_report_prints_the_same_counts():
    text = resources.files("betterbench.report").joinpath("paper.json").read_text(encoding="utf-8")
    facts, tables = json.loads(text), paper_tables().by_name
    for name, table, columns in (("coffee", "coffee_case", 4), ("composition", "composition_case", 3)):
        for row, counts in facts[name]["rows"].items():
            printed = [tables[table].cell(row, column) for column in tables[table].columns[:columns]]
            assert printed == [Decimal(100 * k) / facts["trials_per_cell"] for k in counts]
