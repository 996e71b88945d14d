"""Assets are found for descriptions, suit their groups, and have names that tell them apart."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from tests.looping import each

from betterbench.errors import InvalidInputError
from betterbench.generation.building.casting import cast_of
from betterbench.generation.scenario import DescribedObject, Scenario
from betterbench.sim.assets import build
from betterbench.sim.assets.catalogue.indexing import index_sources
from betterbench.sim.assets.catalogue.search import Catalogue
from betterbench.sim.assets.catalogue.sources import open_source
from betterbench.sim.assets.catalogue.sources.source import SourceOptions


@pytest.fixture(scope="module")
def catalogue(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Catalogue]:
    folder = tmp_path_factory.mktemp("catalogue")
    index_sources(folder, [open_source("procedural", SourceOptions())], on_progress=lambda *_: None)
    with Catalogue(folder) as opened:
        yield opened


def described(description: str, query: str, name: str, size: tuple[float, float] = (0.04, 0.15)) -> DescribedObject:
    return DescribedObject(description, query, name, (0.02, 0.5), size)


def packing(*items: DescribedObject, container: str = "lunchbox") -> Scenario:
    box = described(f"an open {container}", container, "box", (0.15, 0.4))
    return Scenario("loose_packing", "Packing", "Pack it.", "kitchen", {"container": (box,), "items": items})


def test_each_description_gets_its_asset(catalogue: Catalogue) -> None:
    fruit = packing(
        described("a shiny red apple", "apple", "a"),
        described("a ripe orange", "orange", "b"),
        described("a green soda can", "soda can", "c"),
    )
    cast, chosen = cast_of(fruit, catalogue)
    assert [(s.category, s.color, s.kind) for s in cast.groups["items"]] == [
        ("apple", "red", "apple"),
        ("orange", None, "orange"),
        ("can", "green", "soda can"),
    ]
    assert cast.one("container").category == "lunchbox"
    assert cast.one("container").role == "container"
    assert all(choice.score > 0.2 for choice in chosen)


def test_two_objects_of_one_kind_are_told_apart_by_color(catalogue: Catalogue) -> None:
    coffee = Scenario(
        "constrained_positioning",
        "Coffee",
        "Make coffee.",
        "kitchen",
        {
            "fixture": (described("an espresso machine", "coffee maker", "machine", (0.2, 0.4)),),
            "items": (described("a green mug", "coffee mug", "m1"), described("a yellow mug", "mug", "m2")),
        },
    )
    cast, _ = cast_of(coffee, catalogue)
    assert [s.kind for s in cast.groups["items"]] == ["green mug", "yellow mug"]
    assert cast.one("fixture").fixed
    with pytest.raises(InvalidInputError, match=r"'mug' and 'cup' are both red"):
        cast_of(packing(described("a red mug", "mug", "m1"), described("a red mug", "mug", "m2")), catalogue)


def test_look_alikes_share_color_or_shape_and_not_the_name(catalogue: Catalogue) -> None:
    things = packing(
        described("a red apple", "apple", "a"), described("a lemon", "lemon", "b"), described("a blue mug", "mug", "c")
    )
    cast, _ = cast_of(things, catalogue)
    present = {s.category for specs in cast.groups.values() for s in specs}
    for spec in cast.groups["items"]:
        own = build(spec.category, color=spec.color)
        assert cast.look_alikes[spec.name], f"{spec.name} has no look-alike"
        for other in cast.look_alikes[spec.name]:
            asset = build(other.category, color=other.color)
            assert other.role == "distractor"
            assert other.category not in present
            assert asset.color == own.color or asset.shape == own.shape
            assert asset.grasps
    assert "cup" not in {s.category for s in cast.look_alikes["c"]}, "a person may call a cup a mug"


@pytest.mark.parametrize(
    ("scenario", "message"),
    [
        (packing(described("a bowling ball", "bowling ball", "x")), "no asset suits 'bowling ball'"),
        (packing(described("a laptop", "laptop", "x", (0.2, 0.4))), "it has no grasp"),
        (packing(described("an apple", "apple", "x"), container="laptop"), "has no region 'inside'"),
        (packing(described("a giant apple", "apple", "x", (0.5, 0.9))), "50 to 90 cm were estimated"),
    ],
)
def test_what_does_not_suit_is_refused_with_the_reason(catalogue: Catalogue, scenario: Scenario, message: str) -> None:
    with pytest.raises(InvalidInputError, match=message):
        cast_of(scenario, catalogue)


@each(
    "query, category, kind",
    [
        ("coffee cup", "mug", "coffee cup"),
        ("glass", "tumbler", "glass"),
        ("drinking glass", "tumbler", "drinking glass"),
        ("soft drink", "drink_cup", "soft drink"),
        ("paper ball", "crumpled_napkin", "paper ball"),
        ("Scotch tape", "tape_roll", "tape"),
        ("tape roll", "tape_roll", "tape"),
        ("red fries box", "fries_box", "fries"),
        ("blue drink cup", "drink_cup", "drink"),
        ("white napkin stack", "napkin_stack", "napkins"),
        ("can", "can", "can"),
        ("napkins", "napkin_stack", "napkins"),
    ],
)
def test_the_noun_of_a_query_is_an_everyday_word_for_what_is_seen(
    catalogue: Catalogue, query: str, category: str, kind: str
) -> None:
    (item,) = cast_of(packing(described(f"a {query}", query, "x", (0.02, 0.25))), catalogue)[0].groups["items"]
    assert (item.category, item.kind) == (category, kind)


@each(
    "query",
    ["banana", "laptop bag", "toy car", "bag of chips", "chips", "computer", "desk", "metal", "wood", "ball", "food",
     "coffee", "apples", "two apples", "pair of mugs", "wine glass", "apple juice"],
)  # fmt: skip
def test_a_query_for_something_else_or_several_is_refused(catalogue: Catalogue, query: str) -> None:
    with pytest.raises(InvalidInputError, match="no asset suits"):
        cast_of(packing(described(f"a {query}", query, "x", (0.02, 0.25))), catalogue)


def test_a_can_and_a_lunchbox_of_one_color_have_different_names(catalogue: Catalogue) -> None:
    can = described("a blue can", "blue can", "can")
    cast, _ = cast_of(packing(can, container="blue lunchbox"), catalogue)
    assert [spec.kind for specs in cast.groups.values() for spec in specs] == ["lunchbox", "can"]


@pytest.mark.parametrize("query", ["takeaway box", "takeout box", "white takeout box"])
def test_the_box_of_fast_food_is_found_by_both_of_its_names(catalogue: Catalogue, query: str) -> None:
    assert catalogue.search(query, limit=1)[0].entry.category == "takeaway_box"
    cast, _ = cast_of(packing(described("a lemon", "lemon", "x"), container=query), catalogue)
    assert cast.one("container").category == "takeaway_box"


def test_a_noun_that_fits_two_objects_gives_way_to_the_longer_one(catalogue: Catalogue) -> None:
    both = packing(described("a blue drink cup", "drink cup", "x"), described("a blue soda can", "soda can", "y"))
    assert [spec.kind for spec in cast_of(both, catalogue)[0].groups["items"]] == ["drink cup", "soda can"]


def test_a_look_alike_does_not_answer_to_the_name_of_an_object(catalogue: Catalogue) -> None:
    cast, _ = cast_of(packing(described("a blue drink", "blue drink cup", "x")), catalogue)
    assert "can" not in {spec.category for spec in cast.look_alikes["x"]}, "a soda can is a drink too"
