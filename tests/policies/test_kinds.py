"""Laws of the register of policy kinds: it alone knows what an address begins with."""

from __future__ import annotations

import dataclasses
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from tests.looping import each

import betterbench
import betterbench_calibration
from betterbench.errors import InvalidInputError, UnknownNameError
from betterbench.policies.address import AddressForm, Option, PolicyAddress
from betterbench.policies.factory import check_policy
from betterbench.policies.kinds import (
    KINDS,
    PolicyKind,
    PolicyNeeds,
    find_kind,
    kind_of,
    known_policies,
    make_for,
    make_policy,
    needs_of,
    read_address,
    register,
)
from betterbench.policies.kinds.kind import _REGISTERED_AT, AT_ONCE, STATE
from betterbench.policies.kinds.noop import Noop
from betterbench.records.naming import built_in_names

EACH_KIND = each("kind", KINDS.values(), lambda kind: kind.name)
KINDS_FOLDER = Path(betterbench.__path__[0]) / "policies" / "kinds"


@EACH_KIND
def test_an_address_belongs_to_one_kind(kind):
    address = f"{kind.name}:x" if kind.form.target == "required" else kind.name
    assert kind_of(address) is kind
    assert [other for other in KINDS.values() if other.form.has(address)] == [kind]


@each("entry", known_policies(), name=lambda entry: entry.address)
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
def test_the_first_word_is_a_literal_where_the_file_makes_the_form(kind):
    """Reports read the reserved names from the text of these files."""
    file = Path(_REGISTERED_AT[kind.name].file)
    text = file.read_text(encoding="utf-8") if file.parent == KINDS_FOLDER else ""
    literal = f'scheme="{kind.name}"'
    cure = f"Write {literal} in AddressForm (docs/adding-a-policy-kind.md)"
    found = f"betterbench/policies/kinds/{file.name}: the first word of kind {kind.name!r} is not a literal"
    assert "AddressForm(" not in text or literal in text, f"{found}. {cure}"


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
    return register(PolicyKind(form=form, shown="toy:NAME", summary="A toy.", needs=AT_ONCE, make=lambda _: Noop()))


def test_a_second_kind_of_the_same_name_is_refused(toy):
    with pytest.raises(InvalidInputError, match=r"(test_kinds\.py, line \d+.*){2}both register the policy kind 'toy'"):
        register(PolicyKind(form=toy.form, shown="toy:NAME", summary="Another.", needs=AT_ONCE, make=toy.make))


def test_the_options_of_a_kind_are_read_and_typed(toy):
    read = read_address("toy:a/b?gain=1.5&turns=3&let.x=y%20z")
    assert (kind_of(read.text), read.target, read.number("gain"), read.whole("turns")) == (toy, "a/b", 1.5, 3)
    assert read.options["let.x"] == "y z"
    assert isinstance(make_policy("toy:a"), Noop)
    assert not needs_of("toy:a").thread


@pytest.mark.parametrize(
    ("address", "text"),
    [
        ("toy:a?gan=1", "Unknown option of toy 'gan'. Did you mean 'gain'? Known: gain, let.KEY, turns"),
        ("toy:a?gain=3", "gain=3 is out of range. Set it to the gain, from 0 to 2"),
        ("toy:a?gain=x", "gain: expected a number, got 'x'. Set it to the gain, from 0 to 2"),
        ("toy:a?let.x=1&gain=nan", "gain: expected a number, got 'nan'"),
        ("toy:a?gain=inf", "gain=inf is out of range"),
        ("openpi://localhost:8000?timeout=soon", "timeout: expected a number, got 'soon'. Set it to the time limit"),
        ("toy:a?turns=1.5", "turns=1.5 must be a whole number. Set it to the turns, such as 8"),
        ("toy:a?turns=ten", "turns=ten must be a whole number. Set it to the turns, such as 8"),
        ("toy:a?turns=inf", "turns=inf must be a whole number. Set it to the turns, such as 8"),
        ("toy:a?turns=-1", "turns=-1 must be ≥ 0. Set it to the turns, such as 8"),
        ("toy:a?turns=1&turns=2", "an option is given twice"),
        ("toy:a?turns=", "turns has no value. Give the turns as turns=VALUE, or omit turns"),
        ("toy:a?turns", "the options cannot be read"),
        ("toy:", "the target after the colon is missing. Write toy:NAME"),
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


@pytest.mark.parametrize(
    ("fields", "text"),
    [
        ({"name": ""}, "the name of an option must be a non-empty text, got ''"),
        ({"meaning": ""}, "option 'gain': the meaning must be a non-empty text, got ''"),
        ({"reads": "integer"}, "option 'gain': reads='integer' is unknown. Use 'text', 'number' or 'whole'"),
        ({"most": "1"}, "option 'gain': most must be a number, got '1'"),
    ],
)
def test_a_wrong_option_of_a_kind_is_refused(fields, text):
    with pytest.raises((TypeError, ValueError), match=re.escape(text)):
        Option(**{"name": "gain", "meaning": "the gain", **fields})


@pytest.mark.parametrize(
    ("fields", "text"),
    [
        ({"options": Option("gain", "the gain")}, "options must be a tuple of Option, such as (Option(...),)"),
        ({"options": ("gain",)}, "options must be a tuple of Option, such as (Option(...),)"),
        ({"options": (Option("a", "b"), Option("a", "c"))}, "the option 'a' is declared twice"),
        ({"target": "maybe"}, "target='maybe' is unknown. Use 'none', 'optional' or 'required'"),
    ],
)
def test_a_wrong_form_of_a_kind_is_refused(fields, text):
    with pytest.raises((TypeError, ValueError), match=re.escape(text)):
        AddressForm(**{"scheme": "toy", "example": "toy:NAME", **fields})


@pytest.mark.parametrize(
    ("fields", "text"),
    [
        ({"needs": "at_once"}, "needs='at_once' is not a PolicyNeeds. Use AT_ONCE, OWN_PROCESS, SERVER, STATE,"),
        ({"form": "toy:NAME"}, "form must be an AddressForm, got 'toy:NAME'"),
        ({"summary": None}, "summary must be a text, got None"),
        ({"make": Noop()}, "make must be a function, got a Noop"),
        ({"make": Noop}, "make must be callable as make(address) (too many positional arguments)"),
        ({"read": lambda _: None}, "read must be callable as read(text, world) (too many positional arguments)"),
        ({"make": None}, "make is missing. Pass the function that returns a policy for an address"),
        ({"needs": STATE}, "make_for is missing. Pass the function that returns a policy for one episode"),
        ({"needs": lambda _: STATE, "make": None}, "make and make_for are missing"),
        (
            {"form": AddressForm(scheme="to:y", example="to:y:NAME")},
            "scheme 'to:y' must be one word, such as sway",
        ),
        (
            {"form": AddressForm(scheme="toy", example="tyo:NAME")},
            "the example 'tyo:NAME' is not an address of this kind. Begin it with toy:",
        ),
        (
            {"form": AddressForm(scheme="zoo", example="zoo:NAME")},
            "both register the policy kind 'zoo'. Change the name at one of the two places",
        ),
    ],
)
def test_a_wrong_kind_is_refused_when_it_is_registered(monkeypatch, fields, text):
    monkeypatch.setattr("betterbench.policies.kinds.kind.KINDS", {**KINDS})
    form = AddressForm(scheme="toy", example="toy:NAME")
    right = {"form": form, "shown": "toy:NAME", "summary": "A toy.", "needs": AT_ONCE, "make": lambda _: Noop()}
    with pytest.raises((TypeError, ValueError, InvalidInputError), match=re.escape(text)):
        register(PolicyKind(**{**right, **fields}))


@pytest.mark.parametrize("ask", ["number", "whole", "choice"])
@pytest.mark.usefixtures("toy")
def test_an_option_that_the_form_does_not_declare_is_refused(ask):
    arguments = (("left", "right"), "left") if ask == "choice" else ()
    text = "policy kind toy: its code reads the option 'gian', which its form does not declare"
    with pytest.raises(InvalidInputError, match=f"{text}. Did you mean 'gain'"):
        getattr(read_address("toy:a"), ask)("gian", *arguments)


class Idle:
    info = Noop.info

    def reset(self, start):
        pass


@pytest.mark.parametrize(
    ("made", "text"),
    [
        (None, "policy toy:a: its kind returned None instead of a policy. Return the policy"),
        (Noop, "policy toy:a: Noop is a class. Pass an instance: Noop(...)"),
        (Idle(), "policy toy:a: Idle has no 'act'. Define info, reset(start) and act(observation)"),
    ],
)
def test_a_kind_that_returns_no_policy_is_named_before_the_run(toy, monkeypatch, made, text):
    kinds = {**KINDS, "toy": dataclasses.replace(toy, make=lambda _: made)}
    monkeypatch.setattr("betterbench.policies.kinds.kind.KINDS", kinds)
    with pytest.raises(InvalidInputError, match=re.escape(text)):
        check_policy("toy:a")


@pytest.mark.parametrize("needs", [STATE, PolicyNeeds(trial=True)], ids=["state", "trial"])
@pytest.mark.parametrize(
    ("made", "text"), [(None, "its kind returned None instead of a policy"), (Idle(), "Idle has no 'act'")]
)
def test_a_kind_that_returns_no_policy_for_an_episode_is_named(toy, monkeypatch, needs, made, text):
    kind = dataclasses.replace(toy, needs=needs, make=None, make_for=lambda *_: made)
    monkeypatch.setattr("betterbench.policies.kinds.kind.KINDS", {**KINDS, "toy": kind})
    with pytest.raises(InvalidInputError, match=f"policy toy:a: {text}"):
        make_for("toy:a", None)


@pytest.mark.parametrize(
    ("name", "given", "expected"),
    [
        (
            "source_of",
            ("toy.py", "0a1b"),
            "must return a text such as 'my_policy.py, sha256 0a1b', got ('toy.py', '0a1b')",
        ),
        ("source_of", None, "must return a text such as 'my_policy.py, sha256 0a1b', got None"),
        ("describe", "toy", "must return a PolicyInfo or None, got 'toy'"),
        ("needs", None, "must return a PolicyNeeds, got None"),
        ("read", "toy:a", "must return a PolicyAddress, got 'toy:a'"),
        ("space_in_world", 7, "must return a text such as 'ee_delta' or None, got 7"),
    ],
)
def test_a_function_of_a_kind_that_returns_another_type_is_named_with_its_file(toy, monkeypatch, name, given, expected):
    def wrong(address, world=""):
        return given

    kind = dataclasses.replace(toy, **{name: wrong, "make": lambda _: Noop()})
    monkeypatch.setattr("betterbench.policies.kinds.kind.KINDS", {**KINDS, "toy": kind})
    place = re.escape(
        f"{__file__}, line {wrong.__code__.co_firstlineno}: {name} of the policy kind toy {expected}. Correct "
    )
    with pytest.raises(InvalidInputError, match=place):
        kind.space_of(PolicyAddress("toy:a", toy.form, "a")) if name == "space_in_world" else check_policy("toy:a")


def test_the_needs_of_an_address_are_checked_when_a_policy_is_made(toy, monkeypatch):
    kind = dataclasses.replace(toy, needs=lambda _: None)
    monkeypatch.setattr("betterbench.policies.kinds.kind.KINDS", {**KINDS, "toy": kind})
    with pytest.raises(InvalidInputError, match="needs of the policy kind toy must return a PolicyNeeds, got None"):
        make_policy("toy:a")


def test_the_source_of_a_kind_is_part_of_the_description(toy, monkeypatch):
    kind = dataclasses.replace(toy, source_of=lambda _: "toy.py, sha256 0a1b", make=lambda _: Noop())
    monkeypatch.setattr("betterbench.policies.kinds.kind.KINDS", {**KINDS, "toy": kind})
    assert check_policy("toy:a").metadata["source file"] == "toy.py, sha256 0a1b"


def test_a_mistake_in_the_file_of_a_kind_names_the_file_and_the_line(tmp_path):
    """The folder of the kinds is read from a copy, in a process of its own."""
    package = tmp_path / "betterbench"
    shutil.copytree(betterbench.__path__[0], package, ignore=lambda *_: ["data"])
    wrong = "from betterbench.policies.kinds.authoring import *\n\nregister(PolicyKind(form=None))\n"
    (package / "policies" / "kinds" / "toy.py").write_text(wrong)
    code = """
from betterbench.errors import InvalidInputError
try:
    import betterbench.policies.kinds
except InvalidInputError as error:
    print(error)
"""
    environment = {**os.environ, "PYTHONPATH": str(tmp_path)}
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=environment, check=True)
    assert re.match(
        r"\S+/kinds/toy.py, line 3: TypeError: .*missing.*'shown'.*\. Correct the file\.$", run.stdout.strip()
    )


def test_a_name_that_no_kind_has_is_no_policy():
    assert find_kind("my policy") is None
    assert find_kind("") is None
