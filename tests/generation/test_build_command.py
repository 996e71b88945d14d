"""Files and options of ``better build`` are checked before a task is built."""

from __future__ import annotations

import copy
import functools
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from betterbench.cli.border import guarded
from betterbench.cli.build_options import BuildOptions
from betterbench.cli.verbs import build as verb
from betterbench.cli.verbs.build import PAGE, build_command, read_scenarios
from betterbench.errors import InvalidInputError, UnknownNameError
from betterbench.generation.building import job
from betterbench.generation.building.result import BuildReport
from betterbench.generation.grammar import write_scenarios
from betterbench.generation.scenario_form import scenario_to_json


@functools.cache
def packing() -> dict[str, Any]:
    return scenario_to_json(write_scenarios("loose_packing", 1, seed=0)[0])


def written(folder: Path, name: str, **changes: object) -> Path:
    path = folder / name
    path.write_text(json.dumps({**copy.deepcopy(packing()), **changes}))
    return path


def groups(**changes: object) -> dict[str, object]:
    return {key: value for key, value in {**packing()["instantiation"], **changes}.items() if value is not None}


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        (lambda items: {"ghosts": items}, "Unknown group 'ghosts'"),
        (lambda _: {"container": None}, "instantiation.container: has 0 objects"),
        (lambda _: {"items": []}, "instantiation.items: has 0 objects"),
        (lambda items: {"items": [items[0], items[0], items[1]]}, "is also the name of instantiation.items[0]"),
    ],
)
def test_objects_that_the_template_cannot_use_are_named_with_the_file(
    tmp_path: Path, changed: Callable[[Any], dict[str, object]], said: str
) -> None:
    instantiation = groups(**changed(packing()["instantiation"]["items"]))
    path = written(tmp_path, "001_packing.json", instantiation=instantiation)
    with pytest.raises(InvalidInputError) as caught:
        read_scenarios([path])
    assert str(caught.value).startswith(f"{path}: ")
    assert said in str(caught.value)


def test_an_unknown_template_is_named_with_the_file(tmp_path: Path) -> None:
    path = written(tmp_path, "001_packing.json", template="loose_pack")
    with pytest.raises(UnknownNameError, match="Did you mean 'loose_packing'") as caught:
        read_scenarios([path])
    assert str(path) in str(caught.value)


def test_a_version_that_is_a_boolean_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InvalidInputError, match="schema_version"):
        read_scenarios([written(tmp_path, "001_packing.json", schema_version=True)])


def test_scenarios_are_in_the_order_of_their_numbers(tmp_path: Path) -> None:
    numbers = (2, 999, 1000, 1001)
    for number in numbers:
        written(tmp_path, f"{number:03d}_packing.json", scenario_name=f"Number {number}")
    written(tmp_path, "notes.json", scenario_name="Notes")
    assert [s.name for s in read_scenarios([tmp_path])] == [*(f"Number {n}" for n in numbers), "Notes"]


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"power": -1}, "--power: -1"),
        ({"workers": 0}, "--workers: 0"),
        ({"workers": -1}, "--workers: -1"),
        ({"workers": 300}, "--workers: 300"),
        ({"seeds": 0}, "--seeds: 0"),
        ({"demonstrations": 0}, "--demonstrations: 0"),
        ({"name": "My Suite"}, "--name: 'My Suite'"),
        ({"name": "../up"}, "--name: '../up'"),
        ({"name": "kitchen\n"}, "--name: 'kitchen"),
    ],
)
def test_wrong_options_are_refused_before_the_folder_is_made(tmp_path: Path, options, said: str) -> None:
    path = written(tmp_path, "001_packing.json")
    with pytest.raises(InvalidInputError) as caught:
        guarded(build_command)((path,), out=tmp_path / "out", build=BuildOptions(**options))
    assert said in str(caught.value)
    assert not (tmp_path / "out").exists()


def test_the_page_is_there_while_the_power_is_measured(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It takes hours for a large suite; after an interruption, the page and the cards exist."""
    out = tmp_path / "out"
    monkeypatch.setattr(job, "build_suite", lambda *_, **__: BuildReport((), out / "generated-0123456789ab"))
    monkeypatch.setattr(verb, "draw_cards", lambda *_: {})

    def stopped(*_: object) -> None:
        assert "Suite generated-0123456789ab" in (out / PAGE).read_text()
        raise KeyboardInterrupt

    monkeypatch.setattr(verb, "power_of_suite", stopped)
    with pytest.raises(KeyboardInterrupt):
        build_command((written(tmp_path, "001_packing.json"),), out=out, build=BuildOptions(power=1))
