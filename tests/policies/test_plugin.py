"""Policies of users: loaded by module or file, and refused with one clear line when something is missing."""

from __future__ import annotations

import hashlib
import sys

import pytest
from tests.looping import each

from betterbench.errors import InvalidInputError, PolicyProcessError, UnknownNameError
from betterbench.interface import PolicyInfo
from betterbench.policies import load_plugin
from betterbench.policies.factory import PolicyFactory, check_policy
from betterbench.policies.kinds import known_policies

GOOD = """
import numpy as np
from betterbench.interface import PolicyInfo

class Mine:
    info = PolicyInfo("mine", needs_images=False)
    def reset(self, start): pass
    def act(self, observation): return np.zeros(7)

class InJointSpace(Mine):
    info = PolicyInfo("joints", action_space="joint_delta")

class Mute:
    info = PolicyInfo("mute")
    def reset(self, start): pass

class Nameless:
    info = None
    def reset(self, start): pass
    def act(self, observation): pass

class Needy(Mine):
    def __init__(self, weights): pass

NUMBER = 3
"""

SOURCE_OF_MINE = """
from betterbench.interface import PolicyInfo
from betterbench.policies import Noop

class Mine(Noop):
    info = PolicyInfo("mine", metadata={"weights": "none"})
"""


@pytest.fixture
def plugin(tmp_path):
    file = tmp_path / "my_policy.py"
    file.write_text(GOOD, encoding="utf-8")
    return file


def test_a_class_in_a_file_is_loaded(plugin):
    assert load_plugin(f"{plugin}:Mine").info.name == "mine"
    check_policy(f"python:{plugin}:Mine")


def test_a_class_in_an_importable_module_is_loaded(plugin, monkeypatch):
    monkeypatch.syspath_prepend(str(plugin.parent))
    monkeypatch.setattr(sys, "modules", dict(sys.modules))
    assert load_plugin("my_policy:Mine").info.name == "mine"


def test_a_module_beside_the_caller_is_found(plugin, monkeypatch):
    monkeypatch.chdir(plugin.parent)
    monkeypatch.setattr(sys, "path", list(sys.path))
    monkeypatch.setattr(sys, "modules", dict(sys.modules))
    assert load_plugin("my_policy:Mine").info.name == "mine"


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("Absent", "has no 'Absent'"),
        ("Mute", "Mute has no 'act'"),
        ("Nameless", "info of Nameless is of type NoneType"),
        ("Needy", "cannot be called without arguments"),
        ("NUMBER", "cannot be called without arguments"),
    ],
)
def test_what_is_missing_is_named(plugin, name, text):
    with pytest.raises(InvalidInputError, match=text) as caught:
        load_plugin(f"{plugin}:{name}")
    assert "\n" not in str(caught.value)


@each(
    "address",
    [
        "",
        ":",
        "module",
        ":Class",
        "module:",
        "no_such_module_anywhere:Class",
        "no/such/file.py:Class",
        "../../../../etc/passwd:root",
        ".relative:Class",
        "..:Class",
        "a..b:Class",
        "os;import sys:Class",
        "os\x00:Class",
        "module name:Class",
    ],
)
def test_hostile_and_broken_addresses_give_one_clear_error(address):
    with pytest.raises(InvalidInputError, match="policy python:"):
        load_plugin(address)


@pytest.mark.parametrize("source", ["def broken(:\n", "import no_such_module_anywhere\n"])
def test_a_file_that_cannot_be_loaded_is_named(tmp_path, source):
    file = tmp_path / "broken.py"
    file.write_text(source, encoding="utf-8")
    with pytest.raises(InvalidInputError, match=r"broken\.py: the file cannot be loaded"):
        load_plugin(f"{file}:Mine")


@pytest.mark.parametrize(
    ("source", "text"),
    [
        (
            "class Mine:\n    def __init__(self):\n        raise ZeroDivisionError\n",
            "ZeroDivisionError .*line 3, in __init__",
        ),
        ("import math\n\nmath.sqrt(-1)\n", r"ValueError: .* \(.*angry\.py, line 3\)"),
        ("class Mine:\n  def (:\n", r"SyntaxError: .* \(.*angry\.py, line 2\)"),
        ("import json\nVALUE = json.loads('{')\n", r"JSONDecodeError: .* \(.*angry\.py, line 2\)"),
        ("raise SystemExit(3)\n", r"SystemExit: 3 \(.*angry\.py, line 1\)"),
    ],
)
def test_what_a_plugin_raises_itself_is_one_line_with_its_place(tmp_path, source, text):
    file = tmp_path / "angry.py"
    file.write_text(source, encoding="utf-8")
    with pytest.raises((InvalidInputError, PolicyProcessError), match=text) as caught:
        load_plugin(f"{file}:Mine")
    assert "\n" not in str(caught.value)


ARGUMENTS = """
from betterbench.policies import Noop

class Mine(Noop):
    def __init__(self, checkpoint, horizon: int = 4, *, fast=False, note="x"):
        self.given = (checkpoint, horizon, fast, note)
"""


def test_an_address_passes_arguments(tmp_path):
    file = tmp_path / "mine.py"
    file.write_text(ARGUMENTS, encoding="utf-8")

    def given(query):
        return load_plugin(f"{file}:Mine?{query}").given

    assert given("checkpoint=a/b.pt") == ("a/b.pt", 4, False, "x")
    assert given("checkpoint=hub:me/pi0&horizon=8&fast=true") == ("hub:me/pi0", 8, True, "x")
    assert given("checkpoint=%228%22&note=a%26b%3Dc%20d") == ("8", 4, False, "a&b=c d")
    assert given("checkpoint=&horizon=0.5&note=null") == ("", 0.5, False, None)
    for wrong, text in (
        ("", "cannot be called without arguments"),
        (
            "checkpoint=1&horzon=2",
            "unexpected keyword argument 'horzon'.*It takes these arguments: checkpoint, horizon, fast, note",
        ),
        ("checkpoint=1&checkpoint=2", "'checkpoint' is given twice"),
        ("checkpoint", "'checkpoint' is not an argument"),
    ):
        with pytest.raises(InvalidInputError, match=text):
            given(wrong)
    assert PolicyFactory(f"python:{file}:Mine?checkpoint=1").info.metadata["source file"].startswith("mine.py, sha256")


@pytest.mark.parametrize("address", ["expert", "zoo:lexical", "noop", "random"])
def test_known_addresses_pass(address):
    check_policy(address)


@pytest.mark.parametrize(("address", "close"), [("exprt", "expert"), ("zoo:lexcal", "zoo:lexical"), ("nop", "noop")])
def test_unknown_addresses_are_refused_with_the_closest(address, close):
    with pytest.raises(UnknownNameError, match=f"Did you mean '{close}"):
        check_policy(address)


@pytest.mark.parametrize("address", ["", "openpi", "python", "../expert", "zoo:"])
def test_addresses_that_mean_nothing_are_refused(address):
    with pytest.raises(UnknownNameError, match="Unknown policy"):
        check_policy(address)


@pytest.mark.parametrize("address", ["expert", "zoo:halt", "random"])
def test_both_sides_of_a_convention_are_compared(address):
    check_policy(address, action_space="ee_delta")
    with pytest.raises(InvalidInputError, match="returns actions in 'ee_delta', but the run uses 'ee_pose'"):
        check_policy(address, action_space="ee_pose")


@pytest.mark.parametrize("space", ["ee_delta", "ee_pose", "so101_degrees"])
def test_noop_stands_still_in_every_space(space):
    check_policy("noop", action_space=space)


def test_a_plugin_declares_its_action_space(plugin):
    check_policy(f"python:{plugin}:InJointSpace", action_space="joint_delta")
    with pytest.raises(InvalidInputError, match="Use --action-space joint_delta"):
        check_policy(f"python:{plugin}:InJointSpace", action_space="ee_delta")


def test_known_policies_are_listed_once_each_with_a_line():
    entries = known_policies()
    assert len({e.address for e in entries}) == len(entries)
    assert all(e.summary.endswith(".") for e in entries)
    assert {e.address for e in entries if e.privileged} >= {"expert", "zoo:clumsy"}
    assert not any(e.privileged for e in entries if e.address in ("noop", "random"))


def test_a_file_is_loaded_like_a_script_with_its_neighbors_and_dataclasses(tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "path", list(sys.path))
    monkeypatch.setattr(sys, "modules", dict(sys.modules))
    (tmp_path / "neighbor_of_the_policy.py").write_text("SCALE = 0.5\n", encoding="utf-8")
    file = tmp_path / "scripted_policy.py"
    source = "from __future__ import annotations\nfrom dataclasses import dataclass, field\n"
    source += "from neighbor_of_the_policy import SCALE\n" + GOOD
    source += (
        "@dataclass\nclass Data(Mine):\n    scale: float = SCALE\n    seen: list[str] = field(default_factory=list)\n"
    )
    file.write_text(source, encoding="utf-8")
    assert load_plugin(f"{file}:Data").scale == 0.5


@pytest.mark.parametrize(
    ("says", "error", "text"),
    [
        ({"metadata": {"step": 20000}}, InvalidInputError, r"metadata\['step'\]: it is of type int. Use strings"),
        ({"metadata": None}, InvalidInputError, "metadata: it is of type NoneType"),
        (
            {"execution": {"horizon": 3}},
            InvalidInputError,
            "execution: it is of type dict. Use a value of type Execution",
        ),
        ({"name": None}, InvalidInputError, "name: it is of type NoneType"),
        ({"action_space": None}, InvalidInputError, "action_space: it is of type NoneType"),
        ({"action_space": "ee_dleta"}, UnknownNameError, "Did you mean 'ee_delta'"),
    ],
)
def test_what_a_policy_says_about_itself_is_checked_when_it_says_it(says, error, text):
    with pytest.raises(error, match=text):
        PolicyInfo(**{"name": "mine", **says})


def test_the_file_of_a_plugin_is_fingerprinted_where_it_was_loaded(tmp_path, monkeypatch):
    file = tmp_path / "of_mine.py"
    file.write_text(SOURCE_OF_MINE, encoding="utf-8")
    address = f"python:{file}:Mine"
    digest = hashlib.sha256(SOURCE_OF_MINE.encode()).hexdigest()
    with PolicyFactory(address) as policies:
        assert policies.check().metadata == {"weights": "none", "source file": f"of_mine.py, sha256 {digest}"}
    monkeypatch.chdir(tmp_path)
    monkeypatch.delitem(sys.modules, "of_mine", raising=False)
    with PolicyFactory("python:of_mine:Mine") as policies:
        assert policies.check().metadata["source file"] == f"of_mine.py, sha256 {digest}"
    file.write_text(SOURCE_OF_MINE + "# edited\n", encoding="utf-8")
    with PolicyFactory(address) as policies:
        assert digest not in policies.check().metadata["source file"]
