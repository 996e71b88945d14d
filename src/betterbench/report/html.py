"""Helpers for HTML pages: the template environment, data URIs, and writing files."""

from __future__ import annotations

from base64 import b64encode
from importlib import resources
from pathlib import Path
from types import CodeType

from jinja2 import BytecodeCache, Environment, PackageLoader, StrictUndefined
from jinja2.bccache import Bucket
from markupsafe import Markup

from betterbench.errors import printable
from betterbench.jobs import write_durably
from betterbench.quoting import LONGEST_TEXT


class _CompiledTemplates(BytecodeCache):
    """Compiled templates of this process, because compiling that of the report takes 0.3 s."""

    def __init__(self) -> None:
        self._codes: dict[tuple[str, str], CodeType] = {}

    def load_bytecode(self, bucket: Bucket) -> None:
        bucket.code = self._codes.get((bucket.key, bucket.checksum))

    def dump_bytecode(self, bucket: Bucket) -> None:
        if bucket.code is not None:
            self._codes[bucket.key, bucket.checksum] = bucket.code


_COMPILED = _CompiledTemplates()


def environment() -> Environment:
    """Return the environment of all templates.

    The environment escapes every value, and raises an error if a template uses an unknown name.
    """
    return Environment(
        loader=PackageLoader("betterbench.report", "templates"),
        autoescape=True,
        finalize=_bounded,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        bytecode_cache=_COMPILED,
    )


def asset(name: str) -> str:
    """Return the content of a text file in the templates folder."""
    return resources.files("betterbench.report").joinpath("templates", name).read_text(encoding="utf-8")


def _bounded(value: object) -> object:
    """Shorten a long text from an untrusted source, since a page may repeat the text many times."""
    return printable(value, most=LONGEST_TEXT) if isinstance(value, str) and not isinstance(value, Markup) else value


def data_uri(data: bytes | str, media_type: str) -> Markup:
    """Encode data as a data URI, so that it can be embedded in a self-contained page."""
    if isinstance(data, str):
        data, media_type = data.encode(), f"{media_type};charset=utf-8"
    return Markup(f"data:{media_type};base64,{b64encode(data).decode('ascii')}")  # noqa: S704 - Base64 needs no escaping


def write(path: Path, data: bytes | str) -> Path:
    """Write a file durably and atomically. Return its path."""
    write_durably(path, data.encode() if isinstance(data, str) else data)
    return path
