"""Every printed static number of the paper's Table 3, recomputed from item logs that are made to fit it."""

from __future__ import annotations

import json
from decimal import Decimal
from fractions import Fraction
from importlib import resources

import pytest
from tests.daily import others_slow
from tests.vlm.published import HEIGHT, WIDTH, mask

from betterbench.statistics import percent, round_half_up
from betterbench.vlm import find_benchmark, score_answers
from betterbench.vlm.items import Gold, Item, ItemSet
from betterbench.vqa.coordinates import CONVENTIONS
from betterbench.vqa.question import Form

DOMAINS = {"Daily": 439, "Hobbies": 295, "Recreation": 183, "Work": 404}
CORRECT = {
    "Gemini-2.5-Pro": (194, 127, 85, 160),
    "GPT-4o": (208, 118, 82, 144),
    "Claude-Sonnet-4": (191, 121, 78, 155),
    "RoboBrain-2.0-7B": (173, 95, 62, 109),
    "RoboBrain-2.0-32B": (281, 157, 106, 212),
    "InternVL-3.5-8B": (207, 117, 81, 134),
    "InternVL-3.5-4B": (169, 118, 70, 127),
    "InternVL-3.5-2B": (162, 99, 66, 114),
    "2B + VLM + VLA (multi-patch)": (164, 88, 66, 104),
    "2B + VLM + VLA (single 224px)": (164, 88, 66, 104),
}
"""Correct answers per domain that reproduce the printed cells."""
DROPPED = {"InternVL-3.5-4B": (0, 4, 0, 3)}
"""Items without an answer: its cells only fit smaller denominators."""


def table():
    text = resources.files("betterbench_calibration.audit").joinpath("data/paper_tables.json").read_text()
    (found,) = [t for t in json.loads(text, parse_float=Decimal)["tables"] if t["name"] == "static_bottleneck"]
    return {row: dict(zip(found["columns"], cells, strict=True)) for row, cells in found["rows"].items()}


TABLE = table()


def choices(benchmark, kind, sizes):
    items = [
        Item(
            f"{name}/{i}", Form.CHOICE, "Which?", Gold("B"), (), f"{name}/{i // 2}", ("a", "b", "c", "d"), {kind: name}
        )
        for name, n in sizes.items()
        for i in range(n)
    ]
    return ItemSet(benchmark, tuple(items), lambda _: b"")


def answered(items, kind, correct, dropped=None):
    """Returns texts with a number of correct answers per group; the last items of a group have none."""
    texts, seen = {}, {}
    for item in items.items:
        group = item.groups[kind]
        number = seen[group] = seen.get(group, 0) + 1
        texts[item.id] = "The answer is B." if number <= correct[group] else "A"
    for group, count in (dropped or {}).items():
        for item in [i for i in items.items if i.groups[kind] == group][-count:] if count else []:
            texts.pop(item.id, None)
    return texts


def scored(items, texts):
    return score_answers(find_benchmark(items.benchmark), items, texts, CONVENTIONS["fractions"])


def shown(value):
    return round_half_up(100 * value, 2)


EMBSPATIAL = choices("embspatial", "relation", {"left": 3640})
EGOPLAN2 = choices("egoplan2", "domain", DOMAINS)


@pytest.mark.parametrize("row", others_slow(TABLE, 3))
def test_embspatial(row):
    printed = TABLE[row]["EmbSpatial"]
    dropped = {"InternVL-3.5-8B": 2, "InternVL-3.5-4B": 1}.get(row, 0)
    n = 3640 - dropped
    k = round(Fraction(printed) * n / 100)
    found = scored(EMBSPATIAL, answered(EMBSPATIAL, "relation", {"left": k}, {"left": dropped}))
    assert (found.all.n, found.all.answered) == (3640, n)
    assert shown(found.all.if_dropped) == printed
    if dropped:  # no count of 3,640 items gives the printed number
        assert all(percent(other, 3640, digits=2) != printed for other in range(k - 3, k + 4))
        assert shown(found.headline["parsed"]) == percent(k, 3640, digits=2)
    else:
        assert shown(found.headline["parsed"]) == printed


@pytest.mark.parametrize("row", others_slow(CORRECT, 3))
def test_egoplan2(row):
    correct = dict(zip(DOMAINS, CORRECT[row], strict=True))
    dropped = dict(zip(DOMAINS, DROPPED.get(row, (0, 0, 0, 0)), strict=True))
    found = scored(EGOPLAN2, answered(EGOPLAN2, "domain", correct, dropped))
    cells = {domain: shown(found.part("domain", domain).if_dropped) for domain in DOMAINS}
    expected = {domain: TABLE[row][f"EgoPlan2 {domain}"] for domain in DOMAINS}
    if row == "Claude-Sonnet-4":  # 38.87 is no count of 404; 38.37 is, and fits the printed mean
        assert all(percent(k, 404, digits=2) != expected["Work"] for k in range(405))
        expected["Work"] = Decimal("38.37")
    assert cells == expected
    assert shown(found.all.if_dropped) == TABLE[row]["EgoPlan2 All"]
    if not any(dropped.values()):
        assert shown(found.headline["parsed"]) == TABLE[row]["EgoPlan2 All"]
        assert shown(found.macro["domain"]["parsed"]) != TABLE[row]["EgoPlan2 All"]  # the paper's mean is micro
    else:
        assert shown(found.headline["parsed"]) == percent(484, 1321, digits=2) != TABLE[row]["EgoPlan2 All"]
    assert all(found.headline["strict"] <= v for v in (found.headline["parsed"], found.headline["extracted"]))


def test_egoplan2_of_a_row_that_prints_only_the_mean():
    found = scored(EGOPLAN2, answered(EGOPLAN2, "domain", {"Daily": 300, "Hobbies": 200, "Recreation": 68, "Work": 0}))
    assert shown(found.headline["parsed"]) == TABLE["Mimo-Embodied-7B"]["EgoPlan2 All"]


def points_of(share):
    """Returns a list of points of which a share is in the target region, the right half."""
    inside, count = share.numerator, share.denominator
    return f"[{', '.join(['(0.75, 0.5)'] * inside + ['(0.25, 0.5)'] * (count - inside))}]"


SPLITS = {"location": 100, "placement": 100, "unseen": 77}
REFSPATIAL = ItemSet(
    "refspatial",
    tuple(
        Item(
            f"{split}/{i}", Form.POINTS, "Point.", Gold(mask="mask"), (), f"{split}/{i}", (), {"split": split},
            WIDTH, HEIGHT,
        )
        for split, n in SPLITS.items()
        for i in range(n)
    ),
    lambda _: mask(WIDTH // 2, 0, WIDTH, HEIGHT),
)  # fmt: skip


@pytest.mark.parametrize("row", TABLE)
def test_refspatial(row):
    printed = TABLE[row]
    loc, plc = printed["RefSpatial Loc"], printed["RefSpatial Plc"]
    if loc is None:
        loc = plc = printed["RefSpatial All"]
    texts = {}
    for split, cell in (("location", loc), ("placement", plc), ("unseen", Decimal(100))):
        total = Fraction(cell) * SPLITS[split] / 100
        whole, rest = int(total), total - int(total)
        for i in range(SPLITS[split]):
            texts[f"{split}/{i}"] = points_of(Fraction(i < whole) if i != whole else rest)
    found = scored(REFSPATIAL, texts)
    assert shown(found.part("split", "location").means["parsed"].mean) == loc
    assert shown(found.part("split", "placement").means["parsed"].mean) == plc
    assert shown(found.headline["parsed"]) == printed["RefSpatial All"]
