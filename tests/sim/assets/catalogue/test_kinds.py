"""The list of kinds: what its texts keep to, the kind of a row, and the likeness of a query with a kind."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest
from tests.looping import each

from betterbench.sim.assets.catalogue.entry import CatalogueEntry
from betterbench.sim.assets.catalogue.expansion import COLORS, understood, variety_list
from betterbench.sim.assets.catalogue.kind_vectors import (
    BESIDE_LOSS,
    HEAD_SHARE,
    LACKED_LOSS,
    NAME_SHARE,
    ROLE_SHARE,
    USE_LOSS,
    VARIETY_SHARE,
    WORDS_SHARE,
    KindIndex,
    write_kinds,
)
from betterbench.sim.assets.catalogue.kinds import kind_of, listed_kinds, number_of
from betterbench.sim.assets.catalogue.sources import open_source
from betterbench.sim.assets.catalogue.terms import terms
from betterbench.sim.assets.catalogue.vectors import quantized, text_digest

PLAIN = understood("")
NEGATIONS = {"not", "no", "never", "without", "unlike"}


def row(name, category=""):
    return CatalogueEntry(id="x", source="x", name=name, category=category)


def named(entry):
    number = kind_of(entry)
    return None if number < 0 else listed_kinds()[number].names[0]


def test_each_kind_has_its_own_names_and_descriptions_without_negations():
    kinds = listed_kinds()
    assert len(kinds) >= 250
    counts = Counter(frozenset(tuple(terms(name)) for name in kind.names) for kind in kinds)
    assert max(counts.values()) == 1
    first = Counter(tuple(terms(kind.names[0])) for kind in kinds)
    assert max(first.values()) == 1
    for kind in kinds:
        assert kind.descriptions, kind
        assert not NEGATIONS & {word for text in kind.descriptions for word in terms(text)}, kind


@each(
    "name, category, kind",
    [
        ("coffee mug", "", "mug"),
        ("apple pie", "", "pie"),
        ("mug with an apple", "", "mug"),
        ("cup of tea", "", "cup"),
        ("orange mug", "", "mug"),
        ("mug orange", "", "mug"),
        ("orange", "", "orange"),
        ("Kitchen knives", "", "cooking knife"),
        ("plain object", "soap_bar", "soap"),
        ("dodecahedron", "", None),
    ],
)
def test_the_kind_of_a_row_is_the_noun_that_names_it(name, category, kind):
    assert named(row(name, category)) == kind


def test_every_generated_asset_has_a_kind():
    items = open_source("procedural").items(on_skip=print)
    names = {item.id.removeprefix("procedural/").rpartition("-")[0] for item in items}
    assert [name for name in sorted(names) if kind_of(row("", name)) < 0] == []


def test_likeness_counts_the_two_nearest_texts_and_the_head(tmp_path):
    rng = np.random.default_rng(3)
    vectors = rng.normal(size=(5, 16))
    vectors /= np.linalg.norm(vectors, axis=1, keepdims=True)
    small, scales = quantized(vectors.astype(np.float32))
    kinds = [2, 2, 2, 4, 4]
    write_kinds(tmp_path, [2, -1, 4, 2], kinds, np.zeros((5, 16), np.uint8), (small, scales))
    index = KindIndex(tmp_path, count=4, dimension=16)
    assert index.places(2).tolist() == [0, 3]
    assert index.places(4).tolist() == [2]
    asked, head = vectors[:1], vectors[3]

    def near(vector, places):
        return np.mean(sorted(vectors[places] @ vector)[-2:])

    found = index.likeness(asked, head, PLAIN)
    for kind, places in ((2, [0, 1, 2]), (4, [3, 4])):
        expected = (1 - HEAD_SHARE) * near(asked[0], places) + HEAD_SHARE * near(head, places)
        assert found[kind] == pytest.approx(expected, abs=0.01)
    assert found[[0, 1, 3]].tolist() == [-1.0] * 3
    further = index.likeness(vectors[[0, 4]], head, PLAIN)
    assert further[4] > found[4], "of several descriptions, the nearest one counts"


CHOSEN = [number_of(name) for name in ("apple", "avocado", "speaker")]
VECTOR = np.ones(16, np.float32) / 4.0


def likeness(index, query):
    """Return the similarity of apple, avocado and speaker, if all texts have the vector of the query."""
    return index.likeness(VECTOR[None], VECTOR, understood(query))[CHOSEN]


@pytest.fixture
def index(tmp_path):
    texts = [(number, text) for number in CHOSEN for text in listed_kinds()[number].texts]
    same = quantized(np.ones((len(texts), 16), np.float32) / 4.0)
    digests = np.frombuffer(b"".join(text_digest(text) for _, text in texts), np.uint8).reshape(-1, 16)
    write_kinds(tmp_path, CHOSEN, [number for number, _ in texts], digests, same)
    return KindIndex(tmp_path, count=3, dimension=16)


def test_words_of_the_query_in_the_texts_of_a_kind_count_by_their_rarity(index):
    plain = likeness(index, "")
    apple, avocado, speaker = likeness(index, "green fruit guacamole") - plain
    assert avocado == pytest.approx(WORDS_SHARE), "it has every word"
    assert 0.0 < apple < 0.7 * avocado, "it has the frequent words"
    assert speaker == 0.0
    played = likeness(index, "playing music") - plain
    assert played.argmax() == 2, "verb forms are one word"


def test_a_variety_that_names_the_object_stands_for_its_kind(index):
    plain = likeness(index, "")
    for query, kind in (("granny smith", 0), ("two ripe braeburns in a bowl", 0), ("hass", 1), ("jbl for my room", 2)):
        gained = likeness(index, query) - plain
        assert gained.argmax() == kind, query
        assert gained[kind] > VARIETY_SHARE * 0.19, query
        assert likeness(index, query)[kind] <= 1.0 + WORDS_SHARE
    before_a_noun = likeness(index, "braeburn tart") - plain
    assert 0.0 < before_a_noun[0] < (likeness(index, "braeburn") - plain)[0], "a tart may be meant"
    of_a_use = understood("it keeps granny smiths fresh")
    assert of_a_use.kinds == {}, "the object is another one"
    assert likeness(index, "nespresso").tolist() == plain.tolist(), "no row has the kind"


def test_another_object_of_the_use_is_not_meant(index):
    plain = likeness(index, "zzz")
    for query in ("you bite it like an apple", "zzz for apples", "you cut an apple with it"):
        assert understood(query).beside, query
    lost = likeness(index, "zzz for apples") - plain
    in_a_use = likeness(index, "you zzz apples") - plain
    assert lost[0] == pytest.approx(WORDS_SHARE - BESIDE_LOSS)
    assert in_a_use[0] == pytest.approx(WORDS_SHARE - USE_LOSS)
    assert understood("it is an apple").beside == ()
    assert understood("a slice of apple").beside == ()


def test_the_noun_of_a_query_raises_its_kind(index):
    plain, named = likeness(index, "zzz"), likeness(index, "zzz apple with an avocado")
    without = plain[0] + WORDS_SHARE * (named[1] - plain[1] + BESIDE_LOSS) / WORDS_SHARE
    assert named[0] > without, "the other fruit is no noun of the query"
    alone = likeness(index, "zzz apple")
    before = plain[0] + WORDS_SHARE
    assert alone[0] == pytest.approx(before + NAME_SHARE * (1.0 + WORDS_SHARE - before))


def test_words_of_a_use_count_more_where_the_object_has_the_same_role(index):
    tool, vessel = likeness(index, "zzz music on it"), likeness(index, "zzz music from it")
    on = [text for text in listed_kinds()[CHOSEN[2]].texts if {"music", "on"} <= set(terms(text))]
    assert on == []
    assert vessel[2] - tool[2] == pytest.approx(ROLE_SHARE), "hear music from it"
    assert vessel[:2].tolist() == tool[:2].tolist()


def test_a_member_that_has_what_the_object_lacks_comes_last(index):
    apple, avocado, _ = likeness(index, "fruit without a pit") - likeness(index, "fruit")
    assert apple == pytest.approx(0.0)
    assert avocado == pytest.approx(-LACKED_LOSS)


def test_each_kind_of_the_library_has_statements_of_use():
    items = open_source("procedural").items(on_skip=print)
    of_categories = {item.id.rpartition("-")[0]: item for item in items}  # the color does not change the kind
    entries = [item.read() for item in of_categories.values()]
    few = {kind_of(entry): len(listed_kinds()[kind_of(entry)].descriptions) for entry in entries}
    assert min(few.values()) >= 10, [listed_kinds()[kind].names[0] for kind, count in few.items() if count < 10]


def test_the_lists_name_kinds_and_repeat_no_name():
    names = {tuple(terms(name)) for kind in listed_kinds() for name in kind.names}
    varieties = variety_list()
    assert len(varieties) > 1_200
    for kinds in varieties.values():
        assert len(set(kinds)) == len(kinds)
        assert all(number_of(kind) >= 0 for kind in kinds)
    assert not names & set(varieties), "the name of a kind needs no line"
    plain = [v for v, kinds in varieties.items() if v[0] in COLORS and " ".join(v[1:]) in kinds]
    assert not plain, "as a variety, such a phrase would stand for the kind in any color"
    assert () not in varieties
