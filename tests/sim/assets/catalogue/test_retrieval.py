"""Labeled queries over the procedural library and 122 mesh files: the half that tuned the search does not test it.

The files are stand-ins of the same names, because a catalogue knows of a mesh what its name says.
"""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from betterbench.errors import MissingDependencyError
from betterbench.sim.assets.catalogue.encoders import open_encoder
from betterbench.sim.assets.catalogue.indexing import index_sources
from betterbench.sim.assets.catalogue.search import Catalogue
from betterbench.sim.assets.catalogue.sources import SourceOptions, open_source
from betterbench.sim.assets.catalogue.variety import choose_different

pytestmark = pytest.mark.slow

DATA = Path(__file__).parent / "data"
NEW_QUERIES = json.loads((DATA / "new_queries.json").read_text(encoding="utf-8"))
"""Queries by an author who had not seen the word list, halved by a seed."""
HELD_OUT = json.loads((DATA / "held_out_queries.json").read_text(encoding="utf-8"))
"""Queries written before the errors of the search were looked at; they then chose the weight of the words of kinds."""
FOURTH = json.loads((DATA / "fourth_queries.json").read_text(encoding="utf-8"))
"""Queries written before any search was run on them; their errors then showed the need for varieties and uses."""
FIFTH = json.loads((DATA / "fifth_queries.json").read_text(encoding="utf-8"))
"""Queries frozen before any search was run on them; measured once before their errors led to more statements of use."""
BROADER = json.loads((DATA / "broader_queries.json").read_text(encoding="utf-8"))
"""Queries with broader words and containers, written before any search was run on them; a hash determines the half."""
SIXTH = json.loads((DATA / "sixth_queries.json").read_text(encoding="utf-8"))
"""Paraphrases, attributes and categories by an author who had seen no list and no set; measured once before the broader
words were added."""
SEVENTH = json.loads((DATA / "seventh_queries.json").read_text(encoding="utf-8"))
"""The same by another author, measured once before its errors led to attributes, names and uses."""
EIGHTH = json.loads((DATA / "eighth_queries.json").read_text(encoding="utf-8"))
"""The same by another author, measured once with the present search."""
QUERIES = json.loads((DATA / "queries.json").read_text(encoding="utf-8"))
MESHES = json.loads((DATA / "meshes.json").read_text(encoding="utf-8"))
GENERATED = {row["category"]: row["categories"] for row in json.loads((DATA / "generated.json").read_text())}
BY_FILE = {f"{row['source']}/{row['file']}": row["categories"] for row in MESHES}
EMPTY_GLB = b"glTF\x02\x00\x00\x00\x18\x00\x00\x00\x04\x00\x00\x00JSON{}  "


@pytest.mark.parametrize("queries", [QUERIES, NEW_QUERIES], ids=["first", "new"])
def test_the_labels_are_enough_and_split(queries):
    halves = [row["half"] for row in queries]
    assert len(queries) >= 200
    assert len({row["query"] for row in queries}) == len(queries)
    assert min(halves.count("tune"), halves.count("test")) >= 100


def test_the_sets_share_no_query():
    every = [
        row["query"].lower()
        for row in (*QUERIES, *NEW_QUERIES, *HELD_OUT, *FOURTH, *FIFTH, *BROADER, *SIXTH, *SEVENTH, *EIGHTH)
    ]
    assert len(HELD_OUT) == 120
    assert len(FOURTH) == 154
    assert len(FIFTH) == 150
    assert len(set(every)) == len(every)
    labels = {name for row in MESHES for name in row["categories"]} | {n for names in GENERATED.values() for n in names}
    assert {
        name for row in (*HELD_OUT, *FOURTH, *FIFTH, *BROADER, *SIXTH, *SEVENTH, *EIGHTH) for name in row["categories"]
    } <= labels


@pytest.fixture(scope="module", params=["words", "meaning"])
def catalogue(request, tmp_path_factory):
    encoder = None
    if request.param == "meaning":
        try:
            encoder = open_encoder()
        except MissingDependencyError as error:
            pytest.skip(str(error))
    folder = tmp_path_factory.mktemp("retrieval")
    for row in MESHES:
        file = folder / row["source"] / row["file"]
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_bytes(EMPTY_GLB if file.suffix == ".glb" else b"v 0 0 0\nv 1 0 0\nv 0 1 1\nf 1 2 3\n")
    sources = [open_source("procedural")]
    sources += [
        open_source(str(folder / name), SourceOptions(name=name, license="cc0")) for name in ("kenney_food", "ycb")
    ]
    report = index_sources(folder / "catalogue", sources, encoder=encoder, on_progress=lambda *_: None)
    assert (report.skipped, report.total) == (0, 122 + sum(1 for _ in sources[0].items(on_skip=print)))
    with Catalogue(folder / "catalogue", encoder=lambda _: encoder) as opened:
        yield opened


def categories(entry):
    return set(GENERATED[entry.category] if entry.source == "procedural" else BY_FILE[entry.id])


def shares(catalogue, asked):
    """Return the shares of queries whose first answer, and whose first five answers, have a right category."""
    first = fifth = 0
    for row in asked:
        hits = catalogue.search(row["query"], limit=5)
        right = [bool(categories(hit.entry) & set(row["categories"])) for hit in hits]
        first += bool(right) and right[0]
        fifth += any(right)
    return first / len(asked), fifth / len(asked)


def test_the_half_that_did_not_tune_is_answered(catalogue):
    first, fifth = shares(catalogue, [row for row in QUERIES if row["half"] == "test"])
    assert first >= (0.97 if catalogue.has_vectors else 0.94)
    assert fifth >= (0.98 if catalogue.has_vectors else 0.95)


def test_queries_of_another_author_are_answered(catalogue):
    """Precision@1 was 0.907 before rows had kinds with descriptions; the goal is 0.95."""
    first, fifth = shares(catalogue, [row for row in NEW_QUERIES if row["half"] == "test"])
    assert first >= (0.97 if catalogue.has_vectors else 0.77)
    assert fifth >= (0.98 if catalogue.has_vectors else 0.83)


def test_queries_of_the_third_set_are_answered(catalogue):
    """Precision@1 was 0.942 before words of the kinds counted; these queries chose their weight."""
    first, fifth = shares(catalogue, HELD_OUT)
    assert first >= (0.97 if catalogue.has_vectors else 0.70)
    assert fifth >= (0.98 if catalogue.has_vectors else 0.77)


def test_queries_of_the_fourth_set_are_answered(catalogue):
    """Precision@1 was 0.844 before varieties and uses were listed; these queries showed the need for the lists."""
    if not catalogue.has_vectors:
        pytest.skip("the set was measured by words and meaning only")
    first, fifth = shares(catalogue, FOURTH)
    assert first >= 0.97
    assert fifth >= 0.98


@pytest.mark.parametrize(("half", "least"), [("tune", 0.97), ("test", 0.97)])
def test_broader_words_are_answered(catalogue, half, least):
    """Precision@1 was 52 of 68 and 47 of 58 before broader words were listed."""
    if not catalogue.has_vectors:
        pytest.skip("the set was measured by words and meaning only")
    first, fifth = shares(catalogue, [row for row in BROADER if row["half"] == half])
    assert first >= least
    assert fifth >= 0.98


def test_queries_of_the_fifth_set_are_answered(catalogue):
    """Precision@1 was 0.720 before its errors were looked at; docs/asset-catalogue.md has the numbers."""
    if not catalogue.has_vectors:
        pytest.skip("the set was measured by words and meaning only")
    first, fifth = shares(catalogue, FIFTH)
    assert first >= 0.90
    assert fifth >= 0.95


@pytest.mark.parametrize("query", ["cutery", "a keybord", "spon", "bannana"])
def test_a_misspelled_name_is_answered(catalogue, query):
    (best,) = catalogue.search(query, limit=1)
    assert categories(best.entry) & {"cutlery", "keyboard", "spoon", "banana"}


@pytest.mark.parametrize(
    ("description", "kind", "color"),
    [
        ("A shiny red apple", "apple", "red"),
        ("A blue ceramic coffee mug", "mug", "blue"),
        ("A full, unopened can of soda", "can", ""),
    ],
)
def test_a_description_of_the_paper_gives_different_assets(catalogue, description, kind, color):
    (best,) = catalogue.search(description, limit=1)
    assert kind in categories(best.entry)
    chosen = choose_different(catalogue, description, 3, seed=1)
    assert len({one.id for one in chosen}) == 3
    assert all(kind in categories(one.hit.entry) for one in chosen)
    if color:
        assert {one.hit.entry.color for one in chosen} == {color}
    else:
        assert len({one.hit.entry.color for one in chosen}) == 3


@pytest.mark.parametrize(
    ("queries", "least"),
    [(SIXTH, (0.98, 0.99)), (SEVENTH, (0.97, 0.99)), (EIGHTH, (0.96, 0.98))],
    ids=["sixth", "seventh", "eighth"],
)
def test_paraphrases_attributes_and_categories_by_new_authors_are_answered(catalogue, queries, least):
    """Precision@1 of the seventh set was 0.905 before its errors were looked at; the eighth set was measured once."""
    if not catalogue.has_vectors:
        pytest.skip("the sets were measured by words and meaning only")
    assert len(queries) >= 160
    first, fifth = shares(catalogue, queries)
    assert first >= least[0]
    assert fifth >= least[1]
