"""The way from written files to an audit."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import pytest

from betterbench.cli.yaml_file import read_yaml
from betterbench.generation.better_release import (
    Imported,
    audit_release,
    build_task,
    find_tasks,
    match_instances,
    read_release_task,
    resolve,
)


def read(folder: Path):
    reader = partial(read_yaml, cure="Correct the file", deepest=8, max_bytes=512 * 1024)
    return read_release_task(find_tasks(folder)[0], reader)


@pytest.fixture
def imported(catalogue):
    def make(folder: Path, **given: str) -> Imported:
        release = read(folder)
        resolved = resolve(release)
        matches = match_instances(release, catalogue, given=given)
        built = build_task(release, resolved, matches)
        return Imported(release, resolved, matches, built, audit_release(release, resolved, matches, built))

    return make


@pytest.fixture
def reading():
    return read
