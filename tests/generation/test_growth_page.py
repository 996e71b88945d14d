"""The page of a grown suite in a browser: nothing is wider than the screen, and the bars show the quotas."""

from __future__ import annotations

import pytest
from tests.daily import others_slow
from tests.generation.test_growth import grow, settings  # noqa: F401  (a fixture)
from tests.report.chromium import COMMAND, browser

from betterbench.report.pages.growth_page import write_growth_page

pytestmark = pytest.mark.skipif(COMMAND is None, reason="needs Chromium")


@pytest.fixture(scope="module")
def chromium(tmp_path_factory):
    with browser(tmp_path_factory.mktemp("profile")) as made:
        yield made


@pytest.mark.parametrize("size", others_slow([((1280, 800),), ((390, 844),)], 2))
def test_the_page_fits_the_screen_and_marks_the_quotas(chromium, grow, tmp_path, size):  # noqa: F811
    asked = settings(12, "template=loose_packing:25%-50%", "axis=temporal:10%", "difficulty=hard:2")
    grown = grow(asked, refuse=lambda item: "picnic" in item.task_id or "plates" in item.task_id)
    page = write_growth_page(grown, tmp_path / "growth.html", seeds=3, cards={})
    chromium.open(page, *size)
    assert chromium.value("document.documentElement.scrollWidth") <= size[0]
    assert chromium.value("document.querySelectorAll('.mark').length") == 4
    ratio = "r.querySelector('.fill').offsetWidth / r.querySelector('.track').offsetWidth"
    shares = chromium.value(f"[...document.querySelectorAll('.row')].map(r => {ratio})")
    assert all(0.0 <= share <= 1.01 for share in shares)
    assert max(shares) > 0.1
    assert chromium.complaints() == []
