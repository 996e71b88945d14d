"""A small run and a small set: few trials, few frames, small images."""

from __future__ import annotations

from contextlib import nullcontext

import pytest
from tests.vqa.small import OPTIONS, SIZE, small_run

from betterbench.evaluation.figures.views import ViewRenderer
from betterbench.vqa.dataset import make_set


@pytest.fixture(scope="session")
def run(tmp_path_factory):
    return small_run("expert", tmp_path_factory.mktemp("vqa") / "run")


@pytest.fixture(scope="session")
def source(run):
    """One process that draws for all tests: to start one takes longer than to draw a set."""
    with ViewRenderer(run, size=SIZE, quality="fast") as source:
        yield source


@pytest.fixture(scope="session")
def photos(source):
    return lambda: nullcontext(source)


@pytest.fixture(scope="session")
def made(run, photos, tmp_path_factory):
    return make_set(run, tmp_path_factory.mktemp("vqa") / "set", OPTIONS, open_photos=photos)
