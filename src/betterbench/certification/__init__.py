"""Certification: evidence that a failure in a trial can only be caused by the policy.

The modules that contain only data (:mod:`~betterbench.certification.certificate`,
:mod:`~betterbench.certification.coverage`, :mod:`~betterbench.certification.support`) need no simulator.
:mod:`~betterbench.certification.examine` and :mod:`~betterbench.certification.runner` need one.
"""

from betterbench.certification.certificate import (
    CLAUSES,
    Certificate,
    CertificateVersions,
    Clause,
    Summary,
    TrialCertificate,
    summaries,
)
from betterbench.certification.coverage import Coverage, Gap, load_coverage, packaged_coverage

__all__ = [
    "CLAUSES",
    "Certificate",
    "CertificateVersions",
    "Clause",
    "Coverage",
    "Gap",
    "Summary",
    "TrialCertificate",
    "load_coverage",
    "packaged_coverage",
    "summaries",
]
