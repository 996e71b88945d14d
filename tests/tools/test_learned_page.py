"""The page about learned policies says what the studies beside it say."""

from __future__ import annotations

import json
import re
import shutil
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "tools"))

from betterbench.learning.study.page import study_style
from learned_page import PAGE, SHEET, STUDIES, filled, linked, points, share, share_style


def test_the_tables_are_those_of_the_studies():
    text = PAGE.read_text(encoding="utf-8")
    assert filled(text) == text


def test_another_number_makes_another_table(tmp_path):
    shutil.copytree(STUDIES, tmp_path, dirs_exist_ok=True)
    study = json.loads((tmp_path / "study.json").read_text(encoding="utf-8"))
    study["variations"][0]["verdict"] = "something else"
    (tmp_path / "study.json").write_text(json.dumps(study), encoding="utf-8")
    text = PAGE.read_text(encoding="utf-8")
    assert "| something else |" in filled(text, tmp_path)


def test_levers_of_two_studies_are_joined_only_beside_the_same_learners(tmp_path):
    shutil.copytree(STUDIES, tmp_path, dirs_exist_ok=True)
    base = json.loads((tmp_path / "base.json").read_text(encoding="utf-8"))
    base["levers"][0]["rows"][0]["found"]["training"]["k"] -= 1
    (tmp_path / "base.json").write_text(json.dumps(base), encoding="utf-8")
    with pytest.raises(ValueError, match="differ between the studies: confounded"):
        filled(PAGE.read_text(encoding="utf-8"), tmp_path)


def test_a_page_without_a_table_is_refused():
    with pytest.raises(ValueError, match="doses:end"):
        filled(PAGE.read_text(encoding="utf-8").replace("<!-- doses:end -->", ""))


def test_figures_are_written_as_in_the_text():
    figure = {"value": -0.004, "low": -0.421, "high": 0.124, "k": 33, "n": 40}
    assert share({**figure, "low": 0.681, "high": 0.9054}) == "33/40 = 83 % (68 to 91)"
    assert points(figure) == "0 (−42 to +12)"
    assert points(None) == ""


def test_the_pages_of_the_studies_share_one_style_sheet():
    pages = sorted(STUDIES.glob("*.html"))
    assert len(pages) >= 5
    for page in pages:
        text = page.read_text(encoding="utf-8")
        assert "<style>" not in text
        assert re.findall(r'<link rel="stylesheet" href="([^"]*)">', text) == [SHEET]
    assert (STUDIES / SHEET).read_text(encoding="utf-8") == study_style()


def test_a_page_that_was_copied_there_is_linked_once(tmp_path):
    page = (
        "<meta content=\"default-src 'none'; style-src 'unsafe-inline'\">\n"
        "<style>\np { color: red; }\n</style>\n<p>here</p>"
    )
    (tmp_path / "new.html").write_text(page, encoding="utf-8")
    share_style(tmp_path)
    share_style(tmp_path)
    text = (tmp_path / "new.html").read_text(encoding="utf-8")
    assert text == linked(page)
    assert text == (
        "<meta content=\"default-src 'none'; style-src 'self' file: 'unsafe-inline'\">\n"
        '<link rel="stylesheet" href="study.css">\n<p>here</p>'
    )
