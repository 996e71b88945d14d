"""The calibrations that ship with the package: complete, and the same in documentation and reports."""

from __future__ import annotations

from pathlib import Path

import pytest
from tests.looping import each
from tests.report.factory import run_of

from betterbench.diagnosis import packaged_calibration
from betterbench.diagnosis.measures.confusion import CLAIMED, FAMILIES
from betterbench.report.pages.calibration_page import calibration_markdown, calibration_summary, rate_text
from betterbench.report.pages.trust import trust_of
from betterbench.statistics.wording import points
from betterbench_calibration.independent import FAMILY_PARTS, INDEPENDENT

DOCS = Path(__file__).parents[2] / "docs"


@pytest.mark.parametrize("part", FAMILY_PARTS)
def test_each_part_of_the_family_ships_the_calibration_of_all_its_policies(part):
    found = packaged_calibration(part)
    assert found is not None
    assert part in FAMILIES
    assert set(found.policies) == {p.address for p in INDEPENDENT.values() if p.part == part}


@each("family", FAMILIES)
def test_the_documentation_gives_the_packaged_numbers(family):
    found = packaged_calibration(family)
    assert found is not None
    assert calibration_markdown(found, family) in (DOCS / "calibration.md").read_text()
    mistakes = (DOCS / "mistakes.md").read_text()
    assert all(f"**{j.trial}**, `{j.policy}`" in mistakes for j in found.wrong)


def test_a_report_rests_on_the_part_that_was_used_last():
    newest = list(FAMILY_PARTS)[-1]
    assert newest == CLAIMED
    found = packaged_calibration(newest)
    assert found is not None
    text = trust_of([run_of("mine", seeds=1, tasks=("fast_food",))])["Calibration"]
    assert calibration_summary(found) in text
    assert f"--family {newest}" in text
    assert f"{points(found.failed.low)} to {points(found.failed.high)} %" in text


@pytest.mark.parametrize("part", [p for p in FAMILY_PARTS if p != "development"])
def test_the_documentation_lists_what_each_use_gave(part):
    found = packaged_calibration(part)
    assert found is not None
    rates = (found.failed, found.failed_kinds, found.without_grasp)
    row = f"| {part.replace('_', ' ')} | {' | '.join(map(rate_text, rates))} | {found.accused.k}/{found.accused.n} |"
    assert row in (DOCS / "calibration.md").read_text()
