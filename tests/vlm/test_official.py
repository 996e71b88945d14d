"""Each counted fault of an upstream scorer is reproduced in official mode and absent in our scores."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

import pytest
from tests.vlm.published import HEIGHT, WIDTH, mask

from betterbench.vlm import find_benchmark, score_answers
from betterbench.vlm.items import Gold, Item, ItemSet
from betterbench.vlm.official import UPSTREAM, upstream_scores
from betterbench.vqa.coordinates import CONVENTIONS
from betterbench.vqa.question import Form

OPTIONS = ("mug", "lamp", "chair", "cabinet")


def choice(benchmark, gold, group):
    item = Item("q", Form.CHOICE, "Which?", Gold(gold), (), "q", OPTIONS, {group: "x"})
    return ItemSet(benchmark, (item,), lambda _: b"")


def pointing(split="location", count=1):
    items = tuple(
        Item(f"{i}", Form.POINTS, "Point.", Gold(mask="mask"), (), f"{i}", (), {"split": split}, WIDTH, HEIGHT)
        for i in range(count)
    )
    return ItemSet("refspatial", items, lambda _: mask(32, 12, 48, 24))  # around (40, 18), which is (0.625, 0.375)


def both(items, text, coordinates="fractions", which=0):
    """Returns our score and the result of an upstream scorer for one text, or one text per item."""
    texts = (
        {items.items[0].id: text}
        if isinstance(text, str)
        else {i.id: t for i, t in zip(items.items, text, strict=True)}
    )
    benchmark = find_benchmark(items.benchmark)
    ours = score_answers(benchmark, items, texts, CONVENTIONS[coordinates])
    theirs = upstream_scores(UPSTREAM[items.benchmark], items, texts, ours, coordinates)
    return ours, theirs[which]


@pytest.mark.parametrize(
    ("benchmark", "which", "gold", "text", "theirs"),
    [
        ("egoplan2", 0, "C", "Based on the video, the answer is C", 0),
        ("egoplan2", 0, "D", "Considering the progress, D", 0),
        ("egoplan2", 0, "C", "A person should pick C", 0),
        ("egoplan2", 0, "B", "b", 0),
        ("egoplan2", 0, "C", "The best answer is C", 1),
        ("egoplan2", 0, "D", "The correct answer is (D)", 1),
        ("egoplan2", 0, "C", "Best option: C", 0),  # "Best answer:" and "Best option:" are joined by a missing comma
        ("egoplan2", 0, "C", "Answer: C", 1),
        ("egoplan2", 1, "C", "Answer: C", 0),  # lmms-eval has a shorter list
        ("embspatial", 0, "C", "The answer is C", 0),
        ("embspatial", 0, "D", "Answer: D", 0),
        ("embspatial", 0, "D", "cabinet", 0),
        ("embspatial", 0, "B", "(B) lamp", 1),
    ],
)
def test_letters(benchmark, which, gold, text, theirs):
    items = choice(benchmark, gold, "domain" if benchmark == "egoplan2" else "relation")
    ours, found = both(items, text, which=which)
    assert ours.headline["parsed"] == 1
    assert (found.value, found.scored) == (theirs, 1)
    assert found.moved == theirs - 1
    assert found.differs == (theirs != 1)


def test_faults_that_score_a_wrong_answer_as_right():
    """EgoPlan: "the answer is C" gives the B of "Based"; EmbSpatial: "Answer: D" gives A, "cabinet" gives C."""
    for benchmark, gold, text in (
        ("egoplan2", "B", "Based on the video, the answer is C"),
        ("embspatial", "A", "Answer: D"),
        ("embspatial", "C", "cabinet"),
    ):
        ours, found = both(choice(benchmark, gold, "domain"), text)
        assert (ours.headline["parsed"], found.value) == (0, 1)


@pytest.mark.parametrize(
    ("coordinates", "text", "theirs", "own"),
    [
        ("fractions", "[(0.625, 0.375)]", 1, 1),
        ("fractions", "[( 0.625, 0.375 )]", 0, 1),  # spaces inside the bracket
        ("fractions", "[(.625, .375)]", 0, 1),
        ("fractions", "[[0.625, 0.375]]", 0, 1),
        ("fractions", "[(40, 18)]", 1, 0),  # integers are taken as pixels, whatever was asked for
        ("fractions", "[(0.7484, 0.375)]", 1, 1),  # column 47.9 is in the last pixel of the region, 47
        ("fractions", "(0.625, 0.375), (0.1, 0.1)", Fraction(1, 2), Fraction(1, 2)),
        ("fractions", "[(0.5, 0.25, 0.75, 0.5)]", 1, 1),  # all pixels of a box
        ("percent-xml", '<points x1="62.5" y1="37.5">', 1, 1),
        ("percent-xml", '<point x="62.5" y="37.5">', 0, 1),  # a single point is never found
        ("thousandths-yx-json", '```json\n[{"point": [375, 625]}]\n```', 1, 1),
        ("thousandths-yx-json", '[{"point": [375, 625]}]', 0, 1),  # without a fence
        ("pixels", "(40, 18)", 1, 1),
    ],
)
def test_points(coordinates, text, theirs, own):
    ours, found = both(pointing(), text, coordinates)
    assert (found.value, ours.headline["parsed"]) == (theirs, own)


def test_mixed_numbers_leave_the_picture_upstream():
    """(0.625, 1) and (1.0, 1.0) become row or column 48 and 64 of a picture with rows 0 to 47."""
    items = ItemSet("refspatial", pointing().items, lambda _: mask(0, 0, WIDTH, HEIGHT))
    for text in ("(0.625, 1)", "(1.0, 1.0)"):
        ours, found = both(items, text)
        assert (found.value, ours.headline["parsed"]) == (0, 1)


def test_texts_that_cannot_be_read_leave_the_denominator_upstream():
    fence = '```json\n{"point": [375, 625]}\n```'  # a single object instead of a list
    good = '```json\n[{"point": [375, 625]}]\n```'
    ours, found = both(pointing(count=4), [fence, fence, good, ""], "thousandths-yx-json")
    assert (found.scored, found.total, found.value) == (2, 4, Fraction(1, 2))
    assert ours.headline["parsed"] == Fraction(3, 4)


def test_decimals_in_absolute_mode_end_the_program_upstream():
    ours, found = both(pointing(count=2), ["(40, 18)", "(40.5, 18.0)"], "pixels")
    assert (found.value, found.stopped_at, found.note) == (None, "1", "ends with an error")
    assert ours.headline["parsed"] == 1


def test_lmms_eval_reads_integers_as_fractions_and_averages_all_splits():
    ours, found = both(pointing("unseen"), "(40, 18)", which=1)
    assert found.value == 0
    ours, found = both(pointing("unseen"), "(0.625, 0.375)", which=1)
    assert (found.value, ours.headline["parsed"]) == (1, 0)  # unseen does not count in the paper's number


def test_easi_scores_nothing():
    ours, found = both(pointing(), "(0.625, 0.375)", which=2)
    assert (found.value, ours.headline["parsed"], found.moved) == (0, 1, -1)


def test_a_program_that_does_not_know_a_convention_says_so():
    _, found = both(pointing(), "[500, 500]", "thousandths")
    assert found.value is None
    assert found.note.startswith("reads fractions or pixels")


def test_a_mask_of_another_size_than_the_picture_is_met_by_scaled_points():
    (item,) = pointing().items
    double = ItemSet("refspatial", (replace(item, width=2 * WIDTH, height=2 * HEIGHT),), lambda _: mask(32, 12, 48, 24))
    for coordinates, text in (("fractions", "(0.625, 0.375)"), ("pixels", "(80, 36)")):
        ours, found = both(double, text, coordinates)
        assert ours.headline["parsed"] == 1
        assert found.value == (coordinates == "fractions")  # upstream takes pixels of the mask
