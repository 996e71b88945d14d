"""Audit of published tables: consistency of the numbers, and statistical tests of claims."""

from betterbench_calibration.audit.examine import Audit, TableAudit, audit_source, audit_table
from betterbench_calibration.audit.finding import AuditFinding, ClaimSupport, Verdict
from betterbench_calibration.audit.load import PaperSource, load_tables, paper_tables, read_source
from betterbench_calibration.audit.table import AuditedTable

__all__ = [
    "Audit",
    "AuditFinding",
    "AuditedTable",
    "ClaimSupport",
    "PaperSource",
    "TableAudit",
    "Verdict",
    "audit_source",
    "audit_table",
    "load_tables",
    "paper_tables",
    "read_source",
]
