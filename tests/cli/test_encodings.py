"""Terminals that know ASCII or Latin-1 alone: other characters are replaced, and no verb ends with a traceback."""

import json
import os
import subprocess
import sys

import pytest
from tests.daily import others_slow
from tests.prepared_process import COMMAND_LINE, prepared

PLACES = {
    "ascii": {"PYTHONIOENCODING": "ascii"},
    "strict": {"PYTHONIOENCODING": "ascii:strict"},
    "latin-1": {"PYTHONIOENCODING": "latin-1"},
    "C": {"LC_ALL": "C", "LANG": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"},
}
VERBS = ["--help", "list tasks", "list nonsense", "eval --help", "worlds", "eval --tasks \u00fcber \u2192"]


EACH = """
import os, sys
from betterbench.cli.main import main
statuses = []
for verb in sys.argv[1:]:
    sys.argv[1:] = verb.split()
    try:
        statuses.append(main() or 0)
    except SystemExit as stop:
        statuses.append(stop.code or 0)
    for stream in (sys.stdout, sys.stderr):
        stream.flush()
        os.write(stream.fileno(), b"\\0")
os.write(2, " ".join(map(str, statuses)).encode())
"""
"""What each verb writes ends with a null character, and standard error with the exit statuses."""


def better(place, *words):
    return in_place(place, sys.executable, "-m", "betterbench.cli", *words)


def in_place(place, *command):
    environment = {k: v for k, v in os.environ.items() if k not in ("PYTHONUTF8", "PYTHONIOENCODING", "LC_ALL")}
    return subprocess.run(command, env={**environment, **PLACES[place]}, check=False, capture_output=True)


@pytest.mark.parametrize("verb", ["list tasks", "list nonsense"])
def test_what_cannot_be_shown_is_replaced_to_the_end_of_the_process(verb):
    check("strict", better("strict", *verb.split()))


@pytest.mark.parametrize("place", others_slow(PLACES, 4))
def test_what_cannot_be_shown_is_replaced(place):
    """All verbs in one process, since each process takes half a second to import what it needs."""
    done = in_place(place, sys.executable, "-c", EACH, *VERBS)
    outputs, (*errors, statuses) = done.stdout.split(b"\0")[:-1], done.stderr.split(b"\0")
    for verb, out, err, status in zip(VERBS, outputs, errors, statuses.split(), strict=True):
        check(place, subprocess.CompletedProcess(verb, int(status), out, err))


def check(place, done):
    assert b"Traceback" not in done.stderr, done.args
    assert b"UnicodeEncodeError" not in done.stderr, done.args
    assert done.returncode in (0, 2), done.args
    if place != "latin-1":
        assert done.stdout.isascii(), done.args
    assert done.stdout or done.stderr, done.args


def test_a_document_loses_no_character():
    here = better("ascii", "list", "tasks", "--json")
    assert here.stdout.isascii()
    there = prepared(*COMMAND_LINE).run("-m", "betterbench.cli", "list", "tasks", "--json")  # as UTF-8
    assert json.loads(here.stdout) == json.loads(there.stdout)
