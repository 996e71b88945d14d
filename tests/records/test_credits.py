"""Sources and licenses of assets in scenes and reports."""

from __future__ import annotations

from dataclasses import dataclass, replace

from betterbench.interface.state import ObjectInfo, SceneInfo
from betterbench.records.credits import LIBRARY_CREDIT, credit_lines


@dataclass(frozen=True)
class Shown:
    asset: str
    source: str = ""
    license: str = ""


def test_each_source_is_one_line_and_the_library_is_one_line():
    shown = [
        Shown("my_mug-red#0", "mug.glb, by Ada", "CC BY 4.0"),
        Shown("my_mug-red#1", "mug.glb, by Ada", "CC BY 4.0"),
        Shown("bowl-blue#0", "bowl.urdf"),
        Shown("cup-white#3"),
        Shown("plate-white#1"),
    ]
    assert credit_lines(shown) == (
        "bowl-blue: bowl.urdf; license unknown",
        "my_mug-red: mug.glb, by Ada; license CC BY 4.0",
        LIBRARY_CREDIT,
    )
    assert credit_lines(shown[:2]) == ("my_mug-red: mug.glb, by Ada; license CC BY 4.0",)
    assert credit_lines([]) == ()


def test_the_library_leaves_no_trace_in_a_record_and_others_do():
    plain = ObjectInfo("a", "mug", "mug-red#0", "mug", "red", "cylinder", "item", False, 0.3, (0.1, 0.1, 0.1))
    mine = replace(plain, name="b", asset="my_mug-red#0", source="mug.glb", license="CC0-1.0")
    ours, theirs = SceneInfo((plain, mine), (), (0.0, 0.0, 0.0), 0.08).to_json()["objects"]
    assert {"source", "license"}.isdisjoint(ours)
    assert (theirs["source"], theirs["license"]) == ("mug.glb", "CC0-1.0")


def test_only_what_keeps_upright_says_so_in_a_record():
    plain = ObjectInfo("a", "mug", "mug-red#0", "mug", "red", "cylinder", "item", False, 0.3, (0.1, 0.1, 0.1))
    drink = replace(plain, name="b", kind="drink", keeps_upright=True)
    ours, theirs = SceneInfo((plain, drink), (), (0.0, 0.0, 0.0), 0.08).to_json()["objects"]
    assert "keeps_upright" not in ours
    assert theirs["keeps_upright"] is True
