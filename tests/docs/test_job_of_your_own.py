"""The job on the page for contributors is carried out: it resumes, and one command at a time writes to its folder."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]

CHECK = """
import sys

from betterbench.errors import RunConflictError

if __name__ == "__main__":
    out, files = Path(sys.argv[1]), [Path(name) for name in sys.argv[2:]]

    def stop(progress):
        if progress.last is not None:
            raise KeyboardInterrupt

    try:
        count_all(files, out, on_progress=stop)
    except KeyboardInterrupt:
        pass
    with (out / "journal.jsonl").open("a") as journal:
        journal.write('{"file": "half a li')
    told = []
    found = count_all(files, out, workers=2, on_progress=lambda p: told.append((p.done, p.planned)))
    assert found == {str(file): number for number, file in enumerate(files)}, found
    assert told == [(1, 4), (2, 4), (3, 4), (4, 4)], told
    with WordCounts(out / "journal.jsonl"):
        try:
            count_all(files, out)
        except RunConflictError:
            print("carried out")
"""


def test_the_job_of_the_page_resumes_and_is_alone(tmp_path):
    page = (ROOT / "docs" / "contributing.md").read_text()
    (code,) = (block for block in re.findall(r"```python\n(.*?)```", page, flags=re.DOTALL) if "run_items" in block)
    (tmp_path / "job.py").write_text(code + CHECK)
    files = [tmp_path / f"{number}.txt" for number in range(4)]
    for number, file in enumerate(files):
        file.write_text("word " * number)
    done = subprocess.run(
        [sys.executable, str(tmp_path / "job.py"), str(tmp_path / "counts"), *map(str, files)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.stdout == "carried out\n", done.stderr
    assert "the incomplete last line was removed" in done.stderr
