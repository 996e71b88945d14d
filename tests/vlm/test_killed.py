"""Runs that are killed at any moment, and the same command again: no stored answer is asked for twice."""

from __future__ import annotations

import json
import re
import signal
import subprocess
import sys
from collections import Counter

import pytest
from tests.vlm import published
from tests.vlm.published import texts_of

from betterbench.errors import ModelError
from betterbench.vlm import RunSettings, evaluate_model, find_benchmark
from betterbench.vlm.prompts import find_prompt
from betterbench.vqa import asking
from betterbench.vqa.llm import ChatModel, ReplyCache, endpoint_at

COUNT = 12
_DYING = """
import os, signal, sys
from pathlib import Path
from tests.vlm.test_killed import run_once
from betterbench.jobs import line_journal
from betterbench.vlm import running
from betterbench.vqa import asking
from betterbench.vqa.llm import cache, connections

moment, folder, url, out, kept = sys.argv[1:]
calls = [0]

def die():
    os.kill(os.getpid(), signal.SIGKILL)

def at_fifth(owner, name, before=None, after=None):
    original = getattr(owner, name)
    def patched(*args, **named):
        calls[0] += 1
        if calls[0] == 5 and before is not None:
            before(*args)
            die()
        found = original(*args, **named)
        if calls[0] == 5 and after is not None:
            die()
        return found
    setattr(owner, name, patched)

def nothing(*_):
    pass

def half_file(file, data):
    part = file.parent / ".half.part"
    part.parent.mkdir(parents=True, exist_ok=True)
    part.write_bytes(data[: len(data) // 2])

def half_line(handle, data, place):
    pwrite(handle, data[: len(data) // 2], place)

pwrite = os.pwrite
match moment:
    case "before a request": at_fifth(connections.Connections, "post", before=nothing)
    case "after a reply": at_fifth(connections.Connections, "post", after=True)
    case "within a cache file": at_fifth(cache, "_write", before=half_file)
    case "after a cache file": at_fifth(cache.ReplyCache, "put", after=True)
    case "before a line": at_fifth(asking._AnswerFile, "append", before=nothing)
    case "within a line":
        calls[0] = -3
        at_fifth(line_journal.os, "pwrite", before=half_line)
    case "after a line": at_fifth(asking._AnswerFile, "append", after=True)
    case "before the end of the answers": asking.LineJournal.close = lambda _: die()
    case "before the items": running._write = lambda *_: die()
    case "before the result":
        write = running.write_durably
        running.write_durably = lambda file, data: die() if file.name == "result.json" else write(file, data)
run_once(folder, url, out, kept)
"""
MOMENTS = re.findall(r'case "([^"]+)"', _DYING)
LOST = ("after a reply", "within a cache file")
"""Moments at which one reply has arrived and is not stored."""


def run_once(folder, url, out, kept, *, cached=True):
    from pathlib import Path

    benchmark = find_benchmark("embspatial")
    cache = ReplyCache(Path(kept)) if cached else None
    model = ChatModel(endpoint_at(f"{url}#tiny", cache=cache))
    settings = RunSettings(find_prompt("embspatial", None), at_once=1)
    return evaluate_model(benchmark, benchmark.load(Path(folder)), model, Path(out), settings)


@pytest.fixture
def asked(serve, tmp_path):
    """Returns data, the address of a server, and the number of requests by item."""
    folder, served = tmp_path / "data", Counter()
    folder.mkdir()
    picture = published.base64.b64encode(published.picture(1)).decode()
    rows = [
        row | {"question": f"Question number {i}?", "image": picture}
        for i, row in enumerate(published.embspatial_rows(COUNT))
    ]
    (folder / "questions.json").write_text(json.dumps(rows))

    def answer(body):
        number = int(re.search(r"number (\d+)", texts_of(body))[1])
        served[number] += 1
        return "ABCD"[number % 4]

    return folder, serve(answer).url, served


def test_there_are_ten_moments():
    assert len(MOMENTS) == 10


@pytest.mark.slow
@pytest.mark.parametrize("moment", MOMENTS)
def test_a_run_killed_at_any_moment_asks_no_item_twice(moment, asked, tmp_path):
    folder, url, served = asked
    places = [str(folder), url, str(tmp_path / "run"), str(tmp_path / "kept")]
    died = subprocess.run([sys.executable, "-c", _DYING, moment, *places], capture_output=True, text=True, check=False)
    assert died.returncode == -signal.SIGKILL, died.stderr
    found = run_once(*places)
    assert found.score.headline["strict"] == 1
    assert set(served) == set(range(COUNT))
    again = served.total() - COUNT
    if "line" in moment:  # another thread may have had a request on its way
        assert again <= 1, served
    else:
        assert again == (1 if moment in LOST else 0), served
    before = served.total()
    run_once(*places)
    assert served.total() == before


@pytest.mark.parametrize("cached", [True, False])
def test_replies_between_the_cache_and_the_answers_are_not_asked_again(cached, asked, tmp_path, monkeypatch):
    folder, url, served = asked
    places = (folder, url, tmp_path / "run", tmp_path / "kept")
    append = asking._AnswerFile.append

    def breaks(journal, answer):
        if len(journal.known) == 4:
            raise ModelError("stopped")
        append(journal, answer)

    with monkeypatch.context() as patched:
        patched.setattr(asking._AnswerFile, "append", breaks)
        with pytest.raises(ModelError, match="stopped"):
            run_once(*places, cached=cached)
    assert run_once(*places, cached=cached).score.headline["strict"] == 1
    assert all(served[n] == 1 for n in range(4))
    again = served.total() - COUNT
    assert again <= 1 if cached else again >= 1  # a request on its way at the stop is sent again
