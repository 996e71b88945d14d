"""Terminals that know ASCII or Latin-1 alone: other characters are replaced, and no verb ends with a traceback."""

import json
import os
import subprocess
import sys

import pytest

PLACES = {
    "ascii": {"PYTHONIOENCODING": "ascii"},
    "strict": {"PYTHONIOENCODING": "ascii:strict"},
    "latin-1": {"PYTHONIOENCODING": "latin-1"},
    "C": {"LC_ALL": "C", "LANG": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"},
}
VERBS = ["--help", "list tasks", "list nonsense", "eval --help", "worlds", "eval --tasks \u00fcber \u2192"]


def better(place, *words):
    environment = {k: v for k, v in os.environ.items() if k not in ("PYTHONUTF8", "PYTHONIOENCODING", "LC_ALL")}
    command = [sys.executable, "-m", "betterbench.cli", *words]
    return subprocess.run(command, env={**environment, **PLACES[place]}, check=False, capture_output=True)


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("verb", VERBS)
def test_what_cannot_be_shown_is_replaced(place, verb):
    done = better(place, *verb.split())
    assert b"Traceback" not in done.stderr
    assert b"UnicodeEncodeError" not in done.stderr
    assert done.returncode in (0, 2)
    if place != "latin-1":
        assert done.stdout.isascii()
    assert done.stdout or done.stderr


def test_a_document_loses_no_character():
    here = better("ascii", "list", "tasks", "--json")
    assert here.stdout.isascii()
    environment = {**os.environ, "PYTHONIOENCODING": "utf-8"}
    command = [sys.executable, "-m", "betterbench.cli", "list", "tasks", "--json"]
    there = subprocess.run(command, env=environment, check=True, capture_output=True)
    assert json.loads(here.stdout) == json.loads(there.stdout)
