"""The audit of printed tables: which numbers agree with each other, and what their trials can carry."""

from betterbench.audit.examine import Audit, TableAudit, audit_source, audit_table
from betterbench.audit.finding import Finding, Support, Verdict
from betterbench.audit.load import Source, load_tables, paper_tables, read_source
from betterbench.audit.table import Table

__all__ = [
    "Audit",
    "Finding",
    "Source",
    "Support",
    "Table",
    "TableAudit",
    "Verdict",
    "audit_source",
    "audit_table",
    "load_tables",
    "paper_tables",
    "read_source",
]
