"""Every command that a message advises: it names a verb that there is, with options that the verb has."""

from __future__ import annotations

import ast
import functools
import os
import re
import shlex
from pathlib import Path

from tests.cli.helps import help_of
from tests.prepared_process import COMMAND_LINE, prepared

from betterbench.certification.coverage import Gap, cure_for
from betterbench.cli.main import every_command
from betterbench.tasks import TrialId
from betterbench.tasks.user_files import VARIABLE

ROOT = Path(__file__).resolve().parents[2]
SOURCES = (ROOT / "src", ROOT / "packages" / "betterbench-calibration" / "src")
_NAMES = "|".join(sorted(every_command(), reverse=True))
ADVISED = re.compile(rf"(?<![\w./-])better ({_NAMES})\b(?!-)((?: (?:--)?[\w./{{}}|:=\[\]<>-]+)*)")


def texts(tree):
    """Every text of a module that is no docstring, with X for what an f-string puts in."""
    documented = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)
    docs = {id(n.body[0].value) for n in ast.walk(tree) if isinstance(n, documented) and ast.get_docstring(n)}
    parts = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.JoinedStr):
            parts |= {id(part) for part in ast.walk(node) if part is not node}
            yield "".join(p.value if isinstance(p, ast.Constant) else "X" for p in node.values)
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in docs | parts:
            yield node.value


@functools.cache  # in the tests and not while they are collected, because it parses all sources
def advised():
    """The commands of all messages: verb and options, with the file that has them."""
    found = {}
    for file in sorted(file for source in SOURCES for file in source.rglob("*.py")):
        code = file.read_text(encoding="utf-8")
        for text in texts(ast.parse(code)) if re.search(r"\bbetter\b", code) else ():
            for verb, rest in ADVISED.findall(text):
                options = tuple(re.findall(r"(?<= )--[a-z][a-z-]*", rest))
                found.setdefault((verb, options), file.relative_to(ROOT))
    return sorted(found.items())


def test_there_are_messages_that_advise_commands():
    assert len(advised()) > 20


def test_every_advised_command_has_a_verb_and_options_that_exist():
    for (verb, options), file in advised():
        assert verb in every_command(), file
        known = set(re.findall(r"--[a-z][a-z-]*", help_of(verb)))
        assert set(options) <= known, f"{file} advises better {verb} {' '.join(options)}"


OWN = """
from dataclasses import replace
from betterbench.tasks import get_task
from betterbench.tasks.authoring.registry import task

@task
def my_advised_task():
    '''Like morning_coffee.'''
    base = get_task("morning_coffee")
    return replace(base, version=1, title="Mine", variations=base.variations[:1])
"""


def test_a_task_that_was_never_measured_is_measured_before_it_is_certified(tmp_path):
    """`certify --trials 2` alone ended with "were never measured"."""
    file = tmp_path / "my tasks.py"
    file.write_text(OWN, encoding="utf-8")
    words = ["--policy", "expert", "--tasks", "my_advised_task", "--task-file", str(file), "--trials", "2"]
    command = ("-m", "betterbench.cli", "eval", *words, "--out", str(tmp_path / "run"))
    done = prepared(*COMMAND_LINE).run(*command, env={n: value for n, value in os.environ.items() if n != VARIABLE})
    assert done.returncode == 2
    said = " ".join(done.stderr.split())
    first, second = re.findall(r"better (certify .*?)(?:, then|and give it)", said)
    given = ["--task-file", str(file), "--tasks", "my_advised_task"]
    assert shlex.split(first) == ["certify", *given, "--demonstrations", "120"]
    assert shlex.split(second) == ["certify", *given, "--trials", "2", "--out", "runs/certificate"]


def test_what_is_measured_is_only_certified():
    gap = Gap(TrialId("fast_food", "T1", 99), "the certificate holds other seeds")
    assert cure_for(gap, tasks=("fast_food",), first=0, trials=100).startswith(
        "Run better certify --tasks fast_food --tr"
    )
