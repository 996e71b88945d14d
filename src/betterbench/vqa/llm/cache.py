"""Cache of model replies. It is keyed by the content of the request and shared between runs and processes.

Each reply is a JSON file with a checksum. Files are written under a temporary name and then renamed, so that several
processes can use the same folder. Files are not flushed to disk. A file that was damaged by a power failure is
recognized by its checksum, and the request is sent again. The folder may be deleted at any time.
"""

from __future__ import annotations

import hashlib
import json
import logging
import os
import tempfile
import threading
from pathlib import Path

import platformdirs

from betterbench.errors import BetterError, one_line
from betterbench.json_form import open_seal, read_bounded, sealed_form
from betterbench.vqa.llm.reply import Reply

logger = logging.getLogger(__name__)

_FORM = "1"
"""Version of the cache files, which is part of the key."""
_MAX_BYTES = 1 << 26


class ReplyCache:
    """Cache of replies, looked up by request. Several threads and processes can use it at the same time.

    Attributes:
        folder: Folder of the files.
    """

    def __init__(self, folder: Path | None = None) -> None:
        """Set the folder of the cache. By default, this folder is in the user's cache folder. It is not created yet."""
        self.folder = folder or platformdirs.user_cache_path("betterbench") / "replies"
        self._lock, self._is_off = threading.Lock(), False

    def key(self, address: str, body: bytes) -> str:
        """Return the key of a request: the SHA-256 of its address and its complete body.

        The body contains the model, the prompt, the bytes of the images as they are sent, the sampling settings and the
        processor arguments. Requests with the same key are therefore identical.
        """
        digest = hashlib.sha256(f"{_FORM}\n{address}\n".encode())
        digest.update(body)
        return digest.hexdigest()

    def get(self, key: str) -> Reply | None:
        """Return the stored reply to a request, or None if no reply is stored or its file is damaged."""
        file = self._file(key)
        try:
            raw = read_bounded(file, max_bytes=_MAX_BYTES, cure="")
            form = open_seal(raw, where=str(file), cure="")
            if form["key"] != key or not isinstance(form["text"], str):
                return None
            tokens = form["prompt_tokens"], form["completion_tokens"]
        except (BetterError, KeyError, ValueError):
            return None
        prompt, completion = (count if type(count) is int and count >= 0 else None for count in tokens)
        return Reply(form["text"], prompt, completion, is_cached=True, is_cut=form.get("is_cut") is True)

    def put(self, key: str, reply: Reply) -> None:
        """Store a reply. If the folder cannot be written, log a single warning and do not store any more replies."""
        if self._is_off:
            return
        tokens = {"prompt_tokens": reply.prompt_tokens, "completion_tokens": reply.completion_tokens}
        form = sealed_form({"key": key, "text": reply.text, **tokens, **({"is_cut": True} if reply.is_cut else {})})
        file = self._file(key)
        try:
            try:
                _write(file, json.dumps(form).encode())
            except FileNotFoundError:
                file.parent.mkdir(parents=True, exist_ok=True)
                _write(file, json.dumps(form).encode())
        except OSError as error:
            with self._lock:
                if not self._is_off:
                    logger.warning("%s: the replies cannot be stored for later runs (%s)", self.folder, one_line(error))
                self._is_off = True

    def _file(self, key: str) -> Path:
        return self.folder / key[:2] / f"{key}.json"


def _write(file: Path, data: bytes) -> None:
    """Write a file under a temporary name and rename it."""
    handle, part = tempfile.mkstemp(prefix=f".{file.name[:8]}.", suffix=".part", dir=file.parent)
    try:
        with os.fdopen(handle, "wb") as opened:
            opened.write(data)
        Path(part).replace(file)
    except BaseException:
        Path(part).unlink()
        raise
