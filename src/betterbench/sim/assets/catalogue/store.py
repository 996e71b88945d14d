"""SQLite file that stores the rows of an asset catalogue and the words in them."""

from __future__ import annotations

import contextlib
import json
import sqlite3
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Self

from betterbench.errors import InvalidInputError, RecordError, StorageError
from betterbench.geometry import Vector
from betterbench.json_form import parse_json
from betterbench.sim.assets.catalogue.entry import CatalogueEntry
from betterbench.sim.assets.catalogue.terms import terms

FILE = "catalogue.sqlite"
VERSION = 3
"""Version of the tables. Catalogues of other versions must be indexed again."""
_APPLICATION = 0x62657474
"""Application id that marks the SQLite file of a catalogue: "bett"."""

_TABLES = """
CREATE TABLE facts (key TEXT PRIMARY KEY, value TEXT NOT NULL) WITHOUT ROWID;
CREATE TABLE sources (number INTEGER PRIMARY KEY, name TEXT NOT NULL UNIQUE, address TEXT NOT NULL);
CREATE TABLE assets (
    row INTEGER PRIMARY KEY, id TEXT NOT NULL UNIQUE, source INTEGER NOT NULL REFERENCES sources(number),
    fingerprint TEXT NOT NULL, content_hash TEXT NOT NULL, path TEXT NOT NULL, name TEXT NOT NULL, tags TEXT NOT NULL,
    description TEXT NOT NULL, category TEXT NOT NULL, color TEXT NOT NULL, size_x REAL, size_y REAL, size_z REAL,
    faces INTEGER, license TEXT NOT NULL, author TEXT NOT NULL, variants INTEGER NOT NULL
);
CREATE INDEX assets_by_source ON assets(source);
CREATE VIRTUAL TABLE words USING fts5(name, tags, description, tokenize='unicode61');
CREATE VIRTUAL TABLE vocabulary USING fts5vocab('words', 'row');
CREATE TABLE frequencies (term TEXT PRIMARY KEY, total INTEGER NOT NULL) WITHOUT ROWID;
"""
_COLUMNS = (
    "row, id, sources.name AS source_name, content_hash, path, assets.name AS name, tags, description, category, "
    "color, size_x, size_y, size_z, faces, license, author, variants"
)


@dataclass(frozen=True, slots=True)
class WordMatch:
    """A row whose words match a query, with the values used for filtering.

    Attributes:
        row: Row number.
        fields: Normalized words of the name, the tags and the description, separated by spaces.
        source: Name of the asset's source.
        faces: Number of triangles, or None if unknown.
        license: Name of the license. Empty if unknown.
        largest_m: Largest extent [m], or None if unknown.
    """

    row: int
    fields: tuple[str, str, str]
    source: str
    faces: int | None
    license: str
    largest_m: float | None


class Store:
    """The rows of a catalogue in its SQLite file. Used as a context manager, it closes the file at the end.

    Args:
        folder: Folder of the catalogue.
        writes: Whether rows will be written. If True, the file is created if it does not exist.

    Raises:
        InvalidInputError: If there is no catalogue in the folder.
        RecordError: If the file is damaged, was written by another program, or has a different version.
    """

    def __init__(self, folder: Path, *, writes: bool = False) -> None:
        self.path = folder / FILE
        exists = self.path.is_file()
        if not writes and not exists:
            raise InvalidInputError(str(folder), "it has no asset catalogue", "Run `better assets index`")
        with self.checked():
            mode = "rwc" if writes else "ro"
            self._database = sqlite3.connect(f"{self.path.absolute().as_uri()}?mode={mode}", uri=True)
            self._database.row_factory = sqlite3.Row
            if not exists:
                self._database.executescript(_TABLES)
                self._database.execute(f"PRAGMA application_id = {_APPLICATION}")
                self._database.execute(f"PRAGMA user_version = {VERSION}")
                self._database.commit()
            self._require_ours()

    def _require_ours(self) -> None:
        (application,) = self._database.execute("PRAGMA application_id").fetchone()
        (version,) = self._database.execute("PRAGMA user_version").fetchone()
        # A view or a trigger of another person could run a query that never ends.
        kinds = {kind for (kind,) in self._database.execute("SELECT type FROM sqlite_master")}
        if application == _APPLICATION and version == VERSION and kinds <= {"table", "index"}:
            return
        self._database.close()
        if application != _APPLICATION or version == VERSION:
            raise RecordError(f"{self.path} is not an asset catalogue. Use a different folder.")
        raise RecordError(
            f"{self.path} is a version {version} catalogue, but version {VERSION} is expected. Move the folder away "
            "and index the sources again."
        )

    @contextlib.contextmanager
    def checked(self) -> Iterator[None]:
        """Context manager that converts SQLite errors to errors with the name of the file and a remedy."""
        try:
            yield
        except sqlite3.OperationalError as error:
            if "full" in str(error):
                raise StorageError(
                    f"{self.path}: {error}. Free disk space, then run the same command again."
                ) from error
            raise self._damaged(error) from error
        except sqlite3.DatabaseError as error:
            raise self._damaged(error) from error

    def _damaged(self, error: sqlite3.Error) -> RecordError:
        return RecordError(
            f"{self.path}: is damaged or is not an asset catalogue ({error}). Move the folder away and "
            "index the sources again."
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._database.close()

    # -------------------------------------------------------------------------------------------------------- facts

    def fact(self, key: str) -> str:
        """Return a stored fact about the catalogue, or an empty string if the fact is not stored."""
        with self.checked():
            found = self._database.execute("SELECT value FROM facts WHERE key = ?", (key,)).fetchone()
        return "" if found is None else str(found[0])

    def note(self, **facts: str) -> None:
        """Store facts about the catalogue, and commit the transaction."""
        with self.checked():
            self._database.executemany("INSERT OR REPLACE INTO facts VALUES (?, ?)", facts.items())
            self._database.commit()

    def sources(self) -> dict[str, tuple[int, str]]:
        """Return the number and the address of each source, keyed by the name of the source."""
        with self.checked():
            found = self._database.execute("SELECT name, number, address FROM sources ORDER BY number").fetchall()
        return {name: (number, address) for name, number, address in found}

    def add_source(self, name: str, address: str) -> int:
        """Add a source if it is new, and return its number.

        Raises:
            InvalidInputError: If a source with this name but a different address exists, or there are too many sources.
        """
        known = self.sources()
        if name in known and known[name][1] != address:
            both = f"the catalogue already uses this name for {known[name][1]}, but the given address is {address}"
            raise InvalidInputError(f"source {name}", both, "Choose a different name with --name")
        if name not in known and len(known) >= 255:
            raise InvalidInputError(
                "sources", "the catalogue already has the maximum of 255 sources", "Use a different catalogue"
            )
        with self.checked():
            self._database.execute("INSERT OR IGNORE INTO sources (name, address) VALUES (?, ?)", (name, address))
            self._database.commit()
        return self.sources()[name][0]

    # --------------------------------------------------------------------------------------------------------- rows

    def count(self) -> int:
        """Return the number of rows."""
        with self.checked():
            return int(self._database.execute("SELECT count(*) FROM assets").fetchone()[0])

    def fingerprints(self, source: int) -> dict[str, str]:
        """Return the fingerprint of each row of a source, keyed by the row's id."""
        with self.checked():
            found = self._database.execute("SELECT id, fingerprint FROM assets WHERE source = ?", (source,))
            return dict(found.fetchall())

    def write(self, source: int, rows: Iterable[tuple[str, CatalogueEntry]]) -> None:
        """Write rows with their fingerprints, and commit the transaction. Rows with the same ids are replaced."""
        with self.checked():
            for fingerprint, entry in rows:
                self._remove(entry.id)
                size: Sequence[float | None] = entry.size_m or (None, None, None)
                values: list[object] = [entry.id, source, fingerprint, entry.content_hash, entry.path, entry.name]
                values += [json.dumps(entry.tags), entry.description, entry.category, entry.color, *size, entry.faces]
                values += [entry.license, entry.author, entry.variants]
                marks = ", ".join("?" * len(values))
                fields = "id, source, fingerprint, content_hash, path, name, tags, description, category, color, "
                fields += "size_x, size_y, size_z, faces, license, author, variants"
                made = self._database.execute(f"INSERT INTO assets ({fields}) VALUES ({marks})", values)  # noqa: S608
                words = (
                    " ".join(terms(f"{entry.category} {entry.name}")),
                    " ".join(terms(f"{' '.join(entry.tags)} {entry.color}")),
                    " ".join(terms(entry.description)),
                )
                self._database.execute(
                    "INSERT INTO words (rowid, name, tags, description) VALUES (?, ?, ?, ?)", (made.lastrowid, *words)
                )
            self._database.commit()

    def remove(self, ids: Iterable[str]) -> None:
        """Remove the rows with the given ids, and commit the transaction."""
        with self.checked():
            for one in ids:
                self._remove(one)
            self._database.commit()

    def _remove(self, one: str) -> None:
        found = self._database.execute("SELECT row FROM assets WHERE id = ?", (one,)).fetchone()
        if found is not None:
            self._database.execute("DELETE FROM words WHERE rowid = ?", (found[0],))
            self._database.execute("DELETE FROM assets WHERE row = ?", (found[0],))

    def entries(self, *, after: int = 0, limit: int = 1 << 62) -> list[tuple[int, int, CatalogueEntry]]:
        """Return the rows after a given row number, in order, as tuples (row number, source number, entry)."""
        with self.checked():
            found = self._database.execute(
                f"SELECT {_COLUMNS}, source FROM assets JOIN sources ON sources.number = assets.source "  # noqa: S608
                "WHERE row > ? ORDER BY row LIMIT ?",
                (after, limit),
            ).fetchall()
        return [(line["row"], line["source"], self._entry(line)) for line in found]

    def rows(self, numbers: Sequence[int]) -> dict[int, CatalogueEntry]:
        """Return the rows with the given row numbers. Numbers without a row are left out."""
        marks = ", ".join("?" * len(numbers))
        with self.checked():
            found = self._database.execute(
                f"SELECT {_COLUMNS} FROM assets JOIN sources ON sources.number = assets.source WHERE row IN ({marks})",  # noqa: S608
                list(map(int, numbers)),
            ).fetchall()
        return {line["row"]: self._entry(line) for line in found}

    def row_of(self, asset_id: str) -> CatalogueEntry | None:
        """Return the row with the given id, or None if there is no such row."""
        with self.checked():
            line = self._database.execute(
                f"SELECT {_COLUMNS} FROM assets JOIN sources ON sources.number = assets.source WHERE id = ?",  # noqa: S608
                (asset_id,),
            ).fetchone()
        return None if line is None else self._entry(line)

    def ids_like(self, text: str, limit: int) -> list[str]:
        """Return at most ``limit`` ids that contain the given string."""
        with self.checked():
            found = self._database.execute(
                "SELECT id FROM assets WHERE instr(id, ?) > 0 ORDER BY row LIMIT ?", (text, limit)
            ).fetchall()
        return [line[0] for line in found]

    def licenses(self) -> list[tuple[str, str, int]]:
        """Return the number of assets for each source and license, as tuples (source, license, number).

        For each source, the most frequent license comes first.
        """
        with self.checked():
            found = self._database.execute(
                "SELECT sources.name, license, count(*) AS total FROM assets JOIN sources ON number = source "
                "GROUP BY source, license ORDER BY number, total DESC, license"
            ).fetchall()
        return [(source, name, total) for source, name, total in found]

    def _entry(self, line: sqlite3.Row) -> CatalogueEntry:
        try:
            tags = parse_json(line["tags"])
            size: Vector | None = None
            if line["size_x"] is not None:
                size = (float(line["size_x"]), float(line["size_y"]), float(line["size_z"]))
            return CatalogueEntry(
                id=line["id"],
                source=line["source_name"],
                name=line["name"],
                content_hash=line["content_hash"],
                path=line["path"],
                description=line["description"],
                tags=tuple(map(str, tags)),
                category=line["category"],
                color=line["color"],
                size_m=size,
                faces=line["faces"],
                license=line["license"],
                author=line["author"],
                variants=line["variants"],
            )
        except (TypeError, ValueError) as error:
            raise RecordError(
                f"{self.path}: row {line['row']} is damaged ({error}). Index the sources again."
            ) from error

    # -------------------------------------------------------------------------------------------------------- words

    def count_terms(self) -> None:
        """Count the rows in which each term occurs, and store the counts.

        Without stored counts, SQLite's full-text search would read every match to count a term. For a term that occurs
        in most of 800,000 rows, this would take 30 ms.
        """
        with self.checked():
            self._database.execute("DELETE FROM frequencies")
            self._database.execute("INSERT INTO frequencies SELECT term, doc FROM vocabulary")
            self._database.commit()

    def frequencies(self, words: Iterable[str]) -> dict[str, int]:
        """Return the stored number of rows in which each word occurs. Words that occur in no row are left out."""
        found = {}
        with self.checked():
            for word in dict.fromkeys(words):
                line = self._database.execute("SELECT total FROM frequencies WHERE term = ?", (word,)).fetchone()
                if line is not None:
                    found[word] = int(line[0])
        return found

    def matching(self, expression: str, limit: int, *, ranked: bool) -> list[WordMatch]:
        """Return at most ``limit`` rows that match an FTS5 expression, in no particular order.

        If there are more matches than ``limit``, ``ranked`` determines whether the best or the first matches are
        returned.
        """
        order = "ORDER BY bm25(words, 6.0, 3.0, 1.0), rowid" if ranked else "ORDER BY rowid"
        # The inner query sorts row numbers alone: sorting the words of all matches takes longer.
        with self.checked():
            found = self._database.execute(
                "SELECT best, words.name, words.tags, words.description, sources.name, faces, license, "  # noqa: S608
                "max(size_x, size_y, size_z) FROM "
                f"(SELECT rowid AS best FROM words WHERE words MATCH ? {order} LIMIT ?) "
                "JOIN words ON words.rowid = best JOIN assets ON assets.row = best "
                "JOIN sources ON sources.number = assets.source",
                (expression, limit),
            ).fetchall()
        return [WordMatch(line[0], line[1:4], *line[4:]) for line in found]
