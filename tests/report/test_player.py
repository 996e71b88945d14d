"""The page of one trial: it holds what it is given, needs nothing else, and lets no name break out of it."""

from __future__ import annotations

import base64
import dataclasses
import hashlib
import json
import re
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))

from chromium import COMMAND, browser

from betterbench.errors import InvalidInputError
from betterbench.report.figures.player import PlayedLane, PlayedTrial, PlayedView, is_player, write_player

VIEW = PlayedView(
    "front_8x8", 8, 8, [b"\xff\xd8a", b"\xff\xd8b"], [b"\x89PNG1", b"\x89PNG2"], [[], [(0, 1, 2, 5, 6, 0.25)]]
)
TRIAL = PlayedTrial(
    heading="fast_food/T1/3",
    policy="zoo:lexical",
    instruction="Pack the </script><b>fries</b>",
    ended="success",
    times_s=[0.0, 0.05],
    objects=[("fries</script>", (200, 10, 20))],
    views=[VIEW],
    lanes=[PlayedLane("subgoal", "pack_fries", [(1, 1, "met")])],
)


def test_the_page_holds_all_of_it_and_asks_for_nothing_else(tmp_path):
    page = write_player(TRIAL, tmp_path / "x.html").read_text()
    data = json.loads(re.search(r'id="data">(.*?)</script>', page, flags=re.DOTALL)[1])
    assert data["times"] == [0.0, 0.05]
    assert data["objects"] == [{"name": "fries</script>", "color": [200, 10, 20]}]
    (view,) = data["views"]
    assert [base64.b64decode(p) for p in view["pictures"]] == VIEW.pictures
    assert [base64.b64decode(p) for p in view["masks"]] == VIEW.masks
    assert view["boxes"] == [[], [[0, 1, 2, 5, 6, 0.25]]]
    assert data["lanes"] == [{"kind": "subgoal", "name": "pack_fries", "spans": [[1, 1, "met"]]}]
    assert page.count("</script>") == 2
    assert "<b>fries" not in page
    assert not re.search(r"""(?:src|href)=["'](?!data:)""", page)
    script = re.search(r"</script>\s*<script>(.*?)</script>", page, flags=re.DOTALL)[1]
    assert f"sha256-{base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()}" in page


@pytest.mark.skipif(COMMAND is None, reason="no Chromium is installed")
def test_the_last_time_of_the_scale_is_not_cut_off(tmp_path):
    page = write_player(dataclasses.replace(TRIAL, times_s=[0.0, 14.0]), tmp_path / "x.html")
    with browser(tmp_path / "profile") as chromium:
        chromium.open(page, 1300, 900)
        scale = "document.querySelector('.ticks .track')"
        assert chromium.value(f"{scale}.lastElementChild.textContent") == "14 s"
        edges = [f"{e}.getBoundingClientRect().right" for e in (scale, f"{scale}.lastElementChild")]
        track, last = chromium.value(f"[{', '.join(edges)}]")
        assert last <= track + 1


def test_a_page_of_the_player_is_known_again(tmp_path):
    page = write_player(TRIAL, tmp_path / "x.html")
    assert is_player(page)
    for content in ("", "<!doctype html><main>mine</main>", page.read_text()[: page.stat().st_size // 4]):
        page.write_text(content)
        assert not is_player(page)


def test_views_have_one_frame_per_time(tmp_path):
    short = dataclasses.replace(TRIAL, times_s=[0.0])
    with pytest.raises(InvalidInputError, match="front_8x8"):
        write_player(short, tmp_path / "x.html")
