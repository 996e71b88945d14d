"""The catalogue: indexing that goes on where it stopped, search by words, meaning and filters, and what is damaged."""

from __future__ import annotations

import json
import os
import sqlite3
from dataclasses import replace

import numpy as np
import pytest

from betterbench.errors import InvalidInputError, RecordError, RunConflictError, UnknownNameError
from betterbench.jobs.lock import LOCK_NAME, RunLock
from betterbench.sim.assets.catalogue import indexing, kind_vectors, kinds
from betterbench.sim.assets.catalogue.entry import CatalogueEntry
from betterbench.sim.assets.catalogue.expansion import understood
from betterbench.sim.assets.catalogue.hypernyms import members_named
from betterbench.sim.assets.catalogue.indexing import JOURNAL, index_sources
from betterbench.sim.assets.catalogue.search import Catalogue, Filters
from betterbench.sim.assets.catalogue.sources import SourceItem
from betterbench.sim.assets.catalogue.store import FILE
from betterbench.sim.assets.catalogue.terms import terms
from betterbench.sim.assets.catalogue.variety import choose_different
from betterbench.sim.assets.catalogue.vectors import VectorIndex, columns_of, quantized, write_vectors


class Bag:
    """An encoder without weights: each word has a random direction, and a text is the mean of its words."""

    name = "bag"
    dimension = 64

    def has_word(self, word):
        return word in ("plates", "ceramic", "coffee", "shiny")

    def __init__(self):
        self.texts = []

    def encode(self, texts):
        self.texts += texts
        return np.array([self._vector(text) for text in texts], np.float32)

    def _vector(self, text):
        seeds = [int.from_bytes(word.encode()[:8].ljust(8), "big") for word in terms(text)] or [0]
        total = sum(np.random.default_rng(seed).normal(size=self.dimension) for seed in seeds)
        return total / np.linalg.norm(total)


class Listed:
    """A source of rows that are given."""

    def __init__(self, name, *entries):
        self.name, self.address, self.entries, self.stamp = name, f"folder:/{name}", list(entries), "1"

    def items(self, *, on_skip):
        del on_skip
        for entry in self.entries:
            yield SourceItem(entry.id, f"{self.stamp} {entry!r}", lambda entry=entry: entry)


def thing(name, *, license="CC0-1.0", **more):  # noqa: A002
    return CatalogueEntry(id=f"things/{name.replace(' ', '_')}", source="things", name=name, license=license, **more)


THINGS = [
    thing("red apple", tags=("fruit", "food"), size_m=(0.07, 0.07, 0.06), faces=300, color="red"),
    thing("green apple", tags=("fruit", "food"), size_m=(0.07, 0.07, 0.08), faces=900, color="green"),
    thing("apple pie", tags=("dessert", "food"), faces=500),
    thing("blue mug", description="A coffee mug with a handle", size_m=(0.1, 0.08, 0.09), faces=100, color="blue"),
    thing("white mug", description="A coffee mug with a handle", license="CC-BY-NC-4.0", color="white"),
    thing("french fries", tags=("potato",), license=""),
    thing("dinner plate", tags=("dish", "tableware")),
]


def quiet(*_):
    pass


def index(folder, *sources, encoder=None):
    return index_sources(folder, sources, encoder=encoder, on_progress=quiet)


@pytest.fixture(params=["words", "meaning"])
def catalogue(tmp_path, request):
    bag = Bag()
    index(tmp_path, Listed("things", *THINGS), encoder=bag if request.param == "meaning" else None)
    with Catalogue(tmp_path, encoder=lambda _: bag) as opened:
        assert opened.has_vectors == (request.param == "meaning")
        yield opened


def names(hits):
    return [hit.entry.name for hit in hits]


def test_the_best_fit_comes_first(catalogue):
    assert names(catalogue.search("a shiny red apple"))[:2] == ["red apple", "green apple"]
    assert names(catalogue.search("a blue ceramic coffee mug", limit=1)) == ["blue mug"]
    best, second = (hit.score for hit in catalogue.search("red apple", limit=2))
    assert 1.0 >= best > second >= 0.0
    assert best > 0.7


def test_the_same_query_gives_the_same_answer(catalogue):
    first, second = (catalogue.search("food on a dish", filters=Filters(license="any")) for _ in range(2))
    assert first == second


def test_licenses_that_restrict_or_are_unknown_are_left_out(catalogue):
    assert "white mug" not in names(catalogue.search("white mug"))
    assert "french fries" not in names(catalogue.search("french fries"))
    assert names(catalogue.search("white mug", filters=Filters(license="any")))[0] == "white mug"
    assert names(catalogue.search("chips", filters=Filters(license="any")))[0] == "french fries"


def test_filters_admit_what_they_say(catalogue):
    assert names(catalogue.search("apple", filters=Filters(max_faces=400)))[0] == "red apple"
    assert "green apple" not in names(catalogue.search("apple", filters=Filters(max_faces=400)))
    assert "red apple" not in names(catalogue.search("apple", filters=Filters(min_size_m=0.075)))
    assert "apple pie" not in names(catalogue.search("apple", filters=Filters(max_size_m=1.0)))  # has no size
    with pytest.raises(UnknownNameError, match="thinks"):
        catalogue.search("apple", filters=Filters(source="thinks"))


def test_words_of_the_list_are_found_by_other_words(catalogue):
    assert names(catalogue.search("flat dish for food", limit=1)) == ["dinner plate"]


def test_a_misspelled_name_is_found(catalogue):
    assert names(catalogue.search("dinner plte"))[0] == "dinner plate"
    assert names(catalogue.search("aple pie"))[0] == "apple pie"


def test_a_broader_word_reaches_all_members_and_is_understood_once(tmp_path, monkeypatch):
    fruits = ("apple", "pear", "orange", "lemon", "banana", "cherry", "coconut", "avocado", "mango", "plum")
    rows = [thing(f"{name} {number}") for name in (*fruits, "hammer") for number in range(100)]
    bag, asked = Bag(), []
    index(tmp_path, Listed("things", *rows), encoder=bag)
    monkeypatch.setattr(kind_vectors, "members_named", lambda text: asked.append(text) or members_named(text))
    with Catalogue(tmp_path, encoder=lambda _: bag) as opened:
        assert {hit.entry.name.split()[0] for hit in opened.search("fruit", limit=5)} <= set(fruits)
        assert asked == ["fruit"]
        near = opened._by_meaning(understood("fruit"), Filters(), 5, {})
        assert {rows[number - 1].name.split()[0] for number in near} >= set(fruits)
        assert len(near) < 250, "not every row of every member is compared"
        assert opened.search("fruit", filters=Filters(max_faces=3)) == []


def test_an_empty_or_endless_query_is_refused(catalogue):
    for query in ("", "  ", "x" * 1001):
        with pytest.raises(InvalidInputError, match="query"):
            catalogue.search(query)
    catalogue.search('"*() NEAR AND ; -- \0 ^name:')


def test_a_further_reading_is_searched_like_the_query():
    query = understood("something for breakfast", expander=lambda _: ["a bowl of cereal"])
    assert query.readings == ("something for breakfast", "a bowl of cereal")


@pytest.mark.parametrize(
    ("query", "words"),
    [
        ("trash can", {"trash", "can"}),
        ("a red can", {"red", "can"}),
        ("can opener", {"can", "opener"}),
        ("something that can hold water", {"hold", "water"}),
        ("what can I use to eat", {"eat"}),
        ("it can be stacked", {"stacked"}),
    ],
)
def test_the_noun_can_stays_and_the_verb_goes(query, words):
    assert {word for concept in understood(query).concepts for word in concept.alternatives[0][0]} == words


@pytest.mark.parametrize(
    ("query", "head"),
    [
        ("a bowl for fruit", "a bowl"),
        ("fruit in a bowl", "fruit"),
        ("a slice of cheese for a burger", "a slice of cheese"),
        ("something to drink from", "something to drink"),
        ("for fruit", "for fruit"),
    ],
)
def test_the_head_of_a_query_ends_before_uses_and_attributes(query, head):
    assert understood(query).head == head


def test_an_asset_is_found_by_its_id(catalogue):
    assert catalogue.entry("things/blue_mug") == THINGS[3]
    with pytest.raises(UnknownNameError, match="Did you mean 'things/blue_mug'"):
        catalogue.entry("things/blue_mu")
    assert ("things", "CC0-1.0", 5) in catalogue.licenses()


# ------------------------------------------------------------------------------------------ one description, many


def test_several_assets_for_one_description_differ(catalogue):
    for seed in range(6):
        chosen = choose_different(catalogue, "an apple", 2, seed=seed)
        assert {one.hit.entry.name for one in chosen} == {"red apple", "green apple"}
    assert [one.id for one in choose_different(catalogue, "a red apple", 1)] == ["things/red_apple"]
    with pytest.raises(InvalidInputError, match="1 assets of the catalogue fit 'a red apple', but 2 are requested"):
        choose_different(catalogue, "a red apple", 2)


def test_looks_of_a_row_are_different_assets(tmp_path):
    rows = [thing("mug", color=color, variants=8, category="mug") for color in ("red",)]
    rows.append(thing("blue cup of tea", color="blue", category="mug", variants=8))
    index(tmp_path, Listed("things", *rows))
    with Catalogue(tmp_path) as opened:
        chosen = [one.id for one in choose_different(opened, "a mug", 6, seed=3)]
        again = [one.id for one in choose_different(opened, "a mug", 6, seed=3)]
        other = [one.id for one in choose_different(opened, "a mug", 6, seed=4)]
    assert chosen == again != other
    assert len({one.partition("#")[2] for one in chosen}) == 6
    assert {one.partition("#")[0] for one in chosen[:2]} == {row.id for row in rows}


# --------------------------------------------------------------------------------------------------------------- job


def test_only_what_changed_is_read_and_encoded_again(tmp_path):
    bag, source = Bag(), Listed("things", *THINGS)
    assert index(tmp_path, source, encoder=bag).encoded == len(THINGS)
    source.entries[0] = thing("golden apple")
    del source.entries[1]
    report = index(tmp_path, source, encoder=bag)
    assert (report.added, report.updated, report.removed, report.kept, report.encoded) == (1, 0, 2, 5, 1)
    assert not (tmp_path / JOURNAL).exists()
    with Catalogue(tmp_path, encoder=lambda _: bag) as opened:
        assert names(opened.search("golden apple", words=False))[0] == "golden apple"


def test_a_killed_job_goes_on_where_it_stopped(tmp_path, monkeypatch):
    monkeypatch.setattr(indexing, "_BATCH", 2)
    whole, source = Bag(), Listed("things", *THINGS)
    index(tmp_path / "whole", source, encoder=whole)

    class Dies(Bag):
        def encode(self, texts):
            if len(self.texts) >= 4:
                raise KeyboardInterrupt
            return super().encode(texts)

    with pytest.raises(KeyboardInterrupt):
        index(tmp_path / "killed", source, encoder=Dies())
    with pytest.raises(InvalidInputError, match=r"its indexing is still running.*Run `better assets index` again"):
        Catalogue(tmp_path / "killed")
    with (tmp_path / "killed" / JOURNAL).open("ab") as journal:
        journal.write(b"half a line")
    rest = Bag()
    report = index(tmp_path / "killed", source, encoder=rest)
    assert (report.kept, report.encoded) == (7, 3)
    assert not set(rest.texts[3:]) & {entry.text for entry in THINGS}, "only texts of kinds come after the assets"
    for file in (tmp_path / "whole").glob("*.npy"):
        assert file.read_bytes() == (tmp_path / "killed" / file.name).read_bytes(), file.name


def test_a_catalogue_of_older_lists_is_searched_and_gets_the_new_texts(tmp_path, monkeypatch):
    listed = kinds.listed_kinds()
    older = tuple(replace(kind, descriptions=("an older text",)) for kind in listed)
    bag = Bag()
    with monkeypatch.context() as patched:
        patched.setattr(indexing, "listed_kinds", lambda: older)
        index(tmp_path, Listed("things", *THINGS), encoder=bag)
    with Catalogue(tmp_path, encoder=lambda _: bag) as opened:
        assert names(opened.search("red apple", limit=1)) == ["red apple"]
        assert names(opened.search("fruit for cider", limit=1))[0].endswith("apple")
    assert index(tmp_path, Listed("things", *THINGS), encoder=bag).kept == len(THINGS)
    texts = listed[kinds.number_of("apple")].texts
    assert set(texts) <= set(bag.texts), "the new texts are encoded, although no row has changed"


def test_vectors_of_another_encoder_are_made_again(tmp_path):
    class Other(Bag):
        name, dimension = "other", 32

    index(tmp_path, Listed("things", *THINGS), encoder=Bag())
    other = Other()
    assert index(tmp_path, Listed("things", *THINGS), encoder=other).encoded == len(THINGS)
    with Catalogue(tmp_path, encoder=lambda name: {"other": other}[name]) as opened:
        assert names(opened.search("dinner plate dish tableware", words=False))[0] == "dinner plate"


def test_sources_keep_to_themselves(tmp_path):
    index(tmp_path, Listed("things", *THINGS))
    index(tmp_path, Listed("others", CatalogueEntry(id="others/x", source="others", name="spoon", license="MIT")))
    with Catalogue(tmp_path) as opened:
        assert (opened.count, opened.sources) == (8, ("things", "others"))
        assert names(opened.search("spoon", filters=Filters(source="others"))) == ["spoon"]
    elsewhere = Listed("things")
    elsewhere.address = "folder:/elsewhere"
    with pytest.raises(InvalidInputError, match=r"the catalogue already uses this name for folder:/things.*--name"):
        index(tmp_path, elsewhere)


def test_two_jobs_do_not_write_one_catalogue(tmp_path):
    with RunLock(tmp_path / LOCK_NAME), pytest.raises(RunConflictError, match="is writing here"):
        index(tmp_path, Listed("things"))


# ------------------------------------------------------------------------------------------------------------- damage


def spoil_version(folder):
    database = sqlite3.connect(folder / FILE)
    database.execute("PRAGMA user_version = 99")
    database.commit()


def spoil_application(folder):
    (folder / FILE).unlink()
    database = sqlite3.connect(folder / FILE)
    database.execute("CREATE TABLE t (x)")
    database.commit()


def spoil_tables(folder):
    database = sqlite3.connect(folder / FILE)
    database.execute("DROP TABLE facts")
    database.commit()


def spoil_pipe(folder):
    (folder / "scales.npy").unlink()
    os.mkfifo(folder / "scales.npy")


def npy(header):
    return b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header.encode()


HUGE = "{'descr': '<i2', 'fortran_order': False, 'shape': (10000000000000,)}"
"""Header of an array of 20 TB, as the NumPy file states it."""


def spoil_view(folder):
    database = sqlite3.connect(folder / FILE)
    database.execute("ALTER TABLE facts RENAME TO f")
    database.execute(
        "CREATE VIEW facts AS WITH RECURSIVE r(n) AS (SELECT 1 UNION ALL SELECT n + 1 FROM r) SELECT f.* FROM f, r"
    )
    database.commit()


SPOILT = {
    "text": (lambda folder: (folder / FILE).write_bytes(b"no database" * 99), "not an asset catalogue"),
    "foreign": (spoil_application, "is not an asset catalogue"),
    "version": (spoil_version, "is a version 99 catalogue, but version 3 is expected"),
    "tables": (spoil_tables, "is damaged"),
    "view": (spoil_view, "is not an asset catalogue"),
    "cut": (lambda folder: (folder / "vectors.npy").write_bytes(b"\x93NUMPY\x01\x00"), "vectors.npy cannot be read"),
    "other": (lambda folder: np.save(folder / "faces.npy", np.zeros(3)), "faces.npy does not contain"),
    "kinds cut": (lambda folder: np.save(folder / "kinds.npy", np.zeros(3, np.int16)), "kinds.npy has 3 rows"),
    "kinds unknown": (
        lambda folder: np.save(folder / "kinds.npy", np.full(7, 999, np.int16)),
        "kinds that have no texts",
    ),
    "kind texts": (lambda folder: np.save(folder / "kind_texts.npy", np.zeros(3)), "kind_texts.npy does not contain"),
    "missing": (lambda folder: (folder / "sketches.npy").unlink(), "sketches.npy cannot be read"),
    "pipe": (spoil_pipe, "scales.npy cannot be read"),
    "zip": (lambda folder: (folder / "vectors.npy").write_bytes(b"PK\x03\x04"), "vectors.npy cannot be read"),
    "brackets": (lambda folder: (folder / "kinds.npy").write_bytes(npy("((((")), "kinds.npy cannot be read"),
    "huge": (lambda folder: (folder / "kinds.npy").write_bytes(npy(HUGE)), "kinds.npy cannot be read"),
}


@pytest.mark.parametrize("kind", SPOILT)
def test_a_damaged_catalogue_is_one_clear_error(tmp_path, kind):
    bag = Bag()
    index(tmp_path, Listed("things", *THINGS), encoder=bag)
    spoil, text = SPOILT[kind]
    spoil(tmp_path)
    with pytest.raises(RecordError, match=text) as caught:
        Catalogue(tmp_path, encoder=lambda _: bag)
    assert "index the sources again" in str(caught.value) or "Use a different folder" in str(caught.value)


def test_without_a_catalogue_the_command_is_named(tmp_path):
    with pytest.raises(InvalidInputError, match=r"it has no asset catalogue\. Run `better assets index`"):
        Catalogue(tmp_path)


# ------------------------------------------------------------------------------------------------------------ vectors


def test_sketches_find_what_a_search_of_all_vectors_finds(tmp_path, monkeypatch):
    """Clustered vectors, as those of texts are: nearly all of the ten nearest are the same."""
    rng = np.random.default_rng(0)
    count, dimension = 30_000, 128
    centers = rng.normal(size=(300, dimension))
    vectors = centers[rng.integers(300, size=count)] + 0.7 * rng.normal(size=(count, dimension))
    vectors = (vectors / np.linalg.norm(vectors, axis=1, keepdims=True)).astype(np.float32)
    small, scales = quantized(vectors)
    assert np.abs(small * scales[:, None] - vectors).max() < 0.003
    columns = columns_of([(row, row % 3, 1, row, 0.1) for row in range(count)])
    blocks = [(small, scales, np.zeros((count, 16), np.uint8))]
    write_vectors(tmp_path, columns, blocks, dimension)
    index = VectorIndex(tmp_path, count=count, dimension=dimension)
    allowed = columns.licenses == 0
    shared, right = 0, 0
    for query in vectors[:40]:
        exact, cosines = index.nearest(query[None], allowed, 10, exact=True)
        found, _ = index.nearest(query[None], allowed, 10)
        assert allowed[found].all()
        shared += len(set(exact.tolist()) & set(found.tolist()))
        best = np.argsort(-(vectors @ query) - 9.0 * allowed)[:10]
        right += len(set(exact.tolist()) & set(best.tolist()))
        assert (np.diff(cosines) <= 0.0).all()
    index.close()
    assert shared >= 0.97 * 400
    assert right >= 0.97 * 400


def test_a_row_is_a_json_document(catalogue):
    form = catalogue.search("blue mug", limit=1)[0].to_json()
    assert json.loads(json.dumps(form))["license_kind"] == "free"
    assert form["size_m"] == [0.1, 0.08, 0.09]
