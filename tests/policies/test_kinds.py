"""Laws of the register of policy kinds: it alone knows what an address begins with."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

import betterbench
import betterbench_calibration
from betterbench.errors import InvalidInputError, UnknownNameError
from betterbench.policies.address import AddressForm, Option
from betterbench.policies.kinds import (
    KINDS,
    PolicyKind,
    PolicyNeeds,
    find_kind,
    kind_of,
    known_policies,
    make_policy,
    needs_of,
    read_address,
    register,
)
from betterbench.policies.kinds.kind import AT_ONCE
from betterbench.records.naming import built_in_names

EACH_KIND = pytest.mark.parametrize("kind", KINDS.values(), ids=KINDS)
KINDS_FOLDER = Path(betterbench.__path__[0]) / "policies" / "kinds"


@EACH_KIND
def test_an_address_belongs_to_one_kind(kind):
    address = f"{kind.name}:x" if kind.form.target == "required" else kind.name
    assert kind_of(address) is kind
    assert [other for other in KINDS.values() if other.form.has(address)] == [kind]


@pytest.mark.parametrize("entry", known_policies(), ids=lambda entry: entry.address)
def test_a_listed_address_is_found_by_its_kind(entry):
    kind = kind_of(entry.address)
    assert entry in kind.entries()
    if kind.named is not None or kind.form.target == "none":
        assert read_address(entry.address).name == entry.address


@EACH_KIND
def test_the_example_of_a_message_is_accepted(kind):
    found = kind_of(kind.form.example)
    assert found is kind or kind.name == "grpc", "LeRobot's own server is refused, and its checkpoint advised"
    if kind.name != "independent":  # whose names are in its distribution
        found.parse(kind.form.example.replace("FILE.py:CLASS", "mine.py:Mine"))


@EACH_KIND
def test_a_kind_makes_its_policies_in_one_way_for_each_need(kind):
    for needs in (AT_ONCE, PolicyNeeds(state=True)) if callable(kind.needs) else (kind.needs,):
        once = needs.state or needs.trial
        refused = kind.name == "grpc"
        assert (kind.make_for if once else kind.make) is not None or refused


@EACH_KIND
def test_the_names_of_runs_know_which_policies_are_built_in(kind):
    built_in = callable(kind.needs) or not kind.needs.thread
    address = kind.name if kind.form.target == "none" else f"{kind.name}:x"
    cure = 'write scheme="NAME" in the file of the kind: the names are read from its text'
    assert bool(built_in_names().fullmatch(address)) == built_in, cure


ASKING = re.compile(
    rf"""(?:startswith|removeprefix|partition|split)\(\s*[rf]*["'](?:(?:{"|".join(KINDS)}):|://)"""
    r"""|\b(?:policy|address)\.(?:r?partition\(["'][:?]|split\(["'][:?]|startswith\(|removeprefix\()"""
)


def test_nothing_but_the_register_asks_what_an_address_begins_with():
    asking = []
    for folder in (*betterbench.__path__, *betterbench_calibration.__path__):
        for file in Path(folder).rglob("*.py"):
            if file.parent != KINDS_FOLDER:
                found = ASKING.finditer(file.read_text(encoding="utf-8"))
                asking += [f"{file.relative_to(folder)}: {match.group()}" for match in found]
    ray = "evaluation/ray_engine/cluster.py: "  # addresses of a cluster
    trust = "evaluation/planning/trust.py: address.partition("  # options of an address of any kind
    assets = "sim/assets/catalogue/sources/source.py: address."  # sources of assets have a registry of their own
    urdf = "sim/assets/importing/urdf.py: "  # references of a URDF file to packages
    models = "vlm/models/kind.py: address.partition("  # kinds of models of better vlm have a registry of their own
    assert [line for line in asking if not line.startswith((ray, trust, assets, urdf, models))] == []


def test_kinds_are_known_without_a_simulator_or_a_library_of_a_server():
    code = "import sys, betterbench.policies.kinds; print('\\n'.join(sys.modules))"
    run = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    heavy = {"mujoco", "scipy", "pydantic", "torch", "websockets", "zmq", "msgpack", "betterbench.sim"}
    assert not heavy & set(run.stdout.split())


def test_what_a_policy_needs_goes_together():
    with pytest.raises(ValueError, match="thread=True"):
        PolicyNeeds(server=True)
    with pytest.raises(ValueError, match="thread=False"):
        PolicyNeeds(state=True, thread=True)


@pytest.fixture
def toy(monkeypatch):
    monkeypatch.setattr("betterbench.policies.kinds.kind.KINDS", {**KINDS})
    options = (Option("gain", "the gain", "number", 2.0), Option("turns", "the turns", "whole"), Option("let.", "one"))
    form = AddressForm(scheme="toy", example="toy:NAME", options=options)
    return register(PolicyKind(form=form, shown="toy:NAME", summary="A toy.", needs=AT_ONCE, make=lambda read: read))


def test_a_second_kind_of_the_same_name_is_refused(toy):
    with pytest.raises(ValueError, match="another policy kind has the name 'toy'"):
        register(PolicyKind(form=toy.form, shown="toy:NAME", summary="Another.", needs=AT_ONCE))


def test_the_options_of_a_kind_are_read_and_typed(toy):
    read = read_address("toy:a/b?gain=1.5&turns=3&let.x=y%20z")
    assert (kind_of(read.text), read.target, read.number("gain"), read.whole("turns")) == (toy, "a/b", 1.5, 3)
    assert read.options["let.x"] == "y z"
    assert make_policy("toy:a") == read_address("toy:a")
    assert not needs_of("toy:a").thread


@pytest.mark.parametrize(
    ("address", "text"),
    [
        ("toy:a?gan=1", "Unknown option of toy 'gan'. Did you mean 'gain'? Known: gain, let.KEY, turns"),
        ("toy:a?gain=3", "gain=3 is out of range. Give the gain, from 0 to 2"),
        ("toy:a?gain=x", "gain=x is out of range"),
        ("toy:a?turns=1.5", "turns=1.5 must be a whole number. Give the turns, such as 8"),
        ("toy:a?turns=1&turns=2", "an option is given twice"),
        ("toy:a?turns=", "turns has no value. Give the turns as turns=VALUE, or omit turns"),
        ("toy:a?turns", "the options cannot be read"),
        ("toy:", "nothing follows the colon. Write toy:NAME"),
        ("toi:a", "Unknown policy kind 'toi'. Did you mean 'toy'"),
        ("toy", "Unknown policy 'toy'"),
        ("noop?speed=1", "noop does not take options. Write noop"),
        ("noop:x", "Unknown policy 'noop:x'"),
        ("zoo:lexical?sterngth=0.5", "Unknown option of zoo 'sterngth'. Did you mean 'strength'"),
        ("replay:", "no run was given"),
        ("python:mine.py", "the class name is missing from the address"),
        ("mine.py:Mine", "the prefix python: is missing. Write python:mine.py:Mine"),
        ("a b/mine.py:Mine?gain=2", "Write 'python:a b/mine.py:Mine?gain=2'"),
        ("mine.py", "the prefix python: is missing. Write python:mine.py:CLASS"),
    ],
)
@pytest.mark.usefixtures("toy")
def test_a_wrong_address_is_one_clear_line(address, text):
    with pytest.raises((InvalidInputError, UnknownNameError)) as caught:
        read_address(address)
    assert text in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_name_that_no_kind_has_is_no_policy():
    assert find_kind("my policy") is None
    assert find_kind("") is None
