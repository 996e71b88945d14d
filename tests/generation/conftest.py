"""Catalogue of the library, indexed once for all tests of generation and searched by words."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest

from betterbench.generation.building import job as building_job
from betterbench.generation.growth import job as growth_job
from betterbench.sim.assets.catalogue.search import Catalogue


@pytest.fixture(scope="session")
def library(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("library")
    building_job.index_library(folder)
    return folder / building_job.CATALOGUE


@pytest.fixture(scope="session")
def catalogue(library: Path) -> Iterator[Catalogue]:
    with Catalogue(library) as opened:
        yield opened


@pytest.fixture
def indexed_once(library: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Lets builds begin with a copy of the library's catalogue, which is the same in every new folder."""
    real = building_job.index_library

    def index(out: Path) -> None:
        if (out / building_job.CATALOGUE).exists():
            real(out)
        else:
            shutil.copytree(library, out / building_job.CATALOGUE)

    for module in (building_job, growth_job):
        monkeypatch.setattr(module, "index_library", index)
