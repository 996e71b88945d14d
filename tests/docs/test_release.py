"""What the project offers to others fits what it has: the image, the example of a CI job, run files, exit statuses."""

from __future__ import annotations

import fnmatch
import importlib
import re
import shlex
from pathlib import Path

import pytest
import yaml

from betterbench.cli.main import EXIT_BAD_INPUT, EXIT_INTERRUPTED, VERBS, main
from betterbench.cli.run_file import read_run_file

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "command-line.md").read_text()
DOCKERFILE = (ROOT / "Dockerfile").read_text()
BLOCKS = re.findall(r"```yaml\n(.*?)```", PAGE, flags=re.DOTALL)
JOB = next(block for block in BLOCKS if "runs-on" in block)


def test_the_image_is_made_from_files_that_exist_and_are_sent():
    ignore = (ROOT / ".dockerignore").read_text().split()
    sent = {line[1:] for line in ignore if line.startswith("!")}
    copies = re.findall(r"^COPY (?!--from)(.*) \S+$", DOCKERFILE, flags=re.MULTILINE)
    for name in " ".join(copies).split():
        assert (ROOT / name).exists(), name
        assert any(fnmatch.fnmatch(name, pattern) or name.startswith(f"{pattern}/") for pattern in sent), name


def test_the_image_has_the_libraries_that_the_set_up_installs(monkeypatch):
    monkeypatch.syspath_prepend(ROOT / "tools")
    packages = importlib.import_module("setup_environment").GL_PACKAGES
    for package in packages:
        assert package in DOCKERFILE
        assert package in JOB


def test_the_image_runs_the_command_and_not_as_root():
    assert 'ENTRYPOINT ["better"]' in DOCKERFILE
    assert re.search(r"^USER (?!root)", DOCKERFILE, flags=re.MULTILINE)


def test_the_example_of_a_run_file_is_read(tmp_path):
    (tmp_path / "run.yaml").write_text(BLOCKS[0])
    assert read_run_file(tmp_path / "run.yaml").tasks == ("fast_food", "morning_coffee")


def commands_of_the_job():
    steps = yaml.safe_load(JOB)["jobs"]["better"]["steps"]
    return [step["run"] for step in steps if step.get("run", "").startswith("better ")]


@pytest.mark.parametrize("command", commands_of_the_job())
def test_the_job_uses_verbs_and_options_that_exist(command, capsys):
    verb, *words = shlex.split(command)[1:]
    assert verb in VERBS
    with pytest.raises(SystemExit):
        main([verb, "--help"])
    offered = capsys.readouterr().out
    for word in words:
        if word.startswith("--"):
            assert re.search(rf"{word}\b", offered), word


def test_the_exit_statuses_are_those_of_the_program():
    for status in (0, EXIT_BAD_INPUT, EXIT_INTERRUPTED):
        assert f"| {status} | " in PAGE
