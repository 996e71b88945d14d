"""The border of the command line: numbers, texts from outside, and a standard output of one document."""

from __future__ import annotations

import dataclasses
import inspect
import json
import subprocess
import sys
import typing

import pytest
from tests.looping import each

from betterbench.cli import console
from betterbench.cli.border import LIMITS, guarded
from betterbench.cli.main import Telling, every_command, main


def numbers(function):
    """The options of a verb that are numbers, those of its groups of options included."""
    for name, hint in typing.get_type_hints(function).items():
        if dataclasses.is_dataclass(hint):
            yield from numbers(hint)
        elif typing.get_origin(hint) is not tuple and {int, float} & {hint, *typing.get_args(hint)}:
            yield name


@each("verb", every_command())
def test_every_number_of_every_verb_has_bounds(verb):
    missing = set(numbers(every_command()[verb].load(Telling()))) - LIMITS.keys() - {"port"}
    assert not missing


OUT_OF_BOUNDS = [
    (
        "eval --policy noop --trials 99999999999999999999",
        "--trials: 99999999999999999999 is out of range. Use a number from 1 to 10000",
    ),
    ("eval --policy noop --trials 0", "--trials: 0 is out of range"),
    ("eval --policy noop --seed=-1", "--seed: -1 is out of range"),
    ("eval --policy noop --seed -1", "--seed: -1 is out of range"),
    ("eval --policy noop --policy-timeout nan", "--policy-timeout: nan is out of range"),
    ("eval --policy noop --policy-timeout inf", "--policy-timeout: inf is out of range"),
    ("eval --policy noop --engine ray --replicas 0", "--replicas: 0 is out of range"),
    ("certify --seed=-5", "--seed: -5 is out of range"),
    ("calibrate --trials 1000000", "--trials: 1000000 is out of range"),
    ("demo --films=-1", "--films: -1 is out of range"),
    ("show fast_food --size 1000000", "--size: 1000000 is out of range"),
    ("compare a b --alpha nan", "--alpha: nan is out of range"),
    ("serve noop --clients 0", "--clients: 0 is out of range"),
    ("serve noop --port 65536", "--port: 65536 is not a port"),
]


@pytest.mark.parametrize(("line", "text"), OUT_OF_BOUNDS)
def test_a_number_out_of_bounds_is_one_clear_line(line, text, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(line.split()) == 2
    assert text in capsys.readouterr().err.replace("\n", " ")
    assert not list(tmp_path.iterdir())


def test_a_verb_keeps_its_face_behind_its_guard():
    def verb(what: str, *, seed: int = 0) -> None:
        """Do it."""

    made = guarded(verb)
    assert inspect.signature(made) == inspect.signature(verb)
    assert made.__doc__ == "Do it."


NOISY = """
import os, sys
from betterbench.cli.border import guarded
from betterbench.cli.console import OUT, print_json, say

def verb(*, json: bool = False) -> None:
    print("a policy prints")
    OUT.print("a library prints")
    os.write(1, b"C prints\\n")
    os.system("echo a child prints")
    sys.__stdout__.write("somebody who kept it prints\\n")
    sys.__stdout__.flush()
    print_json({"k": "caf\\u00e9 \\x1b[31m \\x9b \\u202e"})

guarded(verb)(json=True)
print("after")
"""


def test_with_json_nothing_else_is_on_stdout():
    done = subprocess.run([sys.executable, "-c", NOISY], capture_output=True, text=True, encoding="utf-8", check=True)
    document, _, after = done.stdout.rpartition("}\n")
    assert after == "after\n"
    assert json.loads(document + "}") == {"k": "caf\u00e9 \x1b[31m \x9b \u202e"}
    assert "caf\u00e9" in document
    assert not {"\x1b", "\x9b", "\u202e"} & set(document)
    assert sorted(done.stderr.splitlines()) == sorted(
        ["a policy prints", "a library prints", "C prints", "a child prints", "somebody who kept it prints"]
    )


def test_what_is_printed_steers_no_terminal_and_has_an_end(capsys):
    evil = "\x1b]0;pwned\x07\x1b[2J\x9b31m\u202e"
    console.say(f"run {evil}")
    console.OUT.print(f"out {evil}", markup=False)
    console.print_table(["name"], [[f"cell {evil}"]])
    console.say("x" * 1_000_000)
    said = capsys.readouterr()
    assert all(c.isprintable() or c in "\n\ufffd" for c in said.out + said.err)
    assert "pwned" in said.out
    assert len(said.err) < 25_000


def test_an_unknown_name_of_a_megabyte_is_one_short_line(capsys):
    assert main(["show", "x" * 1_000_000]) == 2
    assert len(capsys.readouterr().err) < 2000
