"""What a person sees in a terminal of 80 columns: one line of progress, tables, errors, and help that can be pasted."""

from __future__ import annotations

import io
import os
import pty
import re
import shlex
import subprocess
import sys
import threading

import pytest
from tests.cli.helps import help_of
from tests.looping import each

from betterbench.cli import console, progress
from betterbench.cli.console import Terminal, complain, print_table, progress_bar
from betterbench.cli.main import VERBS, main
from betterbench.cli.verbs.evaluate import prepare_robot
from betterbench.errors import UNPRINTABLE, one_line

WORK = [
    ("calibrate", 2040, 13, "zoo:progress-cue at 60 %", True),
    ("certify", 3400, 1200, "fruit_basket_sorting/T1 seed 1000012", True),
    ("collect", 120, 15, "18 attempts, candy_and_cookies/training_1/1000015", True),
    ("policy 4 of 4: zoo:progress-cue", 168, 22, "31/min, 5 min left · 18/22 succeeded", False),
    ("expert", 1680, 1022, "31/min, at most 1 h 05 min left · 18/22 succeeded · 12/68 variations decided", False),
    ("film strips of zoo:progress-cue", 160, 12, "", True),
    ("questions about a-run-with-a-name-as-long-as-they-get", 1600, 12, "", True),
    ("looking", 0, 0, "", True),
]


def drawn(monkeypatch, width, work):
    """Return the lines of a bar on a terminal of so many columns, a minute after its begin."""
    what, total, done, note, estimate = work
    terminal = Terminal(stderr=True, width=width, force_terminal=True, file=io.StringIO())
    monkeypatch.setattr(console, "ERR", terminal)
    with progress_bar(what, total, estimate=estimate) as (bar, task):
        bar._tasks[task].start_time -= 60.0
        bar.update(task, completed=done, note=note)
        lines = terminal.render_lines(bar.get_renderable(), pad=False)
    return ["".join(segment.text for segment in line) for line in lines]


@pytest.mark.parametrize("width", [40, 60, 80, 132])
@pytest.mark.parametrize("work", WORK, ids=lambda w: w[0].split()[0])
def test_progress_is_one_line_in_which_count_and_time_are_whole(monkeypatch, width, work):
    """And three columns stay free, so that the ^C that a terminal writes begins no new line."""
    (line,) = drawn(monkeypatch, width, work)
    what, total, done, note, estimate = work
    assert len(line.rstrip()) <= width - 3
    if total:
        assert f"{done}/{total}" in line
    if estimate:
        assert "0:01:00" in line or re.search(r"\d:\d\d:\d\d left", line)
    assert line.startswith(what[:8])
    if width >= 80 and what != "expert":
        assert note[:24] in line


def test_the_width_of_a_bar_does_not_change_with_the_note(monkeypatch):
    notes = ("fast_food/L1 seed 3", "candy_and_cookies/training_1 seed 1000015")
    lines = [drawn(monkeypatch, 80, ("certify", 3400, 17, note, True))[0] for note in notes]
    assert lines[0].index("17/3400") == lines[1].index("17/3400")


def test_a_run_without_a_first_result_shows_that_time_goes_by(monkeypatch):
    (line,) = drawn(monkeypatch, 80, ("expert", 24, 0, "", False))
    assert " 0/24 0:01:00" in line


def test_long_work_without_a_terminal_says_now_and_then_how_far_it_is(monkeypatch, capsys):
    monkeypatch.setattr(progress, "FIRST_LINE_S", 0.0)
    with progress_bar("collect", 120) as (bar, task):
        bar.update(task, completed=15, note="18 attempts")
        bar.update(task, completed=16, note="19 attempts")  # too soon for a second line
        bar.advance(task)
    assert capsys.readouterr().err == "collect: 15/120, 18 attempts\n"
    monkeypatch.undo()
    with progress_bar("collect", 120) as (bar, task):
        bar.update(task, completed=15)
    assert capsys.readouterr().err == ""


def test_each_step_of_preparing_the_arm_is_named_with_its_own_count(monkeypatch):
    """The first run of a machine reads ten meshes and then decimates them; "reading, 1/10" must not stand meanwhile."""
    terminal = Terminal(stderr=True, width=80, force_terminal=True, file=io.StringIO())
    monkeypatch.setattr(console, "ERR", terminal)
    seen = []

    class Shown(progress.WorkProgress):
        def update(self, task_id, **changes):
            super().update(task_id, **changes)
            lines = terminal.render_lines(self.get_renderable(), pad=False)
            seen.append("".join(segment.text for segment in lines[0]))

    def build(name, *, progress):
        for step in (("reading the arm's meshes", 0, 10), ("reading the arm's meshes", 9, 10)):
            progress(*step)
        for done in (0, 1):
            progress("decimating the arm's meshes", done, 1)

    monkeypatch.setattr(progress, "WorkProgress", Shown)
    monkeypatch.setattr("betterbench.sim.robots.build_robot_spec", build)
    prepare_robot("panda")
    assert ["0/10" in seen[0], "9/10" in seen[1]] == [True, True]
    assert [line.startswith("decimating the arm's meshes") for line in seen] == [False, False, True, True]
    assert [" 0/1 " in seen[2], " 1/1 " in seen[3]] == [True, True]
    left = terminal.file.getvalue()
    assert left.rstrip().endswith("\x1b[2K"), "the bar goes when the arm is ready"


def test_a_long_error_is_broken_between_words_on_a_terminal_and_not_at_all_in_a_log(monkeypatch, capsys):
    text = "Unknown variation of morning_coffee 'R1'. Did you mean 'T1' or 'O1' or 'L1'? Known: [L1], \x1b[31mL2."
    shown = f"error: {text}".replace("\x1b", "\N{REPLACEMENT CHARACTER}")
    complain(text)
    assert capsys.readouterr().err == f"{shown}\n"
    terminal = Terminal(stderr=True, width=80, force_terminal=True, no_color=True, file=io.StringIO())
    monkeypatch.setattr(console, "ERR", terminal)
    complain(text)
    plain = re.sub(r"\x1b\[[0-9;]*m", "", terminal.file.getvalue())
    lines = plain.splitlines()
    assert [len(line) <= 80 for line in lines] == [True, True]
    assert " ".join(plain.split()) == shown


def test_tables_keep_what_stands_in_brackets_and_set_numbers_flush_right(capsys, monkeypatch):
    monkeypatch.setattr(console.OUT, "_width", 80)
    rows = [["[/]a", "1,234", "45.360 %", "3/4"], ["b\\", "5", "4.000 %", "–"]]
    print_table(["[bold]set", "samples [million]", "share", "k/n"], rows, title="a policy named [/red]")
    assert [line.rstrip() for line in capsys.readouterr().out.splitlines()] == [
        "a policy named [/red]",
        "[bold]set  samples [million]     share  k/n",
        "[/]a                   1,234  45.360 %  3/4",
        "b\\                         5   4.000 %  –",
    ]


def test_a_narrow_table_keeps_a_rate_on_one_line(capsys, monkeypatch):
    monkeypatch.setattr(console.OUT, "_width", 80)
    rows = [["lexical kinematic shortcut", "48/48 100.0 % a", "12/48 25.0 % b", "−75.0 (−88.0 to −61.2)", "< 0.001"]]
    print_table(["what", "zoo:lexical", "a policy with a long name", "difference, 95 %", "p"], rows, whole=(1, 2))
    shown = capsys.readouterr().out
    assert all(rate in shown for rate in rows[0][1:3])
    assert max(map(len, shown.splitlines())) <= 80


@each("verb", VERBS)
def test_the_example_of_a_verb_can_be_pasted_from_a_narrow_terminal(verb):
    lines = help_of(verb, columns=60).splitlines()
    (start,) = [i for i, line in enumerate(lines) if line.startswith("Example: ")]
    shown = lines[start : lines.index("", start)]
    assert all(line.endswith(" \\") for line in shown[:-1])
    assert not shown[-1].endswith("\\")
    words = "\n".join(shown).removeprefix("Example: ").replace("\\\n", " ")
    assert shlex.split(words)[:2] == ["better", verb]
    assert "\n" not in words


def test_the_text_of_an_option_breaks_only_at_the_edge_of_the_terminal():
    """Line breaks of the docstring are not line breaks of the help."""
    assert "while the policy computes; default: chosen by a warm-up." in help_of("eval", columns=200)
    assert "set it in the policy address." in help_of("eval", columns=200)


def test_an_empty_default_is_not_shown():
    assert "--arm-port TEXT    Serial port of the arm.  " in help_of("real run")


@pytest.mark.parametrize(("words", "nearest"), [(["evl"], "eval"), (["raport", "x"], "report")])
def test_a_mistyped_verb_is_named_with_the_nearest_one(capsys, words, nearest):
    assert main(words) == 2
    assert f"Did you mean '{nearest}'" in capsys.readouterr().err


def test_a_mistyped_policy_is_reported_before_any_statement_about_the_plan(capsys, tmp_path):
    assert main(["eval", "--policy", "zoo:lexcial", "--out", str(tmp_path / "run")]) == 2
    assert capsys.readouterr().err.startswith("error: Unknown policy 'zoo:lexcial'. Did you mean 'zoo:lexical'")


def on_terminal(command, **environment):
    """Return what a command writes to a terminal, and its status."""
    ours, theirs = pty.openpty()
    process = subprocess.Popen(command, stdout=theirs, stderr=theirs, env={**os.environ, **environment})
    os.close(theirs)
    said = b""
    try:
        while block := os.read(ours, 65536):
            said += block
    except OSError:  # so a terminal ends
        pass
    os.close(ours)
    return said.decode(), process.wait()


LOG = """
import logging
from betterbench.jobs.worker_process import prepare_process
prepare_process()
logging.getLogger("betterbench.evaluation").warning("a trial broke")
"""


def test_what_a_worker_logs_takes_the_place_of_the_progress_bar_on_a_terminal():
    command = [sys.executable, "-c", LOG]
    assert on_terminal(command, TERM="xterm")[0] == "\r\x1b[2Ka trial broke\r\n"
    assert on_terminal(command, TERM="dumb")[0] == "a trial broke\r\n"
    assert subprocess.run(command, capture_output=True, text=True, check=True).stderr == "a trial broke\n"


def test_no_color_keeps_colors_out_of_help_and_errors():
    better = [sys.executable, "-m", "betterbench.cli"]
    environment = {"TERM": "xterm-256color", "COLUMNS": "80"}
    colored, _ = on_terminal([*better, "worlds", "--polcy", "x"], **environment)
    assert "\x1b[" in colored
    for words in (["--help"], ["worlds", "--polcy", "x"], ["evl"]):
        plain, _ = on_terminal([*better, *words], NO_COLOR="1", **environment)
        assert "\x1b[3" not in plain
        assert "\x1b[9" not in plain


def test_a_reader_that_has_seen_enough_is_no_error():
    better = [sys.executable, "-m", "betterbench.cli", "list", "variations"]
    process = subprocess.Popen(better, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    process.stdout.close()
    err = process.stderr.read()
    process.stderr.close()
    assert (process.wait(), err) == (0, b"")


def test_the_overview_fits_80_columns(capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    with pytest.raises(SystemExit):
        main(["--help"])
    out = capsys.readouterr().out
    assert out.startswith("usage: better [-h] COMMAND\n")
    assert max(map(len, out.splitlines())) <= 80


@pytest.mark.parametrize(("verb", "goes_on"), [("certify", True), ("compare", False)])
def test_an_interrupted_verb_says_whether_it_goes_on(capsys, monkeypatch, verb, goes_on):
    def interrupted(*_args, **_options):
        raise KeyboardInterrupt

    monkeypatch.setattr(type(VERBS[verb]), "load", interrupted)
    assert main([verb]) == 130
    assert ("same command" in capsys.readouterr().err) == goes_on


def test_a_worker_whose_run_is_gone_ends_without_a_word(monkeypatch):
    """Also where the run has not read what the worker sent, which resets the connection."""
    import multiprocessing

    from betterbench.evaluation.workers import pool

    class Ready:
        free = envs = 1
        busy, problem = False, None

        def __init__(self, _settings, **_):
            pass

        def __enter__(self):
            return self

        def __exit__(self, *_):
            pass

    class Settings:
        envs = 1
        turn = 0
        held = ()

    problems = []
    monkeypatch.setattr(pool, "Worker", Ready)
    monkeypatch.setattr(threading, "excepthook", lambda problem: problems.append(problem.exc_type))
    ours, theirs = multiprocessing.get_context("spawn").Pipe()
    worker = threading.Thread(target=pool.work, args=(Settings(), theirs))
    worker.start()
    assert ours.poll(10.0)
    ours.close()
    worker.join(10.0)
    assert not worker.is_alive()
    assert problems == []


def test_the_further_lines_of_an_item_are_set_in_and_no_number_loses_its_sign(monkeypatch):
    shown = io.StringIO()
    monkeypatch.setattr(console, "OUT", console.Terminal(file=shown, force_terminal=True, width=40, color_system=None))
    text = "; ".join(f"{n} %: thing and place \x1b[31m[red]" for n in range(10, 90))
    console.print_item(text, indent=2)
    lines = shown.getvalue().splitlines()
    assert max(map(len, lines)) <= 40
    assert lines[0].startswith("  10 %")
    assert all(line.startswith("    ") and not line.strip().startswith("%") for line in lines[1:])
    assert " ".join(line.strip() for line in lines) == one_line(text, most=20_000)
    assert not UNPRINTABLE.search("".join(lines))
    shown = io.StringIO()
    monkeypatch.setattr(console, "OUT", console.Terminal(file=shown))
    console.print_item(text, indent=2)
    assert shown.getvalue() == f"  {one_line(text, most=20_000)}\n"
