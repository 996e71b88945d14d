"""Loading of tables and their rules from the packaged file or from another file in the same format."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from decimal import Decimal
from functools import cache
from importlib import resources
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field, TypeAdapter

from betterbench.errors import InvalidInputError, UnknownNameError
from betterbench.json_form import form_errors, parse_json, read_bounded
from betterbench_calibration.audit.chance import Chance
from betterbench_calibration.audit.claims import Composition, Differences
from betterbench_calibration.audit.fields import NonEmptyText, Number, exact_fields
from betterbench_calibration.audit.grids import Grid
from betterbench_calibration.audit.pooled import Pooled
from betterbench_calibration.audit.quotes import Quoted
from betterbench_calibration.audit.shape import Falling, Measured, Shares
from betterbench_calibration.audit.sums import Delta, Mean, Sum, Total
from betterbench_calibration.audit.table import AuditedTable, AuditRule

RULES: Mapping[str, type[AuditRule]] = {
    "grid": Grid,
    "mean": Mean,
    "sum": Sum,
    "delta": Delta,
    "total": Total,
    "pooled": Pooled,
    "falling": Falling,
    "measured": Measured,
    "shares": Shares,
    "quoted": Quoted,
    "chance": Chance,
    "composition": Composition,
    "differences": Differences,
}
"""Rules for tables, by their names in the file."""

MOST_BYTES = 1_000_000
"""Largest file that is read [bytes], because auditing a larger file would take too long."""

MOST_ROWS = 200
"""Maximum number of rows in a table, because all pairs of rows are compared."""

_CURE = "Correct the file, or start from the packaged file"


@exact_fields
@dataclass(frozen=True, slots=True)
class _TableForm:
    name: NonEmptyText
    title: NonEmptyText
    columns: Annotated[tuple[NonEmptyText, ...], Field(min_length=1)]
    rows: Annotated[dict[str, tuple[Number | None, ...]], Field(min_length=1, max_length=MOST_ROWS)]
    rules: tuple[dict[str, Any], ...]

    def __post_init__(self) -> None:
        if len(set(self.columns)) < len(self.columns):
            raise ValueError("a column occurs twice")
        for name, numbers in self.rows.items():
            if len(numbers) != len(self.columns):
                raise ValueError(f"row {name!r} must have {len(self.columns)} numbers, one per column")


@exact_fields
@dataclass(frozen=True, slots=True)
class _SourceForm:
    source: NonEmptyText
    tables: Annotated[tuple[_TableForm, ...], Field(min_length=1)]

    def __post_init__(self) -> None:
        names = [table.name for table in self.tables]
        for name in names:
            if names.count(name) > 1:
                raise ValueError(f"the table {name!r} occurs twice")


_SOURCE = TypeAdapter(_SourceForm)


@dataclass(frozen=True, slots=True)
class PaperSource:
    """Tables of a file, each with the rules that it must satisfy."""

    name: str
    tables: tuple[tuple[AuditedTable, tuple[AuditRule, ...]], ...]

    @property
    def by_name(self) -> dict[str, AuditedTable]:
        """Tables by name."""
        return {table.name: table for table, _ in self.tables}


@cache
def paper_tables() -> PaperSource:
    """Return the tables of the benchmark paper with their rules."""
    text = (
        resources.files("betterbench_calibration.audit").joinpath("data/paper_tables.json").read_text(encoding="utf-8")
    )
    return read_source(text, "paper_tables.json")


def load_tables(path: Path) -> PaperSource:
    """Return the tables in a JSON file with the same format as the packaged file.

    Raises the same errors as :func:`read_source`.
    """
    try:
        text = read_bounded(path, max_bytes=MOST_BYTES, cure="Give a JSON file, or split it").decode("utf-8")
    except UnicodeDecodeError as error:
        raise InvalidInputError(str(path), "is not UTF-8 text", "Give a JSON file") from error
    return read_source(text, str(path))


def read_source(text: str, where: str) -> PaperSource:
    """Return the tables in a JSON string.

    Raises InvalidInputError if the text is not JSON or a field is wrong, and UnknownNameError if a rule is unknown.
    """
    with form_errors(where, _CURE):
        # Numbers are parsed as decimals to keep the printed digits. Pydantic's own JSON parser would lose them.
        source = _SOURCE.validate_python(parse_json(text, unique=True, number=Decimal))
    return PaperSource(
        source.source, tuple(_table(form, f"{where}: tables[{i}]") for i, form in enumerate(source.tables))
    )


def _table(form: _TableForm, where: str) -> tuple[AuditedTable, tuple[AuditRule, ...]]:
    table = AuditedTable(form.name, form.title, form.columns, tuple(form.rows.items()))
    return table, tuple(_rule(f, table, f"{where}.rules[{i}]") for i, f in enumerate(form.rules))


def _rule(form: Mapping[str, Any], table: AuditedTable, where: str) -> AuditRule:
    name = form.get("rule")
    if not isinstance(name, str) or name not in RULES:
        raise UnknownNameError(f"rule in {where}", str(name), RULES)
    with form_errors(where, _CURE):
        fields = {key: value for key, value in form.items() if key != "rule"}
        return TypeAdapter(RULES[name]).validate_python(fields, context=table)
