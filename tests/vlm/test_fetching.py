"""Download of data from a hub, and what is said where none can be reached."""

from __future__ import annotations

import hashlib
import json
import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import pytest
from tests.vlm import published

from betterbench.cli.main import main
from betterbench.vlm import find_benchmark


@pytest.fixture
def hub(tmp_path, monkeypatch):
    """A hub that serves the files in a folder; "cut" answers end early."""
    root = tmp_path / "hub"
    asked = []

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self):
            asked.append(self.path)
            path = root / self.path.split("/resolve/main/")[-1]
            if not path.is_file():
                self.send_error(404)
                return
            data = path.read_bytes()
            self.send_response(200)
            self.send_header("Content-Length", str(len(data)))
            self.end_headers()
            self.wfile.write(data[: len(data) // 2] if (root / "cut").exists() else data)

        def log_message(self, *_):
            pass

    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    monkeypatch.setenv("HF_ENDPOINT", f"http://127.0.0.1:{server.server_port}")
    yield root, asked
    server.shutdown()
    server.server_close()


def test_files_are_fetched_once_and_can_be_read(hub, tmp_path, capsys):
    root, asked = hub
    published.refspatial_parquet(root)
    line = ["vlm", "fetch", "refspatial", "--data", str(tmp_path / "data"), "--json"]
    assert main(line) == 0
    found = json.loads(capsys.readouterr().out)
    assert [f["path"] for f in found["files"]] == [f.path for f in find_benchmark("refspatial").source.files]
    first = root / found["files"][0]["path"]
    assert found["files"][0]["sha256"] == hashlib.sha256(first.read_bytes()).hexdigest()
    assert asked[0] == "/datasets/BAAI/RefSpatial-Bench/resolve/main/data/location-00000-of-00001.parquet"
    assert len(find_benchmark("refspatial").load(tmp_path / "data").items) == 9
    assert main(line) == 0
    assert len(asked) == 3


def test_a_download_that_ends_early_leaves_no_file(hub, tmp_path, capsys):
    root, _ = hub
    published.refspatial_parquet(root)
    (root / "cut").touch()
    assert main(["vlm", "fetch", "refspatial", "--data", str(tmp_path / "data")]) == 2
    assert "cannot be downloaded" in capsys.readouterr().err
    assert not list((tmp_path / "data").rglob("*.parquet*"))


def test_without_a_hub_the_command_says_what_to_put_where(tmp_path, capsys, monkeypatch):
    monkeypatch.setenv("HF_ENDPOINT", "http://127.0.0.1:9")
    assert main(["vlm", "fetch", "egoplan2", "--data", str(tmp_path / "data")]) == 2
    said = " ".join(capsys.readouterr().err.split())
    for part in (f"{tmp_path / 'data' / 'EgoPlan-Bench2.json'}", "1.95 MB", "Ego4D", "license agreement"):
        assert part in said
    assert main(["vlm", "fetch", "embspatial"]) == 2
    told = capsys.readouterr()
    assert "embspatial_bench.json" in told.out
    assert "254" in told.out
    assert "CC-BY-4.0" in told.out
    assert "--data: this option is required" in told.err
    assert main(["vlm", "fetch", "better-vqa", "--data", "x"]) == 2
    assert "needs no data" in capsys.readouterr().err
    assert main(["vlm", "fetch"]) == 2
