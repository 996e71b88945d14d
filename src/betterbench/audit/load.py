"""Reading tables with what they promise, from the packaged file or another of the same form."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from decimal import Decimal
from functools import cache
from importlib import resources
from pathlib import Path

from betterbench.audit.chance import Chance
from betterbench.audit.claims import Composition, Differences
from betterbench.audit.form import Form
from betterbench.audit.grids import Grid
from betterbench.audit.pooled import Pooled
from betterbench.audit.quotes import Quoted
from betterbench.audit.shape import Falling, Measured, Shares
from betterbench.audit.sums import RowSum, Total
from betterbench.audit.table import AuditedTable, AuditRule
from betterbench.errors import InvalidInputError, UnknownNameError

RULES: Mapping[str, Callable[[Form, AuditedTable], AuditRule]] = {
    "grid": Grid.read,
    "mean": RowSum.read_mean,
    "sum": RowSum.read_sum,
    "delta": RowSum.read_delta,
    "total": Total.read,
    "pooled": Pooled.read,
    "falling": Falling.read,
    "measured": Measured.read,
    "shares": Shares.read,
    "quoted": Quoted.read,
    "chance": Chance.read,
    "composition": Composition.read,
    "differences": Differences.read,
}
"""What a table can promise, by name."""

MOST_BYTES = 1_000_000
"""Largest file that is read: a thousand times the tables of one paper would not be checked within seconds."""

MOST_ROWS = 200
"""Most rows of a table, all pairs of which are compared."""

MOST_DIGITS = 15
"""Most digits before the point that a number of a table may have."""

MOST_DECIMALS = 6
"""Most decimals that a number of a table may have."""


@dataclass(frozen=True, slots=True)
class PaperSource:
    """A file of tables.

    Attributes:
        name: What the tables come from.
        tables: Each table with its rules.
    """

    name: str
    tables: tuple[tuple[AuditedTable, tuple[AuditRule, ...]], ...]

    @property
    def by_name(self) -> dict[str, AuditedTable]:
        """The tables by name."""
        return {table.name: table for table, _ in self.tables}


@cache
def paper_tables() -> PaperSource:
    """Return the tables of the benchmark paper with what they promise."""
    text = resources.files("betterbench.audit").joinpath("data/paper_tables.json").read_text(encoding="utf-8")
    return read_source(text, "paper_tables.json")


def load_tables(path: Path) -> PaperSource:
    """Return the tables of a file.

    Args:
        path: A JSON file of the form of the packaged one.

    Raises:
        InvalidInputError: If it cannot be read or a field is wrong.
        UnknownNameError: If a rule is unknown.
    """
    try:
        if path.stat().st_size > MOST_BYTES:
            raise InvalidInputError(str(path), f"it is larger than {MOST_BYTES} bytes", "Split the file")
        text = path.read_text(encoding="utf-8")
    except OSError as error:
        raise InvalidInputError(str(path), f"it cannot be read ({error.strerror})", "Give a JSON file") from error
    except UnicodeDecodeError as error:
        raise InvalidInputError(str(path), "it is no text in UTF-8", "Give a JSON file") from error
    return read_source(text, str(path))


def read_source(text: str, where: str) -> PaperSource:
    """Return the tables that a JSON text holds.

    Args:
        text: The text.
        where: What messages call it.

    Raises:
        InvalidInputError: If it is no JSON or a field is wrong.
        UnknownNameError: If a rule is unknown.
    """
    try:
        document = json.loads(
            text, parse_float=Decimal, parse_int=Decimal, parse_constant=_refuse, object_pairs_hook=_once
        )
    except (ValueError, RecursionError, ArithmeticError) as error:
        raise InvalidInputError(
            where, f"it is no JSON ({error})", "Mend it, or start from the packaged file"
        ) from error
    form = Form(where, document)
    source = form.text("source")
    forms = form.forms("tables")
    form.done()
    if not forms:
        raise form.wrong("tables", "the list is empty", "Write at least one table")
    tables = tuple(_table(f) for f in forms)
    names = [table.name for table, _ in tables]
    for name in names:
        if names.count(name) > 1:
            raise form.wrong("tables", f"{name!r} is there twice", "Give each table a name of its own")
    return PaperSource(source, tables)


def _refuse(constant: str) -> Decimal:
    msg = f"{constant} is no number"
    raise ValueError(msg)


def _once(pairs: list[tuple[str, object]]) -> dict[str, object]:
    fields = dict(pairs)
    if len(fields) < len(pairs):
        names = [name for name, _ in pairs]
        msg = f"{next(n for n in names if names.count(n) > 1)!r} is there twice in one object"
        raise ValueError(msg)
    return fields


def _table(form: Form) -> tuple[AuditedTable, tuple[AuditRule, ...]]:
    name, title = form.text("name"), form.text("title")
    columns = form.new_names("columns")
    rows = []
    for row, numbers in form.mapping("rows").items():
        if not isinstance(numbers, list) or len(numbers) != len(columns):
            raise form.wrong(f"rows.{row}", f"this is no list of {len(columns)} numbers", "Write one per column")
        rows.append((row, tuple(_number(form, row, c, n) for c, n in zip(columns, numbers, strict=True))))
    if not 1 <= len(rows) <= MOST_ROWS:
        raise form.wrong("rows", f"there are {len(rows)}", f"Write 1 to {MOST_ROWS} rows")
    table = AuditedTable(name, title, columns, tuple(rows))
    rules = tuple(_rule(f, table) for f in form.forms("rules"))
    form.done()
    return table, rules


def _number(form: Form, row: str, column: str, value: object) -> Decimal | None:
    where = f"rows.{row}[{column}]"
    if value is None:
        return None
    if not isinstance(value, Decimal) or not value.is_finite() or value.adjusted() >= MOST_DIGITS:
        raise form.wrong(where, f"{value!r} is no number to print", "Write a number such as 40.80, or null")
    exponent = value.as_tuple().exponent
    if not isinstance(exponent, int) or not -MOST_DECIMALS <= exponent <= 0:
        raise form.wrong(
            where, f"{value} is not written out", f"Write at most {MOST_DECIMALS} decimals and no exponent"
        )
    return value


def _rule(form: Form, table: AuditedTable) -> AuditRule:
    name = form.text("rule")
    if name not in RULES:
        raise UnknownNameError(f"rule in {form.where}", name, RULES)
    rule = RULES[name](form, table)
    form.done()
    return rule
