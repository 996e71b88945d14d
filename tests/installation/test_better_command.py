"""Commands in messages begin as this installation is started; files that travel say ``better``."""

from __future__ import annotations

import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from betterbench import installation
from betterbench.cli.console import complain, say
from betterbench.cli.main import VERBS
from betterbench.installation import as_started_here, better_command


@pytest.fixture
def environment(tmp_path, monkeypatch):
    """An environment with a script of its own, which is not on the path."""
    scripts = tmp_path / "my clone" / ".venv" / "bin"
    scripts.mkdir(parents=True)
    script = scripts / "better"
    script.write_text("#!/bin/sh\n", encoding="utf-8")
    script.chmod(0o755)
    monkeypatch.setattr(sys, "argv", ["/usr/bin/pytest"])
    monkeypatch.setattr(installation.sysconfig, "get_path", lambda _: str(scripts))
    monkeypatch.setenv("PATH", "/usr/bin")
    return script


def test_the_verbs_are_those_of_the_command_line():
    assert set(installation.VERBS) == set(VERBS)


def test_the_command_is_how_this_one_can_be_started(environment, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    assert shlex.split(better_command()) == ["my clone/.venv/bin/better"]
    monkeypatch.chdir(environment.parents[2])
    assert better_command() == ".venv/bin/better"
    monkeypatch.chdir("/usr")
    assert shlex.split(better_command()) == [str(environment)]
    monkeypatch.setenv("PATH", f"{environment.parent}:/usr/bin")
    assert better_command() == "better"


def test_another_better_on_the_path_is_not_this_one(environment, monkeypatch, tmp_path):
    (tmp_path / "better").write_text("#!/bin/sh\n", encoding="utf-8")
    (tmp_path / "better").chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path))
    assert better_command() != "better"
    (tmp_path / "better").unlink()
    (tmp_path / "better").symlink_to(environment)
    assert better_command() == "better"


def test_without_a_script_the_module_is_named(environment, monkeypatch):
    environment.unlink()
    monkeypatch.setattr(sys, "executable", "/opt/my env/bin/python")
    assert better_command() == "'/opt/my env/bin/python' -m betterbench.cli"


def test_the_script_that_was_started_is_named(environment, monkeypatch, tmp_path):
    other = tmp_path / "user" / "better"
    other.parent.mkdir()
    other.touch()
    monkeypatch.setattr(sys, "argv", [str(other), "eval"])
    monkeypatch.chdir("/usr")
    assert better_command() == str(other)


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("Run better certify --tasks a", "Run X/better certify --tasks a"),
        ("Run `better worlds install libero` once", "Run `X/better worlds install libero` once"),
        ("next        better report runs/a", "next        X/better report runs/a"),
        ("Give a run of better collect", "Give a run of better collect"),
        ("Pass a run made with `better eval`", "Pass a run made with `better eval`"),
        ("the image size of `better real run`", "the image size of `better real run`"),
        ("a file that better view wrote", "a file that better view wrote"),
        ("Pass a run of `better collect`", "Pass a run of `better collect`"),
        ("that `better view` or `better eval` wrote", "that `better view` or `better eval` wrote"),
        ("error: better vqa: no folder is given", "error: better vqa: no folder is given"),
        ("the better listing, a better list-like thing", "the better listing, a better list-like thing"),
        ("X/better report runs/a", "X/better report runs/a"),
        ("better than nothing", "better than nothing"),
    ],
)
def test_commands_in_a_message_begin_as_here_and_prose_stays(monkeypatch, text, shown):
    monkeypatch.setattr(installation, "better_command", lambda: "X/better")
    assert as_started_here(text) == shown
    assert as_started_here(shown) == shown


def test_messages_and_errors_name_it(monkeypatch, capsys):
    monkeypatch.setattr(installation, "better_command", lambda: "X/better")
    say("Run better report runs/a")
    complain("Run better certify --tasks a")
    said = capsys.readouterr().err
    assert "Run X/better report runs/a" in said
    assert "Run X/better certify --tasks a" in said


def test_reports_do_not_depend_on_this_machine():
    from betterbench.report.figures.media import Media

    command = Media(folders={"p": "runs/a"}).replay_command("p", "records/t/T1/0.parquet")
    assert command == "better replay runs/a/records/t/T1/0.parquet --twin"


def test_the_printed_command_runs_from_another_folder(tmp_path):
    code = "from betterbench.installation import better_command; print(better_command())"
    command = subprocess.check_output([sys.executable, "-c", code], cwd=tmp_path, text=True).strip()
    done = subprocess.run(
        [*shlex.split(command), "--version"], cwd=tmp_path, capture_output=True, check=True, text=True
    )
    assert done.stdout.strip()


def test_the_front_pages_say_how_better_gets_on_the_path():
    root = Path(__file__).parents[2]
    for page in ("README.md", "docs/tutorial.md", "docs/index.md", "docs/command-line.md"):
        assert "source .venv/bin/activate" in (root / page).read_text(encoding="utf-8"), page
