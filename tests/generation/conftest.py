"""Catalogue of the library, indexed once for all tests of generation and searched by words."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from betterbench.sim.assets.catalogue.indexing import index_sources
from betterbench.sim.assets.catalogue.search import Catalogue
from betterbench.sim.assets.catalogue.sources import open_source
from betterbench.sim.assets.catalogue.sources.source import SourceOptions


@pytest.fixture(scope="session")
def catalogue(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Catalogue]:
    folder = tmp_path_factory.mktemp("catalogue")
    index_sources(folder, [open_source("procedural", SourceOptions())], on_progress=lambda *_: None)
    with Catalogue(folder) as opened:
        yield opened
