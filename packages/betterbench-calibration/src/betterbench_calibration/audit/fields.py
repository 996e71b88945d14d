"""Field types for a file of tables.

If the validation context is a table, names of rows and columns must exist in this table.
"""

from __future__ import annotations

from decimal import Decimal
from typing import Annotated

from pydantic import AfterValidator, BeforeValidator, ConfigDict, Field, Strict, ValidationInfo, with_config

from betterbench.errors import one_line
from betterbench_calibration.audit.table import AuditedTable

MOST = 1_000_000
"""Largest whole number in a file, for example for trials, choices or units."""

MOST_DIGITS = 15
"""Maximum number of digits before the decimal point of a number in a table."""

MOST_DECIMALS = 6
"""Maximum number of decimals of a number in a table."""

exact_fields = with_config(ConfigDict(extra="forbid"))
"""Class decorator that makes unknown fields an error."""


def _count(value: object) -> int:
    if not isinstance(value, Decimal) or value.adjusted() > 6 or value != int(value):
        raise ValueError(f"{value!r} is not a whole number from 1 to {MOST}")
    return int(value)


def _number(value: object) -> Decimal:
    if not isinstance(value, Decimal) or not value.is_finite() or value.adjusted() >= MOST_DIGITS:
        raise ValueError(f"{value!r} is not a number to print, such as 40.80")
    exponent = value.as_tuple().exponent
    if not isinstance(exponent, int) or not -MOST_DECIMALS <= exponent <= 0:
        raise ValueError(f"{value} must be written with at most {MOST_DECIMALS} decimals and no exponent")
    return value


def _row(name: str, info: ValidationInfo) -> str:
    return _known(name, info.context.row_names if isinstance(info.context, AuditedTable) else (name,))


def _column(name: str, info: ValidationInfo) -> str:
    return _known(name, info.context.columns if isinstance(info.context, AuditedTable) else (name,))


def _known(name: str, known: tuple[str, ...]) -> str:
    if name not in known:
        there = ", ".join(one_line(other, most=80) for other in known[:50])
        raise ValueError(f"{one_line(name, most=80)!r} does not exist; there are {there}")
    return name


NonEmptyText = Annotated[str, Field(min_length=1)]
WholeNumber = Annotated[int, BeforeValidator(_count), Field(ge=1, le=MOST)]
Flag = Annotated[bool, Strict()]
Number = Annotated[Decimal, BeforeValidator(_number)]
RowName = Annotated[str, AfterValidator(_row)]
ColumnName = Annotated[str, AfterValidator(_column)]
RowNames = Annotated[tuple[RowName, ...], Field(min_length=1)]
ColumnNames = Annotated[tuple[ColumnName, ...], Field(min_length=1)]
