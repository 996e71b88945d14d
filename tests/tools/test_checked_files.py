"""`make check` looks at the code of the project, and not at what a user keeps beside it in the clone."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]


def test_a_policy_of_a_user_in_the_clone_is_not_linted(tmp_path):
    shutil.copy(ROOT / "pyproject.toml", tmp_path)
    ours = ("src/betterbench/a.py", "tests/cli/b.py", "tools/c.py", "benchmarks/d.py", "packages/e/src/e/f.py")
    theirs = ("my_policy.py", "runs/mine/task_files/g.py")
    for name in (*ours, *theirs):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text("x=1\n")
    command = [sys.executable, "-m", "ruff", "check", "--no-cache", "--show-files"]
    listed = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=True).stdout.splitlines()
    assert {Path(line).relative_to(tmp_path).as_posix() for line in listed if line.endswith(".py")} == set(ours)
