"""The list of kinds: what its texts keep to, the kind of a row, and the likeness of a query with a kind."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest

from betterbench.sim.assets.catalogue.entry import CatalogueEntry
from betterbench.sim.assets.catalogue.kind_vectors import HEAD_SHARE, WORDS_SHARE, KindIndex, write_kinds
from betterbench.sim.assets.catalogue.kinds import kind_of, listed_kinds
from betterbench.sim.assets.catalogue.sources import open_source
from betterbench.sim.assets.catalogue.terms import terms
from betterbench.sim.assets.catalogue.vectors import quantized, text_digest

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


@pytest.mark.parametrize(
    ("name", "category", "kind"),
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

    found = index.likeness(asked, head, [])
    for kind, places in ((2, [0, 1, 2]), (4, [3, 4])):
        expected = (1 - HEAD_SHARE) * near(asked[0], places) + HEAD_SHARE * near(head, places)
        assert found[kind] == pytest.approx(expected, abs=0.01)
    assert found[[0, 1, 3]].tolist() == [-1.0] * 3
    further = index.likeness(vectors[[0, 4]], head, [])
    assert further[4] > found[4], "of several descriptions, the nearest one counts"


def test_words_of_the_query_in_the_texts_of_a_kind_count_by_their_rarity(tmp_path):
    kinds = listed_kinds()
    chosen = [next(n for n, kind in enumerate(kinds) if name in kind.names) for name in ("apple", "avocado", "speaker")]
    texts = [(number, text) for number in chosen for text in kinds[number].texts]
    same = quantized(np.ones((len(texts), 16), np.float32) / 4.0)
    digests = np.frombuffer(b"".join(text_digest(text) for _, text in texts), np.uint8).reshape(-1, 16)
    write_kinds(tmp_path, chosen, [number for number, _ in texts], digests, same)
    index = KindIndex(tmp_path, count=3, dimension=16)
    vector = np.ones(16, np.float32) / 4.0
    plain = index.likeness(vector[None], vector, [])[chosen]
    apple, avocado, speaker = index.likeness(vector[None], vector, ["green", "fruit", "guacamole"])[chosen] - plain
    assert avocado == pytest.approx(WORDS_SHARE), "it has every word"
    assert 0.0 < apple < 0.7 * avocado, "it has the frequent words"
    assert speaker == 0.0
    played = index.likeness(vector[None], vector, ["playing", "music"])[chosen] - plain
    assert played.argmax() == 2, "verb forms are one word"
